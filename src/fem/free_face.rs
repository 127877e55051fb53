//! The stress in a face that nothing presses or pulls, from the stretches that are seen in it: plane stress.
//!
//! In: the principal stretches λ₁, λ₂ of the face, less 1. Out: the stretch λ₃ across it by which σ₃ = 0, and σ₁, σ₂.
//! No dilatation enters, so nothing grows without bound as ν nears 1/2 (Zienkiewicz and Taylor, vol. 1, 5th ed., section
//! 4.2.4, for small strain; the laws of large strain have the same form).

use super::lame::Lame;

/// A free face under two principal stretches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeFace {
    /// λ₃ - 1.
    pub across: f64,
    /// σ₁, σ₂, Pa; of laws of large strain those of the deformed area (Cauchy).
    pub stress: [f64; 2],
}

/// The least stretch that is computed with: a body that is flatter is none any more.
const LEAST: f64 = 1e-3;

fn admitted(h: [f64; 2]) -> [f64; 2] {
    h.map(|h| h.max(LEAST - 1.0))
}

/// λ / (λ + 2μ): the part of a stretch in the face by which it shrinks across.
fn share(lame: Lame) -> f64 {
    lame.lambda / (lame.lambda + 2.0 * lame.mu)
}

/// Hooke's law, which knows no difference between the area at rest and the deformed one: σ_i = 2μ (h_i - h₃).
pub fn hooke(h: [f64; 2], lame: Lame) -> FreeFace {
    let across = -share(lame) * (h[0] + h[1]);
    FreeFace { across, stress: h.map(|h| 2.0 * lame.mu * (h - across)) }
}

/// The corotational law, as force on the area at rest, P_i; σ_i = P_i λ_i / J.
pub(super) fn corotational(h: [f64; 2], lame: Lame) -> FreeFace {
    let h = admitted(h);
    let across = (-share(lame) * (h[0] + h[1])).max(LEAST - 1.0);
    let stress = [h[1], h[0]].map(|other| 2.0 * lame.mu / ((1.0 + other) * (1.0 + across)));
    FreeFace { across, stress: [stress[0] * (h[0] - across), stress[1] * (h[1] - across)] }
}

/// S_i = 2μ (E_i - E₃) with E = h + h²/2; σ_i = λ_i² S_i / J.
pub(super) fn stvk(h: [f64; 2], lame: Lame) -> FreeFace {
    let h = admitted(h);
    let green = h.map(|h| h + 0.5 * h * h);
    let least = 0.5 * (LEAST * LEAST - 1.0);
    let thin = (-share(lame) * (green[0] + green[1])).max(least);
    let across = 2.0 * thin / (1.0 + (1.0 + 2.0 * thin).sqrt());
    let of =
        |i: usize| 2.0 * lame.mu * (green[i] - thin) * (1.0 + h[i]) / ((1.0 + h[1 - i]) * (1.0 + across));
    FreeFace { across, stress: [of(0), of(1)] }
}

/// λ₃ = (λ + 2μ) a / (μ + (λ + μ) a²) with a = λ₁ λ₂; σ_i = μ (λ_i² - λ₃²) / J.
pub(super) fn neo_hookean(h: [f64; 2], lame: Lame) -> FreeFace {
    let h = admitted(h);
    let wider = h[0] + h[1] + h[0] * h[1];
    let a = 1.0 + wider;
    let bulk = lame.lambda + lame.mu;
    let across = -(lame.lambda * wider + bulk * wider * wider) / (lame.mu + bulk * a * a);
    let volume = a * (1.0 + across);
    FreeFace { across, stress: h.map(|h| lame.mu * (h - across) * (2.0 + h + across) / volume) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bar that is pulled with free sides: σ = E ε, and -ν ε across, up to ν = 0.4999.
    #[test]
    fn a_pulled_bar_has_the_stress_of_youngs_modulus() {
        for poisson in [-0.3, 0.0, 0.3, 0.4999] {
            let (young, strain) = (3e6, 1e-5);
            let lame = Lame::from_young_poisson(young, poisson);
            for face in
                [hooke, corotational, stvk, neo_hookean].map(|law| law([strain, -poisson * strain], lame))
            {
                let [along, side] = face.stress.map(|stress| stress / (young * strain));
                assert!((along - 1.0).abs() < 4e-5 && side.abs() < 4e-5, "ν {poisson}: {face:?}");
                assert!((face.across + poisson * strain).abs() < 1e-9, "ν {poisson}: {face:?}");
            }
        }
    }

    proptest::proptest! {
        #[test]
        fn no_stretch_makes_it_infinite(a in -2.0..1e6_f64, b in -2.0..1e6_f64, poisson in -0.99..0.4999_f64) {
            let lame = Lame::from_young_poisson(1.0, poisson);
            for law in [corotational, stvk, neo_hookean] {
                let FreeFace { across, stress } = law([a, b], lame);
                proptest::prop_assert!(across.is_finite() && across > -1.0 && stress.iter().all(|s| s.is_finite()));
            }
        }
    }
}
