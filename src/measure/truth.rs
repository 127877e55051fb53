//! The true equilibrium of a body in a pose, by which errors that were shown are judged: with tet10 on its mesh refined once.
//!
//! In: a body of a scene and poses. Out: the equilibrium on the finest of two meshes. That on the coarser one is found from rest,
//! whatever other equilibria a report started from, and leads to that on the finer one. Then the errors of a report's rows against it
//! ([`judged`]).

use super::data::Measurement;
use super::fields::{difference, placed, stored};
use super::finer::{EquilibriumOfPose, FinerReference, Size, along_arcs};
use super::norms::{MeshLadder, relative};
use super::pose_errors::Compared;
use super::poses::about_origins;
use super::reference::References;
use super::request::{MeasureError, Request};
use super::variants::{Candidate, Meshes};
use crate::deform::{ControlPoses, EquilibriumResult, Statics, StaticsError, Truth};
use crate::fem::TET4;
use crate::green;
use crate::mesh::TetMesh;
use crate::mesh::quadratic::straight;
use crate::scene::{Scene, Storage};
use crate::solve::{Silent, Solver};
use nalgebra::Vector3;

/// Largest part by which the equilibria of both meshes may differ to count as one.
const SAME: f64 = 0.5;

/// A body that was read from a mesh file, with tet10 on its own mesh and on that mesh refined once.
pub struct RefinedBody {
    ladder: MeshLadder,
    statics: [Statics; 2],
    /// Origins of the control elements on the scene's mesh.
    about: Vec<Vector3<f64>>,
}

impl RefinedBody {
    pub fn new(scene: &Scene, name: &str) -> Result<RefinedBody, MeasureError> {
        let refined = |refine: u32| {
            let mut scene = scene.clone();
            let body = &mut scene.body[name];
            (body.element, body.solver) = (&TET4, Solver::default());
            body.refine += refine;
            scene
        };
        let [own, fine] = [refined(0), refined(1)];
        let mesh =
            |scene: &Scene| Ok::<TetMesh, MeasureError>(scene.load_mesh(name, &scene.body[name])?.mesh);
        let ladder = MeshLadder::new(vec![mesh(&own)?, mesh(&fine)?], &straight);
        let about = green::prepare(&own, name)?.controls.iter().map(|control| control.origin).collect();
        let statics =
            [Truth::Finer.statics(&own, name, &Silent)?, Truth::Finer.statics(&fine, name, &Silent)?];
        Ok(RefinedBody { ladder, statics, about })
    }

    /// The mesh whose nodes the equilibria have.
    pub fn mesh(&self) -> &TetMesh {
        self.ladder.top()
    }

    /// Origins of the control elements on the scene's mesh, about which poses are meant.
    pub fn origins(&self) -> &[Vector3<f64>] {
        &self.about
    }

    /// The equilibrium in a pose, its wrenches about where the pose brings the scene's origins; the inner error says why there is
    /// none.
    pub fn equilibrium(
        &mut self,
        poses: &ControlPoses,
    ) -> Result<Result<EquilibriumOfPose, String>, MeasureError> {
        let RefinedBody { ladder, statics: [coarse, fine], about } = self;
        let of = |statics: &Statics| -> Vec<Vector3<f64>> {
            statics.controls.iter().map(|control| control.origin).collect()
        };
        let (from, to) = (of(coarse), of(fine));
        let own = about_origins(poses, about, &from);
        let first = match coarse.solve(&own, &Silent) {
            Err(StaticsError::Stopped { .. }) => along_arcs(coarse, &from, &own, &Silent),
            found => found,
        };
        let first = match first {
            Ok(found) if found.inverted.is_empty() => found,
            Ok(_) => return Ok(Err("tet10 turns tetrahedra inside out".into())),
            Err(error @ StaticsError::Stopped { .. }) => return Ok(Err(error.to_string())),
            Err(error) => return Err(error.into()),
        };
        let guess = ladder.climb(0, &first.displacement);
        let Some(found) = fine.solve_near(&guess, &about_origins(poses, about, &to))? else {
            return Ok(Err("tet10 on the refined mesh has no equilibrium near that on the mesh".into()));
        };
        let change = relative(&difference(&found.displacement, &guess), &guess);
        if change > SAME {
            return Ok(Err(format!("both meshes differ by {:.0} %", 100.0 * change)));
        }
        let EquilibriumResult { wrenches, .. } = &found;
        let wrenches = placed(wrenches, &to, about, poses);
        Ok(Ok(EquilibriumOfPose { wrenches, ..found.into() }))
    }
}

/// The true errors of a row, relative: of shape and of wrench; `None` where they could not be found.
pub type TrueErrors = Option<[f64; 2]>;

/// The true errors of shape and of wrench of each row, in the worst of the poses for which it speaks, relative as the row's are.
/// `None` where one of those poses has no true equilibrium; `truths` has one for each pose of the request.
pub fn judged(
    request: &Request<'_>,
    rows: &[Measurement],
    (meshes, candidates, references): (&Meshes, &[Candidate], &References<'_>),
    truths: &[Option<EquilibriumOfPose>],
) -> Vec<TrueErrors> {
    let norms = &references.norms;
    let truth = |name: &str| {
        let pose = request.poses.iter().position(|(own, _)| own == name)?;
        let truth = truths.get(pose)?.as_ref()?;
        let (field, held) = (truth.field(), truth.wrenches.clone());
        if field.len() != norms.mesh.nodes.len() {
            return None;
        }
        let size = Size::new(norms, &field, &held, truth.energy);
        Some(FinerReference { field, held, size, doubt: None })
    };
    let poses: Option<Vec<_>> = references.judged().map(|pose| Some((pose, truth(&pose.name)?))).collect();
    let judged = |row: &Measurement| {
        let poses = poses.as_ref()?;
        let storage = Storage::named(&row.setting.storage)?;
        let candidate = candidates.iter().find(|candidate| candidate.has(&row.setting))?;
        let of = Compared { meshes, candidates, candidate, references };
        let rounded = stored(&candidate.solution, storage);
        let mut worst = [0.0_f64; 2];
        for (pose, truth) in poses {
            let found = of.against(row.setting.model, &rounded, pose, truth)?;
            worst = [0, 1].map(|i| worst[i].max(found[i]));
        }
        Some(worst)
    };
    rows.iter().map(judged).collect()
}
