//! Integrals over two triangles, which meet in nothing, a corner, an edge, or are one.
//!
//! In: two triangles. Out: ∫∫ 1/r and ∫∫ r rᵀ/r³ ([`Pull`]), and ∫∫ -r·n/r³ φ_q. Far from each other, both are integrated by
//! Gauss; nearer, the greater in closed form and the smaller by Gauss; nearest, the smaller is halved across its longest edge until
//! halving changes nothing, so that thin walls and slivers need no case of their own. Those that touch: [`touching`].

use super::touching;
use super::triangle::{Pull, Triangle};
use nalgebra::{Matrix3, Vector3};

/// Distance of the centres over the sum of the radii: from the first on Gauss' rule of three points does for both, from the
/// second on one of seven for one.
const FAR: f64 = 3.0;
const NEAR: f64 = 1.6;
/// Halving ends where it changes the integral by less than this part, and at this depth.
const TOLERANCE: f64 = 3e-6;
const DEPTH: u32 = 18;

/// Weights of the corners in the three points of degree 2, each of a third of the area.
const THREE: [[f64; 3]; 3] =
    [[2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0]];

/// Weights of the corners and parts of the area of the seven points of degree 5 (Radon).
const SEVEN: [([f64; 3], f64); 7] = {
    const A: f64 = 0.470_142_064_105_115_1;
    const B: f64 = 0.101_286_507_323_456_33;
    const OF_A: f64 = 0.132_394_152_788_506_2;
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
    let is_smaller = i.radius.total_cmp(&j.radius).then_with(|| order(i, j)).is_le();
    let (small, great) = if is_smaller { (i, j) } else { (j, i) };
    if apart > FAR {
        return both_by_gauss(small, great);
    }
    if let Some(pull) = touching::pull(small, great) {
        return pull;
    }
    let whole = seven(&small.corners, small.area, &|x| great.pull(x));
    if apart > NEAR {
        return whole;
    }
    let least = TOLERANCE * whole.g;
    halved(&small.corners, small.area, whole, DEPTH, &|x| great.pull(x), &|a: &Pull, b: &Pull| {
        a.is_near(b, least)
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
    Pull::default().plus(&sum, i.area * j.area / 9.0)
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
    let least = TOLERANCE * std::f64::consts::TAU * i.area;
    halved(&i.corners, i.area, whole, DEPTH, &at, &|a: &Vector3<f64>, b: &Vector3<f64>| {
        (a - b).amax() < least
    })
}

/// What is integrated: summed with weights.
trait Sum: Default + Copy {
    fn plus(self, other: Self, weight: f64) -> Self;
}

impl Sum for Pull {
    fn plus(self, other: Pull, weight: f64) -> Pull {
        Pull::plus(self, &other, weight)
    }
}

impl Sum for Vector3<f64> {
    fn plus(self, other: Self, weight: f64) -> Self {
        self + other * weight
    }
}

fn seven<T: Sum>(corners: &[Vector3<f64>; 3], area: f64, f: &impl Fn(&Vector3<f64>) -> T) -> T {
    let frame = Matrix3::from_columns(corners);
    SEVEN
        .iter()
        .fold(T::default(), |sum, (at, weight)| sum.plus(f(&(frame * Vector3::from(*at))), weight * area))
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn triangle(x: [[f64; 3]; 3]) -> Triangle {
        Triangle::new(x.map(Vector3::from)).unwrap()
    }

    /// Twice the same triangle: ∫∫ 1/r of an equilateral one of side 1 is (√3/4)²·… in closed form by its three edges
    /// (Eibert and Hansen, IEEE Trans. Antennas Propag. 43, 1995): A² · 4/3 · 3 · ln 3 / side.
    #[test]
    fn a_triangle_on_itself_has_the_closed_form() {
        let own = triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.75f64.sqrt(), 0.0]]);
        let exact = own.area * own.area * 4.0 * 3f64.ln();
        let pull = pull(&own, &own);
        assert!((pull.g / exact - 1.0).abs() < 1e-12, "{} {exact}", pull.g);
        // r rᵀ/r³ has the trace 1/r, and no side is preferred.
        let [xx, xy, _, yy, _, zz] = pull.h;
        let tolerance = 1e-12 * exact;
        assert!((xx - yy).abs() < tolerance && xy.abs() < tolerance && zz.abs() < 1e-12);
        assert!((xx + yy - pull.g).abs() < 1e-12);
    }

    /// In whatever unit.
    #[test]
    fn a_triangle_on_itself_grows_with_the_cube_of_its_size() {
        let of = |size: f64| {
            let own = triangle([[0.0; 3], [4.0 * size, 0.0, 0.0], [0.0, size, 0.0]]);
            pull(&own, &own).g / size.powi(3)
        };
        let one = of(1.0);
        assert!(one > 0.0);
        for size in [1e-9, 1e-3, 7.0, 1e3, 1e9] {
            assert!((of(size) / one - 1.0).abs() < 1e-12, "{size}");
        }
    }

    /// Triangles that share an edge or a corner, flat, folded and sharp, beside halving, which needs no such case.
    #[test]
    fn shared_corners_are_as_halving_has_them() {
        let own = triangle([[0.0; 3], [1.0, 0.1, 0.0], [0.4, 0.9, 0.2]]);
        for other in [
            [[1.0, 0.1, 0.0], [0.0; 3], [0.5, -0.9, 0.1]],
            [[0.0; 3], [0.4, 0.9, 0.2], [-0.6, 0.7, 0.9]],
            [[1.0, 0.1, 0.0], [0.0; 3], [0.4, 0.7, 0.5]],
            [[1.0, 0.1, 0.0], [1.7, 0.3, 0.0], [1.2, 0.9, -0.4]],
            [[0.0; 3], [-0.9, 0.1, 0.3], [-0.4, -0.8, 0.0]],
            [[0.4, 0.9, 0.2], [0.5, 0.9, 3.0], [0.3, 1.0, 3.0]],
        ] {
            let other = triangle(other);
            let sum = pull(&own, &other);
            let whole = seven(&own.corners, own.area, &|x| other.pull(x));
            let fine = halved(&own.corners, own.area, whole, 10, &|x| other.pull(x), &|_, _| false);
            assert!(sum.is_near(&fine, 5e-5 * sum.g), "{sum:?} {fine:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// Wherever the second one lies: both orders agree, and both with many points of Gauss where they are apart.
        #[test]
        fn rules_agree_across_their_borders(at in prop::array::uniform3(-4.0..4.0f64), tip in prop::array::uniform3(-0.5..0.5f64)) {
            let [x, y, z] = at;
            let near = triangle([[0.0; 3], [1.0, 0.1, 0.0], [0.4, 0.9, 0.2]]);
            let other = triangle([[x, y, z], [x + 0.8, y, z + 0.3], [x + tip[0], y + 0.9, z + tip[2]]]);
            let (there, back) = (pull(&near, &other), pull(&other, &near));
            prop_assert_eq!(there.g.to_bits(), back.g.to_bits());
            prop_assert!((there.h[0] + there.h[3] + there.h[5] - there.g).abs() < 1e-12 * there.g);
            if distance(&near, &other) > 1.0 {
                let whole = seven(&near.corners, near.area, &|x| other.pull(x));
                let fine = halved(&near.corners, near.area, whole, 6, &|x| other.pull(x), &|_, _| false);
                prop_assert!((there.g - fine.g).abs() < 1e-4 * fine.g, "{} {}", there.g, fine.g);
                for (a, b) in there.h.iter().zip(&fine.h) {
                    prop_assert!((a - b).abs() < 1e-4 * fine.g);
                }
            }
        }

        /// From inside a closed surface all of it is seen, under 4π.
        #[test]
        fn a_tetrahedron_is_seen_all_around(x in prop::array::uniform3(0.05..0.3f64)) {
            let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|face: [usize; 3]| triangle(face.map(|c| corners[c])));
            let seen: f64 = faces.iter().flat_map(|face| face.view(&Vector3::from(x))).sum();
            prop_assert!((seen + 4.0 * std::f64::consts::PI).abs() < 1e-12);
        }
    }
}
