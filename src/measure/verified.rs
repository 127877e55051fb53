//! A chosen setting, measured itself: its own .green file in poses by which it was not chosen, against a finer reference.
//!
//! In: a scene with the setting, and poses. Out: [`Verified`], the worst errors and what they are against. The table from which
//! settings are chosen adds parts of errors, each found apart from the others; this is the whole at once.

use super::data::Measurement;
use super::fields::difference;
use super::fields::placed;
use super::norms::relative;
use super::poses::{about_origins, on_the_way};
use crate::base::extent::bounding_box;
use crate::base::failure::Failure;
use crate::deform::{
    ControlPoses, Deformer, Deviation, PoseResult, Statics, StaticsError, Truth, Wrench, in_session,
};
use crate::fem::TET4;
use crate::green::{self, Precomputed};
use crate::prepare::Resolved;
use crate::scene::Scene;
use crate::solve::{Silent, Solver};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Unknowns of the largest finer reference, which is solved some dozen times for each pose.
const LARGEST: f64 = 60_000.0;
/// Nodes of the finer reference over those of the body, at most.
const GROWN: f64 = 8.0;

/// The worst errors of a setting.
#[derive(Clone, Debug, PartialEq)]
pub struct Verified {
    pub shape: f64,
    pub held: Option<f64>,
    /// Poses that were measured.
    pub count: usize,
    /// The reference, for a sentence.
    pub against: String,
}

/// Measures the setting of the body `name` in these poses. `None` where none of them has an equilibrium, or the element none.
pub fn verify(
    scene: &Resolved,
    name: &str,
    row: &Measurement,
    poses: &[(String, ControlPoses)],
) -> Result<Option<Verified>, Failure> {
    let mut setting = SettingInSession::new(scene, name)?;
    let Some((mut statics, added, against)) = reference(scene, name, row)? else { return Ok(None) };
    let places = setting.places(&statics.mesh.nodes);
    let others: Vec<Vector3<f64>> = statics.controls.iter().map(|control| control.origin).collect();
    let mut found = Verified { shape: 0.0, held: None, count: 0, against };
    for (_, pose) in poses {
        let settled = match statics.solve(&about_origins(pose, &setting.about, &others), &Silent) {
            Ok(settled) if settled.inverted.is_empty() => settled,
            Ok(_) | Err(StaticsError::Stopped { .. }) => continue,
            Err(error) => return Err(Failure::work(error)),
        };
        setting.take(pose);
        let held = placed(&settled.wrenches, &others, &setting.about, pose);
        let [shape, held] = setting.errors(pose, &places, &settled.displacement, held);
        found.count += 1;
        found.shape = found.shape.max(shape.unwrap_or(0.0).hypot(added[0]));
        if let Some(held) = held {
            found.held = Some(found.held.unwrap_or(0.0).max(held.hypot(added[1])));
        }
    }
    Ok((found.count > 0).then_some(found))
}

/// A setting as a session has it, from a .green file of its own.
pub struct SettingInSession {
    pub deformer: Deformer,
    /// Origins of the control elements on the scene's mesh, about which poses are meant, and those of the deformer.
    about: Vec<Vector3<f64>>,
    own: Vec<Vector3<f64>>,
    /// Largest extent of the body, m.
    extent: f64,
}

impl SettingInSession {
    pub fn new(scene: &Resolved, name: &str) -> Result<SettingInSession, Failure> {
        let model = scene.bodies[name].model;
        let made = green::precompute(scene, name, &model.with_energy(), &Silent)?;
        SettingInSession::of_precomputed(scene, name, &made)
    }

    /// The setting of a body that was precomputed with all that its model and its energy need.
    pub fn of_precomputed(
        scene: &Resolved,
        name: &str,
        made: &Precomputed,
    ) -> Result<SettingInSession, Failure> {
        let mut plain = Scene::clone(scene);
        let body = &mut plain.body[name];
        (body.element, body.solver, body.refine) = (&TET4, Solver::default(), 0);
        let prepared = green::prepare(&plain, name)?;
        let about = prepared.controls.iter().map(|control| control.origin).collect();
        let (low, high) = bounding_box(&prepared.mesh.nodes);
        let model = scene.bodies[name].model;
        let deformer = in_session(made, model)?.map_err(|why| Failure::work(anyhow::anyhow!(why)))?;
        let centre = deformer.centre;
        let own = deformer.controls.iter().map(|control| centre + control.origin).collect();
        Ok(SettingInSession { deformer, about, own, extent: (high - low).amax() })
    }

    /// The deformer's surface nodes, and those of `nodes` at the same places.
    pub fn places(&self, nodes: &[Vector3<f64>]) -> Vec<(usize, usize)> {
        matching(nodes, &self.deformer, self.extent)
    }

    /// Brings the body from rest to a pose, as a hand does.
    pub fn take(&mut self, pose: &ControlPoses) {
        self.deformer.forget();
        for between in on_the_way(pose) {
            self.deformer.take(&about_origins(&between, &self.about, &self.own));
        }
        self.deformer.evaluate(&about_origins(pose, &self.about, &self.own));
    }

    /// The model's wrenches about where the pose brings the scene's origins; the same points have other origins on other meshes.
    pub fn held(&self, pose: &ControlPoses) -> Option<Vec<Wrench>> {
        Some(placed(&self.deformer.wrenches()?.0, &self.own, &self.about, pose))
    }

    /// Errors of shape and of force and torque in the pose that was taken, against an equilibrium: displacements of a mesh's nodes
    /// and wrenches. Of shape `None` where no node has a place on that mesh.
    pub fn errors(
        &self,
        pose: &ControlPoses,
        places: &[(usize, usize)],
        displacement: &[Vector3<f64>],
        wrenches: Vec<Wrench>,
    ) -> [Option<f64>; 2] {
        let surface = places.iter().map(|&(i, _)| self.deformer.displacement(i)).collect();
        let model = PoseResult { wrenches: self.held(pose), energy: 0.0, surface };
        let surface = places.iter().map(|&(_, node)| displacement[node]).collect();
        let truth = PoseResult { wrenches: Some(wrenches), energy: 0.0, surface };
        let off = Deviation::new(&model, &truth, self.extent);
        let shape = relative(&difference(&model.surface, &truth.surface), &truth.surface);
        let held = off.force.zip(off.torque).map(|(force, torque)| force.max(torque));
        [(!places.is_empty()).then_some(shape), held]
    }
}

/// A reference, what has to be added to errors against it (of shape and of force), and its name.
fn reference(
    scene: &Scene,
    name: &str,
    row: &Measurement,
) -> Result<Option<(Statics, [f64; 2], String)>, Failure> {
    let is_linear = scene.body[name].element.order == 1;
    let is_finer = 3.0 * GROWN * row.mesh_nodes as f64 <= LARGEST;
    let truth = if is_finer { Truth::Finer } else { Truth::SameMesh };
    let statics = match truth.statics(scene, name, &Silent) {
        Ok(statics) => statics,
        Err(StaticsError::Green(_)) => return Ok(None),
        Err(error) => return Err(Failure::work(error)),
    };
    if is_finer {
        let mesh = if is_linear { "the same mesh" } else { "the mesh refined once more" };
        return Ok(Some((statics, [0.0; 2], format!("static equilibrium with tet10 on {mesh}"))));
    }
    // What the mesh adds is known from the table alone.
    let Some((shape, held)) = row.error.discretisation.zip(row.error.mesh_held) else { return Ok(None) };
    let against = "static equilibrium on the same mesh, with the error of the mesh from the table";
    Ok(Some((statics, [shape.worst, held.worst], against.into())))
}

/// The deformer's surface nodes and those of `nodes` at the same places.
fn matching(nodes: &[Vector3<f64>], deformer: &Deformer, extent: f64) -> Vec<(usize, usize)> {
    // Places in f32 differ from those in f64 by less than the cell of this grid, which is far smaller than an element.
    let cell = 1e-5 * extent.max(f64::MIN_POSITIVE);
    let key = |x: &Vector3<f64>| <[i64; 3]>::from(x.map(|x| (x / cell).round() as i64));
    let by_place: BTreeMap<[i64; 3], usize> =
        nodes.iter().enumerate().map(|(node, x)| (key(x), node)).collect();
    let near = |x: &Vector3<f64>| {
        let [a, b, c] = key(x);
        let around =
            (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [a + i, b + j, c + k])));
        around.into_iter().find_map(|key| by_place.get(&key).copied())
    };
    let rest = deformer.rest().iter().enumerate();
    let place = |x: &[f32; 3]| deformer.centre + Vector3::from(*x).cast::<f64>();
    rest.filter_map(|(i, x)| Some((i, near(&place(x))?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::poses::random;
    use crate::measure::{Errors, Spread};
    use std::path::Path;

    /// A bar far from the mesh's origin, in a separate mesh file.
    fn bar(folder: &Path, keys: &str) -> Resolved {
        let mesh =
            crate::mesh::block(&crate::mesh::Block { size: [1.0, 0.2, 0.2], cells: [3, 1, 1] }).unwrap();
        let mut text = String::from("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n");
        text += &format!("{}\n", mesh.nodes.len());
        for (i, x) in mesh.nodes.iter().enumerate() {
            text += &format!("{} {} {} {}\n", i + 1, x.x + 3.0, x.y - 2.0, x.z + 5.0);
        }
        text += &format!("$EndNodes\n$Elements\n{}\n", mesh.tets.len());
        for (i, tet) in mesh.tets.iter().enumerate() {
            let [a, b, c, d] = tet.map(|node| node + 1);
            text += &format!("{} 4 2 0 1 {a} {b} {c} {d}\n", i + 1);
        }
        std::fs::write(folder.join("bar.msh"), text + "$EndElements\n").unwrap();
        let text = format!(
            "[body.b]\nmesh = \"bar.msh\"\nmaterial = {{ young = 1.0e6, poisson = 0.3 }}\n{keys}\n[body.b.control]\n\
             low = {{ nodes = {{ box = {{ min = [2.4, -3.0, 4.0], max = [2.6, 0.0, 6.0] }} }}, grab = \"fixed\" }}\n\
             high = {{ nodes = {{ box = {{ min = [3.4, -3.0, 4.0], max = [3.6, 0.0, 6.0] }} }}, grab = \"dragger\" }}\n"
        );
        Resolved::parse(&text, &folder.join("bar.toml")).unwrap()
    }

    fn verified(keys: &str, angle: f64) -> Verified {
        let folder = tempfile::tempdir().unwrap();
        let scene = bar(folder.path(), keys);
        // Too large for a finer reference, and no error of the mesh: what is left is the model's.
        let exact = Some(Spread::default());
        let error = Errors { discretisation: exact, mesh_held: exact, ..Errors::default() };
        let row = Measurement { mesh_nodes: 1_000_000, error, ..Measurement::default() };
        let origins = [Vector3::new(2.5, -2.0, 5.0), Vector3::new(3.5, -2.0, 5.0)];
        verify(&scene, "b", &row, &random(&origins, &[angle], 0.0, 1)).unwrap().unwrap()
    }

    /// Poses near rest have the linear theory's answer; a large turn has not, and its error is found, wherever the body rests.
    #[test]
    fn an_exact_setting_has_no_error_and_a_wrong_one_is_found() {
        let exact = verified("model = \"linear\"", 1e-4);
        // The force of `linear` errs in the first power of the turn, by some tens of per cent at one degree.
        assert!(exact.shape < 1e-3 && exact.held.unwrap() < 0.01, "{exact:?}");
        let turned = verified("model = \"reduced\"", 0.3);
        assert!(turned.shape < 0.01 && turned.held.unwrap() < 0.05, "{turned:?}");
        let wrong = verified("model = \"linear\"", 1.0);
        assert!(wrong.shape > 0.1 && wrong.held.unwrap() > 0.3, "{wrong:?}");
    }
}
