//! Kelvin's point force in full space, seen from a cube at a distance.
//!
//! With r from the source, G the shear modulus:
//!
//! ```text
//! u = ((3-4ν) F + r (r·F)/r²) / (16π G (1-ν) r)
//! ```
//!
//! (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 135). The field is prescribed on the whole surface
//! of the unit cube, whose n³ cells are split after Kuhn; errors inside are measured, and compared with the same
//! computed elsewhere by another program.

use super::body::Body;
use super::problem::{Problem, ProblemError};
use super::solution::{Bound, Exact, Measure};
use crate::fem::{Dilatation, Element, Lame};
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::PI;

pub const PROBLEM: Problem = Problem {
    name: "kelvin",
    about: "unit cube in the field of a point force outside it, prescribed on its surface: errors in L2 and energy",
    source: "exact (Kelvin; Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 135); errors on n³ cells of \
             Kuhn's split by scikit-fem",
    sizes: [2, 4, 8, 12],
    solve,
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
const WITHIN: [f64; 2] = [2e-5, 2e-4];

/// The field of the force (0.3, -0.7, 1) at (1.6, 1.3, -0.4), E = 1.
pub struct Kelvin {
    poisson: f64,
    lame: Lame,
}

impl Kelvin {
    const FORCE: [f64; 3] = [0.3, -0.7, 1.0];
    const SOURCE: [f64; 3] = [1.6, 1.3, -0.4];

    pub fn new(poisson: f64) -> Kelvin {
        Kelvin { poisson, lame: Lame::from_young_poisson(1.0, poisson) }
    }

    fn scale(&self) -> f64 {
        1.0 / (16.0 * PI * self.lame.mu * (1.0 - self.poisson))
    }
}

impl Exact for Kelvin {
    fn displacement(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let (r, force) = (x - Vector3::from(Self::SOURCE), Vector3::from(Self::FORCE));
        let distance = r.norm();
        let along = r * (r.dot(&force) / distance.powi(2));
        (force * (3.0 - 4.0 * self.poisson) + along) * (self.scale() / distance)
    }

    fn gradient(&self, x: &Vector3<f64>) -> Matrix3<f64> {
        let (r, force) = (x - Vector3::from(Self::SOURCE), Vector3::from(Self::FORCE));
        let (distance, along) = (r.norm(), r.dot(&force));
        let turned = r * force.transpose() - force * r.transpose() * (3.0 - 4.0 * self.poisson);
        let radial = r * r.transpose() * (3.0 * along / distance.powi(2));
        (turned + Matrix3::from_diagonal_element(along) - radial) * (self.scale() / distance.powi(3))
    }
}

fn solve(element: &Element, size: u32, ratios: &[f64]) -> Result<Vec<Measure>, ProblemError> {
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
        measures.push(solution.norm(quantity, worst, Bound::error(WITHIN[element.order as usize - 1])));
    }
    Ok(measures)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::problem::POISSON;

    /// u_zz(1, 0, 0) and u_zz(0, 0, 1) of a unit force along z at the origin, E = 1, ν = 0.3.
    #[test]
    fn displacements_have_their_published_values() {
        let kelvin = Kelvin::new(0.3);
        let (force, source) = (Vector3::from(Kelvin::FORCE), Vector3::from(Kelvin::SOURCE));
        // Across and along the force, u · F̂ of a unit force is 3-4ν and 4-4ν by the same factor.
        let along = force.normalize();
        let across = along.cross(&Vector3::x()).normalize();
        for (direction, expected) in [(across, 0.133_008_059_584), (along, 0.206_901_426_019)] {
            let found = kelvin.displacement(&(source + direction)).dot(&along) / force.norm();
            assert!((found - expected).abs() < 1e-11, "{found}");
        }
    }

    #[test]
    fn the_gradient_is_the_fields_and_its_stress_is_in_equilibrium() {
        let step = 1e-4;
        let x = Vector3::new(0.3, 0.8, 0.4);
        for poisson in POISSON {
            let kelvin = Kelvin::new(poisson);
            let stress = |x: &Vector3<f64>| {
                let h = kelvin.gradient(x);
                let pressure = Matrix3::from_diagonal_element(kelvin.lame.lambda * h.trace());
                pressure + (h + h.transpose()) * kelvin.lame.mu
            };
            let mut force = Vector3::zeros();
            for axis in 0..3 {
                let (before, after) = (x - Vector3::ith(axis, step), x + Vector3::ith(axis, step));
                let slope = (kelvin.displacement(&after) - kelvin.displacement(&before)) / (2.0 * step);
                assert!((slope - kelvin.gradient(&x).column(axis)).amax() < 1e-8, "ν {poisson}");
                force += (stress(&after) - stress(&before)).column(axis) / (2.0 * step);
            }
            assert!(force.amax() < 1e-6 * stress(&x).amax(), "ν {poisson}: {force}");
        }
    }
}
