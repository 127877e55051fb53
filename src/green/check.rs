//! What must be right before anything is factorised: a Cholesky factorization that succeeds proves nothing, it
//! passes floating pieces held at two points and answers with nonsense.

use super::control::rank;
use super::{ControlElement, GreenError};
use crate::mesh::{TetMesh, quality};
use crate::scene::Scene;
use nalgebra::Vector3;

/// Refuses control elements that share nodes, and face-connected pieces of the body that no control element holds
/// at three points or more off one line.
pub fn check_support(
    scene: &Scene,
    body: &str,
    mesh: &TetMesh,
    controls: &[ControlElement],
) -> Result<(), GreenError> {
    let owner = owners(scene, body, mesh, controls)?;
    let components = quality::components(mesh);
    for (component, nodes) in components.nodes.iter().enumerate() {
        let held: Vec<u32> = nodes.iter().copied().filter(|&node| owner[node as usize].is_some()).collect();
        let (centre, all) = offsets_from_centroid(mesh, nodes);
        let (_, offsets) = offsets_from_centroid(mesh, &held);
        let size = all.iter().map(Vector3::norm).fold(0.0, f64::max);
        if rank(&offsets, 1e-6 * size) >= 2 {
            continue;
        }
        let tags: Vec<String> =
            nodes.iter().take(5).map(|&node| mesh.tags[node as usize].to_string()).collect();
        let how = match held.len() {
            0 => "is held by no control element".to_owned(),
            1 => "is held at a single node, about which it can turn freely".to_owned(),
            count => {
                format!("is held at {count} nodes on one line, about which it can turn freely")
            }
        };
        let message = format!(
            "piece {} of {} of the mesh ({} nodes, tags {}…, around ({:.4}, {:.4}, {:.4}) m) {how}; hold it with a \
             control element at three nodes or more that are not on one line, join it to the rest by shared faces, \
             or remove it from the mesh",
            component + 1,
            components.nodes.len(),
            nodes.len(),
            tags.join(", "),
            centre.x,
            centre.y,
            centre.z
        );
        return Err(scene.invalid(&format!("body.{body}"), message).into());
    }
    Ok(())
}

fn offsets_from_centroid(mesh: &TetMesh, nodes: &[u32]) -> (Vector3<f64>, Vec<Vector3<f64>>) {
    let centre = quality::centroid(mesh, nodes).unwrap_or_default();
    (centre, nodes.iter().map(|&node| mesh.nodes[node as usize] - centre).collect())
}

/// The control element of every node, if any.
fn owners(
    scene: &Scene,
    body: &str,
    mesh: &TetMesh,
    controls: &[ControlElement],
) -> Result<Vec<Option<usize>>, GreenError> {
    let mut owner: Vec<Option<usize>> = vec![None; mesh.nodes.len()];
    for (index, control) in controls.iter().enumerate() {
        for &node in &control.nodes {
            if let Some(other) = owner[node as usize].replace(index) {
                let other = &controls[other];
                let shared = control.nodes.iter().filter(|n| other.nodes.binary_search(n).is_ok()).count();
                let message = format!(
                    "overlaps control {}: {shared} nodes belong to both (the first has tag {}); each node can be \
                     prescribed by one control element only, so make the selections disjoint",
                    other.name, mesh.tags[node as usize]
                );
                return Err(scene.invalid(&format!("body.{body}.control.{}", control.name), message).into());
            }
        }
    }
    Ok(owner)
}
