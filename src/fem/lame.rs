//! Isotropic linear elasticity: σ = λ tr(ε) I + 2μ ε. Laws of large strain: [`super::LAWS`].

/// Lamé's constants, Pa.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lame {
    pub lambda: f64,
    pub mu: f64,
}

impl Lame {
    /// Converts Young's modulus E > 0 (Pa) and Poisson's ratio -1 < ν < 1/2:
    /// λ = Eν / ((1+ν)(1-2ν)), μ = E / (2(1+ν)).
    pub fn from_young_poisson(young: f64, poisson: f64) -> Lame {
        Lame {
            lambda: young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)),
            mu: young / (2.0 * (1.0 + poisson)),
        }
    }
}
