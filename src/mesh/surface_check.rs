//! Finds the defects of a triangle surface, and makes the repairs that are unambiguous.
//!
//! In: a [`TriangleSurface`]. Out: the same with outward triangles (cavities inward), and a [`SurfaceReport`]: shells,
//! holes, edges of three triangles and more, places where it passes through itself, volume. Winding numbers by solid
//! angles: Van Oosterom and Strackee (IEEE Trans. Biomed. Eng. 30, 1983).

use super::shells::solid_angle;
use super::surface_files::TriangleSurface;
use super::surface_intersect::{Intersections, intersections};
use crate::base::extent::bounding_box;
use crate::base::table::count;
use nalgebra::Vector3;
use serde::Serialize;
use std::collections::VecDeque;

/// The report of `inspect` on a surface; lengths in m.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SurfaceReport {
    pub vertices: usize,
    pub triangles: usize,
    /// Pieces whose triangles are joined through edges, in the order of their first triangles in the file.
    pub shells: Vec<Shell>,
    pub bounding_box: [[f64; 3]; 2],
    pub area: f64,
    /// Volume inside the surface, without cavities. It means nothing for an open surface.
    pub volume: f64,
    /// Loops of edges that an odd number of triangles share, mostly one.
    pub holes: Vec<Hole>,
    /// Edges of three triangles or more: how many, and the middle of the first.
    pub crowded_edges: usize,
    pub crowded_at: Option<[f64; 3]>,
    /// Edges at which outside and inside cannot be distinguished whichever way the triangles are turned (a Möbius band).
    pub unorientable_edges: usize,
    pub intersections: Intersections,
    /// Triangles without area.
    pub flat: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Shell {
    pub triangles: usize,
    pub volume: f64,
    /// Whether it lies inside an odd number of other shells.
    pub is_cavity: bool,
}

/// A loop of boundary edges: how many, and the middle of its vertices.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Hole {
    pub edges: usize,
    pub at: [f64; 3],
}

/// Number of vertices of a shell for which is tested whether they lie inside another shell.
const SAMPLES: usize = 16;
/// No further shell is tested after this many solid angles.
const MOST_SOLID_ANGLES: usize = 50_000_000;

/// Turns the triangles of every shell one way, outward or into a cavity, and reports the remaining defects. Notes of the
/// turned triangles are added to `notices`.
pub fn check(surface: &mut TriangleSurface, notices: &mut Vec<String>) -> SurfaceReport {
    let edges = Edges::new(surface);
    let (shell_of, turned, unorientable_edges) = orient(surface, &edges);
    let mut report = SurfaceReport {
        vertices: surface.vertices.len(),
        triangles: surface.triangles.len(),
        shells: Vec::new(),
        bounding_box: {
            let (low, high) = bounding_box(&surface.vertices);
            [low.into(), high.into()]
        },
        area: 0.0,
        volume: 0.0,
        holes: holes(surface, &edges),
        crowded_edges: 0,
        crowded_at: None,
        unorientable_edges,
        intersections: intersections(surface),
        flat: 0,
    };
    for group in edges.groups().filter(|group| group.len() > 2) {
        report.crowded_edges += 1;
        report.crowded_at.get_or_insert_with(|| middle(surface, &group[0].0));
    }
    if turned > 0 {
        notices.push(format!("{turned} triangles were turned round, so that neighbours agree"));
    }
    report.shells = shells(surface, &shell_of);
    if report.is_closed() {
        turn_shells(surface, &shell_of, &mut report.shells, notices);
    }
    report.volume = report.shells.iter().map(|shell| shell.volume).sum();
    for t in 0..surface.triangles.len() {
        let [a, b, c] = surface.corners(t);
        let area = (b - a).cross(&(c - a)).norm() / 2.0;
        let longest = (b - a).norm_squared().max((c - a).norm_squared()).max((c - b).norm_squared());
        report.flat += usize::from(area <= 1e-12 * longest);
        report.area += area;
    }
    report
}

impl SurfaceReport {
    /// Whether the surface has an inside.
    pub fn is_closed(&self) -> bool {
        self.holes.is_empty() && self.unorientable_edges == 0
    }

    /// A sentence about each kind of defect, the worst first; none for a sound surface.
    pub fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        let place = |[x, y, z]: &[f64; 3]| format!("({x:.6}, {y:.6}, {z:.6})");
        if let Some(first) = self.holes.first() {
            let some: Vec<String> = self.holes.iter().take(5).map(|hole| place(&hole.at)).collect();
            faults.push(format!(
                "{}: loops of edges that belong to one triangle only, the first of {} edges; near {}{}",
                count(self.holes.len(), "hole"),
                first.edges,
                some.join(", "),
                if self.holes.len() > some.len() { ", …" } else { "" }
            ));
        }
        if self.unorientable_edges > 0 {
            faults.push(format!(
                "{} edges where the two sides cannot be told apart (a Möbius band)",
                self.unorientable_edges
            ));
        }
        if let (crowded @ 1.., Some(at)) = (self.crowded_edges, &self.crowded_at) {
            faults.push(format!("{crowded} edges of three triangles or more, the first near {}", place(at)));
        }
        if self.intersections.pairs > 0 {
            let some: Vec<String> = self.intersections.places.iter().take(3).map(place).collect();
            faults.push(format!(
                "it passes through itself: {}{} pairs of triangles, the first {} and {}; near {}",
                self.intersections.pairs,
                if self.intersections.is_complete { "" } else { " or more" },
                self.intersections.first[0],
                self.intersections.first[1],
                some.join(", ")
            ));
        }
        faults
    }
}

/// The edges of all triangles, sorted: the vertices in ascending order, the triangle, and whether the triangle runs from the
/// lower to the higher vertex. Equal edges are neighbours.
struct Edges(Vec<([u32; 2], u32, bool)>);

impl Edges {
    fn new(surface: &TriangleSurface) -> Edges {
        let mut edges = Vec::with_capacity(3 * surface.triangles.len());
        for (t, [a, b, c]) in (0u32..).zip(&surface.triangles) {
            for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
                edges.push(([from.min(to), from.max(to)], t, from < to));
            }
        }
        edges.sort_unstable();
        Edges(edges)
    }

    fn groups(&self) -> impl Iterator<Item = &[([u32; 2], u32, bool)]> {
        self.0.chunk_by(|a, b| a.0 == b.0)
    }
}

fn middle(surface: &TriangleSurface, vertices: &[u32]) -> [f64; 3] {
    let sum: Vector3<f64> = vertices.iter().map(|&v| surface.vertices[v as usize]).sum();
    (sum / vertices.len().max(1) as f64).into()
}

/// Makes neighbours across every edge of two triangles agree, starting from the first triangle of each shell. Returns the
/// shell of each triangle (joined through edges), the number of turned triangles, and the number of edges that still
/// disagree.
fn orient(surface: &mut TriangleSurface, edges: &Edges) -> (Vec<u32>, usize, usize) {
    let count = surface.triangles.len();
    let mut links: Vec<(u32, u32, bool)> = Vec::new();
    for group in edges.groups() {
        for pair in group.windows(2) {
            // An edge of three triangles or more joins them into one shell, but demands no direction.
            let disagree = group.len() == 2 && pair[0].2 == pair[1].2;
            links.push((pair[0].1, pair[1].1, disagree));
            links.push((pair[1].1, pair[0].1, disagree));
        }
    }
    links.sort_unstable();
    let first: Vec<usize> = (0..=count as u32).map(|t| links.partition_point(|link| link.0 < t)).collect();
    let (mut shell_of, mut flip) = (vec![u32::MAX; count], vec![false; count]);
    let (mut shells, mut contradictions) = (0, 0);
    let mut flips_of_shell: Vec<(usize, usize)> = Vec::new();
    for start in 0..count {
        if shell_of[start] != u32::MAX {
            continue;
        }
        shell_of[start] = shells;
        let mut queue = VecDeque::from([start]);
        let (mut members, mut flipped) = (0, 0);
        while let Some(t) = queue.pop_front() {
            members += 1;
            flipped += usize::from(flip[t]);
            for &(_, next, disagree) in &links[first[t]..first[t + 1]] {
                let next = next as usize;
                if shell_of[next] == u32::MAX {
                    shell_of[next] = shells;
                    flip[next] = flip[t] != disagree;
                    queue.push_back(next);
                } else if (flip[next] != flip[t]) != disagree && edge_of_two(edges, surface, t, next) {
                    contradictions += 1;
                }
            }
        }
        flips_of_shell.push((members, flipped));
        shells += 1;
    }
    let mut turned = 0;
    for t in 0..count {
        // The smaller part of a shell is turned.
        let (members, flipped) = flips_of_shell[shell_of[t] as usize];
        if flip[t] != (2 * flipped > members) {
            surface.triangles[t].swap(1, 2);
            turned += 1;
        }
    }
    (shell_of, turned, contradictions / 2)
}

/// Whether two triangles share an edge that belongs to no third one: only across such an edge must they agree.
fn edge_of_two(edges: &Edges, surface: &TriangleSurface, t: usize, next: usize) -> bool {
    let [a, b, c] = surface.triangles[t];
    [(a, b), (b, c), (c, a)].into_iter().any(|(from, to)| {
        let key = [from.min(to), from.max(to)];
        let begin = edges.0.partition_point(|edge| edge.0 < key);
        let group: Vec<_> = edges.0[begin..].iter().take_while(|edge| edge.0 == key).take(3).collect();
        group.len() == 2 && group.iter().any(|edge| edge.1 as usize == next)
    })
}

/// Loops of edges that an odd number of triangles share.
fn holes(surface: &TriangleSurface, edges: &Edges) -> Vec<Hole> {
    let open: Vec<[u32; 2]> =
        edges.groups().filter(|group| group.len() % 2 == 1).map(|group| group[0].0).collect();
    let mut ends: Vec<(u32, usize)> =
        open.iter().enumerate().flat_map(|(e, edge)| edge.map(|vertex| (vertex, e))).collect();
    ends.sort_unstable();
    let mut seen = vec![false; open.len()];
    let mut holes = Vec::new();
    for start in 0..open.len() {
        if std::mem::replace(&mut seen[start], true) {
            continue;
        }
        let mut stack = vec![start];
        let mut vertices = Vec::new();
        let mut count = 0;
        while let Some(edge) = stack.pop() {
            count += 1;
            for vertex in open[edge] {
                vertices.push(vertex);
                let begin = ends.partition_point(|end| end.0 < vertex);
                for &(_, next) in ends[begin..].iter().take_while(|end| end.0 == vertex) {
                    if !std::mem::replace(&mut seen[next], true) {
                        stack.push(next);
                    }
                }
            }
        }
        holes.push(Hole { edges: count, at: middle(surface, &vertices) });
    }
    holes
}

fn shells(surface: &TriangleSurface, shell_of: &[u32]) -> Vec<Shell> {
    let count = shell_of.iter().max().map_or(0, |&last| last as usize + 1);
    let mut shells = vec![Shell { triangles: 0, volume: 0.0, is_cavity: false }; count];
    let origin = surface.vertices.first().copied().unwrap_or_default();
    for (t, &shell) in shell_of.iter().enumerate() {
        let [a, b, c] = surface.corners(t).map(|corner| corner - origin);
        shells[shell as usize].triangles += 1;
        shells[shell as usize].volume += a.dot(&b.cross(&c)) / 6.0;
    }
    shells
}

/// Turns whole shells: those inside an even number of others enclose matter, the others a cavity.
fn turn_shells(
    surface: &mut TriangleSurface,
    shell_of: &[u32],
    shells: &mut [Shell],
    notices: &mut Vec<String>,
) {
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); shells.len()];
    shell_of.iter().enumerate().for_each(|(t, &shell)| members[shell as usize].push(t));
    let boxes: Vec<_> = members
        .iter()
        .map(|triangles| {
            let corners: Vec<_> = triangles.iter().flat_map(|&t| surface.corners(t)).collect();
            bounding_box(&corners)
        })
        .collect();
    let mut budget = MOST_SOLID_ANGLES;
    let mut turned = Vec::new();
    for (s, triangles) in members.iter().enumerate() {
        let (mut deep, mut tested) = (0, 0);
        let mut vertices: Vec<u32> = triangles.iter().flat_map(|&t| surface.triangles[t]).collect();
        vertices.sort_unstable();
        vertices.dedup();
        for &vertex in vertices.iter().step_by(vertices.len().div_ceil(SAMPLES).max(1)) {
            let point = surface.vertices[vertex as usize];
            let mut depth = 0;
            for (o, others) in members.iter().enumerate() {
                let (low, high) = &boxes[o];
                let within = (0..3).all(|axis| low[axis] <= point[axis] && point[axis] <= high[axis]);
                if o == s || !within || others.len() > budget {
                    continue;
                }
                budget -= others.len();
                depth += usize::from(winding(surface, others, &point).abs() > 0.5);
            }
            tested += 1;
            deep += depth % 2;
        }
        // A shell that passes through another lies inside it with some of its vertices only.
        shells[s].is_cavity = deep == tested;
        if (shells[s].volume < 0.0) != shells[s].is_cavity {
            shells[s].volume = -shells[s].volume;
            triangles.iter().for_each(|&t| surface.triangles[t].swap(1, 2));
            turned.push(if shells[s].is_cavity { "into a cavity" } else { "inside out" });
        }
    }
    let inside_out = turned.iter().filter(|how| **how == "inside out").count();
    if inside_out > 0 {
        notices.push(format!("{inside_out} of {} shells were inside out and were turned", shells.len()));
    }
    if turned.len() > inside_out {
        let cavities = turned.len() - inside_out;
        notices.push(format!("{cavities} shells lie inside another and were taken for cavities"));
    }
}

/// The number of times that the triangles wind about `point`: 1 inside a closed outward surface, 0 outside.
fn winding(surface: &TriangleSurface, triangles: &[usize], point: &Vector3<f64>) -> f64 {
    let angle = |&t: &usize| solid_angle(surface.corners(t), point);
    triangles.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
}
