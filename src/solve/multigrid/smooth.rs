//! One pass over a level's matrix for all columns, and Chebyshev's iteration made of such passes.
//!
//! ```text
//! residual   d ← b - A x
//! step       d ← c₁ d + c₂ D⁻¹ (b - A x),   y ← x + d,        D: the blocks of A on the clusters
//! ```
//!
//! (Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., algorithm 12.1; as a smoother: Adams, Brezina, Hu and
//! Tuminaro, J. Comput. Phys. 188, 2003, 593-610.) Vectors are row-major like
//! [`crate::fem::NodeFields`]: all columns of an unknown stand together.

use super::cluster::MOST;
use super::prolong::{Part, Smoothed};
use crate::base::lanes::{Kernel, fused, lanes, lanes_mut, run};
use rayon::prelude::*;
use std::ops::Range;

/// Chebyshev's iteration as a smoother.
pub struct Smoother {
    /// Passes over the matrix before and after the coarse correction.
    degree: usize,
    /// Part of the largest eigenvalue of D⁻¹ A from which up errors are damped.
    damped: f64,
}

/// Smoother for compact bodies, where few iterations are needed.
pub const THICK: Smoother = Smoother { degree: 2, damped: 1.0 / 10.0 };
/// Smoother for thin bodies, where more passes cost nothing in all.
pub const THIN: Smoother = Smoother { degree: 3, damped: 1.0 / 15.0 };

/// The vectors of one level, f32, for several columns.
#[derive(Default)]
pub struct Vectors {
    pub columns: usize,
    pub b: Vec<f32>,
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub d: Vec<f32>,
}

impl Vectors {
    pub fn new(unknowns: usize, columns: usize) -> Vectors {
        let zeros = || vec![0.0; unknowns * columns];
        Vectors { columns, b: zeros(), x: zeros(), y: zeros(), d: zeros() }
    }
}

/// The use that is made of A x.
#[derive(Clone, Copy)]
enum Pass {
    Residual,
    Step([f32; 2]),
    /// x = 0, and A is not read.
    First(f32),
}

/// One pass over some clusters; `y` and `d` are those of their nodes.
struct Clustered<'a, const B: usize> {
    matrix: &'a Smoothed<B>,
    part: &'a Part,
    pass: Pass,
    columns: usize,
    b: &'a [f32],
    x: &'a [f32],
    y: &'a mut [f32],
    d: &'a mut [f32],
}

impl<const B: usize> Kernel for Clustered<'_, B> {
    #[inline(always)]
    fn run<const FUSED: bool>(mut self) {
        let mut at = self.part.inverse;
        for cluster in self.part.clusters.clone() {
            let nodes = self.matrix.clusters[cluster] as usize..self.matrix.clusters[cluster + 1] as usize;
            let size = (B * nodes.len()).pow(2);
            let inverse = &self.matrix.inverse[at..at + size];
            at += size;
            let is_alone = B > 3 || nodes.len() == 1;
            let mut lane = 0;
            if B == 3 && is_alone {
                while lane + 24 <= self.columns {
                    self.tile::<FUSED, 24, 1>(&nodes, inverse, lane);
                    lane += 24;
                }
            }
            while lane + 8 <= self.columns {
                if is_alone {
                    self.tile::<FUSED, 8, 1>(&nodes, inverse, lane);
                } else {
                    self.tile::<FUSED, 8, MOST>(&nodes, inverse, lane);
                }
                lane += 8;
            }
            while lane + 4 <= self.columns {
                if is_alone {
                    self.tile::<FUSED, 4, 1>(&nodes, inverse, lane);
                } else {
                    self.tile::<FUSED, 4, MOST>(&nodes, inverse, lane);
                }
                lane += 4;
            }
        }
    }
}

impl<const B: usize> Clustered<'_, B> {
    /// b - A x of one node.
    #[inline(always)]
    fn rest<const FUSED: bool, const T: usize>(&self, node: usize, lane: usize) -> [[f32; T]; B] {
        let m = self.columns;
        let mut rest = [[0.0_f32; T]; B];
        for r in 0..B {
            rest[r] = *lanes::<T, f32>(self.b, (node * B + r) * m + lane);
        }
        if matches!(self.pass, Pass::First(_)) {
            return rest;
        }
        let mut sum = [[0.0_f32; T]; B];
        let row = self.matrix.start[node]..self.matrix.start[node + 1];
        let blocks = self.matrix.value[row.start * B * B..row.end * B * B].chunks_exact(B * B);
        for (block, &other) in blocks.zip(&self.matrix.column[row]) {
            let from = other as usize * B * m + lane;
            for k in 0..B {
                let x = lanes::<T, f32>(self.x, from + k * m);
                for r in 0..B {
                    let a = block[k * B + r];
                    for t in 0..T {
                        sum[r][t] = fused::<FUSED>(a, x[t], sum[r][t]);
                    }
                }
            }
        }
        for r in 0..B {
            for t in 0..T {
                rest[r][t] -= sum[r][t];
            }
        }
        rest
    }

    /// `T` columns of one cluster of at most `M` nodes.
    #[inline(always)]
    fn tile<const FUSED: bool, const T: usize, const M: usize>(
        &mut self,
        nodes: &Range<usize>,
        inverse: &[f32],
        lane: usize,
    ) {
        let m = self.columns;
        let count = if M == 1 { 1 } else { nodes.len() };
        let here = (nodes.start - self.part.nodes.start) * B * m + lane;
        let mut rest = [[[0.0_f32; T]; B]; M];
        for i in 0..count {
            rest[i] = self.rest::<FUSED, T>(nodes.start + i, lane);
        }
        let (keep, take) = match self.pass {
            Pass::Residual => {
                for (i, r) in (0..count).flat_map(|i| (0..B).map(move |r| (i, r))) {
                    *lanes_mut(self.d, here + (i * B + r) * m) = rest[i][r];
                }
                return;
            }
            Pass::Step([keep, take]) => (keep, take),
            Pass::First(take) => (0.0, take),
        };
        for (i, r) in (0..count).flat_map(|i| (0..B).map(move |r| (i, r))) {
            let mut sum = [0.0_f32; T];
            for j in 0..count {
                for k in 0..B {
                    let a = inverse[((j * B + k) * count + i) * B + r];
                    for t in 0..T {
                        sum[t] = fused::<FUSED>(a, rest[j][k][t], sum[t]);
                    }
                }
            }
            let own = (i * B + r) * m;
            let d = lanes_mut::<T, f32>(self.d, here + own);
            for t in 0..T {
                // What stands there before the first step may be anything.
                d[t] = if keep == 0.0 { take * sum[t] } else { keep * d[t] + take * sum[t] };
            }
            let y = lanes_mut::<T, f32>(self.y, here + own);
            if matches!(self.pass, Pass::First(_)) {
                *y = *d;
            } else {
                let x = lanes::<T, f32>(self.x, nodes.start * B * m + lane + own);
                for t in 0..T {
                    y[t] = x[t] + d[t];
                }
            }
        }
    }
}

impl<const B: usize> Smoothed<B> {
    /// One pass; the result from x goes to y, or the residual to d.
    fn pass(&self, pass: Pass, v: &mut Vectors) {
        let columns = v.columns;
        let (b, x) = (&v.b, &v.x);
        let (mut rest_y, mut rest_d) = (v.y.as_mut_slice(), v.d.as_mut_slice());
        let mut works = Vec::with_capacity(self.parts.len());
        for part in &self.parts {
            let length = B * columns * part.nodes.len();
            let (y, behind_y) = rest_y.split_at_mut(length);
            let (d, behind_d) = rest_d.split_at_mut(length);
            (rest_y, rest_d) = (behind_y, behind_d);
            works.push(Clustered { matrix: self, part, pass, columns, b, x, y, d });
        }
        works.into_par_iter().for_each(run);
    }

    /// d = b - A x.
    pub fn residual(&self, v: &mut Vectors) {
        self.pass(Pass::Residual, v);
    }

    /// Smooths x; `is_zero`: whether x is zero, and so need not be read.
    pub fn smooth(&self, smoother: &Smoother, largest: f64, is_zero: bool, v: &mut Vectors) {
        let (high, low) = (largest, smoother.damped * largest);
        let (middle, half) = (0.5 * (high + low), 0.5 * (high - low));
        let sigma = middle / half;
        let mut rho = 1.0 / sigma;
        for step in 0..smoother.degree {
            let pass = if step > 0 {
                let next = 1.0 / (2.0 * sigma - rho);
                let pass = Pass::Step([(next * rho) as f32, (2.0 * next / half) as f32]);
                rho = next;
                pass
            } else if is_zero {
                Pass::First((1.0 / middle) as f32)
            } else {
                Pass::Step([0.0, (1.0 / middle) as f32])
            };
            self.pass(pass, v);
            std::mem::swap(&mut v.x, &mut v.y);
        }
    }

    /// λ_max(D⁻¹ A) by Lanczos' iteration in the product with D, from below to a few per cent.
    pub fn largest_eigenvalue(&self) -> f64 {
        const STEPS: usize = 15;
        let unknowns = B * self.nodes();
        let dot = |a: &[f64], b: &[f64]| -> f64 {
            let parts: Vec<f64> = a
                .par_chunks(4096)
                .zip(b.par_chunks(4096))
                .map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum())
                .collect();
            parts.iter().sum()
        };
        // Numbers without a pattern, always the same (Weyl's sequence).
        let mut dv: Vec<f64> =
            (1..=unknowns).map(|i| 2.0 * (i as f64 * 0.754_877_666_246_692_7).fract() - 1.0).collect();
        let mut v = self.cluster_by_cluster(&dv);
        let (mut v_before, mut dv_before) = (vec![0.0; unknowns], vec![0.0; unknowns]);
        let mut length = dot(&v, &dv).sqrt();
        let (mut main, mut beside): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
        for _ in 0..STEPS.min(unknowns) {
            if length <= 0.0 || length.is_nan() {
                break;
            }
            v.iter_mut().chain(&mut dv).for_each(|value| *value /= length);
            let mut w = self.product(&v);
            let mut u = self.cluster_by_cluster(&w);
            let alpha = dot(&v, &w);
            let beta = beside.last().copied().unwrap_or(0.0);
            for (u, (v, before)) in u.iter_mut().zip(v.iter().zip(&v_before)) {
                *u -= alpha * v + beta * before;
            }
            for (w, (dv, before)) in w.iter_mut().zip(dv.iter().zip(&dv_before)) {
                *w -= alpha * dv + beta * before;
            }
            main.push(alpha);
            length = dot(&u, &w).max(0.0).sqrt();
            beside.push(length);
            (v_before, dv_before) = (std::mem::replace(&mut v, u), std::mem::replace(&mut dv, w));
        }
        let size = main.len();
        let tridiagonal = nalgebra::DMatrix::from_fn(size, size, |r, c| match r.abs_diff(c) {
            0 => main[r],
            1 => beside[r.min(c)],
            _ => 0.0,
        });
        tridiagonal.symmetric_eigenvalues().max()
    }

    /// A x of one column.
    fn product(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        y.par_chunks_mut(B).enumerate().with_min_len(256).for_each(|(node, y)| {
            for at in self.start[node]..self.start[node + 1] {
                let x = lanes::<B, f64>(x, B * self.column[at] as usize);
                for (k, column) in self.value[B * B * at..][..B * B].chunks_exact(B).enumerate() {
                    for r in 0..B {
                        y[r] += f64::from(column[r]) * x[k];
                    }
                }
            }
        });
        y
    }

    /// D⁻¹ x of one column.
    fn cluster_by_cluster(&self, x: &[f64]) -> Vec<f64> {
        let mut y = vec![0.0; x.len()];
        let mut at = 0;
        for nodes in self.clusters.windows(2) {
            let own = B * nodes[0] as usize..B * nodes[1] as usize;
            for k in own.clone() {
                for (y, a) in y[own.clone()].iter_mut().zip(&self.inverse[at..at + own.len()]) {
                    *y += f64::from(*a) * x[k];
                }
                at += own.len();
            }
        }
        y
    }
}
