//! Integrals over two triangles, which meet in nothing, a corner, an edge, or are one.
//!
//! In: two triangles. Out: ∫∫ 1/r and ∫∫ r rᵀ/r³ ([`Pull`]), and ∫∫ -r·n/r³ φ_q. Far from each other, both are integrated by
//! Gauss, with three points each ([`super::far`]) or seven; nearer, the greater in closed form and the smaller by Gauss, which is
//! halved across its longest edge until two rules agree, so that thin walls and slivers need no case of their own. Those that touch:
//! [`touching`].

use super::potentials::{PULL, Points, pulls, views};
use super::rules::{SEVEN, TRIANGLE};
use super::touching::{self, is_near};
use super::triangle::{Pull, Triangle};
use crate::base::lanes::{self, Kernel};
use nalgebra::Vector3;

/// Distance of the centres over the sum of the radii: from the first on Gauss' rule of three points does for both, from the
/// second on one of seven.
pub const FAR: f64 = 8.0;
const NEAR: f64 = 2.0;
/// Halving ends where the rules of degrees 5 and 8 differ by less than this part, and at this depth.
const TOLERANCE: f64 = 3e-5;
const DEPTH: u32 = 18;

/// Distance of the centres over the sum of the radii.
fn distance(i: &Triangle, j: &Triangle) -> f64 {
    (i.centre - j.centre).norm() / (i.radius + j.radius)
}

/// ∫∫ 1/r and ∫∫ r rᵀ/r³ over both; the same for (j, i), to the last bit.
pub fn pull(i: &Triangle, j: &Triangle) -> Pull {
    let is_smaller = i.radius.total_cmp(&j.radius).then_with(|| order(i, j)).is_le();
    let (small, great) = if is_smaller { (i, j) } else { (j, i) };
    if distance(i, j) > NEAR {
        return Pull(by_gauss(small, great).0);
    }
    if let Some(pull) = touching::pull(small, great) {
        return pull;
    }
    let of = |x: &Points<24>| pulls(great, x);
    Pull(integral(small, |fine| TOLERANCE * fine[0], &of))
}

/// A fixed order of triangles of the same radius.
fn order(i: &Triangle, j: &Triangle) -> std::cmp::Ordering {
    let numbers = |t: &Triangle| [t.centre.x, t.centre.y, t.centre.z];
    let pairs = numbers(i).into_iter().zip(numbers(j));
    pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
}

/// ∫∫ -r·n/r³ φ_q over x in i and y in j, n and φ_q those of j.
pub fn view(i: &Triangle, j: &Triangle) -> Vector3<f64> {
    if distance(i, j) > NEAR {
        return by_gauss(i, j).1.into();
    }
    // As large as it gets: half the full angle over all of i.
    let least = TOLERANCE * std::f64::consts::TAU;
    Vector3::from(integral(i, |_| least, &|x| views(j, x)))
}

/// One evaluation of the kernels between x and y, of weight 1: of a pull, and -r·n/r³.
#[inline(always)]
pub fn kernel(x: [f64; 3], y: [f64; 3], normal: &[f64; 3]) -> ([f64; PULL], f64) {
    let r = [y[0] - x[0], y[1] - x[1], y[2] - x[2]];
    let inverse = 1.0 / (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt();
    let cube = inverse * inverse * inverse;
    let s = [r[0] * cube, r[1] * cube, r[2] * cube];
    let pull = [inverse, s[0] * r[0], s[0] * r[1], s[0] * r[2], s[1] * r[1], s[1] * r[2], s[2] * r[2]];
    (pull, -(s[0] * normal[0] + s[1] * normal[1] + s[2] * normal[2]))
}

struct Sevens<'a> {
    i: &'a Triangle,
    j: &'a Triangle,
    pull: [[f64; 8]; PULL],
    view: [[f64; 8]; 3],
}

impl Kernel for &mut Sevens<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let (from, to, normal) = (&self.i.seven, &self.j.seven, &self.j.frame.normal);
        for k in 0..8 {
            let x = [from[0][k], from[1][k], from[2][k]];
            let (mut pull, mut view) = ([0.0; PULL], [0.0; 3]);
            for l in 0..7 {
                let (own, flow) = kernel(x, [to[0][l], to[1][l], to[2][l]], normal);
                for m in 0..PULL {
                    pull[m] += SEVEN.fine[l] * own[m];
                }
                for q in 0..3 {
                    view[q] += SEVEN.fine[l] * SEVEN.at[q][l] * flow;
                }
            }
            for m in 0..PULL {
                self.pull[m][k] = pull[m];
            }
            for q in 0..3 {
                self.view[q][k] = view[q];
            }
        }
    }
}

/// Both integrals by seven points of each.
fn by_gauss(i: &Triangle, j: &Triangle) -> ([f64; PULL], [f64; 3]) {
    let mut sums = Sevens { i, j, pull: [[0.0; 8]; PULL], view: [[0.0; 8]; 3] };
    lanes::run(&mut sums);
    let areas = i.area * j.area;
    let ([_, pull], [_, view]) = (SEVEN.means(&sums.pull), SEVEN.means(&sums.view));
    (pull.map(|value| areas * value), view.map(|value| areas * value))
}

/// The integral over a triangle, as exact as `least` asks of its mean.
fn integral<const M: usize>(
    triangle: &Triangle,
    least: impl Fn(&[f64; M]) -> f64,
    f: &impl Fn(&Points<24>) -> [[f64; 24]; M],
) -> [f64; M] {
    let corners = &triangle.corners;
    let [coarse, fine] = TRIANGLE.means(&f(&TRIANGLE.points(corners)));
    let least = least(&fine);
    let mean = if is_near(&coarse, &fine, least) { fine } else { halved(corners, least, DEPTH, f) };
    mean.map(|value| triangle.area * value)
}

/// The mean over a triangle from both its halves.
fn halved<const M: usize>(
    corners: &[Vector3<f64>; 3],
    least: f64,
    depth: u32,
    f: &impl Fn(&Points<24>) -> [[f64; 24]; M],
) -> [f64; M] {
    let length = |k: usize| (corners[(k + 1) % 3] - corners[k]).norm_squared();
    let longest = (0..3).fold(0, |most, k| if length(k) > length(most) { k } else { most });
    let [a, b, c] = std::array::from_fn(|k| corners[(longest + k) % 3]);
    let middle = (a + b) / 2.0;
    // Of half the area, twice as much may be wrong.
    let least = 2.0 * least;
    let halves = [[a, middle, c], [middle, b, c]].map(|half| {
        let [coarse, fine] = TRIANGLE.means(&f(&TRIANGLE.points(&half)));
        if depth == 0 || is_near(&coarse, &fine, least) { fine } else { halved(&half, least, depth - 1, f) }
    });
    std::array::from_fn(|m| 0.5 * (halves[0][m] + halves[1][m]))
}
