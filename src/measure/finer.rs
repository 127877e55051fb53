//! The finer equilibrium of a pose, against which whole errors are measured.
//!
//! In: a pose with its equilibrium on the scene's mesh. Out: static equilibrium of a St. Venant–Kirchhoff body with tet10 on the
//! finest mesh of the ladder ([`Truth::Finer`]), started from the coarser one, or led along arcs where that leads nowhere. Where
//! the ladder has two meshes, both are solved and extrapolated: the error of quadratic elements is taken to fall by the order 1.5
//! with their size, because stresses are singular at the edges of held parts, so that u = u₂ + (u₂ - u₁)/(2^1.5 - 1), and what is
//! added is the reference's own error.

use super::course::{Course, Step};
use super::fields::{difference, less, placed};
use super::norms::Norms;
use super::poses::{about_origins, largest_turn};
use super::request::{MeasureError, Request};
use super::variants::{Meshes, variant};
use crate::base::extent::bounding_box;
use crate::deform::{
    ControlPose, ControlPoses, EquilibriumResult, Statics, StaticsError, Truth, Wrench, se3,
};
use crate::fem::{TET4, nearest_turn};
use crate::solve::{Progress, Silent, Solver};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// The order in which the error of quadratic elements falls with their size.
const ORDER: f64 = 1.5;
/// Largest part that the last halving may change for an extrapolation to be worth anything.
const MOST: f64 = 0.25;

/// An equilibrium as it is kept.
#[derive(Serialize, Deserialize)]
pub struct EquilibriumOfPose {
    pub displacement: Vec<[f64; 3]>,
    /// Wrenches about where the origins rested.
    pub wrenches: Vec<Wrench>,
    pub energy: f64,
}

impl EquilibriumOfPose {
    pub fn field(&self) -> Vec<Vector3<f64>> {
        self.displacement.iter().map(|u| Vector3::from(*u)).collect()
    }
}

impl From<EquilibriumResult> for EquilibriumOfPose {
    fn from(found: EquilibriumResult) -> EquilibriumOfPose {
        let displacement = found.displacement.iter().map(|u| (*u).into()).collect();
        EquilibriumOfPose { displacement, wrenches: found.wrenches, energy: found.energy }
    }
}

/// Sizes of an equilibrium. In a pose that strains nothing, energy and forces are what rounding leaves of them.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    /// Norm of the displacement in L2, m.
    pub displacement: f64,
    /// Square root of the strain energy, J^½.
    pub energy: f64,
    /// Largest force on a control element, N, or its torque divided by the body's extent where that is larger: a pose
    /// that only bends has hardly any force.
    pub force: f64,
    /// `force` times the extent, N m.
    pub torque: f64,
}

/// Energies and forces smaller than this part of stiffness times displacement are rounding.
const ROUNDING: f64 = 1e-8;

impl Size {
    /// Sizes of an equilibrium with this field on the finest mesh, its wrenches about the places of the control elements, and its
    /// energy, J.
    pub fn new(norms: &Norms<'_>, field: &[Vector3<f64>], held: &[Wrench], energy: f64) -> Size {
        let most = |of: fn(&Wrench) -> Vector3<f64>| held.iter().map(|w| of(w).norm()).fold(0.0, f64::max);
        let displacement = norms.l2(field);
        let (low, high) = bounding_box(&norms.mesh.nodes);
        let extent = (high - low).amax();
        let stiffest = norms.stiffness.diagonal.iter().map(Matrix3::amax).fold(0.0, f64::max);
        let force =
            most(|w| w.force).max(most(|w| w.moment) / extent).max(ROUNDING * stiffest * displacement);
        let energy = energy.max(0.0).sqrt().max(ROUNDING * stiffest.sqrt() * displacement);
        Size { displacement, energy, force, torque: force * extent }
    }
}

/// The finer equilibrium of a pose.
pub struct FinerReference {
    /// Displacements of the nodes of the ladder's finest mesh, m.
    pub field: Vec<Vector3<f64>>,
    /// The wrench that holds each control element, about where the pose brings the origin that it has on the scene's mesh.
    pub held: Vec<Wrench>,
    pub size: Size,
    /// Its own error, relative, of shape and of wrench; `None` where only one mesh was solved.
    pub doubt: Option<[f64; 2]>,
}

/// The body on the meshes of the ladder with tet10, each made when it is first needed.
pub struct Finer<'a> {
    request: &'a Request<'a>,
    meshes: &'a Meshes,
    /// Origins of the control elements on the scene's mesh.
    about: &'a [Vector3<f64>],
    statics: Vec<Option<Statics>>,
    /// Whether a pose has such an equilibrium: until one has, they are solved however little time is left.
    is_any: bool,
}

impl<'a> Finer<'a> {
    pub fn new(request: &'a Request<'a>, meshes: &'a Meshes, about: &'a [Vector3<f64>]) -> Finer<'a> {
        let statics = meshes.ladder.levels.iter().map(|_| None).collect();
        Finer { request, meshes, about, statics, is_any: false }
    }

    /// The finer equilibrium of pose number `pose`, next to displacements of the nodes of the scene's mesh; the inner error says why there is
    /// none.
    pub fn solve(
        &mut self,
        norms: &Norms<'_>,
        pose: usize,
        coarse: &[Vector3<f64>],
        course: &Course<'_>,
    ) -> Result<Result<FinerReference, String>, MeasureError> {
        let (name, poses) = &self.request.poses[pose];
        let key = Step::finer(pose, name);
        if self.is_any && !course.affords(&key) {
            return Ok(Err("--quick left no time for its finer equilibrium".into()));
        }
        let top = self.statics.len() - 1;
        let found = course.step_as_json(&key, |progress| {
            let mut guess = coarse.to_vec();
            let mut found: Vec<EquilibriumOfPose> = Vec::new();
            for level in 0..=top {
                match self.at(level, &guess, poses, progress)? {
                    Ok(settled) => {
                        guess = settled.field();
                        found.push(settled);
                        // Only the last two are compared.
                        found.drain(..found.len().saturating_sub(2));
                    }
                    Err(why) => return Ok(Err(why)),
                }
                if level < top {
                    guess = self.meshes.ladder.climb(level, &guess);
                }
            }
            Ok(Ok(found))
        })?;
        let found = found.and_then(|found| self.reference(norms, &found));
        self.is_any |= found.is_ok();
        Ok(found)
    }

    fn at(
        &mut self,
        level: usize,
        guess: &[Vector3<f64>],
        poses: &ControlPoses,
        progress: &dyn Progress,
    ) -> Result<Result<EquilibriumOfPose, String>, MeasureError> {
        let mesh = &self.meshes.ladder.levels[level];
        let statics = match &mut self.statics[level] {
            Some(statics) => statics,
            none => {
                let scene = variant(self.request, level as u32, &TET4, Solver::default());
                match Truth::Finer.statics(&scene, self.request.body, &Silent) {
                    Ok(made) => none.insert(made),
                    Err(StaticsError::Green(why)) => return Ok(Err(format!("tet10: {why}"))),
                    Err(error) => return Err(error.into()),
                }
            }
        };
        let origins: Vec<Vector3<f64>> = statics.controls.iter().map(|control| control.origin).collect();
        let guess = self.meshes.ladder.with_mids(level, guess);
        let own = about_origins(poses, self.about, &origins);
        let found = match statics.solve_near(&guess, &own)? {
            Some(settled) => Ok(settled),
            None => along_arcs(statics, &origins, &own, progress),
        };
        Ok(match found {
            Ok(settled) if !settled.inverted.is_empty() => Err(format!(
                "{} of {} tetrahedra with tet10 turn inside out",
                settled.inverted.len(),
                mesh.tets.len()
            )),
            Ok(settled) => {
                let held = placed(&settled.wrenches, &origins, self.about, poses);
                Ok(EquilibriumOfPose { wrenches: held, ..settled.into() })
            }
            Err(StaticsError::Stopped { share, .. }) => {
                Err(format!("tet10 has no equilibrium beyond {:.0} % of the way", 100.0 * share))
            }
            Err(error) => return Err(error.into()),
        })
    }

    /// The reference of one mesh, or extrapolated from two.
    fn reference(&self, norms: &Norms<'_>, found: &[EquilibriumOfPose]) -> Result<FinerReference, String> {
        let top = self.statics.len() - 1;
        let Some((best, coarser)) = found.split_last() else { return Err("nothing was solved".into()) };
        let (mut field, mut held) = (best.field(), best.wrenches.clone());
        let Some(coarser) = coarser.last() else {
            let size = Size::new(norms, &field, &held, best.energy);
            return Ok(FinerReference { field, held, size, doubt: None });
        };
        let part = 1.0 / (ORDER.exp2() - 1.0);
        let change = difference(&field, &self.meshes.ladder.raise(top - 1, &coarser.field()));
        let wrenches = less(&held, &coarser.wrenches);
        field.iter_mut().zip(&change).for_each(|(u, change)| *u += change * part);
        for (wrench, change) in held.iter_mut().zip(&wrenches) {
            wrench.force += change.force * part;
            wrench.moment += change.moment * part;
        }
        let energy = best.energy + part * (best.energy - coarser.energy);
        let size = Size::new(norms, &field, &held, energy);
        let off = |w: &Wrench| (w.force.norm() / size.force).max(w.moment.norm() / size.torque);
        let wrench = wrenches.iter().map(off).fold(0.0, f64::max);
        let changed = [norms.l2(&change) / size.displacement, wrench];
        if changed.iter().any(|changed| *changed > MOST) {
            let [shape, wrench] = changed.map(|changed| 100.0 * changed);
            return Err(format!(
                "its two finest meshes differ by {shape:.0} % in shape and {wrench:.0} % in force and torque"
            ));
        }
        Ok(FinerReference { field, held, size, doubt: Some(changed.map(|changed| part * changed)) })
    }
}

/// Largest turn between two poses on the way along arcs, rad.
const ARC: f64 = std::f64::consts::PI / 12.0;

/// Leads a body to poses about `origins` along arcs: every control element goes as the end of a rod of constant curvature and twist
/// from the first one does, which keeps the body's length, where a screw about one axis would press it together on the way.
pub fn along_arcs(
    statics: &mut Statics,
    origins: &[Vector3<f64>],
    poses: &ControlPoses,
    progress: &dyn Progress,
) -> Result<EquilibriumResult, StaticsError> {
    let steps = (largest_turn(poses) / ARC).ceil().max(1.0) as usize;
    for step in 1..steps {
        statics.solve(&on_arcs(origins, poses, step as f64 / steps as f64), progress)?;
    }
    statics.solve(poses, progress)
}

/// The poses at a share of the way along arcs. Against the first control element, another with the turn ω and its origin at w + t has
/// v = V(ω)⁻¹ (w + t), V the integral of the turn along the rod; at share s it has sω and V(sω) (w + s (v - w)).
fn on_arcs(origins: &[Vector3<f64>], poses: &ControlPoses, share: f64) -> ControlPoses {
    let turns: Vec<_> = poses.iter().map(|pose| nearest_turn(&pose.matrix)).collect();
    let Some((base, base_turn)) = poses.first().zip(turns.first()) else { return Vec::new() };
    let start = UnitQuaternion::from_scaled_axis(base_turn.scaled_axis() * share);
    let place = |e: usize| {
        let way = origins[e] - origins[0];
        let turn = (base_turn.inverse() * turns[e]).scaled_axis();
        let moved = base_turn.inverse() * (way + poses[e].translation - base.translation);
        let along = way + (se3::inverse_slide_matrix(&turn) * moved - way) * share;
        let end = start * (se3::slide_matrix(&(turn * share)) * along);
        // What stretches the control element itself goes straight.
        let stretch = turns[e].inverse().to_rotation_matrix().matrix() * poses[e].matrix;
        let stretch = Matrix3::identity() + (stretch - Matrix3::identity()) * share;
        let turned = (start * UnitQuaternion::from_scaled_axis(turn * share)).to_rotation_matrix();
        ControlPose { translation: base.translation * share + end - way, matrix: turned.matrix() * stretch }
    };
    (0..poses.len()).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::{Motion, Moved};

    /// The way to an arc leads over arcs, and ends where it should, wherever the first control element goes.
    #[test]
    fn the_way_to_a_bend_is_a_bend() {
        let origins = [Vector3::new(0.1, 0.2, 0.3), Vector3::new(1.1, 0.5, 0.3)];
        let moved = Moved::new(&origins, 1).unwrap();
        let bent = moved.poses(Motion::Bend(60.0));
        for (share, known) in [(0.25, moved.poses(Motion::Bend(15.0))), (1.0, bent.clone())] {
            for (own, known) in on_arcs(&origins, &bent, share).iter().zip(&known) {
                let off =
                    (own.translation - known.translation).amax().max((own.matrix - known.matrix).amax());
                assert!(off < 1e-12, "{share}: {own:?} {known:?}");
            }
        }
        let turned = |pose: &ControlPose, origin: &Vector3<f64>| {
            let turn = *nalgebra::Rotation3::new(Vector3::new(0.4, -0.7, 0.2)).matrix();
            let place = turn * (origin + pose.translation) - origin;
            ControlPose { translation: place, matrix: turn * pose.matrix }
        };
        let whole: ControlPoses =
            bent.iter().zip(&origins).map(|(pose, origin)| turned(pose, origin)).collect();
        for (own, known) in on_arcs(&origins, &whole, 1.0).iter().zip(&whole) {
            assert!((own.translation - known.translation).amax() < 1e-12);
            assert!((own.matrix - known.matrix).amax() < 1e-12);
        }
    }
}
