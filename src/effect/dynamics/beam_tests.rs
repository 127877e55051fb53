//! Frequencies of a bar that is held at one end, against those of beam theory.

use super::tests::{DENSITY, LENGTH, SECTION, YOUNG, bar, hertz, tables};
use std::f64::consts::TAU;

pub(super) fn nearest(list: &[f64], to: f64) -> f64 {
    *list.iter().min_by(|a, b| (*a - to).abs().total_cmp(&(*b - to).abs())).unwrap()
}

/// The ends of a beam.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Ends {
    ClampedFree,
    FreeFree,
}

/// Frequencies of a Timoshenko beam that bends across `height`, Hz: the roots b of Huang's equations (T. C. Huang, The effect of rotatory
/// inertia and of shear deformation on the frequency and normal mode equations of uniform beams, Journal of Applied Mechanics 28,
/// 1961, 579-584), divided by cosh bα, with Cowper's shear coefficient 10 (1 + ν)/(12 + 11 ν) at ν = 0.
pub(super) fn timoshenko(ends: Ends, height: f64, count: usize) -> Vec<f64> {
    let slender = height * height / 12.0 / LENGTH.powi(2);
    let (r2, s2) = (slender, slender * 2.0 * 12.0 / 10.0);
    let equation = |b: f64| {
        let root = ((r2 - s2).powi(2) + 4.0 / (b * b)).sqrt();
        let [alpha, beta] = [root - (r2 + s2), root + (r2 + s2)].map(|x| (0.5 * x).sqrt());
        let apart = (r2 - s2).powi(2);
        let by_shear = b / (1.0 - b * b * r2 * s2).sqrt() * (b * alpha).tanh() * (b * beta).sin();
        match ends {
            Ends::ClampedFree => {
                2.0 / (b * alpha).cosh() + (b * b * apart + 2.0) * (b * beta).cos() - (r2 + s2) * by_shear
            }
            Ends::FreeFree => {
                2.0 / (b * alpha).cosh() - 2.0 * (b * beta).cos()
                    + (b * b * r2 * apart + 3.0 * r2 - s2) * by_shear
            }
        }
    };
    let mut roots = Vec::new();
    let (mut b, step) = (1.0, 0.05);
    while roots.len() < count {
        if equation(b) * equation(b + step) < 0.0 {
            let (mut low, mut high) = (b, b + step);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if equation(low) * equation(middle) <= 0.0 { high = middle } else { low = middle }
            }
            roots.push(low);
        }
        b += step;
    }
    let unit = (YOUNG / DENSITY * slender).sqrt() / (LENGTH * TAU);
    roots.iter().map(|b| b * unit).collect()
}

/// The roots of the slender limit are those of Euler and Bernoulli, β² = 3.516, 22.03, 61.70, 120.90, 199.86 and, with both ends free,
/// 22.37, 61.67, 120.90, 199.86.
#[test]
fn huangs_equations_have_bernoullis_roots_in_a_slender_beam() {
    let height = 1e-3;
    let unit = (YOUNG / DENSITY / 12.0).sqrt() * height / TAU;
    let clamped = [1.87510, 4.69409, 7.85476, 10.99554, 14.13717_f64].as_slice();
    for (ends, beta) in
        [(Ends::ClampedFree, clamped), (Ends::FreeFree, &[4.73004, 7.85320, 10.99561, 14.13717])]
    {
        for (found, beta) in timoshenko(ends, height, beta.len()).iter().zip(beta) {
            assert!((found / (beta * beta * unit) - 1.0).abs() < 1e-4, "{found}");
        }
    }
}

#[test]
fn the_first_five_bending_frequencies_of_a_cantilever_are_timoshenkos() {
    let found = |cells| {
        let (_, file) = bar(cells, "element = \"tet10\"\neffect.dynamics.modes = 15", false);
        hertz(&tables(&file).squares)
    };
    let (coarse, fine) = (found([16, 1, 2]), found([32, 2, 2]));
    let expected = timoshenko(Ends::ClampedFree, SECTION[1], 5);
    for (k, f) in expected.iter().enumerate() {
        let [off, less] = [&coarse, &fine].map(|list| nearest(list, *f) / f - 1.0);
        println!("mode {}: {f:.4} Hz, coarse {off:.2e}, fine {less:.2e}", k + 1);
        // Half the elements leave an eighth of the error or less: the order is 3 at least.
        assert!(
            less.abs() < 2.5e-3 && less.abs() < off.abs() / 8.0,
            "mode {}: {less:e}, coarse {off:e}",
            k + 1
        );
    }
}

/// The rod's mode sin((2n-1) π x / 2L) is one of the solid too, without lateral contraction.
#[test]
fn a_rod_swings_along_its_axis_with_odd_quarters_of_its_wave() {
    let (_, file) = bar([16, 1, 1], "element = \"tet10\"\neffect.dynamics.modes = 24", false);
    let found = hertz(&tables(&file).squares);
    let expected = 0.25 / LENGTH * (YOUNG / DENSITY).sqrt();
    let off = nearest(&found, expected) / expected - 1.0;
    println!("axial {off:.2e}");
    assert!(off.abs() < 1e-5, "{off:e}");
}
