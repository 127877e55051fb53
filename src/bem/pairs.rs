//! Integrals over two triangles, which meet in nothing, a corner, an edge, or are one.
//!
//! In: two triangles. Out: ∫∫ 1/r and ∫∫ r rᵀ/r³ ([`Pull`]), and ∫∫ -r·n/r³ φ_q. Far from each other, both are integrated by
//! Gauss; nearer, the greater in closed form and the smaller by Gauss; nearest, the smaller is halved across its longest edge until
//! halving changes nothing, so that edges in common, thin walls and slivers need no case of their own.

use super::triangle::{Pull, Triangle};
use nalgebra::{Matrix3, Vector3};

/// Distance of the centres over the sum of the radii: from the first on Gauss' rule of three points does for both, from the
/// second on one of seven for one.
const FAR: f64 = 3.0;
const NEAR: f64 = 1.6;
/// Halving ends where it changes the integral by less than this part, and at this depth.
const TOLERANCE: f64 = 1e-6;
const DEPTH: u32 = 18;

/// Weights of the corners in the three points of degree 2, each of a third of the area.
const THREE: [[f64; 3]; 3] = [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];

/// Weights of the corners and parts of the area of the seven points of degree 5 (Radon).
const SEVEN: [([f64; 3], f64); 7] = {
    const A: f64 = 0.470_142_064_105_115_1;
    const B: f64 = 0.101_286_507_323_456_33;
    const OF_A: f64 = 0.132_394_152_788_506_18;
    const OF_B: f64 = 0.125_939_180_544_827_17;
    [
        ([1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0], 0.225),
        ([1.0 - 2.0 * A, A, A], OF_A),
        ([A, 1.0 - 2.0 * A, A], OF_A),
        ([A, A, 1.0 - 2.0 * A], OF_A),
        ([1.0 - 2.0 * B, B, B], OF_B),
        ([B, 1.0 - 2.0 * B, B], OF_B),
        ([B, B, 1.0 - 2.0 * B], OF_B),
    ]
};

/// Distance of the centres over the sum of the radii.
fn distance(i: &Triangle, j: &Triangle) -> f64 {
    (i.centre - j.centre).norm() / (i.radius + j.radius)
}

/// ∫∫ 1/r and ∫∫ r rᵀ/r³ over both; the same for (j, i), to the last bit.
pub fn pull(i: &Triangle, j: &Triangle) -> Pull {
    let apart = distance(i, j);
    if apart > FAR {
        return both_by_gauss(i, j);
    }
    let is_smaller = i.radius.total_cmp(&j.radius).then_with(|| order(i, j)).is_le();
    let (small, great) = if is_smaller { (i, j) } else { (j, i) };
    let whole = seven(&small.corners, small.area, &|x| great.pull(x));
    if apart > NEAR {
        return whole;
    }
    let least = TOLERANCE * whole.g;
    halved(&small.corners, small.area, whole, DEPTH, &|x| great.pull(x), &|a, b| {
        (a.g - b.g).abs() < least && a.h.iter().zip(&b.h).all(|(a, b)| (a - b).abs() < least)
    })
}

/// A fixed order of triangles of the same radius.
fn order(i: &Triangle, j: &Triangle) -> std::cmp::Ordering {
    let numbers = |t: &Triangle| [t.centre.x, t.centre.y, t.centre.z];
    let pairs = numbers(i).into_iter().zip(numbers(j));
    pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
}

fn both_by_gauss(i: &Triangle, j: &Triangle) -> Pull {
    let (from, to) = (THREE.map(|at| i.at(&at)), THREE.map(|at| j.at(&at)));
    let mut sum = Pull::default();
    for x in &from {
        for y in &to {
            let r = y - x;
            let inverse = 1.0 / r.norm();
            sum.g += inverse;
            sum.add_product(&r, &r, inverse * inverse * inverse);
        }
    }
    Pull::default().plus(sum, i.area * j.area / 9.0)
}

/// ∫∫ -r·n/r³ φ_q over x in i and y in j, n and φ_q those of j.
pub fn view(i: &Triangle, j: &Triangle) -> Vector3<f64> {
    let apart = distance(i, j);
    let at = |x: &Vector3<f64>| Vector3::from(j.view(x));
    if apart > FAR {
        return THREE.iter().map(|weights| at(&i.at(weights)) * (i.area / 3.0)).sum();
    }
    let whole = seven(&i.corners, i.area, &at);
    if apart > NEAR {
        return whole;
    }
    // As large as it gets: half the full angle over all of i.
    let least = 10.0 * TOLERANCE * std::f64::consts::TAU * i.area;
    halved(&i.corners, i.area, whole, DEPTH, &at, &|a: &Vector3<f64>, b: &Vector3<f64>| (a - b).amax() < least)
}

/// What is integrated: summed with weights.
trait Sum: Default + Copy {
    fn plus(self, other: Self, weight: f64) -> Self;
}

impl Sum for Pull {
    fn plus(mut self, other: Pull, weight: f64) -> Pull {
        self.add(&other, weight);
        self
    }
}

impl Sum for Vector3<f64> {
    fn plus(self, other: Self, weight: f64) -> Self {
        self + other * weight
    }
}

fn seven<T: Sum>(corners: &[Vector3<f64>; 3], area: f64, f: &impl Fn(&Vector3<f64>) -> T) -> T {
    let frame = Matrix3::from_columns(corners);
    SEVEN.iter().fold(T::default(), |sum, (at, weight)| sum.plus(f(&(frame * Vector3::from(*at))), weight * area))
}

/// The integral over a triangle, of which `whole` is a first value, as exact as `is_near` asks.
fn halved<T: Sum>(
    corners: &[Vector3<f64>; 3],
    area: f64,
    whole: T,
    depth: u32,
    f: &impl Fn(&Vector3<f64>) -> T,
    is_near: &impl Fn(&T, &T) -> bool,
) -> T {
    let length = |k: usize| (corners[(k + 1) % 3] - corners[k]).norm_squared();
    let longest = (0..3).fold(0, |most, k| if length(k) > length(most) { k } else { most });
    let [a, b, c] = std::array::from_fn(|k| corners[(longest + k) % 3]);
    let middle = (a + b) / 2.0;
    let halves = [[a, middle, c], [middle, b, c]];
    let parts = halves.map(|half| seven(&half, area / 2.0, f));
    let sum = parts[0].plus(parts[1], 1.0);
    if depth == 0 || is_near(&whole, &sum) {
        return sum;
    }
    let [first, second] =
        [0, 1].map(|half| halved(&halves[half], area / 2.0, parts[half], depth - 1, f, is_near));
    first.plus(second, 1.0)
}
