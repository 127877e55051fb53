//! Integrals over two triangles that share corners.
//!
//! In: two triangles. Out: ∫∫ 1/r and ∫∫ r rᵀ/r³. Both kernels are homogeneous of degree -1 in x - y, so that Euler's theorem, applied
//! about a corner in common, leaves integrals over the sides behind it, one dimension less each time (Lenoir and Salles, SIAM J. Sci.
//! Comput. 34, 2012). What is left is in closed form, or smooth along one edge.

use super::triangle::{Pull, Triangle};
use nalgebra::Vector3;

/// Points of Gauss on \[0, 1\] and their weights: degree 7.
const FOUR: [(f64, f64); 4] = {
    const A: f64 = 0.069_431_844_202_973_71;
    const B: f64 = 0.330_009_478_207_571_87;
    const OF_A: f64 = 0.173_927_422_568_726_92;
    const OF_B: f64 = 0.326_072_577_431_273_05;
    [(A, OF_A), (B, OF_B), (1.0 - B, OF_B), (1.0 - A, OF_A)]
};
/// Halving ends where it changes the mean by less than this part, and at this depth.
const TOLERANCE: f64 = 1e-7;
const DEPTH: u32 = 24;

/// Both integrals; `None` of triangles without a corner in common.
pub fn pull(i: &Triangle, j: &Triangle) -> Option<Pull> {
    let shared = |p: usize| (0..3).find(|&q| i.corners[p] == j.corners[q]);
    let pairs: Vec<(usize, usize)> = (0..3).filter_map(|p| Some((p, shared(p)?))).collect();
    match pairs[..] {
        [] => None,
        [(p, q)] => Some(corner(i, j, p, q)),
        [first, second] => Some(edge(i, j, first, second)),
        [..] => Some(itself(i)),
    }
}

/// ⅔ of the area times the sum over the corners of ∫ f from there.
fn itself(i: &Triangle) -> Pull {
    let part = 2.0 * i.area / 3.0;
    i.corners.iter().fold(Pull::default(), |sum, corner| sum.plus(&i.pull(corner), part))
}

/// ⅔ of each area times the other's potential, on the mean over the edge behind the corner.
fn corner(i: &Triangle, j: &Triangle, p: usize, q: usize) -> Pull {
    let behind = |of: &Triangle, at: usize, other: &Triangle| {
        mean(&of.corners[(at + 1) % 3], &of.corners[(at + 2) % 3], &|x| other.pull(x))
    };
    let part = |of: &Triangle| 2.0 * of.area / 3.0;
    Pull::default().plus(&behind(i, p, j), part(i)).plus(&behind(j, q, i), part(j))
}

/// With the edge from v to w in common and the tips a and b: a third of each area times the other's potential at its tip, and ⅔ of the
/// product of the areas times the means of the kernel between the edges wa, vb and wb, va.
fn edge(i: &Triangle, j: &Triangle, first: (usize, usize), second: (usize, usize)) -> Pull {
    let tip = |of: &Triangle, one: usize, other: usize| of.corners[3 - one - other];
    let (a, b) = (tip(i, first.0, second.0), tip(j, first.1, second.1));
    let (v, w) = (i.corners[first.0], i.corners[second.0]);
    let between = |c: &Vector3<f64>, d: &Vector3<f64>| mean(&w, c, &|x| segment(x, &v, d));
    let product = 2.0 * i.area * j.area / 3.0;
    let tips = Pull::default().plus(&j.pull(&a), i.area / 3.0).plus(&i.pull(&b), j.area / 3.0);
    tips.plus(&between(&a, &b), product).plus(&between(&b, &a), product)
}

/// The mean of 1/r and r rᵀ/r³ over the way from `a` to `b`, seen from x.
fn segment(x: &Vector3<f64>, a: &Vector3<f64>, b: &Vector3<f64>) -> Pull {
    let (length, along) = ((b - a).norm(), (b - a).normalize());
    let (from, to) = (a - x, b - x);
    let (s, t) = (from.dot(&along), to.dot(&along));
    let (near, far) = (from.norm(), to.norm());
    let quotient = if s + t >= 0.0 { (far + t) / (near + s) } else { (near - s) / (far - t) };
    let log = quotient.clamp(f64::MIN_POSITIVE, f64::MAX).ln() / length;
    let off = from - along * s;
    let across = off.try_normalize(0.0).unwrap_or_default();
    let rise = (t / far - s / near) / length;
    let fall = (1.0 / near - 1.0 / far) / length;
    let mut pull = Pull { g: log, h: [0.0; 6] };
    pull.add_product(&along, &along, log - rise);
    pull.add_product(&across, &across, rise);
    pull.add_product(&off, &along, 2.0 * fall);
    pull
}

/// The mean of f over the way from `a` to `b`.
fn mean(a: &Vector3<f64>, b: &Vector3<f64>, f: &impl Fn(&Vector3<f64>) -> Pull) -> Pull {
    let whole = four(a, b, f);
    halved(a, b, whole, TOLERANCE * whole.g, DEPTH, f)
}

fn four(a: &Vector3<f64>, b: &Vector3<f64>, f: &impl Fn(&Vector3<f64>) -> Pull) -> Pull {
    FOUR.iter().fold(Pull::default(), |sum, (at, weight)| sum.plus(&f(&a.lerp(b, *at)), *weight))
}

fn halved(
    a: &Vector3<f64>,
    b: &Vector3<f64>,
    whole: Pull,
    least: f64,
    depth: u32,
    f: &impl Fn(&Vector3<f64>) -> Pull,
) -> Pull {
    let middle = a.lerp(b, 0.5);
    let [first, second] = [four(a, &middle, f), four(&middle, b, f)];
    let sum = Pull::default().plus(&first, 0.5).plus(&second, 0.5);
    if depth == 0 || sum.is_near(&whole, least) {
        return sum;
    }
    // Of half the way, twice as much may be wrong.
    let part = |a, b, whole| halved(a, b, whole, 2.0 * least, depth - 1, f);
    Pull::default().plus(&part(a, &middle, first), 0.5).plus(&part(&middle, b, second), 0.5)
}
