//! Integrals over two triangles, which meet in nothing, a corner, an edge, or are one.
//!
//! In: two triangles. Out: ∫∫ 1/r and ∫∫ r rᵀ/r³ ([`Pull`]), and ∫∫ -r·n/r³ φ_q. Far from each other, both are integrated by
//! Gauss, with three points each ([`super::strip`]) or seven; nearer, the greater in closed form and the smaller by Gauss, which is
//! halved across its longest edge until two rules agree, so that thin walls and slivers need no case of their own. Those that touch:
//! [`touching`].

use super::potentials::{PULL, Points, pulls, views};
use super::rules::{SEVEN, TRIANGLE};
use super::touching::{self, is_near};
use super::triangle::{Pull, Triangle};
use crate::base::lanes::{self, Kernel};
use nalgebra::Vector3;

/// Distance of the centres over the sum of the radii: from the first on Gauss' rule of three points does for both, from the
/// second on one of seven, to 2e-6 of two million random pairs.
pub const FAR: f64 = 8.0;
const NEAR: f64 = 2.4;
/// Halving ends where the rules of degrees 5 and 8 differ by less than this part, the latter by much less, and at this depth.
const TOLERANCE: f64 = 3e-5;
/// Tolerance of views, in parts of half the full angle; no closed form helps where triangles touch.
const VIEW_TOLERANCE: f64 = 1e-7;
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
    let of = |x: &Points<24>| pulls(&great.frame, x);
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
    Vector3::from(integral(i, |_| VIEW_TOLERANCE * std::f64::consts::TAU, &|x| views(&j.frame, x)))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bem::strip::{LANES, Pulls, Strip};
    use proptest::prelude::*;

    fn triangle(x: [[f64; 3]; 3]) -> Triangle {
        Triangle::new(x.map(Vector3::from)).unwrap()
    }

    fn is_close(a: &Pull, b: &Pull, part: f64) -> bool {
        is_near(&a.0, &b.0, part * b.0[0])
    }

    /// Integrates by halving one of them, which needs no special case, to this part.
    fn fine(i: &Triangle, j: &Triangle, part: f64) -> Pull {
        Pull(integral(i, |mean| part * mean[0], &|x| pulls(&j.frame, x)))
    }

    /// Twice the same triangle: ∫∫ 1/r of an equilateral one of side 1 is (√3/4)²·… in closed form by its three edges
    /// (Eibert and Hansen, IEEE Trans. Antennas Propag. 43, 1995): A² · 4/3 · 3 · ln 3 / side.
    #[test]
    fn a_triangle_on_itself_has_the_closed_form() {
        let own = triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.5, 0.75f64.sqrt(), 0.0]]);
        let exact = own.area * own.area * 4.0 * 3f64.ln();
        let Pull([g, xx, xy, _, yy, _, zz]) = pull(&own, &own);
        assert!((g / exact - 1.0).abs() < 1e-12, "{g} {exact}");
        // r rᵀ/r³ has the trace 1/r, and no side is preferred.
        let tolerance = 1e-12 * exact;
        assert!((xx - yy).abs() < tolerance && xy.abs() < tolerance && zz.abs() < 1e-12);
        assert!((xx + yy - g).abs() < 1e-12);
    }

    /// The pull does not depend on the unit of length.
    #[test]
    fn a_triangle_on_itself_grows_with_the_cube_of_its_size() {
        let of = |size: f64| {
            let own = triangle([[0.0; 3], [4.0 * size, 0.0, 0.0], [0.0, size, 0.0]]);
            pull(&own, &own).0[0] / size.powi(3)
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
            let (sum, halved) = (pull(&own, &other), fine(&own, &other, 1e-7));
            assert!(is_close(&sum, &halved, 1e-6), "{sum:?} {halved:?}");
        }
    }

    /// Two sheets of 1 × 0.3 that nearly touch: the integrals tend to that of a sheet with itself.
    #[test]
    fn nearly_touching_triangles_are_as_touching_ones() {
        let at = |height: f64| triangle([[0.0, 0.0, height], [1.0, 0.0, height], [0.2, 0.3, height]]);
        let own = pull(&at(0.0), &at(0.0)).0[0];
        let lost = [1e-2, 1e-3, 1e-4].map(|height| 1.0 - pull(&at(0.0), &at(height)).0[0] / own);
        // As 2π A height.
        let slope = std::f64::consts::TAU * at(0.0).area / own;
        for (lost, height) in lost.iter().zip([1e-2, 1e-3, 1e-4]) {
            assert!((lost / (slope * height) - 1.0).abs() < 15.0 * height + 0.1, "{lost} at {height}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// A closed surface is seen from inside under 4π.
        #[test]
        fn a_tetrahedron_is_seen_all_around(x in prop::array::uniform3(0.05..0.3f64)) {
            let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]].map(|face: [usize; 3]| triangle(face.map(|c| corners[c])));
            let seen: f64 = faces.iter().flat_map(|face| views(&face.frame, &x.map(|x| [x])).map(|[q]| q)).sum();
            prop_assert!((seen + 4.0 * std::f64::consts::PI).abs() < 1e-12);
        }

        /// Wherever the second one lies: both orders agree, and all rules with halving to the end.
        #[test]
        fn rules_agree_across_their_borders(
            at in prop::array::uniform3(-4.0..4.0f64),
            away in 1.0..6.0f64,
            tip in prop::array::uniform3(-0.5..0.5f64),
        ) {
            let [x, y, z] = at.map(|x| away * x);
            let near = triangle([[0.0; 3], [1.0, 0.1, 0.0], [0.4, 0.9, 0.2]]);
            let other = triangle([[x, y, z], [x + 0.8, y, z + 0.3], [x + tip[0], y + 0.9, z + tip[2]]]);
            let (there, back) = (pull(&near, &other), pull(&other, &near));
            prop_assert_eq!(there.0, back.0);
            let [g, xx, _, _, yy, _, zz] = there.0;
            prop_assert!((xx + yy + zz - g).abs() < 1e-12 * g);
            if distance(&near, &other) > 1.0 {
                let fine = fine(&near, &other, 1e-8);
                prop_assert!(is_close(&there, &fine, 2e-6), "{:?} {:?}", there, fine);
                let seen = integral(&near, |_| 1e-9, &|x| views(&other.frame, x));
                prop_assert!((view(&near, &other) - Vector3::from(seen)).amax() < 2e-6, "{:?}", seen);
            }
            // In lanes, where three points do from FAR on.
            let strip = [&near, &other];
            let (strip, mut pulls) = (Strip::new(&strip), Pulls::default());
            let weights: [f64; LANES] = std::array::from_fn(|k| [1.0, 0.5].get(k).copied().unwrap_or(0.0));
            strip.pulls(&other, &weights, true, &mut pulls);
            let far = Pull(pulls.pull.map(|lanes| lanes[0]));
            prop_assert!(is_close(&far, &there, 3e-5), "{:?} {:?}", far, there);
            prop_assert!(pulls.pull.iter().zip(pull(&other, &other).0).all(|(lanes, own)| lanes[1] == 0.5 * own && lanes[2] == 0.0));
            let seen = Vector3::from(pulls.view.map(|lanes| lanes[0]));
            prop_assert!((seen - view(&near, &other)).amax() < 2e-6 && pulls.view.iter().all(|lanes| lanes[1] == 0.0));
        }
    }
}
