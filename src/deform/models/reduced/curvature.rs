//! The second derivatives of a quartic at one z, made at once or in [`PARTS`] that a tick of the force loop has time for.
//!
//! In: the quartic and z. Out, as for the slopes from D and X ([`super::quartic`]),
//!
//! ```text
//! U^c_ab = Σ w_abcd z_d        W^d_ab = Σ w_abcd z_c        ∂²V/∂z_i∂z_d = ∂/∂z_i Σ (U^d + W^d)_ab z_a z_b + X_id + D_id + …
//! ```

use super::quartic::{
    EMPTY, Lane, Quad, Quartic, SIDE, TEAM, lane_add, lane_fused, lanes_before, lanes_of, multiply, totals,
    triangle,
};
use crate::base::lanes::{self, Kernel, fused64};

/// Parts in which the coefficients are read; what is made of them at the end is one more.
const PARTS: usize = 4;

/// Second derivatives, and what is known of them while they are made.
pub struct Curvature {
    /// ∂²V/∂z² against the first `active` of z, row by row.
    pub second: Vec<f64>,
    /// The z of these derivatives.
    pub z: Vec<f64>,
    active: usize,
    products: Vec<Lane>,
    /// X; W of a team; U of all c, one after the other.
    sums: Vec<Lane>,
    of_team: Vec<Quad>,
    of_all: Vec<Lane>,
    triangle: Vec<f64>,
    row: Vec<f64>,
    progress: Progress,
}

/// Progress of the derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Progress {
    None,
    /// The team of d that is read, the next c, and where its triangle begins, among the coefficients and in U.
    Reading {
        first: usize,
        c: usize,
        quad: usize,
        lane: usize,
    },
    Read,
    Made,
}

impl Curvature {
    /// Derivatives of a quartic of `variables` variables, none of which is made yet.
    pub fn new(variables: usize) -> Curvature {
        let lanes = triangle(variables).div_ceil(SIDE);
        Curvature {
            second: vec![0.0; variables * variables],
            z: vec![0.0; variables],
            active: 0,
            products: vec![EMPTY; lanes],
            sums: vec![EMPTY; lanes],
            of_team: vec![[EMPTY; TEAM]; lanes],
            of_all: vec![EMPTY; lanes_before(variables)],
            triangle: vec![0.0; lanes * SIDE],
            row: vec![0.0; variables],
            progress: Progress::None,
        }
    }

    /// Makes those against the first `active` of z; the others of z must be 0.
    pub fn make(&mut self, quartic: &Quartic, z: &[f64], active: usize) {
        self.begin(z, active);
        while !self.go_on(quartic, usize::MAX) {}
    }

    /// Does the next part of those against all of z, the first one where none is done; true when all are made.
    pub fn prepare(&mut self, quartic: &Quartic, z: &[f64]) -> bool {
        match self.progress {
            Progress::Made => return true,
            Progress::None => self.begin(z, z.len()),
            Progress::Reading { .. } | Progress::Read => {}
        }
        self.go_on(quartic, quartic.coefficients.len().div_ceil(PARTS))
    }

    pub fn is_made(&self) -> bool {
        self.progress == Progress::Made
    }

    /// Drops the derivatives.
    pub fn forget(&mut self) {
        self.progress = Progress::None;
    }

    fn begin(&mut self, z: &[f64], active: usize) {
        self.active = active;
        self.z[..active].copy_from_slice(&z[..active]);
        multiply(&z[..active], &mut self.products);
        self.sums.fill(EMPTY);
        self.of_all.fill(EMPTY);
        self.second[..active * active].fill(0.0);
        self.progress = Progress::Reading { first: 0, c: 0, quad: 0, lane: 0 };
    }

    /// Reads `quads` quads, or makes the derivatives of what was read; true when they are made.
    fn go_on(&mut self, quartic: &Quartic, quads: usize) -> bool {
        match self.progress {
            Progress::None => return false,
            Progress::Reading { .. } => lanes::run(Read { curvature: self, quartic, quads }),
            Progress::Read => {
                lanes::run(Make(self));
                self.progress = Progress::Made;
            }
            Progress::Made => {}
        }
        self.is_made()
    }
}

/// D of a team with one c; adds to X, to W of the team and to U of c what they give.
#[inline(always)]
fn dots_and_all<const FUSED: bool>(
    own: &[Quad],
    products: &[Lane],
    (zc, zd): (f64, [f64; TEAM]),
    sums: &mut [Lane],
    (of_team, of_c): (&mut [Quad], &mut [Lane]),
) -> [f64; TEAM] {
    let mut dots = [EMPTY; TEAM];
    let sides = products.iter().zip(sums).zip(of_team).zip(of_c);
    for (own, (((products, sums), of_team), of_c)) in own.iter().zip(sides) {
        let (mut team, mut sum) = (*of_team, EMPTY);
        for j in 0..TEAM {
            lane_fused::<FUSED>(&own[j], products, &mut dots[j]);
            lane_add::<FUSED>(zd[j], &own[j], &mut sum);
            lane_add::<FUSED>(zc, &own[j], &mut team[j]);
        }
        *of_team = team;
        lane_add::<FUSED>(1.0, &sum, of_c);
        lane_add::<FUSED>(zc, &sum, sums);
    }
    totals(&{ dots })
}

#[inline(always)]
fn dot<const FUSED: bool>(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; SIDE];
    let (wide_a, wide_b) = (a.chunks_exact(SIDE), b.chunks_exact(SIDE));
    let rest: f64 = wide_a.remainder().iter().zip(wide_b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in wide_a.zip(wide_b) {
        for i in 0..SIDE {
            sums[i] = fused64::<FUSED>(a[i], b[i], sums[i]);
        }
    }
    sums.iter().sum::<f64>() + rest
}

/// D, X, U and W of the next coefficients.
struct Read<'a> {
    curvature: &'a mut Curvature,
    quartic: &'a Quartic,
    quads: usize,
}

impl Kernel for Read<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Curvature { second, z, active, products, sums, of_team, of_all, progress, .. } = self.curvature;
        let Progress::Reading { mut first, mut c, mut quad, mut lane } = *progress else { return };
        let (n, z, last) = (*active, &z[..*active], quad.saturating_add(self.quads));
        while first < n {
            if quad >= last {
                *progress = Progress::Reading { first, c, quad, lane };
                return;
            }
            if c == 0 {
                of_team.fill([EMPTY; TEAM]);
            }
            let own = &self.quartic.coefficients[quad..][..lanes_of(c)];
            quad += own.len();
            if c < n {
                let team: [f64; TEAM] = std::array::from_fn(|j| z.get(first + j).copied().unwrap_or(0.0));
                let of_c = &mut of_all[lane..lane + own.len()];
                let dots = dots_and_all::<FUSED>(own, products, (z[c], team), sums, (of_team, of_c));
                for (j, dot) in dots.iter().enumerate().take(n - first) {
                    second[(first + j) * n + c] += dot;
                }
            }
            (c, lane) = (c + 1, lane + own.len());
            if c == self.quartic.variables.min(first + TEAM) {
                for (j, d) in (first..n.min(first + TEAM)).enumerate() {
                    let of_d = of_all[lanes_before(d)..].iter_mut().take(lanes_of(d));
                    of_d.zip(&*of_team).for_each(|(of_d, team)| lane_add::<FUSED>(1.0, &team[j], of_d));
                }
                (first, c, lane) = (first + TEAM, 0, 0);
            }
        }
        *progress = Progress::Read;
    }
}

/// The derivatives, of what was read.
struct Make<'a>(&'a mut Curvature);

impl Kernel for Make<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Curvature { second, z, active, sums, of_all, triangle, row, .. } = self.0;
        let n = *active;
        let mut at = 0;
        for c in 0..n {
            let of_c = &of_all[at..at + lanes_of(c)];
            at += of_c.len();
            for (place, lane) in triangle.chunks_exact_mut(SIDE).zip(of_c) {
                place.copy_from_slice(&lane.0);
            }
            // ∂/∂z_i Σ (U + W)_ab z_a z_b.
            let row = &mut row[..=c];
            row.fill(0.0);
            let mut run = triangle.as_slice();
            for b in 0..=c {
                let own;
                (own, run) = run.split_at(b + 1);
                row[b] += dot::<FUSED>(own, &z[..=b]);
                for (row, own) in row.iter_mut().zip(own) {
                    *row = fused64::<FUSED>(z[b], *own, *row);
                }
            }
            second[c * n..=c * n + c].iter_mut().zip(&*row).for_each(|(second, row)| *second += row);
        }
        let mut sums = sums.iter().flat_map(|lane| lane.0);
        for b in 0..n {
            second[b * n..=b * n + b].iter_mut().zip(&mut sums).for_each(|(second, sum)| *second += sum);
        }
        for i in 0..n {
            for j in 0..=i {
                let both = second[i * n + j] + second[j * n + i];
                (second[i * n + j], second[j * n + i]) = (both, both);
            }
        }
    }
}
