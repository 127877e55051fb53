//! Sound pressure of a body that vibrates in a mode.
//!
//! In: motion of the surface in a mode, its triangles, λ. Out: pressure amplitude at 1 m over the amplitude of the mode's speed, in the
//! root mean square over all directions.
//!
//! The surface's normal velocity is split into that of a ball that breathes (volume), that of a ball that swings to and fro (shift), and the
//! rest. Each radiates as it does from a ball of the same surface S = 4π a², with k = ω/c:
//!
//! ```text
//! p r = ρ c a √(Σ_l σ_l ⟨v_l²⟩)      σ_l = 1/((ka)² |h_l'(ka)|²), h_l the spherical Hankel function
//! ```
//!
//! (P. Morse and K. Ingard, Theoretical Acoustics, McGraw-Hill 1968, section 7.2), l = 0 for the volume, 1 for the shift and 2 for the rest. That is
//! exact for these motions of a ball; of another shape it tells the level within the few decibels by which a ball differs from it, and
//! nothing of how it radiates more in some directions than in others.

use crate::audio::SPEED_OF_SOUND;
use nalgebra::{Matrix3, Vector3};

/// Density of air at 20 °C, kg/m³.
const AIR: f64 = 1.204;

/// Mean square of the pressure at 1 m from what radiates this power alike in all directions, W and Pa²: P ρ c/4π.
pub fn mean_square(power: f64) -> f64 {
    power * AIR * SPEED_OF_SOUND / (4.0 * std::f64::consts::PI)
}

/// The surface that radiates.
pub struct Radiator {
    /// Nodes of each triangle with its outward normal, as long as its area, m².
    faces: Vec<([usize; 3], Vector3<f64>)>,
    surface_m2: f64,
    /// (Σ A n nᵀ)⁻¹.
    shifts: Matrix3<f64>,
}

impl Radiator {
    pub fn new(nodes: &[[f32; 3]], triangles: &[[u32; 3]]) -> Radiator {
        let face = |triangle: &[u32; 3]| {
            let corners = triangle.map(|node| node as usize);
            let [a, b, c] = corners.map(|node| Vector3::from(nodes[node].map(f64::from)));
            (corners, (b - a).cross(&(c - a)) * 0.5)
        };
        let faces: Vec<_> = triangles.iter().map(face).collect();
        let surface_m2 = faces.iter().map(|(_, area)| area.norm()).sum();
        let along = |area: &Vector3<f64>| area * area.transpose() / area.norm().max(f64::MIN_POSITIVE);
        let normals: Matrix3<f64> = faces.iter().map(|(_, area)| along(area)).sum();
        // A sheet has no normals in its plane, and does not shift air along it.
        let shifts = normals.pseudo_inverse(1e-9 * normals.amax()).unwrap_or_else(|_| Matrix3::zeros());
        Radiator { faces, surface_m2, shifts }
    }

    /// p r/ẋ of a mode with this motion of the nodes and ω, rad/s: Pa m over the unit of ẋ.
    pub fn pressure(&self, motion: &[Vector3<f32>], omega: f64) -> f64 {
        if !(self.surface_m2 > 0.0 && omega.is_finite()) {
            return 0.0;
        }
        // The mean square over a face of what is linear in it.
        let (mut flow, mut shift, mut square) = (0.0, Vector3::zeros(), 0.0);
        for (corners, area) in &self.faces {
            let size = area.norm();
            if size == 0.0 {
                continue;
            }
            let normal = area / size;
            let v = corners.map(|node| motion[node].cast::<f64>().dot(&normal));
            let mean = v.iter().sum::<f64>() / 3.0;
            flow += size * mean;
            shift += area * mean;
            square += size * (v.iter().map(|v| v * v).sum::<f64>() + 9.0 * mean * mean) / 12.0;
        }
        let breathing = flow / self.surface_m2;
        let velocity = self.shifts * shift;
        let parts = [breathing * breathing, velocity.dot(&shift) / self.surface_m2];
        let rest = (square / self.surface_m2 - parts[0] - parts[1]).max(0.0);
        let radius = (self.surface_m2 / (4.0 * std::f64::consts::PI)).sqrt();
        let ka = omega * radius / SPEED_OF_SOUND;
        let radiated: f64 =
            efficiencies(ka).iter().zip([parts[0], parts[1], rest]).map(|(by, v)| by * v).sum();
        AIR * SPEED_OF_SOUND * radius * radiated.sqrt()
    }
}

/// σ of a ball that breathes, swings, and changes its shape, at ka.
fn efficiencies(ka: f64) -> [f64; 3] {
    let x = ka * ka;
    [x / (1.0 + x), x * x / (4.0 + x * x), x.powi(3) / (81.0 + 9.0 * x - 2.0 * x * x + x.powi(3))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A ball of 0.1 m by lines of latitude and longitude.
    fn ball() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let (rings, around) = (40_u32, 80_u32);
        let mut nodes = Vec::new();
        for ring in 0..=rings {
            for step in 0..around {
                let (high, turn) =
                    (PI * f64::from(ring) / f64::from(rings), 2.0 * PI * f64::from(step) / f64::from(around));
                let place = [high.sin() * turn.cos(), high.cos(), high.sin() * turn.sin()];
                nodes.push(place.map(|x| (0.1 * x) as f32));
            }
        }
        let mut triangles = Vec::new();
        for ring in 0..rings {
            for step in 0..around {
                let next = (step + 1) % around;
                let [a, b] = [ring * around + step, ring * around + next];
                triangles.push([a, b, b + around]);
                triangles.push([a, b + around, a + around]);
            }
        }
        (nodes, triangles)
    }

    fn motion(nodes: &[[f32; 3]], of: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vec<Vector3<f32>> {
        nodes.iter().map(|node| of(Vector3::from(node.map(f64::from)) / 0.1).cast()).collect()
    }

    /// Morse and Ingard, section 7.2: a breathing ball has p r = ρ c a v ka/√(1 + k²a²), a
    /// swinging one, far away, ρ c a v cos θ (ka)²/√(4 + k⁴a⁴).
    #[test]
    fn balls_breathe_and_swing_as_loud_as_they_should() {
        let (nodes, triangles) = ball();
        let radiator = Radiator::new(&nodes, &triangles);
        for omega in [50.0, 2000.0, 30_000.0] {
            let (ka, by) = (omega * 0.1 / SPEED_OF_SOUND, AIR * SPEED_OF_SOUND * 0.1);
            let breathing = radiator.pressure(&motion(&nodes, |n| n), omega);
            let expected = by * ka / (1.0 + ka * ka).sqrt();
            println!("{omega}: breathing {:e}", breathing / expected - 1.0);
            assert!((breathing / expected - 1.0).abs() < 3e-3, "{omega}: {breathing} {expected}");
            let swinging = radiator.pressure(&motion(&nodes, |_| Vector3::new(0.6, 0.0, 0.8)), omega);
            // The root of the mean of cos² θ.
            let expected = by * ka * ka / (4.0 + ka.powi(4)).sqrt() / 3.0_f64.sqrt();
            println!("{omega}: swinging {:e}", swinging / expected - 1.0);
            assert!((swinging / expected - 1.0).abs() < 3e-3, "{omega}: {swinging} {expected}");
        }
    }

    /// A ball that becomes an ellipsoid: v = P₂(cos θ), ⟨P₂²⟩ = 1/5.
    #[test]
    fn a_ball_that_changes_its_shape_radiates_as_a_quadrupole() {
        let (nodes, triangles) = ball();
        let radiator = Radiator::new(&nodes, &triangles);
        let shape = motion(&nodes, |n| n * (1.5 * n.y * n.y - 0.5));
        let omega = 0.3 * SPEED_OF_SOUND / 0.1;
        // h₂'(x) by the recurrence h₂' = h₁ - 3 h₂/x with h₁ and h₂ in closed form (M. Abramowitz and I. Stegun, 10.1.11 and 10.1.12).
        let x = 0.3_f64;
        let j = [
            x.sin() / (x * x) - x.cos() / x,
            (3.0 / x.powi(3) - 1.0 / x) * x.sin() - 3.0 * x.cos() / (x * x),
        ];
        let y = [
            -x.cos() / (x * x) - x.sin() / x,
            (1.0 / x - 3.0 / x.powi(3)) * x.cos() - 3.0 * x.sin() / (x * x),
        ];
        let slope = |f: [f64; 2]| f[0] - 3.0 * f[1] / x;
        let size = slope(j).powi(2) + slope(y).powi(2);
        let expected = AIR * SPEED_OF_SOUND * 0.1 * (0.2 / (x * x * size)).sqrt();
        let found = radiator.pressure(&shape, omega);
        println!("ellipsoid {:e}", found / expected - 1.0);
        assert!((found / expected - 1.0).abs() < 2.5e-3, "{found} {expected}");
    }

    #[test]
    fn what_has_no_surface_is_silent() {
        assert_eq!(Radiator::new(&[], &[]).pressure(&[], 1.0), 0.0);
        let flat = Radiator::new(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2], [0, 2, 1]]);
        let along = flat.pressure(&[Vector3::new(1.0, 1.0, 0.0); 3], 1e3);
        assert!(along.abs() < 1e-9, "a sheet that slides in its plane moves no air: {along}");
    }
}
