//! Problems with analytic answers: the thick cylinder, torsion of a square bar, Kelvin's point force.

use super::problem::{Bound, Measure, Problem};
use crate::fem::{Dilatation, Element, Lame};
use crate::measure::body::{Body, ProblemError};
use crate::measure::exact::Exact;
use crate::measure::smooth::Kelvin;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// The thick cylinder under inner pressure, in plane strain, towards incompressibility.
///
/// Lamé (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 28), with radii a < b:
///
/// ```text
/// u_r = (1+ν) p a² / (E (b²-a²)) ((1-2ν) r + b²/r)
/// ```
///
/// The numbers of MacNeal and Harder (Finite Elem. Anal. Des. 1, 1985, 3-20): a = 3, b = 9, E = 1000, p = 1. A quarter,
/// one cell high between frictionless walls, with u_x = 0 on x = 0 and u_y = 0 on y = 0. Cells are split after Kuhn:
/// a single layer of the generator's five tetrahedra a cell is like crossed triangles, on which linear elements do not
/// lock (Nagtegaal, Parks and Rice, Comput. Meth. Appl. Mech. Engng. 4, 1974, 153-177); in several layers they do.
pub const CYLINDER: Problem = Problem {
    name: "cylinder",
    about: "thick cylinder under inner pressure, plane strain: u_r on the inner wall, errors in L2 and energy",
    source: "exact (Lamé; Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 28); the numbers of MacNeal \
             and Harder, Finite Elem. Anal. Des. 1 (1985) 3-20",
    sizes: [6, 12, 24, 36],
    solve: thick_cylinder,
};

const INNER: f64 = 3.0;
const OUTER: f64 = 9.0;
const YOUNG: f64 = 1000.0;
const PRESSURE: f64 = 1.0;

struct Cylinder {
    poisson: f64,
}

impl Cylinder {
    /// A and B of u_r = A r + B/r.
    fn factors(&self) -> (f64, f64) {
        let c = (1.0 + self.poisson) * PRESSURE * INNER.powi(2) / (YOUNG * (OUTER.powi(2) - INNER.powi(2)));
        (c * (1.0 - 2.0 * self.poisson), c * OUTER.powi(2))
    }
}

impl Exact for Cylinder {
    fn displacement(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let (linear, inverse) = self.factors();
        let r = Vector3::new(x.x, x.y, 0.0);
        r * (linear + inverse / r.norm_squared())
    }

    /// (A + B/r²) P - 2B/r⁴ r⊗r with P the projector off the axis.
    fn gradient(&self, x: &Vector3<f64>) -> Matrix3<f64> {
        let (linear, inverse) = self.factors();
        let r = Vector3::new(x.x, x.y, 0.0);
        let square = r.norm_squared();
        Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0)) * (linear + inverse / square)
            - r * r.transpose() * (2.0 * inverse / (square * square))
    }
}

fn thick_cylinder(element: &Element, size: u32, ratios: &[f64]) -> Result<Vec<Measure>, ProblemError> {
    let n = element.cells(size);
    let height = (OUTER - INNER) / f64::from(n);
    let mut body = Body::kuhn(element, [n, 2 * n, 1], |place| {
        let (sin, cos) = (FRAC_PI_2 * place.y).sin_cos();
        let radius = INNER + (OUTER - INNER) * place.x;
        Vector3::new(radius * cos, radius * sin, height * place.z)
    })?;
    body.fix(|place| place.y == 1.0, 0, |_| 0.0);
    body.fix(|place| place.y == 0.0, 1, |_| 0.0);
    body.fix(|place| place.z == 0.0 || place.z == 1.0, 2, |_| 0.0);
    body.load(|place| place.x == 0.0, |_, normal| normal * -PRESSURE);
    let inner = body.node_at([0.0, 0.0, 0.0])?;

    let mut measures = Vec::new();
    for &poisson in ratios {
        let exact = Cylinder { poisson };
        let lame = Lame::from_young_poisson(YOUNG, poisson);
        let solution = body.solve(element, lame)?;
        let norms = solution.norms(&body.mesh, element, lame, &exact);
        let reference = exact.displacement(&body.mesh.nodes[inner]).x;
        let value = solution.displacement[inner].x;
        let (l2, energy) = element.promised(poisson);
        measures.extend([
            solution.value(format!("u_r(a), ν {poisson}"), value, reference, 0.0, Bound::NONE),
            solution.norm(format!("L2, ν {poisson}"), norms.l2, l2),
            solution.norm(format!("energy, ν {poisson}"), norms.energy, energy),
        ]);
    }
    Ok(measures)
}

/// Saint-Venant's torsion of a square bar.
///
/// Sections turn by θ z and warp freely, u = θ (-y z, x z, φ(x, y)), and the torque is G J θ with
///
/// ```text
/// J = a⁴/3 (1 - 192/π⁵ Σ tanh(nπ/2)/n⁵), n = 1, 3, 5, …      = 0.1406 a⁴
/// ```
///
/// (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 109). A bar of length a/4 is turned at both ends by
/// prescribed u_x and u_y with u_z left free, so this is the exact solution of the solid, to its ends. J is measured
/// by the energy G J θ² a / 8; its relative error is the square of the relative error in energy. At the edges φ has
/// terms r² log r, so that of quadratic elements falls with h⁴ |log h| instead of h⁴.
pub const TORSION: Problem = Problem {
    name: "torsion",
    about: "square bar turned at both ends, free to warp: the torsion constant J/a⁴ from the energy",
    source: "exact (Saint-Venant's series; Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 109)",
    sizes: [4, 8, 16, 24],
    solve: torsion,
};

/// Least rates for h² and for h⁴ |log h|, which itself has 3.4 between the two coarsest meshes.
const LEAST_LINEAR: f64 = 1.8;
const LEAST_QUADRATIC: f64 = 3.4;

/// J/a⁴. The terms fall with n⁻⁵, so 1500 leave an error below 1e-15.
fn torsion_constant() -> f64 {
    let term = |n: f64| (n * PI / 2.0).tanh() / n.powi(5);
    let sum: f64 = (0..1500).rev().map(|i| term(f64::from(2 * i + 1))).sum();
    (1.0 - 192.0 / PI.powi(5) * sum) / 3.0
}

fn torsion(element: &Element, size: u32, _: &[f64]) -> Result<Vec<Measure>, ProblemError> {
    const TWIST: f64 = 1.0;
    const LENGTH: f64 = 0.25;
    let n = element.cells(size);
    let shape = |place: &Vector3<f64>| Vector3::new(place.x - 0.5, place.y - 0.5, LENGTH * place.z);
    let mut body = Body::new(element, [n, n, n / 4], shape)?;
    let is_end = |place: &Vector3<f64>| place.z == 0.0 || place.z == 1.0;
    body.fix(is_end, 0, |x| -TWIST * x.z * x.y);
    body.fix(is_end, 1, |x| TWIST * x.z * x.x);
    body.fix(|place| *place == Vector3::new(0.5, 0.5, 0.0), 2, |_| 0.0);
    let lame = Lame::from_young_poisson(1.0, 0.3);
    let solution = body.solve(element, lame)?;
    let value = 2.0 * solution.energy / (lame.mu * TWIST * TWIST * LENGTH);
    let bound = Bound::rate(if element.order == 2 { LEAST_QUADRATIC } else { LEAST_LINEAR });
    Ok(vec![solution.value("J/a⁴", value, torsion_constant(), 0.0, bound)])
}

/// Kelvin's point force in full space, seen from a cube at a distance.
///
/// With r from the source, G the shear modulus:
///
/// ```text
/// u = ((3-4ν) F + r (r·F)/r²) / (16π G (1-ν) r)
/// ```
///
/// (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 135). The field is prescribed on the whole surface
/// of the unit cube, whose n³ cells are split after Kuhn; errors inside are measured, and compared with the same
/// computed elsewhere by another program.
pub const KELVIN: Problem = Problem {
    name: "kelvin",
    about: "unit cube in the field of a point force outside it, prescribed on its surface: errors in L2 and energy",
    source: "exact (Kelvin; Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 135); errors on n³ cells of \
             Kuhn's split by scikit-fem",
    sizes: [2, 4, 8, 12],
    solve: point_force,
};

/// Relative errors by scikit-fem on the same meshes, its norms by a rule of degree 9: order of the element, cells along a
/// side, ν, L2, energy.
const COMPUTED_ELSEWHERE: [(u32, u32, f64, f64, f64); 12] = [
    (1, 8, 0.3, 0.001_706_851_767_715_087, 0.118_293_694_588_760_13),
    (1, 16, 0.3, 0.000_435_629_737_637_425_4, 0.059_092_075_053_460_32),
    (2, 4, 0.3, 0.000_441_532_025_230_567_54, 0.026_352_357_005_970_092),
    (1, 8, 0.49, 0.003_436_974_906_450_324_7, 0.370_008_071_347_580_9),
    (1, 16, 0.49, 0.001_368_331_630_203_747, 0.185_591_082_867_503_12),
    (2, 4, 0.49, 0.001_506_021_342_582_455_4, 0.090_707_475_258_574_57),
    (1, 8, 0.499, 0.004_999_048_585_148_842, 1.133_138_134_861_158_9),
    (1, 16, 0.499, 0.003_778_938_767_896_290_3, 0.567_277_757_017_455_9),
    (2, 4, 0.499, 0.002_600_233_898_752_293_5, 0.250_802_387_880_199_5),
    (1, 8, 0.4999, 0.005_344_914_997_086_162, 3.570_069_206_045_176),
    (1, 16, 0.4999, 0.004_913_073_607_159_278, 1.784_185_228_467_839),
    (2, 4, 0.4999, 0.002_977_912_844_629_739, 0.762_389_872_811_478_1),
];
/// Largest relative deviation from those errors, by order: the difference of the rules of degree 7 and 9.
const ELSEWHERE_WITHIN: [f64; 2] = [2e-5, 2e-4];

fn point_force(element: &Element, size: u32, ratios: &[f64]) -> Result<Vec<Measure>, ProblemError> {
    let n = element.cells(size);
    let mut body = Body::kuhn(element, [n; 3], |place| *place)?;
    let mut measures = Vec::new();
    let (mut worst, mut last) = (None, None);
    for &poisson in ratios {
        let exact = Kelvin::new(poisson);
        for axis in 0..3 {
            let on_surface = |place: &Vector3<f64>| place.iter().any(|&at| at == 0.0 || at == 1.0);
            body.fix(on_surface, axis, |x| exact.displacement(x)[axis]);
        }
        let solution = body.solve(element, exact.lame)?;
        let norms = solution.norms(&body.mesh, element, exact.lame, &exact);
        let (l2, energy) = element.promised(poisson);
        measures.extend([
            solution.norm(format!("L2, ν {poisson}"), norms.l2, l2),
            solution.norm(format!("energy, ν {poisson}"), norms.energy, energy),
        ]);
        let same = |row: &&(u32, u32, f64, f64, f64)| (row.0, row.1, row.2) == (element.order, n, poisson);
        if let Some(&(.., l2, energy)) = COMPUTED_ELSEWHERE.iter().find(same) {
            let apart = (norms.l2 / l2 - 1.0).abs().max((norms.energy / energy - 1.0).abs());
            worst = Some(worst.unwrap_or(0.0_f64).max(apart));
        }
        last = Some(solution);
    }
    // Any other program has the plain displacement elements too.
    if let (Some(worst), Some(solution), Dilatation::Own) = (worst, last, element.dilatation) {
        let quantity = format!("errors beside scikit-fem's, {n}³ cells");
        measures.push(solution.norm(
            quantity,
            worst,
            Bound::error(ELSEWHERE_WITHIN[element.order as usize - 1]),
        ));
    }
    Ok(measures)
}

#[cfg(test)]
mod tests {
    use super::super::problem::POISSON;
    use super::*;

    /// The table of MacNeal and Harder, with more digits.
    #[test]
    fn displacements_are_the_published_ones() {
        let published = [0.004_582_5, 0.005_039_925, 0.005_060_249_25, 0.005_062_274_992_5];
        for (poisson, expected) in POISSON.into_iter().zip(published) {
            let found = Cylinder { poisson }.displacement(&Vector3::new(0.0, INNER, 7.0)).y;
            assert!((found / expected - 1.0).abs() < 1e-12, "ν {poisson}: {found}");
        }
    }

    #[test]
    fn walls_carry_the_pressure_and_nothing() {
        for poisson in POISSON {
            let lame = Lame::from_young_poisson(YOUNG, poisson);
            let direction = Vector3::new(0.6, 0.8, 0.0);
            for (radius, expected) in [(INNER, -PRESSURE), (OUTER, 0.0)] {
                let h = Cylinder { poisson }.gradient(&(direction * radius));
                let stress = Matrix3::from_diagonal_element(lame.lambda * h.trace()) + h * (2.0 * lame.mu);
                assert!((stress * direction - direction * expected).amax() < 1e-11, "{stress}");
            }
        }
    }

    #[test]
    fn the_series_has_its_published_sum() {
        assert!((torsion_constant() - 0.140_577_014_955_154).abs() < 1e-14);
    }
}
