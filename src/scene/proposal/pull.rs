//! The poses that answer how much force it takes to move a part of the body by a length.
//!
//! In: a proposed scene with its mesh. Out: the text of a pose file, in which each control element that can be grabbed is pulled away from what is
//! fixed, pushed towards it, and moved across.

use super::super::write::quoted_key;
use super::super::{Grab, Scene, SceneError};
use crate::base::extent::bounding_box;
use crate::base::text::quoted;
use crate::mesh::diagnostics::digits;
use crate::mesh::{TetMesh, quality};
use nalgebra::Vector3;
use std::path::Path;

/// A direction as near to an axis of the mesh as this cosine is taken to be it.
const ALIGNED: f64 = 0.95;
/// An axis whose cosine with the pull is smaller than this leads across.
const ACROSS: f64 = 0.7;
/// Parts of the body's length: what is proposed to pull by, and what is much.
const USUAL: f64 = 0.03;
const MUCH: f64 = 0.25;

/// The text of a pose file by `by_m`, m, for a scene of one body with this mesh.
pub fn poses(scene: &Scene, mesh: &TetMesh, by_m: f64) -> Result<String, SceneError> {
    let by = length(by_m);
    let mut text = format!(
        "# How much force does {by} take? `{}` prints it.\n\
         # Lengths are in metres, along the axes of the mesh.\n",
        command(&scene.path)
    );
    let fixed = middle(scene, mesh, Grab::Fixed, None)?;
    for (name, control) in scene.body.values().flat_map(|body| &body.control) {
        if control.grab == Grab::Fixed {
            continue;
        }
        let away = middle(scene, mesh, Grab::Dragger, Some(name))? - fixed;
        let pull = aligned(away.try_normalize(0.0).unwrap_or(Vector3::z()));
        let mut moved = vec![(format!("pull {name} {by}"), pull), (format!("push {name} {by}"), -pull)];
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let across = Vector3::ith(axis, 1.0);
            if across.dot(&pull).abs() < ACROSS {
                moved.push((format!("move {name} {by} along {letter}"), across));
            }
        }
        for (pose, way) in moved {
            // Adding 0 makes no difference but to -0.
            let [x, y, z] = <[f64; 3]>::from(way).map(|part| rounded(part * by_m) + 0.0);
            let key = quoted_key(name);
            text += &format!(
                "\n[[pose]]\nname = {pose:?}\ncontrol.{key} = {{ translation = [{x:?}, {y:?}, {z:?}] }}\n"
            );
        }
    }
    Ok(text)
}

/// The command that answers the question of the pose file beside the scene at `scene_path`.
pub fn command(scene_path: &Path) -> String {
    let out = Path::new("out").join(scene_path.file_stem().unwrap_or_default());
    let [scene, poses, out] =
        [scene_path, &poses_path(scene_path), &out].map(|path| quoted(&path.display().to_string()));
    format!("greenstage deform {scene} --poses {poses} -o {out}")
}

/// A length for a first question, m: a round number, some per cent of the body.
pub fn usual_m(mesh: &TetMesh) -> f64 {
    let wanted = USUAL * extent(mesh);
    let power = 10_f64.powf(wanted.log10().floor());
    let round = [5.0, 2.0, 1.0].into_iter().find(|round| round * power <= wanted).unwrap_or(1.0);
    rounded(round * power)
}

/// Whether a pull is so long against the body that it may tear it.
pub fn is_much(mesh: &TetMesh, by_m: f64) -> bool {
    by_m > MUCH * extent(mesh)
}

/// Middle of the nodes of the control elements of this kind, or of the one of this name.
fn middle(
    scene: &Scene,
    mesh: &TetMesh,
    grab: Grab,
    named: Option<&String>,
) -> Result<Vector3<f64>, SceneError> {
    let mut nodes = Vec::new();
    for (name, control) in scene.body.values().flat_map(|body| &body.control) {
        if control.grab == grab && named.is_none_or(|named| named == name) {
            let key = format!("control.{name}.nodes");
            let selected = control.nodes.select(mesh);
            nodes.extend(selected.map_err(|why| scene.invalid(&key, why))?);
        }
    }
    Ok(quality::centroid(mesh, &nodes).unwrap_or_default())
}

/// Path of the pose file next to a scene at this path: `part.poses.toml`.
pub fn poses_path(scene_path: &Path) -> std::path::PathBuf {
    scene_path.with_extension("poses.toml")
}

/// `5 mm`, as it is typed: in millimetres, or in metres from one on.
pub fn length(m: f64) -> String {
    let (number, unit) = if m < 1.0 { (digits(m * 1e3), "mm") } else { (digits(m), "m") };
    let is_plain = number.contains('.') && !number.contains('e');
    let number = if is_plain { number.trim_end_matches('0').trim_end_matches('.') } else { &number };
    format!("{number} {unit}")
}

/// The longest side of its box, m.
pub fn extent(mesh: &TetMesh) -> f64 {
    let (low, high) = bounding_box(&mesh.nodes);
    (high - low).amax()
}

fn aligned(way: Vector3<f64>) -> Vector3<f64> {
    let axis = Vector3::ith(way.iamax(), way[way.iamax()].signum());
    if axis.dot(&way) > ALIGNED { axis } else { way }
}

/// Rounds to a nanometre, and below 0.1 mm to five digits.
fn rounded(m: f64) -> f64 {
    let digits = if m.abs() < 1e-4 { format!("{m:.4e}") } else { format!("{m:.9}") };
    digits.parse().unwrap_or(m)
}
