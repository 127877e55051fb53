//! The strain energy V(z) of a body that bends into few fields, of either law.
//!
//! In: z. Out: V with its slopes, and its second derivatives at once or in parts: of a quartic under St. Venant–Kirchhoff's law
//! ([`QuarticEnergy`]), and under the neo-Hookean one of squares of cubics ([`Pressures`](super::pressures::Pressures)).

use super::curvature::Curvature;
use super::quartic::Quartic;
use crate::fem::QuarticShape;

pub trait StrainEnergy: Send {
    /// ½ ∂²V/∂z_k² at rest.
    fn stiffness(&self, k: usize) -> f64;

    /// V, and its slopes against the first `active` of z; the others of z must be 0. What warmth of a body of that `size` does to a
    /// quartic is left to the loads.
    fn slopes(&mut self, z: &[f64], active: usize, size: f64, slopes: &mut [f64]) -> f64;

    /// The slopes against the z behind the first `active`, which are 0. Where [`StrainEnergy::slopes`] was asked last is near enough.
    fn slopes_beyond(&mut self, z: &[f64], active: usize, slopes: &mut [f64]);

    /// The second derivatives against the first `active` of z, row by row, which must be as for [`StrainEnergy::slopes`].
    fn second(&mut self, z: &[f64], active: usize, size: f64) -> &mut [f64];

    /// Does the next part of the second derivatives against all of z, where no load acts; true when all are made.
    fn prepare(&mut self, z: &[f64]) -> bool;

    fn is_prepared(&self) -> bool;

    /// The second derivatives that were prepared last, row by row.
    fn prepared(&self) -> &[f64];

    /// Drops what was prepared.
    fn forget(&mut self);

    /// Whether the body is inside out at a point that is known; of a quartic none is.
    fn is_inverted(&self, z: &[f64]) -> bool;
}

pub struct QuarticEnergy {
    quartic: Quartic,
    /// ½ ∂²V/∂z_k² at rest.
    stiffness: Vec<f64>,
    /// Second derivatives for Newton's method, and those that are prepared in parts.
    newton: Curvature,
    second: Curvature,
}

impl QuarticEnergy {
    /// The quartic of these coefficients; `None` where they are not those of that number of variables.
    pub fn new(variables: usize, coefficients: &[f64]) -> Option<QuarticEnergy> {
        let quartic = Quartic::new(variables, coefficients)?;
        let shape = QuarticShape { variables };
        Some(QuarticEnergy {
            quartic,
            stiffness: (0..variables).map(|k| coefficients[shape.at([0, 0, k, k])]).collect(),
            newton: Curvature::new(variables),
            second: Curvature::new(variables),
        })
    }
}

impl StrainEnergy for QuarticEnergy {
    fn stiffness(&self, k: usize) -> f64 {
        self.stiffness[k]
    }

    fn slopes(&mut self, z: &[f64], active: usize, _: f64, slopes: &mut [f64]) -> f64 {
        self.quartic.slopes(z, active, slopes)
    }

    fn slopes_beyond(&mut self, z: &[f64], active: usize, slopes: &mut [f64]) {
        self.quartic.slopes_beyond(z, active, slopes);
    }

    fn second(&mut self, z: &[f64], active: usize, _: f64) -> &mut [f64] {
        self.newton.make(&self.quartic, z, active);
        &mut self.newton.second[..active * active]
    }

    fn prepare(&mut self, z: &[f64]) -> bool {
        self.second.prepare(&self.quartic, z)
    }

    fn is_prepared(&self) -> bool {
        self.second.is_made()
    }

    fn prepared(&self) -> &[f64] {
        &self.second.second
    }

    fn forget(&mut self) {
        self.second.forget();
    }

    fn is_inverted(&self, _: &[f64]) -> bool {
        false
    }
}
