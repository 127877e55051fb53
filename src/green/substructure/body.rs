//! All parts of a body, solved: what the model `substructured` is made from.
//!
//! In: mesh, materials and control elements, and how the body is cut. Out: for each part its ends, its energy's numbers
//! ([`PartSolution`]), and its displacements at the surface nodes in which it has a share. A node near an interface has
//! shares of both parts, so that the surface has no edge there.

use super::super::control::ControlElement;
use super::cut::Cut;
use super::part::{Domain, End, PartError, PartSolution, coordinates};
use super::second_order::{FrameFit, StrainPoint};
use crate::fem::{AssemblyError, Element, Lame, NodeFields, TET4, tet4};
use crate::mesh::geodesic::edges;
use crate::mesh::{Surface, TetMesh, quality};
use crate::solve::{Progress, Solver};
use nalgebra::Vector3;
use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};

/// A body as it is cut and solved.
pub struct Body<'a> {
    pub element: &'a Element,
    pub mesh: &'a TetMesh,
    pub surface: &'a Surface,
    pub lame: &'a [Lame],
    pub controls: &'a [ControlElement],
    pub cut: &'a Cut,
    pub solver: &'a Solver,
}

/// An end of a solved part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joint {
    /// An interface to another part, by the interface's number among those that are used.
    Interface(usize),
    Control(usize),
}

/// One part: its ends, and its share in the surface.
pub struct SolvedPart {
    pub ends: Vec<Joint>,
    pub solution: PartSolution,
    /// Surface nodes, the part's share in each, and the row of the solution's fields that has the node.
    pub shares: Vec<(u32, f64, usize)>,
}

/// All parts, and where the interfaces rest.
pub struct SolvedBody {
    pub parts: Vec<SolvedPart>,
    pub interfaces: Vec<Vector3<f64>>,
}

#[derive(Debug, thiserror::Error)]
pub enum BodyError {
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    #[error("model \"substructured\" needs linear tetrahedra, not {element}: write element = \"tet4\"")]
    Element { element: &'static str },
    #[error(
        "model \"substructured\" cuts a body between its control elements, and it has one: loads would bend nothing. Write \
         model = \"reduced\""
    )]
    OneControl,
    #[error(
        "part {part} of {parts} has {ends} ends and {coordinates} coordinates, at most \
         {MOST_COORDINATES}: ask for more parts"
    )]
    Ends { part: usize, parts: usize, ends: usize, coordinates: usize },
    #[error(
        "part {part} of {parts} (with node {tag}) meets no control element and no interface of three \
         nodes off one line: ask for fewer parts"
    )]
    Loose { part: usize, parts: usize, tag: u64 },
    #[error(
        "in {parts} parts its forces at small bends and twists are off by {percent:.0} % of linear theory, above 20 %. Write \
         model = \"reduced\""
    )]
    Linear { parts: usize, percent: f64 },
    #[error("part {part} of {parts} (tetrahedra with a corner at node {tag}): {source}")]
    Part { part: usize, parts: usize, tag: u64, source: PartError },
}

impl BodyError {
    /// Whether the scene is to blame, rather than the work.
    pub fn is_request(&self) -> bool {
        !matches!(self, BodyError::Part { source: PartError::Solve(_), .. })
    }
}

/// Errors for an element that has no parts, and for a body that would be a single one.
pub fn suits(element: &'static Element, controls: usize) -> Result<(), BodyError> {
    if *element != TET4 {
        return Err(BodyError::Element { element: element.name });
    }
    if controls < 2 { Err(BodyError::OneControl) } else { Ok(()) }
}

/// Pairs of coordinates grow with their square, and the fourth-order term with the square of that.
const MOST_COORDINATES: usize = 30;
/// Extent of a part's surroundings, in the root mean square radius of the interface.
const MARGIN: f64 = 1.75;
/// Distance from an interface within which two parts share nodes, in parts of the margin and of the shortest way between two
/// ends.
const SHARED: [f64; 2] = [0.5, 0.15];

/// An interface that holds a frame.
struct Face<'a> {
    parts: [usize; 2],
    nodes: &'a [u32],
    origin: Vector3<f64>,
    radius: f64,
}

/// Solves all parts.
pub fn solve(body: &Body<'_>, progress: &dyn Progress) -> Result<SolvedBody, BodyError> {
    let mesh = body.mesh;
    let faces: Vec<Face<'_>> = body.cut.interfaces.iter().filter_map(|face| Face::new(mesh, face)).collect();
    let roads = Roads::new(mesh);
    let mut parts = Vec::with_capacity(body.cut.parts);
    progress.begin("parts", body.cut.parts as u64);
    for part in 0..body.cut.parts {
        let solve =
            |margin| Surroundings::find(body, &faces, &roads, part, margin).solve(body, &faces, progress);
        let solved = match solve(MARGIN) {
            // Its surroundings meet, as where three parts do: its interfaces are held themselves.
            Err(BodyError::Part { source: PartError::Fit { .. }, .. }) => solve(0.0),
            solved => solved,
        };
        parts.push(solved?);
        progress.advance(1);
    }
    progress.end();
    share_nodes(body, &faces, &mut parts);
    let parts = parts.into_iter().map(|(solved, _)| solved).collect();
    Ok(SolvedBody { parts, interfaces: faces.iter().map(|face| face.origin).collect() })
}

impl<'a> Face<'a> {
    /// `None` of nodes that no frame can be fitted to.
    fn new(mesh: &TetMesh, face: &'a super::cut::Interface) -> Option<Face<'a>> {
        let origin = quality::centroid(mesh, &face.nodes)?;
        let offsets: Vec<_> = face.nodes.iter().map(|&node| mesh.nodes[node as usize] - origin).collect();
        let square = offsets.iter().map(Vector3::norm_squared).sum::<f64>() / offsets.len().max(1) as f64;
        FrameFit::new(offsets)?;
        Some(Face { parts: face.parts, nodes: &face.nodes, origin, radius: square.sqrt() })
    }
}

/// The edges from every node, with their lengths.
struct Roads {
    start: Vec<usize>,
    ends: Vec<(u32, f64)>,
}

impl Roads {
    fn new(mesh: &TetMesh) -> Roads {
        let mut both = edges(mesh);
        let half = both.len();
        both.extend_from_within(..);
        both[half..].iter_mut().for_each(|edge| edge.reverse());
        both.sort_unstable();
        let start = (0..=mesh.nodes.len()).map(|node| both.partition_point(|edge| (edge[0] as usize) < node));
        let length = |[a, b]: &[u32; 2]| (mesh.nodes[*a as usize] - mesh.nodes[*b as usize]).norm();
        Roads { start: start.collect(), ends: both.iter().map(|edge| (edge[1], length(edge))).collect() }
    }

    /// The length of the shortest way from some nodes to all that are nearer than `limit`, through nodes that are `open`.
    fn lengths(&self, from: &[u32], limit: f64, open: &dyn Fn(u32) -> bool) -> Vec<f64> {
        let mut length = vec![f64::INFINITY; self.start.len() - 1];
        let mut queue = BinaryHeap::new();
        for &node in from {
            length[node as usize] = 0.0;
            queue.push(Reverse((0u64, node)));
        }
        // Bits of numbers that are not negative are in the numbers' order.
        while let Some(Reverse((bits, node))) = queue.pop() {
            let here = f64::from_bits(bits);
            if here > length[node as usize] {
                continue;
            }
            for &(next, way) in &self.ends[self.start[node as usize]..self.start[node as usize + 1]] {
                let there = here + way;
                if there <= limit && there < length[next as usize] && open(next) {
                    length[next as usize] = there;
                    queue.push(Reverse((there.to_bits(), next)));
                }
            }
        }
        length
    }
}

/// A part with what surrounds it.
struct Surroundings {
    part: usize,
    /// Own tetrahedra first.
    tets: Vec<usize>,
    own: usize,
    /// Interfaces, with the nodes held beyond them and the length of the way to the surroundings' nodes.
    sides: Vec<(usize, Vec<u32>, Vec<f64>)>,
    controls: Vec<usize>,
}

impl Surroundings {
    fn find(body: &Body<'_>, faces: &[Face<'_>], roads: &Roads, part: usize, margin: f64) -> Surroundings {
        let (mesh, cut) = (body.mesh, body.cut);
        let own: Vec<usize> = (0..mesh.tets.len()).filter(|&tet| cut.part[tet] == part).collect();
        let mut is_own = vec![false; mesh.nodes.len()];
        own.iter().flat_map(|&tet| mesh.tets[tet]).for_each(|node| is_own[node as usize] = true);
        let touches = |control: &ControlElement| control.nodes.iter().any(|&node| is_own[node as usize]);
        let controls: Vec<usize> = (0..body.controls.len()).filter(|&e| touches(&body.controls[e])).collect();
        let mut all = Surroundings { part, own: own.len(), tets: own, sides: Vec::new(), controls };
        for (i, face) in faces.iter().enumerate().filter(|(_, face)| face.parts.contains(&part)) {
            let ways = roads.lengths(face.nodes, margin * face.radius, &|node| !is_own[node as usize]);
            let near = |node: u32| ways[node as usize].is_finite();
            let is_new =
                |&tet: &usize| cut.part[tet] != part && mesh.tets[tet].iter().all(|&node| near(node));
            let grown: Vec<usize> = (0..mesh.tets.len()).filter(is_new).collect();
            let held = all.frontier(body, &grown, &is_own);
            let offsets = quality::centroid(mesh, &held)
                .map(|origin| held.iter().map(|&node| mesh.nodes[node as usize] - origin).collect());
            if offsets.and_then(FrameFit::new).is_some() {
                let known: BTreeSet<usize> = all.tets.iter().copied().collect();
                all.tets.extend(grown.into_iter().filter(|tet| !known.contains(tet)));
                all.sides.push((i, held, ways));
            } else {
                // Nothing beyond it holds it: it is held itself.
                all.sides.push((i, face.nodes.to_vec(), Vec::new()));
            }
        }
        all
    }

    /// The nodes of `grown` tetrahedra that lie on others outside, or in a control element that is none of the part's.
    fn frontier(&self, body: &Body<'_>, grown: &[usize], is_own: &[bool]) -> Vec<u32> {
        let mesh = body.mesh;
        let mut inside = vec![false; mesh.tets.len()];
        grown.iter().chain(&self.tets).for_each(|&tet| inside[tet] = true);
        let mut on_others = vec![false; mesh.nodes.len()];
        for (tet, _) in inside.iter().enumerate().filter(|(_, inside)| !**inside) {
            mesh.tets[tet].iter().for_each(|&node| on_others[node as usize] = true);
        }
        for (e, control) in body.controls.iter().enumerate() {
            if !self.controls.contains(&e) {
                control.nodes.iter().for_each(|&node| on_others[node as usize] = true);
            }
        }
        let mut held: Vec<u32> = grown.iter().flat_map(|&tet| mesh.tets[tet]).collect();
        held.sort_unstable();
        held.dedup();
        held.retain(|&node| on_others[node as usize] && !is_own[node as usize]);
        held
    }

    fn solve(
        &self,
        body: &Body<'_>,
        faces: &[Face<'_>],
        progress: &dyn Progress,
    ) -> Result<(SolvedPart, FieldPlaces), BodyError> {
        let (mesh, parts) = (body.mesh, body.cut.parts);
        let mut nodes: Vec<u32> = self.tets.iter().flat_map(|&tet| mesh.tets[tet]).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let local = |node: u32| nodes.binary_search(&node).ok().map(|at| at as u32);
        let sub = TetMesh {
            nodes: nodes.iter().map(|&node| mesh.nodes[node as usize]).collect(),
            tags: nodes.iter().map(|&node| mesh.tags[node as usize]).collect(),
            tets: self.tets.iter().map(|&tet| mesh.tets[tet].map(|node| local(node).unwrap_or(0))).collect(),
            regions: self.tets.iter().map(|&tet| mesh.regions[tet]).collect(),
            ..TetMesh::default()
        };
        let lame: Vec<Lame> = self.tets.iter().map(|&tet| body.lame[tet]).collect();
        let (ends, joints) = self.ends(body, faces, &local);
        let coordinates = coordinates(ends.len(), self.controls.len());
        let tag = self.tets.first().map_or(0, |&tet| mesh.tags[mesh.tets[tet][0] as usize]);
        if ends.is_empty() {
            return Err(BodyError::Loose { part: self.part + 1, parts, tag });
        }
        if coordinates > MOST_COORDINATES {
            let ends = ends.len();
            return Err(BodyError::Ends { part: self.part + 1, parts, ends, coordinates });
        }
        let k = body.element.assemble(&sub, &lame)?;
        let geometry = tet4::Tetrahedra::new(&sub, &lame)?.geometry;
        let point = |(tet, element): (usize, &tet4::Geometry)| StrainPoint {
            nodes: sub.tets[tet].to_vec(),
            gradients: element.gradients.to_vec(),
            volume: element.volume,
            lame: lame[tet],
            is_own: tet < self.own,
        };
        let points: Vec<StrainPoint> = geometry.iter().enumerate().map(point).collect();
        let domain = Domain { nodes: &sub.nodes, points: &points, k: &k, ends: &ends };
        let solution = domain.solve(body.solver, progress).map_err(|source| BodyError::Part {
            part: self.part + 1,
            parts,
            tag,
            source,
        })?;
        let sides = self.sides.iter().map(|(face, _, ways)| (*face, ways.clone())).collect();
        let own = self.tets[..self.own].iter().flat_map(|&tet| mesh.tets[tet]).collect();
        Ok((SolvedPart { ends: joints, solution, shares: Vec::new() }, FieldPlaces { nodes, own, sides }))
    }

    /// Control elements first, then interfaces.
    fn ends(
        &self,
        body: &Body<'_>,
        faces: &[Face<'_>],
        local: &dyn Fn(u32) -> Option<u32>,
    ) -> (Vec<End>, Vec<Joint>) {
        let mesh = body.mesh;
        let mut taken = BTreeSet::new();
        let (mut ends, mut joints) = (Vec::new(), Vec::new());
        for &e in &self.controls {
            let control = &body.controls[e];
            let held: Vec<u32> = control.nodes.iter().filter_map(|&node| local(node)).collect();
            taken.extend(control.nodes.iter().copied());
            let origin = control.origin;
            ends.push(End { nodes: held.clone(), origin, held, held_origin: origin, is_control: true });
            joints.push(Joint::Control(e));
        }
        for (i, beyond, _) in &self.sides {
            let beyond: Vec<u32> = beyond.iter().copied().filter(|&node| taken.insert(node)).collect();
            let here = |nodes: &[u32]| nodes.iter().filter_map(|&node| local(node)).collect();
            ends.push(End {
                nodes: here(faces[*i].nodes),
                origin: faces[*i].origin,
                held_origin: quality::centroid(mesh, &beyond).unwrap_or(faces[*i].origin),
                held: here(&beyond),
                is_control: false,
            });
            joints.push(Joint::Interface(*i));
        }
        (ends, joints)
    }
}

/// Places of a part's fields in the mesh.
struct FieldPlaces {
    /// Ascending mesh nodes of the fields.
    nodes: Vec<u32>,
    /// Nodes of the part itself, in any order.
    own: Vec<u32>,
    /// Interfaces of the part, and the distances from each of the nodes beyond.
    sides: Vec<(usize, Vec<f64>)>,
}

/// Gives each surface node to its part, and near an interface to both.
fn share_nodes(body: &Body<'_>, faces: &[Face<'_>], parts: &mut [(SolvedPart, FieldPlaces)]) {
    let on_surface = |nodes: &mut dyn Iterator<Item = u32>| -> Vec<usize> {
        nodes.filter_map(|node| body.surface.nodes.binary_search(&node).ok()).collect()
    };
    // Shares as they are asked for, by surface node: the owner's are what the others leave.
    let mut asked: Vec<Vec<(usize, f64)>> = vec![Vec::new(); body.surface.nodes.len()];
    let mut owner = vec![usize::MAX; body.surface.nodes.len()];
    for (part, (_, placed)) in parts.iter().enumerate() {
        for at in on_surface(&mut placed.own.iter().copied()) {
            owner[at] = owner[at].min(part);
        }
    }
    for (part, (_, placed)) in parts.iter().enumerate() {
        for (face, ways) in placed.sides.iter().filter(|(_, ways)| !ways.is_empty()) {
            let width =
                (SHARED[0] * MARGIN * faces[*face].radius).min(SHARED[1] * shortest(faces, *face, body));
            for (at, &node) in body.surface.nodes.iter().enumerate() {
                let way = ways[node as usize] / width;
                let is_known = placed.nodes.binary_search(&node).is_ok();
                if way < 1.0 && is_known && owner[at] != part && faces[*face].parts.contains(&owner[at]) {
                    asked[at].push((part, 0.5 - 0.25 * way * (3.0 - way * way)));
                }
            }
        }
    }
    for (at, mut shares) in asked.into_iter().enumerate() {
        let sum: f64 = shares.iter().map(|(_, share)| share).sum();
        shares.push((owner[at], (1.0 - sum).max(0.25)));
        let total = sum + (1.0 - sum).max(0.25);
        for (part, share) in shares {
            let Some((solved, placed)) = parts.get_mut(part) else { continue };
            if let Ok(row) = placed.nodes.binary_search(&body.surface.nodes[at])
                && share > 0.0
            {
                solved.shares.push((at as u32, share / total, row));
            }
        }
    }
}

/// The shortest way from an interface to another end of one of its parts.
fn shortest(faces: &[Face<'_>], face: usize, body: &Body<'_>) -> f64 {
    let [p, q] = faces[face].parts;
    let others = faces.iter().enumerate().filter(|(other, _)| *other != face);
    let near = others.filter(|(_, other)| other.parts.contains(&p) || other.parts.contains(&q));
    let ways = near.map(|(_, other)| (other.origin - faces[face].origin).norm());
    let to_controls = body.controls.iter().map(|control| (control.origin - faces[face].origin).norm());
    ways.chain(to_controls).fold(f64::INFINITY, f64::min)
}

/// The displacements that a part has at a node: those of first order, then those of second order by the screws.
pub fn shape(solution: &PartSolution, screws: usize, row: usize) -> Vec<Vector3<f64>> {
    let of =
        |fields: &NodeFields, column: usize| Vector3::from_fn(|axis, _| fields.row(3 * row + axis)[column]);
    let first = (0..solution.first.columns).map(|column| of(&solution.first, column));
    let pairs = super::second_order::pairs(solution.first.columns);
    let by_screws = pairs.iter().enumerate().filter(|(_, (_, j))| *j < 6 * screws);
    first.chain(by_screws.map(|(column, _)| of(&solution.second, column))).collect()
}
