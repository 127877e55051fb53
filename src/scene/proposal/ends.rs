//! The two ends of a body: where a proposed scene holds it, and where it is pulled, if the user names neither.
//!
//! In: a mesh. Out: two selections of nodes. The ends of a long body lie on its axis of least inertia; those of a body that
//! fills its bounding box are the far faces of the box; those of any other body, such as an organ, are the two places of its
//! surface that are furthest apart through the material.

use super::super::Nodes;
use crate::base::disjoint::DisjointSets;
use crate::base::extent::bounding_box;
use crate::mesh::diagnostics::digits;
use crate::mesh::{Surface, TetMesh, geodesic, quality};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// One end of a body.
#[derive(Clone, Debug)]
pub struct End {
    /// Direction in which it lies as seen from the other end: "left", "top", ….
    pub name: &'static str,
    pub nodes: Nodes,
    /// The nodes it selects, ascending.
    pub selected: Vec<u32>,
    /// Phrase for the nodes: "all nodes within 0.02 m of its left end".
    pub what: String,
}

/// The two ends, the one to be fixed first, and how they were found.
pub struct Ends {
    pub ends: [End; 2],
    pub why: String,
}

/// Ratio of the two largest standard deviations of the body's material above which the body counts as long.
const LONG: f64 = 1.5;
/// Part of its bounding box that a body fills, above which its ends are faces of the box.
const BOXY: f64 = 0.85;
/// Cosine between a principal axis and a coordinate axis above which the coordinate axis is taken.
const ALIGNED: f64 = 0.985;
/// Depth of an end over the body's length: the first that is tried along an axis and through the body, and the last.
const ALONG: f64 = 0.08;
const THROUGH: f64 = 0.12;
const DEEPEST: f64 = 0.35;
/// Least number of nodes of an end, unless that needs more than the last depth.
const FEWEST: usize = 12;

/// The ends of a body; `None` where no two can be distinguished, as in a mesh of a few tetrahedra.
pub fn find(mesh: &TetMesh) -> Option<Ends> {
    let shape = Shape::new(mesh);
    let surface = Surface::from_mesh(mesh);
    let tips = Tips::find(mesh, &surface)?;
    if let Some((axis, why)) = shape.axis()
        && !(shape.is_long() && tips.turn_off(mesh, &axis))
        && let Some(ends) = along(mesh, &surface, &axis)
    {
        return Some(Ends { ends, why });
    }
    let ends = farthest(mesh, &surface, &tips)?;
    Some(Ends {
        ends,
        why: "the two places of the surface that are furthest apart through the body".to_owned(),
    })
}

/// The body's extent along its axis of least inertia, m.
pub fn length(mesh: &TetMesh) -> f64 {
    let axis = Shape::new(mesh).axes[0];
    let (low, high) = span(mesh, &axis);
    high - low
}

/// Its length in radii of gyration about that axis' section, as if it were straight and uniform: 35 of a square bar of 10 : 1, 40 of
/// a round one, and few of a body that is bent.
pub fn slenderness(mesh: &TetMesh) -> f64 {
    let [_, wide, thick] = Shape::new(mesh).deviations;
    length(mesh) / (0.5 * (wide * wide + thick * thick)).sqrt()
}

/// Shape of a body of uniform density: its principal axes and standard deviations along them, the greatest first.
struct Shape {
    axes: [Vector3<f64>; 3],
    deviations: [f64; 3],
    box_sides: Vector3<f64>,
    volume: f64,
}

impl Shape {
    fn new(mesh: &TetMesh) -> Shape {
        let (low, high) = bounding_box(&mesh.nodes);
        let middle = (low + high) * 0.5;
        let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
        for tet in 0..mesh.tets.len() {
            let corners = mesh.corners(tet).map(|corner| corner - middle);
            let part = quality::signed_volume(&corners);
            let centre: Vector3<f64> = corners.iter().sum::<Vector3<f64>>() / 4.0;
            volume += part;
            first += centre * part;
            // ∫ x xᵀ over a tetrahedron: V (Σ cᵢ cᵢᵀ + 16 c cᵀ)/20.
            let corner_sum: Matrix3<f64> = corners.iter().map(|corner| corner * corner.transpose()).sum();
            second += (corner_sum + centre * centre.transpose() * 16.0) * (part / 20.0);
        }
        let covariance = second / volume - first * first.transpose() / (volume * volume);
        let eigen = SymmetricEigen::new(covariance);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        Shape {
            axes: order.map(|i| eigen.eigenvectors.column(i).into_owned()),
            deviations: order.map(|i| eigen.eigenvalues[i].max(0.0).sqrt()),
            box_sides: high - low,
            volume,
        }
    }

    fn is_long(&self) -> bool {
        let [long, next, _] = self.deviations;
        long > LONG * next
    }

    /// The axis at whose ends the body is held, and why; `None` for a body without one.
    fn axis(&self) -> Option<(Vector3<f64>, String)> {
        if self.is_long() {
            let snapped =
                (0..3).map(|i| Vector3::ith(i, 1.0)).find(|axis| axis.dot(&self.axes[0]).abs() > ALIGNED);
            let axis = snapped.unwrap_or(upward(self.axes[0]).map(|x| (x * 1e3).round() / 1e3));
            return Some((axis, "the ends of its long axis".to_owned()));
        }
        let fills = self.volume / self.box_sides.product();
        (fills > BOXY).then(|| {
            // Of nearly equal sides the upright one wins, along which a body stands.
            let side = |axis: &usize| self.box_sides[*axis] * if *axis == 1 { 1.01 } else { 1.0 };
            let longest = (0..3).max_by(|a, b| side(a).total_cmp(&side(b))).unwrap_or(1);
            (Vector3::ith(longest, 1.0), "the far faces of its box".to_owned())
        })
    }
}

/// Reverses an axis that points against the coordinate axis nearest to it.
fn upward(axis: Vector3<f64>) -> Vector3<f64> {
    if axis[axis.iamax()] < 0.0 { -axis } else { axis }
}

fn span(mesh: &TetMesh, axis: &Vector3<f64>) -> (f64, f64) {
    let along = mesh.nodes.iter().map(|node| node.dot(axis));
    along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

/// Name of the end towards which `axis` points: "right", "top", "front" or their opposites.
fn side(axis: &Vector3<f64>) -> &'static str {
    let at = axis.iamax();
    [["left", "right"], ["bottom", "top"], ["back", "front"]][at][usize::from(axis[at] > 0.0)]
}

/// The ends along `axis`: all nodes within a depth of the planes at which the body ends. The lower or left one comes first
/// and is fixed; where only one of them is in one piece, that one is for the hand.
fn along(mesh: &TetMesh, surface: &Surface, axis: &Vector3<f64>) -> Option<[End; 2]> {
    let unit = axis.normalize();
    let (low, high) = span(mesh, &unit);
    let length = high - low;
    let (coarse, middle) = (length * 5e-4, quality::centroid(mesh, &surface.nodes)?);
    let end = |sign: f64| {
        let at = if sign > 0.0 { high } else { low };
        let point = match axis.iter().filter(|x| **x != 0.0).count() {
            // On the axis itself.
            1 => unit * at,
            _ => middle + unit * (at - middle.dot(&unit)),
        };
        let point: [f64; 3] = point.map(|x| rounded(x, coarse)).into();
        selection(mesh, surface, length, ALONG, |depth| Nodes::Plane {
            point,
            normal: (*axis).into(),
            distance: rounded(depth, coarse),
        })
        .map(|(nodes, selected, depth)| End {
            name: side(&(unit * sign)),
            what: format!(
                "all nodes within {} m of its {} end",
                digits(rounded(depth, coarse)),
                side(&(unit * sign))
            ),
            nodes,
            selected,
        })
    };
    let ends = [end(-1.0)?, end(1.0)?];
    if are_apart(&ends[0].selected, &ends[1].selected) {
        let [first, second] = [0, 1].map(|i: usize| pieces(mesh, &ends[i].selected));
        match (first, second) {
            (_, 1) => Some(ends),
            (1, _) => {
                let [first, second] = ends;
                Some([second, first])
            }
            _ => None,
        }
    } else {
        None
    }
}

/// The two surface nodes that are furthest apart along the mesh's edges, found by going to the furthest node twice.
struct Tips {
    distance: f64,
    /// Length of the way from every node to each of the two.
    lengths: [Vec<f64>; 2],
}

impl Tips {
    fn find(mesh: &TetMesh, surface: &Surface) -> Option<Tips> {
        let furthest = |lengths: &[f64]| -> Option<u32> {
            let reached = |node: &&u32| lengths[**node as usize].is_finite();
            let far = |a: &&u32, b: &&u32| lengths[**a as usize].total_cmp(&lengths[**b as usize]);
            surface.nodes.iter().filter(reached).max_by(far).copied()
        };
        let from = |node: u32| geodesic::lengths(mesh, &[node], f64::INFINITY);
        let first = furthest(&from(*surface.nodes.first()?))?;
        let to_first = from(first);
        let second = furthest(&to_first)?;
        let distance = to_first[second as usize];
        Some(Tips { distance, lengths: [to_first, from(second)] })
    }

    /// Centroid of the nodes whose way from a tip, over the distance between both tips, is within `parts`.
    fn middle(&self, mesh: &TetMesh, tip: usize, parts: std::ops::Range<f64>) -> Option<Vector3<f64>> {
        let lengths = self.lengths[tip].iter().zip(0u32..);
        let is_in = |length: f64| parts.contains(&(length / self.distance));
        let shell: Vec<u32> = lengths.filter(|(length, _)| is_in(**length)).map(|(_, node)| node).collect();
        quality::centroid(mesh, &shell)
    }

    /// Whether the body bends away from `axis` at both tips, as an arch does, so that the faces across the axis are no ends.
    fn turn_off(&self, mesh: &TetMesh, axis: &Vector3<f64>) -> bool {
        let (low, high) = span(mesh, &axis.normalize());
        let turns = |tip: usize| {
            let outer = self.middle(mesh, tip, 0.0..0.15);
            let inner = self.middle(mesh, tip, 0.15..0.3);
            outer.zip(inner).is_some_and(|(outer, inner)| (inner - outer).angle(axis).cos().abs() < 0.7)
        };
        self.distance > 1.3 * (high - low) && turns(0) && turns(1)
    }
}

/// The ends about the two tips of the body.
fn farthest(mesh: &TetMesh, surface: &Surface, tips: &Tips) -> Option<[End; 2]> {
    let distance = tips.distance;
    // A tip is a corner of an end: moved to the end's middle.
    let middle = |tip: usize| -> Option<u32> {
        let centre = tips.middle(mesh, tip, 0.0..THROUGH)?;
        geodesic::nearest(mesh, &surface.nodes, &centre).map(|(node, _)| node)
    };
    let (first, second) = (middle(0)?, middle(1)?);
    let apart = mesh.nodes[second as usize] - mesh.nodes[first as usize];
    // The lower or the left one first.
    let (first, second, apart) =
        if apart[apart.iamax()] < 0.0 { (second, first, -apart) } else { (first, second, apart) };
    let end = |node: u32, name: &'static str| {
        let from: [f64; 3] = mesh.nodes[node as usize].map(|x| rounded(x, distance * 5e-5)).into();
        selection(mesh, surface, distance, THROUGH, |depth| Nodes::Geodesic {
            from,
            radius: rounded(depth, distance * 5e-4),
        })
        .map(|(nodes, selected, depth)| End {
            name,
            what: format!(
                "all nodes that a way of {} m through the body reaches from its {name} end",
                digits(rounded(depth, distance * 5e-4))
            ),
            nodes,
            selected,
        })
    };
    let ends = [end(first, side(&-apart))?, end(second, side(&apart))?];
    are_apart(&ends[0].selected, &ends[1].selected).then_some(ends)
}

/// The shallowest selection that a hand can hold and that has [`FEWEST`] nodes, or else the deepest that a hand can hold.
fn selection(
    mesh: &TetMesh,
    surface: &Surface,
    length: f64,
    first: f64,
    nodes: impl Fn(f64) -> Nodes,
) -> Option<(Nodes, Vec<u32>, f64)> {
    let mut depth = first * length;
    let mut found = None;
    while depth <= DEEPEST * length {
        let chosen = nodes(depth);
        if let Ok(selected) = chosen.select(mesh)
            && can_be_held(mesh, surface, &selected)
        {
            let is_enough = selected.len() >= FEWEST;
            found = Some((chosen, selected, depth));
            if is_enough {
                break;
            }
        }
        depth *= 1.25;
    }
    found
}

/// Whether a selection has a whole triangle, which a ray can hit, and does not lie on one line.
pub fn can_be_held(mesh: &TetMesh, surface: &Surface, selected: &[u32]) -> bool {
    let holds = |node: u32| selected.binary_search(&node).is_ok();
    let is_whole = |triangle: &[u32; 3]| triangle.iter().all(|&corner| holds(surface.nodes[corner as usize]));
    surface.triangles.iter().any(is_whole) && !on_one_line(mesh, selected)
}

fn on_one_line(mesh: &TetMesh, selected: &[u32]) -> bool {
    let at = |node: &u32| mesh.nodes[*node as usize];
    let Some(first) = selected.first().map(at) else { return true };
    let far = selected
        .iter()
        .map(|node| at(node) - first)
        .max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    let far = far.unwrap_or_default();
    let off = selected.iter().map(|node| far.cross(&(at(node) - first)).norm()).fold(0.0, f64::max);
    off <= 1e-6 * far.norm_squared()
}

pub fn are_apart(a: &[u32], b: &[u32]) -> bool {
    a.iter().all(|node| b.binary_search(node).is_err())
}

/// Number of pieces of a selection, joined through edges of the mesh.
fn pieces(mesh: &TetMesh, selected: &[u32]) -> usize {
    let mut joined = DisjointSets::new(selected.len());
    for edge in geodesic::edges(mesh) {
        if let [Ok(a), Ok(b)] = edge.map(|node| selected.binary_search(&node)) {
            joined.join(a as u32, b as u32);
        }
    }
    (0..selected.len() as u32).filter(|&i| joined.root(i) == i).count()
}

/// Rounds to a round number at most `coarse` away.
fn rounded(value: f64, coarse: f64) -> f64 {
    let step = 10f64.powf((2.0 * coarse).log10().floor());
    let steps = (value / step).round();
    let places = (-step.log10()).round().clamp(0.0, 17.0) as usize;
    format!("{:.places$}", steps * step).parse().map_or(value, |value: f64| value + 0.0)
}
