//! Integrals over two triangles that share corners.
//!
//! In: two triangles. Out: ∫∫ 1/r and ∫∫ r rᵀ/r³. Both kernels are homogeneous of degree -1 in x - y, so that Euler's theorem, applied
//! about a corner in common, leaves integrals over the sides behind it, one dimension less each time (Lenoir and Salles, SIAM J. Sci.
//! Comput. 34, 2012). What is left is in closed form, or smooth along one edge.

use super::potentials::{PULL, Point, Points, means_over_edge, pulls};
use super::rules::EDGE;
use super::triangle::{Pull, Triangle};
use nalgebra::Vector3;

/// Halving ends where Gauss' and Kronrod's rules differ by less than this part, the latter by much less, and at this depth.
const TOLERANCE: f64 = 1e-5;
const DEPTH: u32 = 24;

/// Both integrals; `None` for triangles without a corner in common.
pub fn pull(i: &Triangle, j: &Triangle) -> Option<Pull> {
    let shared = |p: usize| (0..3).find(|&q| i.corners[p] == j.corners[q]);
    let [a, b, c] = [0, 1, 2].map(|p| shared(p).map(|q| (p, q)));
    match (a, b, c) {
        (None, None, None) => None,
        (Some((p, q)), None, None) | (None, Some((p, q)), None) | (None, None, Some((p, q))) => {
            Some(corner(i, j, p, q))
        }
        (Some(first), Some(second), None)
        | (Some(first), None, Some(second))
        | (None, Some(first), Some(second)) => Some(edge(i, j, first, second)),
        (Some(_), Some(_), Some(_)) => Some(itself(i)),
    }
}

/// ⅔ of the area times the sum over the corners of ∫ f from there.
fn itself(i: &Triangle) -> Pull {
    let sums = pulls(&i.frame, &transposed(&i.frame.corners)).map(|[a, b, c]| a + b + c);
    Pull::default().plus(&Pull(sums), 2.0 * i.area / 3.0)
}

fn transposed(points: &[Point; 3]) -> Points<3> {
    std::array::from_fn(|axis| points.map(|point| point[axis]))
}

/// ⅔ of each area times the other's potential, on the mean over the edge behind the corner.
fn corner(i: &Triangle, j: &Triangle, p: usize, q: usize) -> Pull {
    let behind = |of: &Triangle, at: usize, other: &Triangle| {
        mean(&[of.corners[(at + 1) % 3], of.corners[(at + 2) % 3]], &|x| pulls(&other.frame, x))
    };
    let part = |of: &Triangle| 2.0 * of.area / 3.0;
    Pull::default().plus(&behind(i, p, j), part(i)).plus(&behind(j, q, i), part(j))
}

/// The pull of triangles with the edge from v to w in common and the tips a and b: a third of each area times the other's
/// potential at its tip, and ⅔ of the product of the areas times the means of the kernel between the edges wa, vb and wb, va.
fn edge(i: &Triangle, j: &Triangle, first: (usize, usize), second: (usize, usize)) -> Pull {
    let tip = |of: &Triangle, one: usize, other: usize| of.corners[3 - one - other];
    let (a, b) = (tip(i, first.0, second.0), tip(j, first.1, second.1));
    let (v, w) = (i.corners[first.0], i.corners[second.0]);
    let between = |c: Vector3<f64>, d: &Vector3<f64>| mean(&[w, c], &|x| means_over_edge(&v, d, x));
    let at = |of: &Triangle, x: &Vector3<f64>| {
        Pull(pulls(&of.frame, &[0, 1, 2].map(|axis| [x[axis]])).map(|[value]| value))
    };
    let product = 2.0 * i.area * j.area / 3.0;
    let tips = Pull::default().plus(&at(j, &a), i.area / 3.0).plus(&at(i, &b), j.area / 3.0);
    tips.plus(&between(a, &b), product).plus(&between(b, &a), product)
}

/// The mean of f over the way between the ends.
fn mean(ends: &[Vector3<f64>; 2], f: &impl Fn(&Points<16>) -> [[f64; 16]; PULL]) -> Pull {
    let [coarse, fine] = EDGE.means(&f(&EDGE.points(ends)));
    let least = TOLERANCE * fine[0];
    Pull(if is_near(&coarse, &fine, least) { fine } else { halved(ends, least, DEPTH, f) })
}

/// The mean of two halves, each of which may err by as much as the whole.
fn halved(
    [a, b]: &[Vector3<f64>; 2],
    least: f64,
    depth: u32,
    f: &impl Fn(&Points<16>) -> [[f64; 16]; PULL],
) -> [f64; PULL] {
    let middle = a.lerp(b, 0.5);
    let halves = [[*a, middle], [middle, *b]].map(|ends| {
        let [coarse, fine] = EDGE.means(&f(&EDGE.points(&ends)));
        // Of half the way, twice as much may be wrong.
        let least = 2.0 * least;
        if depth == 0 || is_near(&coarse, &fine, least) { fine } else { halved(&ends, least, depth - 1, f) }
    });
    std::array::from_fn(|m| 0.5 * (halves[0][m] + halves[1][m]))
}

/// Whether no number differs by more than `least`.
pub fn is_near<const M: usize>(a: &[f64; M], b: &[f64; M], least: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < least)
}
