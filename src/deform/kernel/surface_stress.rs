//! Strain and stress on the surface of a deformed body, from the shape of its surface alone.
//!
//! In: the surface at rest, the displacements of its nodes, and the law and constants of what lies behind each triangle. Out:
//! von Mises stress and largest principal strain at the nodes. With D the displacement's gradient in a triangle's plane,
//!
//! ```text
//! 2 E_ab = e_a·D_b + D_a·e_b + D_a·D_b     λ_i² = 1 + 2 E_i     σ₃ = 0 gives λ₃ and σ₁, σ₂ (`fem::FreeFace`)
//! ```
//!
//! so that a rotation, however large, is no strain. The displacements of small-strain theory are no such shape: a slender part that
//! they turn by θ seems longer by θ²/2, which its forces know nothing of. Of them the strain is linear, 2 E_ab = e_a·D_b + D_a·e_b
//! and λ_i = 1 + E_i ([`Strain`]). A body that warmth makes longer by s where it is free has the gradient
//! I + D over s there: what it expands by itself is no strain and no stress. Where loads act on a triangle by known tractions t, what
//! they do while the triangle keeps its shape is added, by Hooke's law,
//!
//! ```text
//! σ₃₃ = t₃   σ₃₁ = t₁   σ₃₂ = t₂   σ₁₁, σ₂₂ + t₃ λ/(λ + 2μ)   ε₃₃ + t₃/(λ + 2μ)   ε₃₁ + t₁/2μ   ε₃₂ + t₂/2μ
//! ```
//!
//! which is all of it for small strain, and for laws of large strain but for parts of the order of (t/μ)². Both tensors are turned
//! back into the body at rest, where a node takes the mean of the triangles around it, weighed by area at rest. The nodes lie on
//! the surface itself, so a bent body has the stress of its outermost fibre, which a mean over the tetrahedra below would miss.
//! Triangles inside control elements are left out: forces of unknown share act there. Where materials meet, a node has that of its
//! materials which is nearest to its limit.

use crate::fem::{FreeFace, Lame};
use nalgebra::Vector3;
use rayon::prelude::*;

/// A surface and what lies behind it.
pub struct SurfaceParts<'a> {
    /// Nodes at rest about any origin, m.
    pub rest: &'a [[f32; 3]],
    pub triangles: &'a [[u32; 3]],
    /// Index of each triangle's material; where it is empty, all have the first.
    pub material: &'a [u8],
    /// Lamé's moduli of each material.
    pub lame: &'a [Lame],
    /// The nodes of each control element.
    pub held: &'a [Vec<u32>],
    pub law: fn([f64; 2], Lame) -> FreeFace,
}

/// A surface whose strain is asked for.
pub struct SurfaceStress {
    faces: Vec<Face>,
    /// A node and its triangles of one material: those of row r are `around[start[r]..start[r + 1]]`.
    rows: Vec<Row>,
    around: Vec<u32>,
    lame: Vec<Lame>,
    law: fn([f64; 2], Lame) -> FreeFace,
    nodes: usize,
    /// Area of each node: a third of the triangles around it, at rest, m².
    pub areas: Vec<f64>,
}

/// The strain that follows from displacements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Strain {
    /// Strain of small-strain theory, to which the displacements belong.
    Small,
    /// Strain of the shape that the displacements make.
    Finite,
}

/// Tractions on the triangles of a surface, Pa on the area at rest; either list may be empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FaceLoads {
    /// Tractions that turn with their triangle, on the axes of the body at rest.
    pub follows: Vec<Vector3<f64>>,
    /// Tractions that keep their direction.
    pub fixed: Vec<Vector3<f64>>,
}

/// Stress and strain at one node.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeStress {
    /// Pa.
    pub von_mises: f64,
    /// The largest of λ₁, λ₂, λ₃, less 1.
    pub strain: f64,
    /// Material of both.
    pub material: u8,
}

/// A triangle that no control element holds.
struct Face {
    /// Index of the triangle in the surface.
    number: usize,
    nodes: [u32; 3],
    /// e₁, e₂ and the normal e₁ × e₂.
    axes: [Vector3<f64>; 3],
    /// X₁ - X₀ = (length, 0), X₂ - X₀ = (along, width) on these axes, m.
    length: f64,
    along: f64,
    width: f64,
    material: u8,
}

struct Row {
    node: u32,
    material: u8,
    end: u32,
}

/// Symmetric: xx, yy, zz, yz, zx, xy.
type Tensor = [f64; 6];

impl SurfaceStress {
    pub fn new(parts: &SurfaceParts<'_>) -> SurfaceStress {
        let nodes = parts.rest.len();
        let mut owners = vec![0_u64; nodes];
        for (e, held) in parts.held.iter().enumerate() {
            // Two of so many elements share a bit; a triangle between them would be left out, no more.
            held.iter().for_each(|&node| owners[node as usize] |= 1 << (e % 64));
        }
        let mut faces = Vec::new();
        for (t, triangle) in parts.triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(|node| node as usize);
            let material = parts.material.get(t).copied().unwrap_or(0);
            let is_held = owners[a] & owners[b] & owners[c] != 0;
            let corners = [a, b, c].map(|node| Vector3::from(parts.rest[node]).cast::<f64>());
            faces.extend(Face::new(t, *triangle, corners, material).filter(|_| !is_held));
        }
        let mut areas = vec![0.0; nodes];
        let mut corners = Vec::with_capacity(3 * faces.len());
        for (f, face) in (0_u32..).zip(&faces) {
            for node in face.nodes {
                areas[node as usize] += face.area() / 3.0;
                corners.push((node, face.material, f));
            }
        }
        corners.sort_unstable();
        let mut rows: Vec<Row> = Vec::new();
        for (end, &(node, material, _)) in (1_u32..).zip(&corners) {
            match rows.last_mut() {
                Some(row) if (row.node, row.material) == (node, material) => row.end = end,
                _ => rows.push(Row { node, material, end }),
            }
        }
        let around = corners.into_iter().map(|(_, _, face)| face).collect();
        SurfaceStress { faces, rows, around, lame: parts.lame.to_vec(), law: parts.law, nodes, areas }
    }

    /// Stress at every node by the displacements u of all, with this strain, where warmth lengthens what is free by the factor
    /// `stretch` and `loads` act; `None` amid control elements. `share` is the part of its limit that a node of a material has
    /// reached, or another measure: where materials meet, the larger one is shown.
    pub fn at_nodes(
        &self,
        u: &[Vector3<f64>],
        stretch: f64,
        of: Strain,
        loads: &FaceLoads,
        share: impl Fn(&NodeStress) -> f64 + Sync,
    ) -> Vec<Option<NodeStress>> {
        let of_face = |face: &Face| {
            let lame = self.lame.get(usize::from(face.material)).copied();
            lame.map_or(([0.0; 6], [0.0; 6]), |lame| face.tensors((u, stretch, of), loads, self.law, lame))
        };
        let tensors: Vec<(Tensor, Tensor)> = self.faces.par_iter().with_min_len(1024).map(of_face).collect();
        let starts = std::iter::once(0).chain(self.rows.iter().map(|row| row.end));
        let mut found: Vec<Option<NodeStress>> = vec![None; self.nodes];
        for (start, row) in starts.zip(&self.rows) {
            let around = &self.around[start as usize..row.end as usize];
            let (mut stress, mut strain, mut whole) = ([0.0; 6], [0.0; 6], 0.0);
            for &face in around {
                let area = self.faces[face as usize].area();
                let (of_stress, of_strain) = &tensors[face as usize];
                for k in 0..6 {
                    stress[k] += area * of_stress[k];
                    strain[k] += area * of_strain[k];
                }
                whole += area;
            }
            let mean = |tensor: Tensor| tensor.map(|part| part / whole);
            let here = NodeStress {
                von_mises: von_mises(&mean(stress)),
                strain: largest(&mean(strain)),
                material: row.material,
            };
            let kept = &mut found[row.node as usize];
            if kept.is_none_or(|kept| share(&here) > share(&kept)) {
                *kept = Some(here);
            }
        }
        found
    }
}

impl Face {
    /// `None` of a triangle without area.
    fn new(number: usize, nodes: [u32; 3], [a, b, c]: [Vector3<f64>; 3], material: u8) -> Option<Face> {
        let (ab, ac) = (b - a, c - a);
        let length = ab.norm();
        let first = ab.try_normalize(0.0)?;
        let along = ac.dot(&first);
        let across = ac - first * along;
        let width = across.norm();
        if width <= 1e-9 * length.max(along.abs()) {
            return None;
        }
        let second = across / width;
        let axes = [first, second, first.cross(&second)];
        Some(Face { number, nodes, axes, length, along, width, material })
    }

    fn area(&self) -> f64 {
        0.5 * self.length * self.width
    }

    /// σ and U - I, turned back into the body at rest.
    fn tensors(
        &self,
        (u, stretch, of): (&[Vector3<f64>], f64, Strain),
        loads: &FaceLoads,
        law: fn([f64; 2], Lame) -> FreeFace,
        lame: Lame,
    ) -> (Tensor, Tensor) {
        let [a, b, c] = self.nodes.map(|node| u[node as usize]);
        let [first, second, normal] = &self.axes;
        let d1 = (b - a) / self.length;
        let d2 = ((c - a) - d1 * self.along) / self.width;
        // F = I + D is s times what strains the body.
        let [d1, d2] = [(d1, first), (d2, second)].map(|(d, axis)| (d - axis * (stretch - 1.0)) / stretch);
        let [t1, t2, t3] = self.traction(loads, of, [d1, d2]);
        let squares = match of {
            Strain::Small => [0.0; 3],
            Strain::Finite => [d1.norm_squared(), d2.norm_squared(), d1.dot(&d2)],
        };
        let xx = first.dot(&d1) + 0.5 * squares[0];
        let yy = second.dot(&d2) + 0.5 * squares[1];
        let xy = 0.5 * (first.dot(&d2) + second.dot(&d1) + squares[2]);
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let radius = half.hypot(xy);
        // λ - 1 of 1 + 2 E, with all its digits; a triangle that is pressed flat has λ = 0.
        let stretch = |e: f64| match of {
            Strain::Small => e,
            Strain::Finite => 2.0 * e / (1.0 + (1.0 + 2.0 * e).max(0.0).sqrt()),
        };
        let stretches = [mean + radius, mean - radius].map(stretch);
        let FreeFace { across, stress } = law(stretches, lame);
        // What has these values on the principal axes of E, on the axes of the triangle.
        let turned = |[one, other]: [f64; 2]| {
            let (mean, part) = (0.5 * (one + other), 0.5 * (one - other));
            let part = if radius > 0.0 { part / radius } else { 0.0 };
            [mean + part * half, mean - part * half, part * xy]
        };
        let tensor = |[xx, yy, xy]: [f64; 3], [zx, yz, zz]: [f64; 3]| {
            let entry = |i: usize, j: usize| {
                first[i] * first[j] * xx
                    + second[i] * second[j] * yy
                    + (first[i] * second[j] + second[i] * first[j]) * xy
                    + (first[i] * normal[j] + normal[i] * first[j]) * zx
                    + (second[i] * normal[j] + normal[i] * second[j]) * yz
                    + normal[i] * normal[j] * zz
            };
            [entry(0, 0), entry(1, 1), entry(2, 2), entry(1, 2), entry(2, 0), entry(0, 1)]
        };
        let stiffness = lame.lambda + 2.0 * lame.mu;
        let own = stress.map(|stress| stress + t3 * lame.lambda / stiffness);
        let [shear1, shear2] = [t1, t2].map(|t| 0.5 * t / lame.mu);
        (
            tensor(turned(own), [t1, t2, t3]),
            tensor(turned(stretches), [shear1, shear2, across + t3 / stiffness]),
        )
    }

    /// The traction on its own axes, Pa on the area that the strain means, where its edges move by these gradients.
    fn traction(&self, loads: &FaceLoads, of: Strain, [d1, d2]: [Vector3<f64>; 2]) -> [f64; 3] {
        let of_loads = |all: &[Vector3<f64>]| all.get(self.number).copied().unwrap_or_default();
        let on = |axes: &[Vector3<f64>; 3], t: Vector3<f64>| axes.map(|axis| axis.dot(&t));
        let (follows, fixed) = (of_loads(&loads.follows), of_loads(&loads.fixed));
        let [first, second, _] = self.axes;
        if of == Strain::Small {
            return on(&self.axes, follows + fixed);
        }
        let across = (first + d1).cross(&(second + d2));
        let area = across.norm();
        let Some(one) = (first + d1).try_normalize(0.0).filter(|_| area > 0.0) else { return [0.0; 3] };
        let normal = across / area;
        let (own, turned) = (on(&self.axes, follows), on(&[one, normal.cross(&one), normal], fixed));
        [0, 1, 2].map(|k| (own[k] + turned[k]) / area)
    }
}

/// √(3/2 s:s) with s the deviator.
fn von_mises(&[xx, yy, zz, yz, zx, xy]: &Tensor) -> f64 {
    let normal = (xx - yy).powi(2) + (yy - zz).powi(2) + (zz - xx).powi(2);
    (0.5 * normal + 3.0 * (yz * yz + zx * zx + xy * xy)).sqrt()
}

/// The largest principal value, in closed form (Smith, Comm. ACM 4, 1961, 168).
fn largest(&[xx, yy, zz, yz, zx, xy]: &Tensor) -> f64 {
    let mean = (xx + yy + zz) / 3.0;
    let [a, b, c] = [xx - mean, yy - mean, zz - mean];
    let shear = yz * yz + zx * zx + xy * xy;
    let size = ((a * a + b * b + c * c + 2.0 * shear) / 6.0).sqrt();
    if size <= 0.0 {
        return mean;
    }
    let [a, b, c, yz, zx, xy] = [a, b, c, yz, zx, xy].map(|part| part / size);
    let determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * zx) + zx * (xy * yz - b * zx);
    mean + 2.0 * size * ((0.5 * determinant).clamp(-1.0, 1.0).acos() / 3.0).cos()
}

#[cfg(test)]
mod tests;
