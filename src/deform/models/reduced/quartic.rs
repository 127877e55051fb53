//! A quartic V(z) = Σ w_abcd z_a z_b z_c z_d over a ≤ b ≤ c ≤ d, evaluated with its slopes.
//!
//! In: w as [`QuarticShape`] orders it, and z. Out, from the triangle of the a ≤ b ≤ c for each c ≤ d,
//!
//! ```text
//! D_cd = Σ w_abcd z_a z_b      X_ab = Σ w_abcd z_c z_d      ∂V/∂z_d = Σ D_cd z_c + …      V = ¼ z·∂V/∂z
//! ```
//!
//! so that each coefficient is read once, in the order in which they stand: the triangles of [`TEAM`] successive d stand side
//! by side, so that what belongs to (a, b) is read and written once for all of them.

use crate::base::lanes::{self, Kernel, fused64};
use crate::fem::QuarticShape;

/// Numbers that one vector instruction takes at most.
pub const SIDE: usize = 8;
/// Triangles that are read together.
pub const TEAM: usize = 4;

/// [`SIDE`] numbers of one triangle.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub struct Lane(pub [f64; SIDE]);

/// [`SIDE`] places (a, b), the same in each of [`TEAM`] triangles.
pub type Quad = [Lane; TEAM];

pub const EMPTY: Lane = Lane([0.0; SIDE]);

/// The coefficients, and the memory for an evaluation.
pub struct Quartic {
    pub variables: usize,
    /// Coefficients for each team of d and each c up to the last of them: the triangle of (c, d), 0 where d < c, and at its end.
    pub coefficients: Vec<Quad>,
    /// z_a z_b of all pairs.
    products: Vec<Lane>,
    /// X.
    sums: Vec<Lane>,
}

/// Pairs a ≤ b < n.
pub fn triangle(n: usize) -> usize {
    n * (n + 1) / 2
}

/// Lanes of the triangle of c.
pub fn lanes_of(c: usize) -> usize {
    triangle(c + 1).div_ceil(SIDE)
}

/// Lanes of the triangles before that of c.
pub fn lanes_before(c: usize) -> usize {
    (0..c).map(lanes_of).sum()
}

/// The first d of each team with one of the first `active`, and the number of the c that the team's triangles have.
fn teams(active: usize, variables: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..active).step_by(TEAM).map(move |d| (d, variables.min(d + TEAM)))
}

impl Quartic {
    /// `None` where `coefficients` are not as many as a quartic of `variables` has.
    pub fn new(variables: usize, coefficients: &[f64]) -> Option<Quartic> {
        let shape = QuarticShape { variables };
        if coefficients.len() != shape.len() {
            return None;
        }
        let mut quads = Vec::new();
        for (first, count) in teams(variables, variables) {
            for c in 0..count {
                let start = quads.len();
                quads.resize(start + lanes_of(c), [EMPTY; TEAM]);
                for d in c.max(first)..variables.min(first + TEAM) {
                    let own = &coefficients[shape.at([0, 0, c, d])..][..triangle(c + 1)];
                    for (quad, own) in quads[start..].iter_mut().zip(own.chunks(SIDE)) {
                        quad[d - first].0[..own.len()].copy_from_slice(own);
                    }
                }
            }
        }
        let lanes = triangle(variables).div_ceil(SIDE);
        Some(Quartic {
            variables,
            coefficients: quads,
            products: vec![EMPTY; lanes],
            sums: vec![EMPTY; lanes],
        })
    }

    /// V, and its slopes against the first `active` of z; the others of z must be 0.
    pub fn slopes(&mut self, z: &[f64], active: usize, slopes: &mut [f64]) -> f64 {
        let z = &z[..active];
        multiply(z, &mut self.products);
        self.sums.fill(EMPTY);
        slopes.fill(0.0);
        lanes::run(Slopes { quartic: self, z, slopes });
        let mut sums = self.sums.iter().flat_map(|lane| lane.0);
        for b in 0..active {
            for (a, sum) in (0..=b).zip(&mut sums) {
                slopes[a] += sum * z[b];
                slopes[b] += sum * z[a];
            }
        }
        0.25 * z.iter().zip(slopes).map(|(z, slope)| z * *slope).sum::<f64>()
    }

    /// The slopes against the z behind the first `active`, which are 0. Where [`Quartic::slopes`] was asked last is near enough.
    pub fn slopes_beyond(&self, z: &[f64], active: usize, slopes: &mut [f64]) {
        slopes.fill(0.0);
        lanes::run(Beyond { quartic: self, z: &z[..active], slopes });
    }
}

/// The products z_a z_b, and nothing behind them.
pub fn multiply(z: &[f64], products: &mut [Lane]) {
    let mut places = products.iter_mut().flat_map(|lane| &mut lane.0);
    for (b, zb) in z.iter().enumerate() {
        z[..=b].iter().zip(&mut places).for_each(|(za, place)| *place = za * zb);
    }
    places.for_each(|place| *place = 0.0);
}

/// A call, so that the lanes above are not torn apart to be summed side by side.
#[inline(never)]
pub fn totals(lanes: &Quad) -> [f64; TEAM] {
    lanes.map(|lane| lane.0.iter().sum())
}

/// a b + c.
#[inline(always)]
pub fn lane_fused<const FUSED: bool>(a: &Lane, b: &Lane, c: &mut Lane) {
    for i in 0..SIDE {
        c.0[i] = fused64::<FUSED>(a.0[i], b.0[i], c.0[i]);
    }
}

#[inline(always)]
pub fn lane_add<const FUSED: bool>(factor: f64, a: &Lane, sum: &mut Lane) {
    for i in 0..SIDE {
        sum.0[i] = fused64::<FUSED>(factor, a.0[i], sum.0[i]);
    }
}

/// D of a team with one c.
#[inline(always)]
fn dots<const FUSED: bool>(own: &[Quad], products: &[Lane]) -> [f64; TEAM] {
    let mut dots = [EMPTY; TEAM];
    for (own, products) in own.iter().zip(products) {
        for j in 0..TEAM {
            lane_fused::<FUSED>(&own[j], products, &mut dots[j]);
        }
    }
    totals(&{ dots })
}

/// D of a team, `zd`, with one c; adds to X what they give.
#[inline(always)]
fn dots_and_sums<const FUSED: bool>(
    own: &[Quad],
    products: &[Lane],
    (zc, zd): (f64, [f64; TEAM]),
    sums: &mut [Lane],
) -> [f64; TEAM] {
    let mut dots = [EMPTY; TEAM];
    let by = zd.map(|zd| zc * zd);
    for ((own, products), sums) in own.iter().zip(products).zip(sums) {
        let mut sum = *sums;
        for j in 0..TEAM {
            lane_fused::<FUSED>(&own[j], products, &mut dots[j]);
            lane_add::<FUSED>(by[j], &own[j], &mut sum);
        }
        *sums = sum;
    }
    totals(&{ dots })
}

/// X, and the part of the slopes that D gives.
struct Slopes<'a> {
    quartic: &'a mut Quartic,
    z: &'a [f64],
    slopes: &'a mut [f64],
}

impl Kernel for Slopes<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Quartic { variables, coefficients, products, sums, .. } = self.quartic;
        let (z, slopes, n) = (self.z, self.slopes, self.z.len());
        let mut rest = coefficients.as_slice();
        for (first, count) in teams(n, *variables) {
            let team: [f64; TEAM] = std::array::from_fn(|j| z.get(first + j).copied().unwrap_or(0.0));
            for c in 0..count {
                let own;
                (own, rest) = rest.split_at(lanes_of(c));
                let Some(&zc) = z.get(c) else { continue };
                let dots = dots_and_sums::<FUSED>(own, products, (zc, team), sums);
                for (j, dot) in dots.iter().enumerate().take(n - first) {
                    slopes[first + j] += dot * zc;
                    slopes[c] += dot * team[j];
                }
            }
        }
    }
}

/// The slopes against what stands behind `z`.
struct Beyond<'a> {
    quartic: &'a Quartic,
    z: &'a [f64],
    slopes: &'a mut [f64],
}

impl Kernel for Beyond<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Quartic { variables, coefficients, products, .. } = self.quartic;
        let (z, slopes, n) = (self.z, self.slopes, self.z.len());
        let mut rest = coefficients.as_slice();
        for (first, count) in teams(*variables, *variables) {
            let mut team;
            (team, rest) = rest.split_at(lanes_before(count));
            if first + TEAM <= n {
                continue;
            }
            for (c, zc) in z.iter().enumerate().take(count) {
                let own;
                (own, team) = team.split_at(lanes_of(c));
                let dots = dots::<FUSED>(own, products);
                for (j, dot) in dots.iter().enumerate() {
                    if let Some(slope) = (first + j).checked_sub(n).and_then(|at| slopes.get_mut(at)) {
                        *slope += dot * zc;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::curvature::Curvature;
    use super::*;

    /// Slopes and second derivatives against sums over all coefficients, and central differences.
    #[test]
    fn slopes_and_second_derivatives_are_those_of_the_sum() {
        let n = 6;
        let shape = QuarticShape { variables: n };
        let coefficients: Vec<f64> = (0..shape.len()).map(|i| (1.3 * i as f64).sin()).collect();
        let value = |z: &[f64]| -> f64 {
            let mut sum = 0.0;
            for d in 0..n {
                for c in 0..=d {
                    for b in 0..=c {
                        for a in 0..=b {
                            sum += coefficients[shape.at([a, b, c, d])] * z[a] * z[b] * z[c] * z[d];
                        }
                    }
                }
            }
            sum
        };
        let mut quartic = Quartic::new(n, &coefficients).unwrap();
        for active in [6, 4] {
            let z: Vec<f64> = (0..n).map(|i| if i < active { (0.7 * i as f64).cos() } else { 0.0 }).collect();
            let mut slopes = vec![0.0; n];
            let found = quartic.slopes(&z, active, &mut slopes[..active]);
            quartic.slopes_beyond(&z, active, &mut slopes[active..]);
            assert!((found - value(&z)).abs() < 1e-13, "{found} {}", value(&z));
            let moved = |i: usize, by: f64| {
                let mut z = z.clone();
                z[i] += by;
                z
            };
            for i in 0..n {
                let slope = (value(&moved(i, 1e-5)) - value(&moved(i, -1e-5))) / 2e-5;
                assert!((slopes[i] - slope).abs() < 1e-8, "{i}: {} {slope}", slopes[i]);
            }
            let mut curvature = Curvature::new(n);
            curvature.make(&quartic, &z, active);
            for i in 0..active {
                let (mut plus, mut minus) = (vec![0.0; active], vec![0.0; active]);
                quartic.slopes(&moved(i, 1e-5), active, &mut plus);
                quartic.slopes(&moved(i, -1e-5), active, &mut minus);
                for j in 0..active {
                    let expected = (plus[j] - minus[j]) / 2e-5;
                    assert!(
                        (curvature.second[i * active + j] - expected).abs() < 1e-8,
                        "{i} {j}: {expected}"
                    );
                }
            }
        }
    }
}
