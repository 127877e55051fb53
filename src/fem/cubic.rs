//! The cubic part of the strain energy of displacement fields, under the St. Venant–Kirchhoff law.
//!
//! In: an element, a mesh and fields u_k over all nodes. Out: with H = ∇u and the linear stress C:ε of the element,
//!
//! ```text
//! Θ(c) = ∫ (C:ε) : ½ HᵀH dV     u = Σ c_k u_k     Θ = Σ_{p≤q≤r} θ_pqr c_p c_q c_r
//! ```
//!
//! W = ½ ∫ E:C:E with Green's strain E = ε + ½ HᵀH has no other term of third order. The element's own dilatation θ takes
//! the place of tr ε where λ multiplies it ([`Dilatation`]).

use super::assembly::AssemblyError;
use super::element::{Dilatation, Element};
use super::lame::Lame;
use super::products::add_dyad;
use super::stiffness::NodeFields;
use super::{tet4, tet10};
use crate::mesh::{TetMesh, quadratic};
use nalgebra::{DMatrix, Matrix3, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Partial sums that are computed in parallel; their number is fixed, so that the result has the same bits on every
/// number of threads.
const PARTS: usize = 16;
/// Rows of stresses that are collected before they are multiplied.
const ROWS: usize = 384;

/// One integration point: its nodes, its share of the volume, the shape gradients.
struct Point<'a> {
    nodes: &'a [u32],
    volume: f64,
    gradients: &'a [Vector3<f64>],
}

/// θ_pqr, r running fastest, then q. Errors as [`Element::assemble`].
pub fn cubic_energy(
    element: &Element,
    mesh: &TetMesh,
    lame: &[Lame],
    fields: &NodeFields,
) -> Result<Vec<f64>, AssemblyError> {
    // Refuses what the element refuses.
    element.sets_of(mesh, lame)?;
    let (n, tets) = (fields.columns, mesh.tets.len());
    let nodal = match element.dilatation {
        Dilatation::Own => None,
        Dilatation::Nodal => Some(NodalDilatation::from_fields(mesh, lame, fields)),
    };
    let width = tets.div_ceil(PARTS).max(1);
    let parts: Vec<DMatrix<f64>> = (0..tets.div_ceil(width))
        .into_par_iter()
        .map(|part| {
            let mut rows = Rows::new(n);
            for tet in part * width..((part + 1) * width).min(tets) {
                rows.take_element(mesh, lame[tet], tet, fields, nodal.as_ref());
            }
            rows.multiply();
            rows.sum
        })
        .collect();
    let mut total = DMatrix::zeros(n * (n + 1) / 2, n);
    parts.iter().for_each(|part| total += part);
    Ok(symmetric(n, &total))
}

/// Σ over the three ways to take one index of {p, q, r} as the stress's, each pair once.
fn symmetric(n: usize, stress_of: &DMatrix<f64>) -> Vec<f64> {
    // Of pair (q, r), q ≤ r, in the order of `Rows`.
    let pair = |q: usize, r: usize| q * n - q * (q + 1) / 2 + r;
    let mut theta = Vec::new();
    for p in 0..n {
        for q in p..n {
            for r in q..n {
                let ways = [(p, pair(q, r)), (q, pair(p, r)), (r, pair(p, q))];
                let mut sum = 0.0;
                for (way, (index, pair)) in ways.iter().enumerate() {
                    // Equal ways are one.
                    if !ways[..way].contains(&(*index, *pair)) {
                        sum += stress_of[(*pair, *index)];
                    }
                }
                theta.push(sum);
            }
        }
    }
    theta
}

/// Six rows for each point: the stresses of all fields, and the products of their gradients, to be multiplied together.
struct Rows {
    fields: usize,
    rows: usize,
    stresses: Vec<f64>,
    products: Vec<f64>,
    /// Row (q, r), q ≤ r, column p: Σ vol (C:ε_p) : H_qᵀH_r, half of it where q = r.
    sum: DMatrix<f64>,
    gradients: Vec<Matrix3<f64>>,
}

/// Rows and columns of the six entries of a symmetric matrix.
const PLACES: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

impl Rows {
    fn new(fields: usize) -> Rows {
        Rows {
            fields,
            rows: 0,
            stresses: Vec::new(),
            products: Vec::new(),
            sum: DMatrix::zeros(fields * (fields + 1) / 2, fields),
            gradients: Vec::new(),
        }
    }

    fn take_element(
        &mut self,
        mesh: &TetMesh,
        lame: Lame,
        tet: usize,
        fields: &NodeFields,
        nodal: Option<&NodalDilatation>,
    ) {
        if mesh.mids.is_empty() {
            let Some(geometry) = tet4::geometry(mesh.corners(tet)) else { return };
            let nodes = &mesh.tets[tet];
            let point = Point { nodes, volume: geometry.volume, gradients: &geometry.gradients };
            match nodal {
                None => self.take(&point, lame, fields, &|_, h| h.trace()),
                Some(nodal) => self.take(&point, lame, fields, &|k, _| nodal.mean(nodes, lame, k)),
            }
            return;
        }
        let nodes = quadratic::nodes(mesh, tet);
        let x = nodes.map(|node| mesh.nodes[node as usize]);
        let Some(points) = tet10::points(&x) else { return };
        let projected = tet10::dilatations(&points);
        for (at, point) in points.iter().enumerate() {
            let own_point = Point { nodes: &nodes, volume: point.volume, gradients: &point.gradients };
            match &projected {
                None => self.take(&own_point, lame, fields, &|_, h| h.trace()),
                Some(projected) => self.take(&own_point, lame, fields, &|k, _| {
                    let of_node =
                        |(a, &node): (usize, &u32)| projected[at][a].dot(&displacement(fields, node, k));
                    nodes.iter().enumerate().map(of_node).sum()
                }),
            }
        }
    }

    /// `dilatation` gives θ of a field, whose own gradient is H.
    fn take(
        &mut self,
        point: &Point<'_>,
        lame: Lame,
        fields: &NodeFields,
        dilatation: &dyn Fn(usize, &Matrix3<f64>) -> f64,
    ) {
        let n = self.fields;
        self.gradients.clear();
        for k in 0..n {
            let origin = displacement(fields, point.nodes[0], k);
            let mut sum = Matrix3::zeros();
            for (&node, gradient) in point.nodes.iter().zip(point.gradients).skip(1) {
                add_dyad(&mut sum, &(displacement(fields, node, k) - origin), gradient);
            }
            self.gradients.push(sum);
        }
        let stress = |k: usize| {
            let h = &self.gradients[k];
            let pressure = lame.lambda * dilatation(k, h);
            ((h + h.transpose()) * lame.mu + Matrix3::from_diagonal_element(pressure)) * point.volume
        };
        let stresses: Vec<Matrix3<f64>> = (0..n).map(stress).collect();
        for (place, &(i, j)) in PLACES.iter().enumerate() {
            // σ : A of symmetric matrices counts the places beside the diagonal twice.
            let weight = if place < 3 { 1.0 } else { 2.0 };
            self.stresses.extend(stresses.iter().map(|stress| weight * stress[(i, j)]));
            for q in 0..n {
                let (hq, hr) = (&self.gradients[q], &self.gradients[q..]);
                let (a, b) = (hq.column(i), hq.column(j));
                let product = |h: &Matrix3<f64>| 0.5 * (a.dot(&h.column(j)) + b.dot(&h.column(i)));
                let first = self.products.len();
                self.products.extend(hr.iter().map(product));
                // ½ HᵀH holds each pair of unequal fields twice.
                self.products[first] *= 0.5;
            }
        }
        self.rows += PLACES.len();
        if self.rows >= ROWS {
            self.multiply();
        }
    }

    fn multiply(&mut self) {
        let pairs = self.sum.nrows();
        let products = DMatrix::from_column_slice(pairs, self.rows, &self.products);
        let stresses = DMatrix::from_row_slice(self.rows, self.fields, &self.stresses);
        self.sum.gemm(1.0, &products, &stresses, 1.0);
        self.rows = 0;
        self.products.clear();
        self.stresses.clear();
    }
}

fn displacement(fields: &NodeFields, node: u32, k: usize) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| fields.row(3 * node as usize + axis)[k])
}

/// The mean dilatations of the patches of [`super::anp`]: of every node, for each material about it.
struct NodalDilatation {
    fields: usize,
    means: BTreeMap<(u32, [u64; 2]), (f64, Vec<f64>)>,
}

fn key(node: u32, lame: Lame) -> (u32, [u64; 2]) {
    (node, [lame.lambda.to_bits(), lame.mu.to_bits()])
}

impl NodalDilatation {
    fn from_fields(mesh: &TetMesh, lame: &[Lame], fields: &NodeFields) -> NodalDilatation {
        let mut means: BTreeMap<_, (f64, Vec<f64>)> = BTreeMap::new();
        for (tet, nodes) in mesh.tets.iter().enumerate() {
            let Some(geometry) = tet4::geometry(mesh.corners(tet)) else { continue };
            let mut own = vec![0.0; fields.columns];
            for (&node, gradient) in nodes.iter().zip(&geometry.gradients) {
                for (k, own) in own.iter_mut().enumerate() {
                    *own += gradient.dot(&displacement(fields, node, k));
                }
            }
            for &node in nodes {
                let (volume, sum) =
                    means.entry(key(node, lame[tet])).or_insert_with(|| (0.0, vec![0.0; fields.columns]));
                *volume += geometry.volume;
                sum.iter_mut().zip(&own).for_each(|(sum, own)| *sum += own * geometry.volume);
            }
        }
        for (volume, sum) in means.values_mut() {
            sum.iter_mut().for_each(|sum| *sum /= *volume);
        }
        NodalDilatation { fields: fields.columns, means }
    }

    /// Mean dilatation of field `k` in an element, over its corners. Averaging is its own adjoint, so this θ beside the element's
    /// ½ tr HᵀH gives the same as the patches' means of both.
    fn mean(&self, nodes: &[u32; 4], lame: Lame, k: usize) -> f64 {
        debug_assert!(k < self.fields);
        nodes
            .iter()
            .map(|&node| self.means.get(&key(node, lame)).map_or(0.0, |(_, mean)| mean[k]))
            .sum::<f64>()
            / 4.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Hyperelastic, STVK, TET4, TET4_ANP, TET10};
    use crate::mesh::{Block, block};

    fn some_fields(nodes: usize, columns: usize) -> NodeFields {
        let mut fields = NodeFields::zeros(nodes, columns);
        fields.data.iter_mut().enumerate().for_each(|(i, u)| *u = (1.7 * i as f64).sin());
        fields
    }

    fn value(theta: &[f64], c: &[f64]) -> f64 {
        let n = c.len();
        let triples = (0..n).flat_map(|p| (p..n).flat_map(move |q| (q..n).map(move |r| (p, q, r))));
        triples.zip(theta).map(|((p, q, r), theta)| theta * c[p] * c[q] * c[r]).sum()
    }

    fn body() -> (TetMesh, Vec<Lame>) {
        let mesh = block(&Block { size: [1.0, 0.7, 1.3], cells: [2, 2, 2] }).unwrap();
        let lame = (0..mesh.tets.len())
            .map(|tet| Lame::from_young_poisson(1.0 + (tet % 3) as f64, 0.37 - 0.4 * (tet % 2) as f64));
        let lame = lame.collect();
        (mesh, lame)
    }

    /// The odd part of the St. Venant–Kirchhoff energy is its cubic part, whatever the dilatation is taken from.
    #[test]
    fn the_cubic_part_is_that_of_the_law() {
        let (mesh, lame) = body();
        let bulged = |a: &Vector3<f64>, b: &Vector3<f64>| (a + b) * 0.5 + (a - b).cross(&Vector3::x()) * 0.05;
        let straight = quadratic::quadratic(mesh.clone(), &quadratic::straight);
        let curved = quadratic::quadratic(mesh.clone(), &bulged);
        let cases = [(&TET4, &mesh), (&TET4_ANP, &mesh), (&TET10, &straight), (&TET10, &curved)];
        for (element, mesh) in cases {
            let fields = some_fields(mesh.nodes.len(), 3);
            let theta = cubic_energy(element, mesh, &lame, &fields).unwrap();
            let law = Hyperelastic::new(element, &STVK, mesh, &lame).unwrap();
            let c = [0.3, -0.2, 0.5];
            let energy = |sign: f64| {
                let mut u = NodeFields::zeros(mesh.nodes.len(), 1);
                for (row, u) in u.data.iter_mut().enumerate() {
                    *u = sign * fields.row(row).iter().zip(&c).map(|(u, c)| u * c).sum::<f64>();
                }
                law.energy(&law.gradients(&u))
            };
            let expected = 0.5 * (energy(1.0) - energy(-1.0));
            let found = value(&theta, &c);
            assert!(
                (found - expected).abs() < 1e-12 * expected.abs(),
                "{}: {found} {expected}",
                element.name
            );
        }
    }

    /// A displacement that is linear in place strains every element alike, whatever its dilatation is taken from.
    #[test]
    fn all_elements_agree_where_the_strain_is_constant() {
        let (mesh, _) = body();
        let gradient = Matrix3::new(0.1, -0.4, 0.2, 0.3, 0.2, -0.1, 0.0, 0.5, -0.3);
        let curved = |a: &Vector3<f64>, b: &Vector3<f64>| (a + b) * 0.5 + (a - b).cross(&Vector3::x()) * 0.05;
        let of = |element: &Element, mesh: &TetMesh| {
            let lame = vec![Lame::from_young_poisson(3.0, 0.4); mesh.tets.len()];
            let mut fields = NodeFields::zeros(mesh.nodes.len(), 1);
            for (node, x) in mesh.nodes.iter().enumerate() {
                fields.data[3 * node..][..3].copy_from_slice((gradient * x).as_slice());
            }
            cubic_energy(element, mesh, &lame, &fields).unwrap()[0]
        };
        let lame = Lame::from_young_poisson(3.0, 0.4);
        let stress = (gradient + gradient.transpose()) * lame.mu
            + Matrix3::from_diagonal_element(lame.lambda * gradient.trace());
        let expected = stress.dot(&(gradient.transpose() * gradient)) * 0.5 * 0.91;
        let straight = quadratic::quadratic(mesh.clone(), &quadratic::straight);
        let bulged = quadratic::quadratic(mesh.clone(), &curved);
        for (element, mesh) in [(&TET4, &mesh), (&TET4_ANP, &mesh), (&TET10, &straight)] {
            let found = of(element, mesh);
            assert!((found - expected).abs() < 1e-12, "{}: {found} {expected}", element.name);
        }
        // A bulged mesh has another volume.
        let volume: f64 = (0..bulged.tets.len())
            .flat_map(|tet| {
                tet10::points(&quadratic::nodes(&bulged, tet).map(|node| bulged.nodes[node as usize]))
                    .unwrap()
            })
            .map(|point| point.volume)
            .sum();
        let found = of(&TET10, &bulged);
        assert!((found - expected * volume / 0.91).abs() < 1e-12, "{found} {volume}");
    }
}
