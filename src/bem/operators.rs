//! The boundary integral operators of isotropic elasticity, tested with functions on the same triangles.
//!
//! In: the pulls of some triangles i, in lanes, with others j. Out: blocks of the matrices of
//!
//! ```text
//! V t = (½ + K) u     D u = (½ - Kᵀ) t
//! ```
//!
//! with u linear on each triangle and continuous, t constant on each. Kernels that cannot be integrated are integrated by parts on
//! the surface first: with c and d the curls n × ∇φ of a corner's function on i and j, all that is left are the pulls, g and H, and the
//! views of [`Pulls`] (Kupradze, Three-Dimensional Problems of the Mathematical Theory of Elasticity and Thermoelasticity, 1979,
//! chapter 5; Han, J. Comput. Math. 12, 1994; Steinbach, Numerical Approximation Methods for Elliptic Boundary Value Problems, 2008,
//! section 6.7):
//!
//! ```text
//! V = (3 - 4ν) g + H     W = (1 - 2ν) g + H     K = view + W [d]     D = 2 g c·d - g c dᵀ + [c] W [d]     [d] b = d × b
//! ```
//!
//! up to factors. Nothing of it grows without bounds as Poisson's ratio nears ½. What depends on j alone is summed over the triangles
//! around each node first ([`CurlSums`]).

use super::potentials::PULL;
use super::strip::{LANES, Lanes, Pulls};
use crate::base::lanes::{self, Kernel};
use crate::fem::Lame;
use std::f64::consts::PI;

/// Shear modulus and Poisson's ratio.
#[derive(Clone, Copy, Debug)]
pub struct Material {
    mu: f64,
    nu: f64,
}

impl From<Lame> for Material {
    fn from(Lame { lambda, mu }: Lame) -> Material {
        Material { mu, nu: lambda / (2.0 * (lambda + mu)) }
    }
}

/// A block for each lane, by row and column.
pub type Blocks = [[Lanes; 3]; 3];

/// Sums over the triangles j around one node, d the curl of its function there.
#[derive(Clone)]
pub struct CurlSums {
    /// Sum of W \[d\].
    bent: Blocks,
    /// Sum of g d.
    plain: [Lanes; 3],
    /// Sum of the views.
    seen: Lanes,
}

/// Numbers of one.
pub const CURLED: usize = 13 * LANES;

impl Default for CurlSums {
    fn default() -> CurlSums {
        CurlSums { bent: [[[0.0; LANES]; 3]; 3], plain: [[0.0; LANES]; 3], seen: [0.0; LANES] }
    }
}

impl CurlSums {
    /// Adds what the triangle of these pulls does by its corner `q`, whose curl is `d`.
    pub fn add(&mut self, Material { nu, .. }: Material, pulls: &Pulls, q: usize, d: [f64; 3]) {
        lanes::run(Adding { sums: self, pull: &pulls.pull, view: &pulls.view[q], d, shear: 1.0 - 2.0 * nu });
    }
}

struct Adding<'a> {
    sums: &'a mut CurlSums,
    pull: &'a [Lanes; PULL],
    view: &'a Lanes,
    d: [f64; 3],
    shear: f64,
}

impl Kernel for Adding<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Adding { sums, pull, view, d, shear } = self;
        for k in 0..LANES {
            let [g, xx, xy, xz, yy, yz, zz] = pull.each_ref().map(|lanes| lanes[k]);
            let own = shear * g;
            let w = [[xx + own, xy, xz], [xy, yy + own, yz], [xz, yz, zz + own]];
            for a in 0..3 {
                sums.bent[a][0][k] += w[a][1] * d[2] - w[a][2] * d[1];
                sums.bent[a][1][k] += w[a][2] * d[0] - w[a][0] * d[2];
                sums.bent[a][2][k] += w[a][0] * d[1] - w[a][1] * d[0];
                sums.plain[a][k] += g * d[a];
            }
            sums.seen[k] += view[k];
        }
    }
}

impl Material {
    /// V: the displacement, summed over one triangle, that a unit traction on another causes by Kelvin's solution, m³ for N/m².
    pub fn single_layer(self, pulls: &Pulls) -> Blocks {
        let factor = 1.0 / (16.0 * PI * self.mu * (1.0 - self.nu));
        let own = 3.0 - 4.0 * self.nu;
        let [g, xx, xy, xz, yy, yz, zz] = &pulls.pull;
        let mut blocks = [[*xx, *xy, *xz], [*xy, *yy, *yz], [*xz, *yz, *zz]];
        for (a, row) in blocks.iter_mut().enumerate() {
            for (b, block) in row.iter_mut().enumerate() {
                let own = if a == b { own } else { 0.0 };
                block.iter_mut().zip(g).for_each(|(value, g)| *value = factor * (own * g + *value));
            }
        }
        blocks
    }

    /// K: the rows tested on each i, for the node of these sums.
    pub fn double_layer(self, sums: &CurlSums) -> Blocks {
        let factor = 1.0 / (8.0 * PI * (1.0 - self.nu));
        let mut blocks = sums.bent;
        for (a, row) in blocks.iter_mut().enumerate() {
            for (b, block) in row.iter_mut().enumerate() {
                let part = if a == b { 1.0 / (4.0 * PI) } else { 0.0 };
                block
                    .iter_mut()
                    .zip(&sums.seen)
                    .for_each(|(value, seen)| *value = factor * *value + part * seen);
            }
        }
        blocks
    }

    /// D: for the corner of each i whose curls are `c`, and the node of these sums, N/m.
    pub fn hypersingular(self, c: &[Lanes; 3], sums: &CurlSums) -> Blocks {
        let mut blocks = [[[0.0; LANES]; 3]; 3];
        let factor = self.mu / (4.0 * PI);
        lanes::run(Hypersingular {
            c,
            sums,
            plain: factor,
            bent: factor / (1.0 - self.nu),
            blocks: &mut blocks,
        });
        blocks
    }
}

struct Hypersingular<'a> {
    c: &'a [Lanes; 3],
    sums: &'a CurlSums,
    plain: f64,
    bent: f64,
    blocks: &'a mut Blocks,
}

impl Kernel for Hypersingular<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Hypersingular { c, sums, plain, bent, blocks } = self;
        for k in 0..LANES {
            let c = c.each_ref().map(|lanes| lanes[k]);
            let x = sums.plain.each_ref().map(|lanes| plain * lanes[k]);
            let product = 2.0 * (c[0] * x[0] + c[1] * x[1] + c[2] * x[2]);
            for b in 0..3 {
                let m = [0, 1, 2].map(|a| bent * sums.bent[a][b][k]);
                let turned =
                    [c[1] * m[2] - c[2] * m[1], c[2] * m[0] - c[0] * m[2], c[0] * m[1] - c[1] * m[0]];
                for a in 0..3 {
                    let own = if a == b { product } else { 0.0 };
                    blocks[a][b][k] = own - c[a] * x[b] + turned[a];
                }
            }
        }
    }
}
