//! Integrates the pull between some triangles in lanes and any other triangle.
//!
//! In: up to [`LANES`] triangles i, another one j. Out: ∫∫ 1/r, ∫∫ r rᵀ/r³ and ∫∫ -r·n/r³ φ_q of every i with j, and their
//! contributions to the operators at a corner of j. Pairs that are far apart, nearly all of them, are integrated in all lanes at
//! once by three points of each; the others one by one ([`pairs`]).

use super::pairs::{self, FAR, kernel};
use super::potentials::PULL;
use super::rules::THREE;
use super::triangle::{Pull, Triangle};
use crate::base::lanes::{self, Kernel};
use nalgebra::Vector3;

/// Number of triangles in a strip.
pub const LANES: usize = 32;
pub type Lanes = [f64; LANES];

/// Triangles i, of which lanes beyond the last repeat the first.
pub struct Strip<'a> {
    pub triangles: &'a [&'a Triangle],
    /// Points of Gauss' rule by point and axis.
    points: [[Lanes; 3]; 3],
    areas: Lanes,
    centres: [Lanes; 3],
    radii: Lanes,
    /// Curls by corner and axis.
    pub curls: [[Lanes; 3]; 3],
}

/// The pulls of each i with one j.
pub struct Pulls {
    pub pull: [Lanes; PULL],
    /// Views by the corner of j.
    pub view: [Lanes; 3],
    /// Distance of the centres over the sum of the radii, squared.
    apart: Lanes,
}

impl Default for Pulls {
    fn default() -> Pulls {
        Pulls { pull: [[0.0; LANES]; PULL], view: [[0.0; LANES]; 3], apart: [0.0; LANES] }
    }
}

impl<'a> Strip<'a> {
    /// A strip of one triangle at least.
    pub fn new(triangles: &'a [&'a Triangle]) -> Strip<'a> {
        let of = |k: usize| triangles.get(k).unwrap_or(&triangles[0]);
        let each = |value: &dyn Fn(&Triangle) -> f64| std::array::from_fn(|k| value(of(k)));
        Strip {
            triangles,
            points: std::array::from_fn(|p| std::array::from_fn(|axis| each(&|t| t.three[p][axis]))),
            areas: each(&|t| t.area),
            centres: std::array::from_fn(|axis| each(&|t| t.centre[axis])),
            radii: each(&|t| t.radius),
            curls: std::array::from_fn(|p| std::array::from_fn(|axis| each(&|t| t.curls[p][axis]))),
        }
    }

    /// Computes the pulls of every i with j, times the weight of its lane; `view` only where it is asked for.
    pub fn pulls(&self, j: &Triangle, weights: &Lanes, with_view: bool, out: &mut Pulls) {
        lanes::run(FarPulls { strip: self, j, weights, out });
        for (k, i) in self.triangles.iter().enumerate() {
            if out.apart[k] > FAR * FAR || weights[k] == 0.0 {
                continue;
            }
            let Pull(pull) = pairs::pull(i, j);
            (0..PULL).for_each(|m| out.pull[m][k] = weights[k] * pull[m]);
            if with_view {
                // A triangle does not see itself.
                let view = if std::ptr::eq(*i, j) { Vector3::zeros() } else { pairs::view(i, j) };
                (0..3).for_each(|q| out.view[q][k] = weights[k] * view[q]);
            }
        }
    }
}

struct FarPulls<'a> {
    strip: &'a Strip<'a>,
    j: &'a Triangle,
    weights: &'a Lanes,
    out: &'a mut Pulls,
}

impl Kernel for FarPulls<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let FarPulls { strip, j, weights, out } = self;
        let centre = &j.frame.centre;
        for k in 0..LANES {
            let off = [0, 1, 2].map(|axis| strip.centres[axis][k] - centre[axis]);
            let radii = strip.radii[k] + j.radius;
            out.apart[k] = (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]) / (radii * radii);
        }
        for k in 0..LANES {
            let (mut pull, mut view) = ([0.0; PULL], [0.0; 3]);
            for p in 0..3 {
                let x = [strip.points[p][0][k], strip.points[p][1][k], strip.points[p][2][k]];
                for l in 0..3 {
                    // Where they touch, points may be the same.
                    let (own, flow) = kernel(x, j.three[l], &j.frame.normal);
                    for m in 0..PULL {
                        pull[m] += own[m];
                    }
                    for q in 0..3 {
                        view[q] += THREE[l][q] * flow;
                    }
                }
            }
            let part = weights[k] * strip.areas[k] * j.area / 9.0;
            for m in 0..PULL {
                out.pull[m][k] = if part == 0.0 { 0.0 } else { part * pull[m] };
            }
            for q in 0..3 {
                out.view[q][k] = if part == 0.0 { 0.0 } else { part * view[q] };
            }
        }
    }
}
