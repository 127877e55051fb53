//! Bodies in pieces: those that nothing holds, and those that no control element joins with the rest.
//!
//! In: a mesh and its control elements. Out: [`Diagnostic`]s that name the piece, how far it is from the rest, and the remedy.

use super::control::{ControlElement, rank};
use crate::base::diagnostic::{Diagnostic, Severity};
use crate::base::disjoint::DisjointSets;
use crate::base::extent::bounding_box;
use crate::mesh::diagnostics::{self, digits, place};
use crate::mesh::near::{NearPair, nearest_pair};
use crate::mesh::quality::Components;
use crate::mesh::{TetMesh, quality};
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// Most pieces whose distances are looked for; a mesh of dust has thousands.
const MEASURED: usize = 8;
/// A gap below this part of the body's extent is taken for one that was not meant.
const GAP: f64 = 1e-2;

/// Pieces joined through faces, and the parts that they form where they share nodes as well.
pub struct Pieces {
    components: Components,
    /// The part of each piece, numbered in the order of their first pieces.
    part: Vec<usize>,
}

impl Pieces {
    pub fn new(mesh: &TetMesh) -> Pieces {
        let components = quality::components(mesh);
        let part = joined(&components, mesh, &[]);
        Pieces { components, part }
    }

    /// Whether another control element holds nodes of the same part, for each one: only then is a motion of it alone felt.
    pub fn is_joined(&self, mesh: &TetMesh, controls: &[ControlElement]) -> Vec<bool> {
        let mut part_of = vec![usize::MAX; mesh.nodes.len()];
        for (nodes, &part) in self.components.nodes.iter().zip(&self.part) {
            nodes.iter().for_each(|&node| part_of[node as usize] = part);
        }
        let parts: Vec<BTreeSet<usize>> = controls
            .iter()
            .map(|control| control.nodes.iter().map(|&node| part_of[node as usize]).collect())
            .collect();
        shares_a_part(&parts)
    }

    fn tags(&self, mesh: &TetMesh, piece: usize) -> String {
        let first: Vec<String> =
            self.components.nodes[piece].iter().take(5).map(|&n| mesh.tags[n as usize].to_string()).collect();
        first.join(", ")
    }
}

/// Whether each set of parts has a part in common with another one.
pub fn shares_a_part<T: Ord>(sets: &[BTreeSet<T>]) -> Vec<bool> {
    let shared = |e: usize, f: usize| e != f && !sets[e].is_disjoint(&sets[f]);
    (0..sets.len()).map(|e| (0..sets.len()).any(|f| shared(e, f))).collect()
}

/// The number of the part of each piece: pieces that share nodes, or are held by one of `controls`, are one part.
fn joined(components: &Components, mesh: &TetMesh, controls: &[ControlElement]) -> Vec<usize> {
    let count = components.nodes.len();
    let mut sets = DisjointSets::new(count);
    let mut piece_of = vec![u32::MAX; mesh.nodes.len()];
    for (piece, nodes) in (0u32..).zip(&components.nodes) {
        for &node in nodes {
            match &mut piece_of[node as usize] {
                own if *own == u32::MAX => *own = piece,
                other => sets.join(*other, piece),
            }
        }
    }
    for control in controls {
        let mut pieces = control.nodes.iter().map(|&node| piece_of[node as usize]).filter(|p| *p != u32::MAX);
        if let Some(first) = pieces.next() {
            pieces.for_each(|piece| sets.join(first, piece));
        }
    }
    let roots: Vec<u32> = (0..count as u32).map(|piece| sets.root(piece)).collect();
    let first: Vec<u32> =
        (0u32..).zip(&roots).filter(|(piece, root)| piece == *root).map(|(p, _)| p).collect();
    roots.iter().map(|root| first.partition_point(|other| other < root)).collect()
}

/// Errors for pieces that no control element holds at three points off one line, and a warning where pieces have no
/// control element in common with the rest.
pub fn find(entity: &str, mesh: &TetMesh, controls: &[ControlElement]) -> Vec<Diagnostic> {
    let pieces = Pieces::new(mesh);
    let mut findings = loose(entity, mesh, controls, &pieces);
    if findings.is_empty() {
        findings.extend(apart(entity, mesh, controls, &pieces));
    }
    findings
}

fn loose(entity: &str, mesh: &TetMesh, controls: &[ControlElement], pieces: &Pieces) -> Vec<Diagnostic> {
    let mut controlled = vec![false; mesh.nodes.len()];
    controls.iter().flat_map(|control| &control.nodes).for_each(|&node| controlled[node as usize] = true);
    let (count, hinges) = (pieces.components.nodes.len(), diagnostics::hinges(mesh, &pieces.components));
    let mut findings = Vec::new();
    for (piece, nodes) in pieces.components.nodes.iter().enumerate() {
        let held: Vec<u32> = nodes.iter().copied().filter(|&node| controlled[node as usize]).collect();
        let Some(how) = how_it_turns(mesh, nodes, &held) else { continue };
        // A piece that hangs on an edge or a node of another has no distance from it.
        let is_apart = !nodes.iter().any(|node| hinges.binary_search(node).is_ok());
        let gap = if is_apart && findings.len() < MEASURED { gap(mesh, &marked(mesh, nodes)) } else { None };
        let message = format!(
            "piece {} of {count} of the mesh ({} nodes, tags {}…, around {}) {how}{}. Hold it at three nodes \
             off one line, or join it to the rest by shared faces{}",
            piece + 1,
            nodes.len(),
            pieces.tags(mesh, piece),
            place(&quality::centroid(mesh, nodes).unwrap_or_default()),
            gap.as_ref().map_or(String::new(), |gap| format!("; {}", gap.told)),
            gap.filter(|gap| gap.is_narrow)
                .map_or(String::new(), |gap| format!(" (merge nodes {})", gap.tolerance)),
        );
        findings.push(Diagnostic::new(Severity::Error, entity, message));
    }
    findings
}

/// The reason why `nodes` do not stay in place though those that are `held` do; `None` if they do.
pub fn how_it_turns(mesh: &TetMesh, nodes: &[u32], held: &[u32]) -> Option<String> {
    let (all, offsets) = (offsets_from_centroid(mesh, nodes), offsets_from_centroid(mesh, held));
    let size = all.iter().map(Vector3::norm).fold(0.0, f64::max);
    if rank(&offsets, 1e-6 * size) >= 2 {
        return None;
    }
    Some(match held.len() {
        0 => "is held by no control element".to_owned(),
        1 => "is held at a single node, about which it can turn freely".to_owned(),
        count => format!("is held at {count} nodes on one line, about which it can turn freely"),
    })
}

fn offsets_from_centroid(mesh: &TetMesh, nodes: &[u32]) -> Vec<Vector3<f64>> {
    let centre = quality::centroid(mesh, nodes).unwrap_or_default();
    nodes.iter().map(|&node| mesh.nodes[node as usize] - centre).collect()
}

/// A warning where the body is in parts that neither nodes nor control elements join.
fn apart(entity: &str, mesh: &TetMesh, controls: &[ControlElement], pieces: &Pieces) -> Option<Diagnostic> {
    let part = joined(&pieces.components, mesh, controls);
    let count = part.iter().max().map_or(0, |last| last + 1);
    if count < 2 {
        return None;
    }
    let mut told = Vec::new();
    // The first part is the rest of the second; where there are more, each is told against all others.
    for number in 1..count.min(MEASURED + 1) {
        let its = pieces.components.nodes.iter().zip(&part).filter(|(_, part)| **part == number);
        let own: Vec<u32> = its.flat_map(|(nodes, _)| nodes).copied().collect();
        let inside = marked(mesh, &own);
        let holds = |control: &&ControlElement| control.nodes.iter().any(|&node| inside[node as usize]);
        let names: Vec<&str> = controls.iter().filter(holds).map(|control| control.name.as_str()).collect();
        let gap = gap(mesh, &inside)?;
        let remedy = match gap.is_narrow {
            true => format!("to join it, merge nodes {}", gap.tolerance),
            false => "make it a body of its own, or hold it with the rest".to_owned(),
        };
        told.push(format!(
            "part {} of {count} ({} nodes around {}, held by {}): {}; {remedy}",
            number + 1,
            own.len(),
            place(&quality::centroid(mesh, &own).unwrap_or_default()),
            names.join(", "),
            gap.told
        ));
    }
    if count > MEASURED + 1 {
        told.push(format!("and {} more", count - 1 - MEASURED));
    }
    let message = format!(
        "the body is in {count} parts that no control element joins, and none moves another. {}",
        told.join(". ")
    );
    Some(Diagnostic::new(Severity::Warning, entity, message))
}

/// The gap between some nodes and all others.
struct Gap {
    told: String,
    is_narrow: bool,
    /// "with a tolerance above …".
    tolerance: String,
}

/// `None` where they are all nodes.
fn gap(mesh: &TetMesh, inside: &[bool]) -> Option<Gap> {
    let (own, rest): (Vec<u32>, Vec<u32>) =
        (0..mesh.nodes.len() as u32).partition(|&node| inside[node as usize]);
    let NearPair { nodes, distance } = nearest_pair(&mesh.nodes, &own, &rest)?;
    let [a, b] = nodes.map(|node| mesh.tags[node as usize]);
    let (low, high) = bounding_box(&mesh.nodes);
    let tolerance = match distance {
        0.0 => "that lie at the same place (gmsh: Coherence Mesh)".to_owned(),
        _ => format!(
            "with a tolerance above {} m (gmsh: Geometry.Tolerance, then Coherence Mesh)",
            digits(distance)
        ),
    };
    Some(Gap {
        told: format!("its distance from the rest is {} m, between nodes {a} and {b}", digits(distance)),
        is_narrow: distance < GAP * (high - low).norm(),
        tolerance,
    })
}

fn marked(mesh: &TetMesh, nodes: &[u32]) -> Vec<bool> {
    let mut marked = vec![false; mesh.nodes.len()];
    nodes.iter().for_each(|&node| marked[node as usize] = true);
    marked
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    /// Two cubes of side 1 side by side along x, `gap` apart, and a control element at each far end.
    fn two_cubes(gap: f64) -> (TetMesh, Vec<ControlElement>) {
        let mut mesh = block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap();
        let (second, count) = (mesh.clone(), mesh.nodes.len() as u32);
        mesh.nodes.extend(second.nodes.iter().map(|x| x + Vector3::new(1.0 + gap, 0.0, 0.0)));
        mesh.tags.extend(second.tags.iter().map(|tag| tag + 1000));
        mesh.tets.extend(second.tets.iter().map(|tet| tet.map(|node| node + count)));
        mesh.regions.extend(&second.regions);
        let near = second.groups["xmin"].clone();
        let far: Vec<u32> = second.groups["xmax"].iter().map(|node| node + count).collect();
        let controls =
            vec![ControlElement::new("L", near, &mesh, 2.0), ControlElement::new("R", far, &mesh, 2.0)];
        (mesh, controls)
    }

    /// Each half is held, so that a factorization has nothing against it; but pulling R is not felt at L.
    #[test]
    fn halves_that_no_control_element_joins_are_told_with_their_distance() {
        let (mesh, controls) = two_cubes(1e-7);
        let found = find("body.b", &mesh, &controls);
        assert_eq!((found.len(), found[0].severity), (1, Severity::Warning), "{found:?}");
        let said = &found[0].message;
        for words in [
            "in 2 parts that no control element joins",
            "held by R",
            "is 1.000e-7 m, between nodes 1",
            "merge nodes with a tolerance above 1.000e-7 m",
        ] {
            assert!(said.contains(words), "{said} lacks {words}");
        }
        assert_eq!(Pieces::new(&mesh).is_joined(&mesh, &controls), [false, false]);

        let (mesh, controls) = two_cubes(0.5);
        let said = &find("body.b", &mesh, &controls)[0].message;
        assert!(said.contains("is 0.5000 m") && said.contains("make it a body of its own"), "{said}");
    }

    #[test]
    fn a_control_element_of_both_halves_joins_them() {
        let (mesh, mut controls) = two_cubes(1e-7);
        let second: Vec<u32> = controls[1].nodes.clone();
        controls[0].nodes.extend(second);
        controls.truncate(1);
        assert_eq!(find("body.b", &mesh, &controls), []);
        let whole = block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap();
        let ends =
            ["xmin", "xmax"].map(|end| ControlElement::new(end, whole.groups[end].clone(), &whole, 1.0));
        assert_eq!(find("body.b", &whole, &ends), []);
        assert_eq!(Pieces::new(&whole).is_joined(&whole, &ends), [true, true]);
    }

    #[test]
    fn a_piece_that_nothing_holds_is_told_with_its_distance() {
        let (mesh, mut controls) = two_cubes(1e-7);
        controls.truncate(1);
        let found = find("body.b", &mesh, &controls);
        assert_eq!((found.len(), found[0].severity), (1, Severity::Error), "{found:?}");
        let said = &found[0].message;
        assert!(said.contains("piece 2 of 2") && said.contains("is held by no control element"), "{said}");
        assert!(said.contains("its distance from the rest is 1.000e-7 m"), "{said}");
        assert!(said.contains("merge nodes with a tolerance above 1.000e-7 m"), "{said}");
    }
}
