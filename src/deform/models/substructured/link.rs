//! One part between its ends: the energy by the frames of interfaces and control elements, with derivatives.
//!
//! In: a frame for each end, a stretch for each end that is a control element. Out: V, its gradient and Hessian by motions
//! g exp δ of the frames, δ = (v, ω), force and torque in the axes of each, and by the stretches. The part's coordinates y are the
//! screws from its first end to the others ([`Tangent`]), ω before the change of v, and the stretches.

use super::energy::PartEnergy;
use crate::deform::pose::frame::FrameSlope;
use crate::deform::pose::se3::{Tangent, halves, log_of};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3, Vector6};

/// ξ of a⁻¹ b = exp ξ, by the shorter turn.
pub fn screw(a: &Isometry3<f64>, b: &Isometry3<f64>) -> Vector6<f64> {
    let mut between = a.inv_mul(b);
    if between.rotation.w < 0.0 {
        between.rotation = UnitQuaternion::new_unchecked(-between.rotation.into_inner());
    }
    log_of(&between)
}

/// An end of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartEnd {
    /// An interface to another part, by the interface's number.
    Interface(usize),
    /// A control element, by its number.
    Control(usize),
}

/// A control element's frame, and s₁₁, s₂₂, s₃₃, s₁₂, s₂₃, s₃₁ of its stretch U - I.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlState {
    pub frame: Isometry3<f64>,
    pub stretch: [f64; 6],
}

/// Frames of all ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Places {
    pub interfaces: Vec<Isometry3<f64>>,
    pub controls: Vec<ControlState>,
}

impl Places {
    pub fn frame(&self, end: PartEnd) -> &Isometry3<f64> {
        match end {
            PartEnd::Interface(i) => &self.interfaces[i],
            PartEnd::Control(e) => &self.controls[e].frame,
        }
    }
}

/// A part with its ends. The first end is that from which the screws to the others are taken.
#[derive(Clone)]
pub struct LinkedPart {
    pub ends: Vec<PartEnd>,
    /// Place of each other end at rest, from the first, m.
    rest: Vec<Vector3<f64>>,
    /// Thermal strain of the part.
    pub strain: f64,
    pub energy: PartEnergy,
    /// Coordinates: ω and d of each screw, then the stretches.
    pub y: Vec<f64>,
    screws: Vec<Vector6<f64>>,
    /// ∂y by motions of the ends, then by the stretches, row by row; and ∂²V/∂y² times it.
    map: Vec<f64>,
    product: Vec<f64>,
    pub gradient: Vec<f64>,
    pub hessian: Vec<f64>,
}

/// Screws by larger turns are refused: the shorter turn may no longer be meant.
const MOST_TURN: f64 = 3.0;

impl LinkedPart {
    /// `origins`: where the ends rest.
    pub fn new(ends: Vec<PartEnd>, origins: &[Vector3<f64>], energy: PartEnergy) -> LinkedPart {
        let rest = origins.iter().skip(1).map(|origin| origin - origins[0]).collect();
        let (m, q) = (energy.m, unknowns(&ends));
        LinkedPart {
            rest,
            strain: 0.0,
            y: vec![0.0; m],
            screws: vec![Vector6::zeros(); ends.len().saturating_sub(1)],
            map: vec![0.0; m * q],
            product: vec![0.0; m * q],
            gradient: vec![0.0; q],
            hessian: vec![0.0; q * q],
            ends,
            energy,
        }
    }

    /// V in J; infinite where two ends have turned too far against each other.
    pub fn value(&mut self, places: &Places) -> f64 {
        let Some((&first, others)) = self.ends.split_first() else { return 0.0 };
        let base = places.frame(first);
        for (i, &end) in others.iter().enumerate() {
            self.screws[i] = screw(base, places.frame(end));
            let (slide, turn) = halves(&self.screws[i]);
            let y = &mut self.y[6 * i..][..6];
            y[..3].copy_from_slice(turn.as_slice());
            y[3..].copy_from_slice((slide - self.rest[i] * (1.0 + self.strain)).as_slice());
            let square = turn.norm_squared();
            if square.is_nan() || square > MOST_TURN * MOST_TURN {
                return f64::INFINITY;
            }
        }
        let mut at = 6 * others.len();
        for &end in &self.ends {
            if let PartEnd::Control(e) = end {
                self.y[at..at + 6].copy_from_slice(&places.controls[e].stretch);
                self.y[at..at + 3].iter_mut().for_each(|stretch| *stretch -= self.strain);
                at += 6;
            }
        }
        self.energy.value(&self.y)
    }

    /// The gradient of the last value, and the Hessian where it is asked for.
    pub fn differentiate(&mut self, twice: bool) {
        let (m, q, links) = (self.energy.m, self.gradient.len(), self.screws.len());
        self.energy.differentiate(&self.y);
        self.map.fill(0.0);
        // Stretches stand behind the screws in y, and behind the ends' motions among the unknowns.
        for (row, column) in (6 * links..m).zip(6 * self.ends.len()..q) {
            self.map[row * q + column] = 1.0;
        }
        if twice {
            self.energy.differentiate_twice(&self.y);
            self.hessian.fill(0.0);
        }
        for (link, screw) in self.screws.iter().enumerate() {
            let (slopes, last) = (Tangent::at(screw), 6 * (link + 1));
            for (row, j) in (0..6).flat_map(|row| (0..6).map(move |j| (row, j))) {
                let to = &mut self.map[(6 * link + behind(row)) * q..][..q];
                (to[j], to[last + j]) = (slopes.first[(row, j)], slopes.last[(row, j)]);
            }
            if twice {
                let gradient = &self.energy.gradient[6 * link..][..6];
                let [first, across, end] =
                    slopes.curvature(&Vector6::from_fn(|row, _| gradient[behind(row)]));
                for (i, j) in (0..6).flat_map(|i| (0..6).map(move |j| (i, j))) {
                    self.hessian[i * q + j] += first[(i, j)];
                    self.hessian[i * q + last + j] += across[(i, j)];
                    self.hessian[(last + j) * q + i] += across[(i, j)];
                    self.hessian[(last + i) * q + last + j] += end[(i, j)];
                }
            }
        }
        self.gradient.fill(0.0);
        for (g, row) in self.energy.gradient.iter().zip(self.map.chunks_exact(q.max(1))) {
            self.gradient.iter_mut().zip(row).for_each(|(to, map)| *to += g * map);
        }
        if twice {
            self.add_squares();
        }
    }

    /// Adds the derivatives by control element `e`, in its own axes.
    pub fn add_slope(&self, e: usize, slope: &mut FrameSlope) {
        let mut stretches = self.gradient[6 * self.ends.len()..].chunks_exact(6);
        for (end, motion) in self.ends.iter().zip(self.gradient.chunks_exact(6)) {
            let PartEnd::Control(own) = *end else { continue };
            let Some(s) = stretches.next().filter(|_| own == e) else { continue };
            slope.force += Vector3::from_column_slice(&motion[..3]);
            slope.torque += Vector3::from_column_slice(&motion[3..]);
            let [xy, yz, zx] = [s[3] * 0.5, s[4] * 0.5, s[5] * 0.5];
            slope.stretch += Matrix3::new(s[0], xy, zx, xy, s[1], yz, zx, yz, s[2]);
        }
    }

    /// Hessian += mapᵀ ∂²V/∂y² map.
    fn add_squares(&mut self) {
        let (m, q) = (self.energy.m, self.gradient.len());
        self.product.fill(0.0);
        for (to, row) in self.product.chunks_exact_mut(q).zip(self.energy.hessian.chunks_exact(m.max(1))) {
            for (h, from) in row.iter().zip(self.map.chunks_exact(q)) {
                to.iter_mut().zip(from).for_each(|(to, map)| *to += h * map);
            }
        }
        for (map, product) in self.map.chunks_exact(q).zip(self.product.chunks_exact(q)) {
            for (weight, to) in map.iter().zip(self.hessian.chunks_exact_mut(q)) {
                if *weight != 0.0 {
                    to.iter_mut().zip(product).for_each(|(to, product)| *to += weight * product);
                }
            }
        }
    }
}

/// The place in y of a number of (v, ω): ω stands first there.
fn behind(row: usize) -> usize {
    (row + 3) % 6
}

/// Six of each end's motion, six of each control element's stretch.
fn unknowns(ends: &[PartEnd]) -> usize {
    6 * ends.len() + 6 * ends.iter().filter(|end| matches!(end, PartEnd::Control(_))).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::pose::se3::exp;
    use nalgebra::DMatrix;

    fn number(i: usize) -> f64 {
        ((i * 2_654_435_761 % 1000) as f64 - 500.0) * 1e-3
    }

    /// An interface and a control element, far apart and turned: gradient and Hessian against differences of V.
    #[test]
    fn derivatives_agree_with_differences() {
        let m = 12;
        let root = DMatrix::from_fn(m, m, |i, j| number(7 * i + j + 1));
        let s = &root * root.transpose() + DMatrix::identity(m, m);
        let z = DMatrix::from_fn(m, m * (m + 1) / 2, |i, j| 0.3 * number(31 * i + j + 5));
        let q = DMatrix::from_fn(21, 21, |i, j| 0.3 * number(29 * i.min(j) + i.max(j) + 11));
        let origins = [Vector3::zeros(), Vector3::new(1.0, 0.2, -0.1)];
        let ends = vec![PartEnd::Control(0), PartEnd::Interface(0)];
        let mut part = LinkedPart::new(ends, &origins, PartEnergy::new(&s, &z, &q));
        let frame = Isometry3::new(Vector3::new(0.1, 0.0, 0.2), Vector3::new(0.3, -0.8, 0.4));
        let other = Isometry3::new(Vector3::new(0.8, 0.6, -0.3), Vector3::new(0.6, -0.4, 0.9));
        let stretch = [0.05, -0.1, 0.02, 0.04, -0.03, 0.06];
        let places = Places { interfaces: vec![other], controls: vec![ControlState { frame, stretch }] };
        // Unknowns: the control element's motion, the interface's, the stretch.
        let moved = |steps: &[(usize, f64)]| {
            let mut to = places.clone();
            let twist = |first: usize| {
                let of =
                    |k: usize| steps.iter().filter(|(i, _)| *i == first + k).map(|(_, h)| h).sum::<f64>();
                Vector6::from_fn(|k, _| of(k))
            };
            to.controls[0].frame = frame * exp(&twist(0));
            to.interfaces[0] = other * exp(&twist(6));
            for k in 0..6 {
                to.controls[0].stretch[k] += twist(12)[k];
            }
            to
        };
        part.value(&places);
        part.differentiate(true);
        let (gradient, hessian) = (part.gradient.clone(), part.hessian.clone());
        let largest = |of: &[f64]| of.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        let q = gradient.len();
        assert_eq!(q, 18);
        for i in 0..q {
            let h = 1e-5;
            let mut at = |step: f64| part.value(&moved(&[(i, step)]));
            let difference = (at(h) - at(-h)) / (2.0 * h);
            assert!((difference - gradient[i]).abs() < 1e-7 * largest(&gradient), "{i}");
            for j in 0..=i {
                let h = 1e-3;
                let mut at = |x: f64, y: f64| part.value(&moved(&[(i, x), (j, y)]));
                let difference = (at(h, h) - at(h, -h) - at(-h, h) + at(-h, -h)) / (4.0 * h * h);
                let off = (difference - hessian[i * q + j]).abs();
                assert!(off < 1e-5 * largest(&hessian), "{i} {j}: {difference} {}", hessian[i * q + j]);
                assert!((hessian[i * q + j] - hessian[j * q + i]).abs() < 1e-12 * largest(&hessian));
            }
        }
    }
}
