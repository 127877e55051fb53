//! What must be right before anything is factorised: a Cholesky factorization that succeeds proves nothing. It passes
//! flat and swapped tetrahedra, pieces held at two points and bodies cracked open, and answers with nonsense.

use super::ControlElement;
use super::control::rank;
use crate::fem::{FLAT, Lame};
use crate::mesh::{TetMesh, defects, quality};
use crate::scene::{Body, Material};
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// How bad a finding is; the most severe first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The body is refused.
    Error,
    /// It is solved, but the answer may not be what was meant.
    Warning,
    /// Something was repaired, or is worth knowing.
    Note,
}

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
        let severity = match self.severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Note => "note",
        };
        write!(f, "{severity}: {}: {}", self.entity, self.message)
    }
}

/// Quality 6·√2·V/ℓ³ below which a sliver is named.
const SLIVER: f64 = 1e-3;
/// Extents, m, whose areas and coefficients single precision can hold.
const EXTENT: [f64; 2] = [1e-14, 1e12];
/// Extent over distance from the origin below which the file's coordinates have lost digits.
const FAR: f64 = 1e-6;
/// Poisson's ratio above which linear tetrahedra are called locking.
const LOCKING: f64 = 0.45;
/// Stiffness of a floating inclusion over that around it: above the first, digits are lost; above the second, all.
const STIFF: [f64; 2] = [1e8, 1e12];

/// Tetrahedra and nodes that no solver can be trusted with.
pub fn mesh(entity: &str, mesh: &TetMesh) -> Vec<Finding> {
    let mut findings = Vec::new();
    let qualities: Vec<f64> = (0..mesh.tets.len()).map(|tet| quality::quality(&mesh.corners(tet))).collect();
    let below = |limit: f64| -> Vec<u32> {
        let mut tets: Vec<u32> =
            (0..mesh.tets.len() as u32).filter(|&t| qualities[t as usize] < limit).collect();
        tets.sort_by(|&a, &b| qualities[a as usize].total_cmp(&qualities[b as usize]));
        tets
    };
    let flat = below(FLAT);
    if !flat.is_empty() {
        findings.push(Finding::new(
            Severity::Error,
            entity,
            format!(
                "{} tetrahedra have no volume (quality below {FLAT:e}): {}; remove them, or mesh this place anew",
                flat.len(),
                tetrahedra(mesh, &flat)
            ),
        ));
    }
    let slivers: Vec<u32> = below(SLIVER).into_iter().filter(|tet| !flat.contains(tet)).collect();
    if !slivers.is_empty() {
        findings.push(Finding::new(
            Severity::Warning,
            entity,
            format!(
                "{} slivers (quality below {SLIVER}, the worst {:.1e}): {}; elsewhere the answer hardly changes, but \
                 their stresses mean nothing and conjugate gradients slow down",
                slivers.len(),
                qualities[slivers[0] as usize],
                tetrahedra(mesh, &slivers)
            ),
        ));
    }
    findings.extend(overlaps(entity, mesh));
    let coincident = defects::coincident_nodes(mesh);
    if let Some(&[a, b]) = coincident.first() {
        let [a_tag, b_tag] = [a, b].map(|node| mesh.tags[node as usize]);
        let message = format!(
            "{} pairs of nodes lie at the same place (the first: tags {a_tag} and {b_tag} at {}); the body is cracked \
             open there and will gape; merge the nodes (gmsh: Coherence Mesh)",
            coincident.len(),
            place(&mesh.nodes[a as usize])
        );
        findings.push(Finding::new(Severity::Warning, entity, message));
    }
    let (low, high) = quality::bounding_box(&mesh.nodes);
    let (extent, offset) = ((high - low).norm(), ((high + low) * 0.5).norm());
    if !(EXTENT[0]..=EXTENT[1]).contains(&extent) {
        let message = format!(
            "the body spans {extent:.1e} m, and only bodies of {:.0e} to {:.0e} m can be drawn; check the mesh's unit",
            EXTENT[0], EXTENT[1]
        );
        findings.push(Finding::new(Severity::Error, entity, message));
    }
    if extent < FAR * offset {
        let message = format!(
            "the body of {extent:.3e} m lies {offset:.3e} m from its origin: its coordinates have only about {:.0} \
             digits left for its shape; move it to the origin before it is meshed",
            (16.0 - (offset / extent).log10()).max(0.0)
        );
        findings.push(Finding::new(Severity::Warning, entity, message));
    }
    findings
}

fn overlaps(entity: &str, mesh: &TetMesh) -> Vec<Finding> {
    let mut findings = Vec::new();
    let folded: BTreeSet<u32> = defects::folded_pairs(mesh).into_iter().flatten().collect();
    if !folded.is_empty() {
        let list: Vec<u32> = folded.iter().copied().collect();
        let message = format!(
            "the mesh is folded: {} tetrahedra lie on the wrong side of a face they share: {}; a node was pushed \
             through its neighbours, move it back or mesh this place anew",
            list.len(),
            tetrahedra(mesh, &list)
        );
        findings.push(Finding::new(Severity::Error, entity, message));
    }
    let crowded = quality::overlapping_faces(mesh);
    if let Some(face) = crowded.first() {
        let tags = face.map(|node| mesh.tags[node as usize]);
        let message = format!(
            "{} faces belong to three tetrahedra or more (the first has nodes with tags {tags:?}): the mesh overlaps \
             itself; remove the doubled elements",
            crowded.len()
        );
        findings.push(Finding::new(Severity::Error, entity, message));
    }
    findings
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
    for (key, Material { poisson, .. }) in named.filter(|(_, material)| material.poisson > LOCKING) {
        let message = format!(
            "Poisson's ratio {poisson} is nearly incompressible: linear tetrahedra lock and the body is too stiff, the \
             more the nearer to 0.5 and the coarser the mesh (chapter method has measured figures); use at most \
             {LOCKING}, or refine and compare"
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

/// The first few of some tetrahedra, by their nodes' tags and their place.
fn tetrahedra(mesh: &TetMesh, tets: &[u32]) -> String {
    let name = |&tet: &u32| {
        let nodes = mesh.tets[tet as usize];
        let centre: Vector3<f64> = mesh.corners(tet as usize).iter().sum::<Vector3<f64>>() / 4.0;
        format!("nodes {:?} near {}", nodes.map(|node| mesh.tags[node as usize]), place(&centre))
    };
    let mut list: Vec<String> = tets.iter().take(3).map(name).collect();
    if tets.len() > 3 {
        list.push("…".into());
    }
    list.join("; ")
}

fn place(x: &Vector3<f64>) -> String {
    format!("({:.4e}, {:.4e}, {:.4e}) m", x.x, x.y, x.z)
}

fn offsets_from_centroid(mesh: &TetMesh, nodes: &[u32]) -> (Vector3<f64>, Vec<Vector3<f64>>) {
    let centre = quality::centroid(mesh, nodes).unwrap_or_default();
    (centre, nodes.iter().map(|&node| mesh.nodes[node as usize] - centre).collect())
}
