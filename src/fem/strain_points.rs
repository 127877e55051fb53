//! The points at which a body's strain is taken at large strain: points of integration, and the means of the dilatation between
//! them.
//!
//! In: the elements of a mesh ([`super::Element::points`]). Out: all that the energy needs of them,
//!
//! ```text
//! H_q = Σ_a u_a⊗G_qa     W = Σ_q V_q ψ(H_q; λ_q, μ_q) + Σ_p κ_p/2 (Σ_q w_pq θ(H_q))²
//! ```
//!
//! with the law's ψ and θ. An element whose dilatation is its own has no means. One whose dilatation is averaged or projected, so
//! that it does not lock near ν = 1/2, has λ_q = 0 and a mean p for each constraint that it keeps.

use super::lame::Lame;
use super::products::{add_dyad, times};
use super::stiffness::NodeFields;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// The points of all elements of a mesh; element e is tetrahedron e.
#[derive(Debug)]
pub struct StrainPoints {
    /// Nodes of each element: 4 or 10.
    width: usize,
    /// The elements' nodes, one element after another.
    nodes: Vec<u32>,
    /// Points of element e: `start[e]..start[e + 1]`.
    start: Vec<usize>,
    /// The element of each point.
    element: Vec<u32>,
    /// V_q, m³.
    pub volume: Vec<f64>,
    /// G_qa, 1/m, `width` for each point; Σ_a G_qa = 0.
    gradients: Vec<Vector3<f64>>,
    /// Lamé's constants of each element's material.
    pub lame: Vec<Lame>,
    /// Lamé's constants with which ψ answers in each element: without λ where means have it.
    own: Vec<Lame>,
    pub means: Means,
}

impl StrainPoints {
    /// No elements yet, each to have `width` nodes.
    pub fn new(width: usize) -> StrainPoints {
        StrainPoints {
            width,
            nodes: Vec::new(),
            start: vec![0],
            element: Vec::new(),
            volume: Vec::new(),
            gradients: Vec::new(),
            lame: Vec::new(),
            own: Vec::new(),
            means: Means { start: vec![0], node_start: vec![0], ..Means::default() },
        }
    }

    /// Appends an element: its nodes, its material's constants, whether means will have λ, and V and G_a of its points.
    pub fn push<'g>(
        &mut self,
        nodes: &[u32],
        lame: Lame,
        has_means: bool,
        points: impl Iterator<Item = (f64, &'g [Vector3<f64>])>,
    ) {
        let element = self.elements() as u32;
        self.nodes.extend(nodes);
        self.lame.push(lame);
        self.own.push(if has_means { Lame { lambda: 0.0, ..lame } } else { lame });
        for (volume, gradients) in points {
            self.volume.push(volume);
            self.gradients.extend(gradients);
            self.element.push(element);
        }
        self.start.push(self.volume.len());
    }

    /// Appends a mean of stiffness κ, N m for weights without unit, over points of elements that are there: (q, w_pq).
    pub fn push_mean(&mut self, stiffness: f64, terms: &[(u32, f64)]) {
        let of = |&(point, _): &(u32, f64)| self.nodes_of(self.element[point as usize] as usize);
        let mut nodes: Vec<u32> = terms.iter().flat_map(of).copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        // Every node of a term's element is among them.
        let slot = |node: &u32| nodes.binary_search(node).unwrap_or(0) as u32;
        let slots: Vec<u32> = terms.iter().flat_map(of).map(slot).collect();
        let means = &mut self.means;
        means.stiffness.push(stiffness);
        means.terms.extend(terms);
        means.slots.extend(slots);
        means.start.push(means.terms.len());
        means.nodes.extend(nodes);
        means.node_start.push(means.nodes.len());
    }

    pub fn elements(&self) -> usize {
        self.start.len() - 1
    }

    /// The number of points.
    pub fn count(&self) -> usize {
        self.volume.len()
    }

    pub fn nodes_of(&self, element: usize) -> &[u32] {
        &self.nodes[self.width * element..][..self.width]
    }

    pub fn points_of(&self, element: usize) -> Range<usize> {
        self.start[element]..self.start[element + 1]
    }

    pub fn element_of(&self, point: usize) -> usize {
        self.element[point] as usize
    }

    /// G_qa of one point, for its element's nodes.
    pub fn gradients_at(&self, point: usize) -> &[Vector3<f64>] {
        &self.gradients[self.width * point..][..self.width]
    }

    /// Lamé's constants of the material at a point.
    pub fn lame(&self, point: usize) -> Lame {
        self.lame[self.element_of(point)]
    }

    /// Lamé's constants with which ψ answers there: without λ where means have it.
    pub fn own_lame(&self, point: usize) -> Lame {
        self.own[self.element_of(point)]
    }

    /// H at every point under the displacements `u`, one column over the nodes.
    pub fn displacement_gradients(&self, u: &NodeFields) -> Vec<Matrix3<f64>> {
        let at = |node: u32| Vector3::from_column_slice(&u.data[3 * node as usize..][..3]);
        let gradient = |point: usize| {
            let nodes = self.nodes_of(self.element_of(point));
            // Relative to corner 0, so that a body far from where it rested keeps its strain.
            let origin = at(nodes[0]);
            let mut sum = Matrix3::zeros();
            for (&node, gradient) in nodes.iter().zip(self.gradients_at(point)).skip(1) {
                add_dyad(&mut sum, &(at(node) - origin), gradient);
            }
            sum
        };
        (0..self.count()).into_par_iter().with_min_len(1024).map(gradient).collect()
    }
}

/// Means θ_p = Σ_q w_pq θ_q of the dilatation, and their stiffness κ_p.
#[derive(Debug, Default)]
pub struct Means {
    stiffness: Vec<f64>,
    /// q and w_pq; those of mean p are `start[p]..start[p + 1]`.
    terms: Vec<(u32, f64)>,
    start: Vec<usize>,
    /// The nodes on which a mean depends, ascending; those of mean p are `node_start[p]..node_start[p + 1]`.
    nodes: Vec<u32>,
    node_start: Vec<usize>,
    /// Index of each node of a term's element among the mean's nodes.
    slots: Vec<u32>,
}

impl Means {
    pub fn count(&self) -> usize {
        self.stiffness.len()
    }

    /// κ_p.
    pub fn stiffness(&self, mean: usize) -> f64 {
        self.stiffness[mean]
    }

    /// Range of a mean's nodes among those of all means.
    pub fn span(&self, mean: usize) -> Range<usize> {
        self.node_start[mean]..self.node_start[mean + 1]
    }

    pub fn nodes_of(&self, mean: usize) -> &[u32] {
        &self.nodes[self.span(mean)]
    }

    /// θ_p, one mean after another, of the points' θ.
    pub fn means(&self, dilatations: &[f64]) -> Vec<f64> {
        let term = |&(point, weight): &(u32, f64)| weight * dilatations[point as usize];
        self.start.windows(2).map(|span| self.terms[span[0]..span[1]].iter().map(term).sum()).collect()
    }

    /// The factor of θ at each of `points` points in the first variation, N m: Σ_p κ_p θ_p w_pq.
    pub fn pressures(&self, means: &[f64], points: usize) -> Vec<f64> {
        let mut pressures = vec![0.0; points];
        for ((span, stiffness), mean) in self.start.windows(2).zip(&self.stiffness).zip(means) {
            for &(point, weight) in &self.terms[span[0]..span[1]] {
                pressures[point as usize] += stiffness * mean * weight;
            }
        }
        pressures
    }

    /// ∂θ_p/∂u_a of every mean for its nodes, of the points' ∂θ/∂F.
    pub fn gradients(&self, points: &StrainPoints, slopes: &[Matrix3<f64>]) -> Vec<Vector3<f64>> {
        let mut gradients = vec![Vector3::zeros(); self.nodes.len()];
        let mut parts = Vec::with_capacity(self.count());
        let mut rest = gradients.as_mut_slice();
        for mean in 0..self.count() {
            let (own, others) = rest.split_at_mut(self.span(mean).len());
            parts.push(own);
            rest = others;
        }
        parts.into_par_iter().enumerate().with_min_len(64).for_each(|(mean, own)| {
            for term in self.start[mean]..self.start[mean + 1] {
                let (point, weight) = self.terms[term];
                let slope = slopes[point as usize] * weight;
                let slots = &self.slots[points.width * term..][..points.width];
                for (&slot, gradient) in slots.iter().zip(points.gradients_at(point as usize)) {
                    own[slot as usize] += times(&slope, gradient);
                }
            }
        });
        gradients
    }
}
