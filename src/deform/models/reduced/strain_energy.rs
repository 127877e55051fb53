//! The strain energy V(z) of a body that bends into few fields, of either law.
//!
//! In: the tables of a body. Out: V with its slopes, and its second derivatives at once or in parts: a quartic under St.
//! Venant–Kirchhoff's law, and under the neo-Hookean one a sum of squares of cubics ([`Pressures`]).

use super::curvature::Curvature;
use super::pressures::Pressures;
use super::quartic::Quartic;
use crate::fem::QuarticShape;

pub enum StrainEnergy {
    Quartic {
        quartic: Box<Quartic>,
        /// ½ ∂²V/∂z_k² at rest.
        stiffness: Vec<f64>,
        /// Second derivatives for Newton's method, and those that are prepared in parts.
        newton: Box<Curvature>,
        second: Box<Curvature>,
    },
    Pressures(Box<Pressures>),
}

impl StrainEnergy {
    /// The quartic of these coefficients; `None` where they are not those of that number of variables.
    pub fn of_quartic(variables: usize, coefficients: &[f64]) -> Option<StrainEnergy> {
        let quartic = Quartic::new(variables, coefficients)?;
        let shape = QuarticShape { variables };
        Some(StrainEnergy::Quartic {
            quartic: Box::new(quartic),
            stiffness: (0..variables).map(|k| coefficients[shape.at([0, 0, k, k])]).collect(),
            newton: Box::new(Curvature::new(variables)),
            second: Box::new(Curvature::new(variables)),
        })
    }

    /// ½ ∂²V/∂z_k² at rest.
    pub fn stiffness(&self, k: usize) -> f64 {
        match self {
            StrainEnergy::Quartic { stiffness, .. } => stiffness[k],
            StrainEnergy::Pressures(pressures) => pressures.stiffness(k),
        }
    }

    /// V, and its slopes against the first `active` of z; the others of z must be 0. What warmth of a body of that `size` does to a
    /// quartic is left to the loads.
    pub fn slopes(&mut self, z: &[f64], active: usize, size: f64, slopes: &mut [f64]) -> f64 {
        match self {
            StrainEnergy::Quartic { quartic, .. } => quartic.slopes(z, active, slopes),
            StrainEnergy::Pressures(pressures) => pressures.slopes(z, active, size, slopes),
        }
    }

    /// The slopes against the z behind the first `active`, which are 0. Where [`StrainEnergy::slopes`] was asked last is near enough.
    pub fn slopes_beyond(&mut self, z: &[f64], active: usize, slopes: &mut [f64]) {
        match self {
            StrainEnergy::Quartic { quartic, .. } => quartic.slopes_beyond(z, active, slopes),
            StrainEnergy::Pressures(pressures) => pressures.slopes_beyond(active, slopes),
        }
    }

    /// The second derivatives against the first `active` of z, row by row, which must be as for [`StrainEnergy::slopes`].
    pub fn second(&mut self, z: &[f64], active: usize, size: f64) -> &mut [f64] {
        match self {
            StrainEnergy::Quartic { quartic, newton, .. } => {
                newton.make(quartic, z, active);
                &mut newton.second[..active * active]
            }
            StrainEnergy::Pressures(pressures) => pressures.second(z, active, size),
        }
    }

    /// Does the next part of the second derivatives against all of z, where no load acts; true when all are made.
    pub fn prepare(&mut self, z: &[f64]) -> bool {
        match self {
            StrainEnergy::Quartic { quartic, second, .. } => second.prepare(quartic, z),
            StrainEnergy::Pressures(pressures) => pressures.prepare(z),
        }
    }

    pub fn is_prepared(&self) -> bool {
        match self {
            StrainEnergy::Quartic { second, .. } => second.is_made(),
            StrainEnergy::Pressures(pressures) => pressures.is_prepared(),
        }
    }

    /// The second derivatives that were prepared last, row by row.
    pub fn prepared(&self) -> &[f64] {
        match self {
            StrainEnergy::Quartic { second, .. } => &second.second,
            StrainEnergy::Pressures(pressures) => pressures.prepared(),
        }
    }

    /// Drops what was prepared.
    pub fn forget(&mut self) {
        match self {
            StrainEnergy::Quartic { second, .. } => second.forget(),
            StrainEnergy::Pressures(pressures) => pressures.forget(),
        }
    }

    /// Whether the body is inside out at a point that is known; of a quartic none is.
    pub fn is_inverted(&self, z: &[f64]) -> bool {
        match self {
            StrainEnergy::Quartic { .. } => false,
            StrainEnergy::Pressures(pressures) => pressures.is_inverted(z),
        }
    }
}
