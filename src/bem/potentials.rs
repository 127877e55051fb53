//! Potentials of one flat triangle and of one edge in closed form, at several points at once.
//!
//! In: a triangle and points x. Out: the integrals over y in the triangle, with r = y - x,
//!
//! ```text
//! g = ∫ 1/r dA     H = ∫ r rᵀ/r³ dA     ∫ -r·n/r³ φ_q dA     φ_q: 1 in corner q, 0 in the others, linear
//! ```
//!
//! by the theorem of Gauss in the plane: logarithms over the edges and the solid angle (Wilton, Rao, Glisson, Schaubert,
//! Al-Bundak and Butler, IEEE Trans. Antennas Propag. 32, 1984; the solid angle by Van Oosterom and Strackee, IEEE Trans.
//! Biomed. Eng. 30, 1983). The code for one point has no branches, nor have its own logarithm ([`ln`]) and arc tangent
//! ([`atan2`]), so that a loop over points becomes vector instructions.

use crate::base::lanes;
use crate::base::lanes::Kernel;
use nalgebra::Vector3;

pub type Point = [f64; 3];

/// Points, axis by axis.
pub type Points<const N: usize> = [[f64; N]; 3];

/// Numbers of a pull: g, and of H xx, xy, xz, yy, yz, zz.
pub const PULL: usize = 7;

#[inline(always)]
fn dot(a: &Point, b: &Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: &Point, b: &Point) -> Point {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Axes of the parts of H.
const PARTS: [[usize; 2]; 6] = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];

/// Adds a bᵀ + b aᵀ, halved, to H.
#[inline(always)]
fn add_product(h: &mut [f64; 6], a: &Point, b: &Point, weight: f64) {
    for (h, [i, j]) in h.iter_mut().zip(PARTS) {
        *h += 0.5 * weight * (a[i] * b[j] + a[j] * b[i]);
    }
}

/// ∫ ds/r over an edge of this length, whose ends are at `a` and `b`, `near` and `far` away. On the edge itself it is without bounds,
/// and only multiplied with 0.
#[inline(always)]
fn log_of_edge(a: &Point, b: &Point, near: f64, far: f64, length: f64) -> f64 {
    // ln (near + far + length)/(near + far - length); both together are 2 (near far + a·b), which cancels between the ends.
    let (product, along) = (near * far, dot(a, b));
    let off = cross(a, b);
    let sum = product + along.abs();
    let small = dot(&off, &off) / sum.max(f64::MIN_POSITIVE);
    let below = if along >= 0.0 { sum } else { small };
    let above = near + far + length;
    ln((0.5 * above * above / below.max(f64::MIN_POSITIVE)).min(f64::MAX))
}

/// Contributions of a triangle's edges at one point.
struct Edges {
    /// ∫ ds/r.
    log: [f64; 3],
    /// Difference of the ends' distances.
    rise: [f64; 3],
    /// Distance of the edge's line in the plane, positive inside.
    off: [f64; 3],
    /// (y - x)·n.
    height: f64,
    solid_angle: f64,
}

/// A triangle's numbers as arrays.
#[derive(Clone, Debug)]
pub struct Frame {
    pub corners: [Point; 3],
    pub centre: Point,
    pub normal: Point,
    /// Unit vectors along the edge behind each corner.
    pub along: [Point; 3],
    /// Unit vectors in the plane, out of the triangle.
    pub out: [Point; 3],
    pub lengths: [f64; 3],
    /// ∇φ_q.
    pub slopes: [Point; 3],
}

impl Frame {
    #[inline(always)]
    fn edges_from(&self, x: &Point) -> Edges {
        let mut r = self.corners;
        let mut far = [0.0; 3];
        for k in 0..3 {
            for axis in 0..3 {
                r[k][axis] -= x[axis];
            }
            far[k] = dot(&r[k], &r[k]).sqrt();
        }
        let (mut log, mut rise, mut off) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for e in 0..3 {
            let next = (e + 1) % 3;
            off[e] = dot(&r[e], &self.out[e]);
            rise[e] = far[next] - far[e];
            log[e] = log_of_edge(&r[e], &r[next], far[e], far[next], self.lengths[e]);
        }
        let [a, b, c] = &r;
        let below = far[0] * far[1] * far[2] + dot(a, b) * far[2] + dot(b, c) * far[0] + dot(c, a) * far[1];
        let solid_angle = 2.0 * atan2(dot(a, &cross(b, c)), below);
        Edges { log, rise, off, height: dot(a, &self.normal), solid_angle }
    }

    #[inline(always)]
    fn pull(&self, edges: &Edges) -> [f64; PULL] {
        let Edges { log, rise, off, height, solid_angle } = edges;
        let up = height * solid_angle;
        let g = off[0] * log[0] + off[1] * log[1] + off[2] * log[2] - up;
        // In the plane (I - n nᵀ) g, less what the edges take.
        let mut h = [g, 0.0, 0.0, g, 0.0, g];
        let n = &self.normal;
        add_product(&mut h, n, n, up - g);
        for e in 0..3 {
            let (along, out) = (&self.along[e], &self.out[e]);
            let mut taken = [0.0; 3];
            for axis in 0..3 {
                taken[axis] =
                    out[axis] * (off[e] * log[e]) + along[axis] * rise[e] + n[axis] * (2.0 * height * log[e]);
            }
            add_product(&mut h, out, &taken, -1.0);
        }
        [g, h[0], h[1], h[2], h[3], h[4], h[5]]
    }

    #[inline(always)]
    fn view(&self, x: &Point, edges: &Edges) -> [f64; 3] {
        let Edges { log, height, solid_angle, .. } = edges;
        let (mut flow, mut foot) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            flow[axis] = self.out[0][axis] * log[0] + self.out[1][axis] * log[1] + self.out[2][axis] * log[2];
            foot[axis] = x[axis] + self.normal[axis] * height - self.centre[axis];
        }
        let mut view = [0.0; 3];
        for q in 0..3 {
            let slope = &self.slopes[q];
            view[q] = -(1.0 / 3.0 + dot(slope, &foot)) * solid_angle + height * dot(slope, &flow);
        }
        view
    }
}

struct Pulling<'a, const N: usize> {
    frame: &'a Frame,
    points: &'a Points<N>,
    out: [[f64; N]; PULL],
}

impl<const N: usize> Kernel for &mut Pulling<'_, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for k in 0..N {
            let x = [self.points[0][k], self.points[1][k], self.points[2][k]];
            let pull = self.frame.pull(&self.frame.edges_from(&x));
            for m in 0..PULL {
                self.out[m][k] = pull[m];
            }
        }
    }
}

/// g and H at the points.
pub fn pulls<const N: usize>(frame: &Frame, points: &Points<N>) -> [[f64; N]; PULL] {
    let mut made = Pulling { frame, points, out: [[0.0; N]; PULL] };
    lanes::run(&mut made);
    made.out
}

struct Viewing<'a, const N: usize> {
    frame: &'a Frame,
    points: &'a Points<N>,
    out: [[f64; N]; 3],
}

impl<const N: usize> Kernel for &mut Viewing<'_, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for k in 0..N {
            let x = [self.points[0][k], self.points[1][k], self.points[2][k]];
            let view = self.frame.view(&x, &self.frame.edges_from(&x));
            for q in 0..3 {
                self.out[q][k] = view[q];
            }
        }
    }
}

/// -∫ r·n/r³ φ_q dA at the points: what the corners' displacements are seen under, -4π all together from inside a closed surface.
pub fn views<const N: usize>(frame: &Frame, points: &Points<N>) -> [[f64; N]; 3] {
    let mut made = Viewing { frame, points, out: [[0.0; N]; 3] };
    lanes::run(&mut made);
    made.out
}

struct Edge<'a, const N: usize> {
    ends: [Point; 2],
    along: Point,
    length: f64,
    points: &'a Points<N>,
    out: [[f64; N]; PULL],
}

impl<const N: usize> Edge<'_, N> {
    #[inline(always)]
    fn pull(&self, x: &Point) -> [f64; PULL] {
        let along = &self.along;
        let [mut from, mut to] = self.ends;
        for axis in 0..3 {
            from[axis] -= x[axis];
            to[axis] -= x[axis];
        }
        let (near, far) = (dot(&from, &from).sqrt(), dot(&to, &to).sqrt());
        let (s, t) = (dot(&from, along), dot(&to, along));
        let log = log_of_edge(&from, &to, near, far, self.length) / self.length;
        let mut off = from;
        for axis in 0..3 {
            off[axis] -= along[axis] * s;
        }
        let rise = (t / far - s / near) / self.length;
        let fall = (1.0 / near - 1.0 / far) / self.length;
        let mut h = [0.0; 6];
        add_product(&mut h, along, along, log - rise);
        add_product(&mut h, &off, &off, rise / dot(&off, &off).max(f64::MIN_POSITIVE));
        add_product(&mut h, &off, along, 2.0 * fall);
        [log, h[0], h[1], h[2], h[3], h[4], h[5]]
    }
}

impl<const N: usize> Kernel for &mut Edge<'_, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for k in 0..N {
            let x = [self.points[0][k], self.points[1][k], self.points[2][k]];
            let pull = self.pull(&x);
            for m in 0..PULL {
                self.out[m][k] = pull[m];
            }
        }
    }
}

/// The means of 1/r and r rᵀ/r³ over the way from `a` to `b`, at the points.
pub fn means_over_edge<const N: usize>(
    a: &Vector3<f64>,
    b: &Vector3<f64>,
    points: &Points<N>,
) -> [[f64; N]; PULL] {
    let (way, length) = (b - a, (b - a).norm());
    let along = (way / length).into();
    let mut made = Edge { ends: [(*a).into(), (*b).into()], along, length, points, out: [[0.0; N]; PULL] };
    lanes::run(&mut made);
    made.out
}

/// ln x of a positive normal number, to two units in the last place: ln 2ᵉ m = e ln 2 + 2 artanh s, s = (m - 1)/(m + 1), |s| < 0.172.
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    /// The bits of √½, from which on a mantissa counts to the exponent above.
    const HALF_ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
    const MANTISSA: u64 = (1 << 52) - 1;
    // 2⁵² + n has n in its last bits.
    const SHIFT: f64 = 4_503_599_627_370_496.0;
    const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
    let bits = x.to_bits().wrapping_add((1023 << 52) - HALF_ROOT);
    let exponent = f64::from_bits((bits >> 52) | SHIFT.to_bits()) - (SHIFT + 1023.0);
    let m = f64::from_bits((bits & MANTISSA).wrapping_add(HALF_ROOT));
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let mut sum = 1.0 / 21.0;
    for k in [19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0] {
        sum = sum * z + 1.0 / k;
    }
    exponent * LN_2[0] + (2.0 * s + (2.0 * s * z * sum + exponent * LN_2[1]))
}

/// The angle of (x, y) from the x axis, within ±π; 0 of (0, 0). Moshier, Methods and Programs for Mathematical Functions, 1989.
#[inline(always)]
pub fn atan2(y: f64, x: f64) -> f64 {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    const P: [f64; 5] = [
        -8.750_608_600_031_904e-1,
        -1.615_753_718_733_365e1,
        -7.500_855_792_314_705e1,
        -1.228_866_684_490_136_2e2,
        -6.485_021_904_942_025e1,
    ];
    const Q: [f64; 5] = [
        2.485_846_490_142_306_3e1,
        1.650_270_098_316_988_5e2,
        4.328_810_604_912_903e2,
        4.853_903_996_359_137e2,
        1.945_506_571_482_614e2,
    ];
    let (across, up) = (x.abs(), y.abs());
    let (small, great) = if up < across { (up, across) } else { (across, up) };
    // Above tan π/8, the angle less π/4.
    let is_steep = small > 0.414_213_562_373_095_03 * great;
    let (over, under) = if is_steep { (small - great, small + great) } else { (small, great) };
    let t = over / under.max(f64::MIN_POSITIVE);
    let z = t * t;
    let p = P.iter().fold(0.0, |sum, part| sum * z + part);
    let q = Q.iter().fold(1.0, |sum, part| sum * z + part);
    let angle = t + t * z * p / q + if is_steep { FRAC_PI_4 } else { 0.0 };
    let angle = if up < across { angle } else { FRAC_PI_2 - angle };
    let angle = if x < 0.0 { PI - angle } else { angle };
    let angle = if great > 0.0 { angle } else { 0.0 };
    if y < 0.0 { -angle } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn they_are_those_of_the_standard_library(exponent in -700.0..700.0f64, near in -0.5..0.5f64, x in -1.0..1.0f64, y in -1.0..1.0f64) {
            for value in [exponent.exp(), 1.0 + near, 1.0 + 1e-9 * near] {
                prop_assert!((ln(value) - value.ln()).abs() <= 1e-15 * value.ln().abs(), "{value:e}");
            }
            for scale in [1.0, 1e-3, 1e-12] {
                for (y, x) in [(y, scale * x), (scale * y, x)] {
                    prop_assert!((atan2(y, x) - y.atan2(x)).abs() <= 1e-15 * y.atan2(x).abs(), "{y} {x}");
                }
            }
        }
    }

    #[test]
    fn their_ends_are_finite() {
        use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
        for value in [f64::MIN_POSITIVE, f64::MAX, 1.0, 0.5f64.sqrt(), 2f64.sqrt()] {
            assert!((ln(value) - value.ln()).abs() <= 2e-16 * value.ln().abs(), "{value:e}");
        }
        assert_eq!(
            [atan2(0.0, 0.0), atan2(1.0, 1.0), atan2(1.0, 0.0), atan2(0.0, -1.0)],
            [0.0, FRAC_PI_4, FRAC_PI_2, PI]
        );
    }
}
