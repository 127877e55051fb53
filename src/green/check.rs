//! What must be right before anything is factorised: a Cholesky factorization that succeeds proves nothing. It passes
//! flat and swapped tetrahedra, pieces held at two points and bodies cracked open, and answers with nonsense.

use super::ControlElement;
use super::control::rank;
use crate::fem::Lame;
use crate::mesh::trouble::{self, Severity, digits, place};
use crate::mesh::{TetMesh, quality};
use crate::scene::{Body, Element, Material};
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// One thing found without solving.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Finding {
    pub severity: Severity,
    /// The scene's key it belongs to.
    pub entity: String,
    /// What, where, and what to do.
    pub message: String,
}

impl Finding {
    pub fn new(severity: Severity, entity: &str, message: impl Into<String>) -> Finding {
        Finding { severity, entity: entity.to_owned(), message: message.into() }
    }
}

impl std::fmt::Display for Finding {
    /// "warning: body.tube.material: …".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}: {}", self.severity, self.entity, self.message)
    }
}

/// Poisson's ratio above which linear tetrahedra are called locking.
const LOCKING: f64 = 0.45;
/// Stiffness of a floating inclusion over that around it: above the first, digits are lost; above the second, all.
const STIFF: [f64; 2] = [1e8, 1e12];

/// Longest sides of bodies that hands bend.
const USUAL_M: std::ops::RangeInclusive<f64> = 1e-3..=10.0;

/// What is wrong with the mesh itself; pieces are judged by [`support`].
pub fn mesh(entity: &str, mesh: &TetMesh) -> Vec<Finding> {
    let found = trouble::find(mesh).into_iter().filter(|trouble| trouble.severity < Severity::Note);
    let found = found.map(|trouble| Finding::new(trouble.severity, entity, trouble.message));
    found.chain(unit(entity, mesh)).collect()
}

/// A word about bodies of an unlikely size: pictures are fitted to the stage and hide a wrong unit.
fn unit(entity: &str, mesh: &TetMesh) -> Option<Finding> {
    let (low, high) = quality::bounding_box(&mesh.nodes);
    let side = (high - low).max();
    let message = format!(
        "its longest side is {} m, for coordinates are metres: pictures fit it into the stage all the same, but with \
         another unit forces and energies are wrong (chapter meshes, Units)",
        digits(side)
    );
    (!USUAL_M.contains(&side)).then(|| Finding::new(Severity::Note, entity, message))
}

/// Control elements that share nodes, and face-connected pieces that none holds at three points off one line.
pub fn support(entity: &str, mesh: &TetMesh, controls: &[ControlElement]) -> Vec<Finding> {
    let mut findings: Vec<Finding> = controls
        .iter()
        .filter_map(|control| Some(Finding::new(Severity::Note, entity, control.notice()?)))
        .collect();
    let mut owner: Vec<Option<usize>> = vec![None; mesh.nodes.len()];
    let mut told = BTreeSet::new();
    for (index, control) in controls.iter().enumerate() {
        for &node in &control.nodes {
            let Some(other) = owner[node as usize].replace(index) else { continue };
            if !told.insert((other, index)) {
                continue;
            }
            let other = &controls[other];
            let shared = control.nodes.iter().filter(|n| other.nodes.binary_search(n).is_ok()).count();
            let message = format!(
                "overlaps control {}: {shared} nodes belong to both (the first has tag {}); each node can be \
                 prescribed by one control element only, so make the selections disjoint",
                other.name, mesh.tags[node as usize]
            );
            let entity = format!("{entity}.control.{}", control.name);
            findings.push(Finding::new(Severity::Error, &entity, message));
        }
    }
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
            count => format!("is held at {count} nodes on one line, about which it can turn freely"),
        };
        let message = format!(
            "piece {} of {} of the mesh ({} nodes, tags {}…, around {}) {how}; hold it with a control element at three \
             nodes or more that are not on one line, join it to the rest by shared faces, or remove it from the mesh",
            component + 1,
            components.nodes.len(),
            nodes.len(),
            tags.join(", "),
            place(&centre)
        );
        findings.push(Finding::new(Severity::Error, entity, message));
    }
    findings
}

/// Materials that linear tetrahedra answer badly, and stiff inclusions that float.
pub fn materials(
    entity: &str,
    body: &Body,
    mesh: &TetMesh,
    controls: &[ControlElement],
    lame: &[Lame],
) -> Vec<Finding> {
    let mut findings = Vec::new();
    let named = std::iter::once(("material".to_owned(), &body.material))
        .chain(body.region.iter().map(|(region, material)| (format!("region.{region}"), material)));
    let locks = body.element == Element::Tet4;
    for (key, Material { poisson, .. }) in named.filter(|(_, material)| locks && material.poisson > LOCKING) {
        let message = format!(
            "Poisson's ratio {poisson} is nearly incompressible: linear tetrahedra lock and the body is too stiff, the \
             more the nearer to 0.5 and the coarser the mesh (chapter method has measured figures); write \
             element = \"tet4_anp\" (same nodes, does not lock) or \"tet10\""
        );
        findings.push(Finding::new(Severity::Warning, &format!("{entity}.{key}"), message));
    }
    let mut controlled = vec![false; mesh.nodes.len()];
    for &node in controls.iter().flat_map(|control| &control.nodes) {
        controlled[node as usize] = true;
    }
    for region in mesh.regions.iter().copied().collect::<BTreeSet<u32>>() {
        let Some(ratio) = floating_stiffness(mesh, lame, &controlled, region) else { continue };
        let severity = match ratio {
            ratio if ratio > STIFF[1] => Severity::Error,
            ratio if ratio > STIFF[0] => Severity::Warning,
            _ => continue,
        };
        let message = format!(
            "region {region} floats inside material that is {ratio:.1e} times softer, held by no control element: its \
             own motion is lost in rounding (digits left: about {:.0}); make the contrast smaller, 10⁶ is as good as \
             rigid, or hold the region by a control element",
            (16.0 - ratio.log10()).max(0.0)
        );
        findings.push(Finding::new(severity, entity, message));
    }
    findings
}

/// Shear modulus of a region over the largest around it, where no control element touches the region.
fn floating_stiffness(mesh: &TetMesh, lame: &[Lame], controlled: &[bool], region: u32) -> Option<f64> {
    let mut inside = vec![false; mesh.nodes.len()];
    let mut softest = f64::INFINITY;
    let own = |tet: &usize| mesh.regions[*tet] == region;
    for tet in (0..mesh.tets.len()).filter(own) {
        mesh.tets[tet].iter().for_each(|&node| inside[node as usize] = true);
        softest = softest.min(lame[tet].mu);
    }
    if (0..mesh.nodes.len()).any(|node| inside[node] && controlled[node]) {
        return None;
    }
    let touches = |tet: &usize| mesh.tets[*tet].iter().any(|&node| inside[node as usize]);
    let around = (0..mesh.tets.len()).filter(|tet| !own(tet) && touches(tet)).map(|tet| lame[tet].mu);
    around.reduce(f64::max).map(|around| softest / around)
}

fn offsets_from_centroid(mesh: &TetMesh, nodes: &[u32]) -> (Vector3<f64>, Vec<Vector3<f64>>) {
    let centre = quality::centroid(mesh, nodes).unwrap_or_default();
    (centre, nodes.iter().map(|&node| mesh.nodes[node as usize] - centre).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    #[test]
    fn a_body_of_unlikely_size_is_told_of() {
        let told = |size: [f64; 3]| {
            let body = block(&Block { size, cells: [1; 3] }).unwrap();
            unit("body.part", &body).map(|finding| finding.message)
        };
        assert_eq!(told([0.2, 0.05, 0.02]), None);
        let far_too_long = told([93.0, 20.0, 20.0]).unwrap();
        assert!(far_too_long.starts_with("its longest side is 93.00 m"), "{far_too_long}");
        assert!(told([2e-7; 3]).unwrap().contains("is 2.000e-7 m"));
    }
}
