//! Shares of a part's ends in a force on it.
//!
//! In: where the ends rest, and a place X. Out: the shares φ of the slots x and R of each end, N = Σ f φ and the three columns of
//! Σ f ⊗ a. Between two ends a and b, d = b - a apart, X = a + t d + X⊥ goes as a beam's point does (Hermite's cubics):
//!
//! ```text
//! x = h₀₀ x_a + h₀₁ x_b + R_a (h₁₀ d + (1 - t) X⊥) + R_b (h₁₁ d + t X⊥)
//! h₀₀ = 1 - h₀₁    h₀₁ = 3t² - 2t³    h₁₀ = t - 2t² + t³    h₁₁ = t³ - t²
//! ```
//!
//! Of one end it goes rigidly with that; of more, with each in inverse proportion to the square of the distance. A common motion of
//! all ends moves X with them.

use super::linked_part::{PartEnd, Places};
use crate::deform::loads::{Borne, SLOTS};
use crate::green::substructure::StoredPart;
use nalgebra::Vector3;

type V3 = Vector3<f64>;

/// The parts with where their ends rest, and the places of the surface by which a force finds its part.
pub struct Shares {
    parts: Vec<Vec<(usize, V3)>>,
    places: Vec<(V3, usize)>,
}

impl Shares {
    /// Slots of interfaces stand before those of control elements.
    pub fn new(parts: &[StoredPart], ends: &[Vec<PartEnd>], rest: &Places, surface: &[[f32; 3]]) -> Shares {
        let slot = |end: &PartEnd| match *end {
            PartEnd::Interface(i) => SLOTS * i,
            PartEnd::Control(e) => SLOTS * (rest.interfaces.len() + e),
        };
        let of_part =
            |ends: &Vec<PartEnd>| ends.iter().map(|end| (slot(end), rest.frame(*end).place)).collect();
        let mut owners = vec![(0.0, 0); surface.len()];
        for (p, part) in parts.iter().enumerate() {
            for (&node, &share) in part.nodes.iter().zip(&part.shares) {
                if share > owners[node as usize].0 {
                    owners[node as usize] = (share, p);
                }
            }
        }
        let place = |(x, (_, p)): (&[f32; 3], &(f64, usize))| (Vector3::from(*x).cast(), *p);
        Shares {
            parts: ends.iter().map(of_part).collect(),
            places: surface.iter().zip(&owners).map(place).collect(),
        }
    }

    /// The slots with the shares of a force at x.
    pub fn at(&self, x: &V3) -> Vec<(usize, f64)> {
        let away = |(place, _): &&(V3, usize)| (place - x).norm_squared();
        let nearest = self.places.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let ends = nearest.and_then(|(_, part)| self.parts.get(*part)).map_or(&[][..], Vec::as_slice);
        if let [(first, a), (last, b)] = ends {
            let d = b - a;
            let along = (x - a).dot(&d) / d.norm_squared();
            let t = along.clamp(0.0, 1.0);
            let across = x - a - d * along;
            let beyond = d * (along - t);
            let h = 3.0 * t * t - 2.0 * t * t * t;
            let [at_first, at_last] = [t - 2.0 * t * t + t * t * t, t * t * t - t * t];
            let one = Borne::shares(*first, 1.0 - h, &(d * at_first + (across + beyond) * (1.0 - t)));
            let other = Borne::shares(*last, h, &(d * at_last + (across + beyond) * t));
            return one.into_iter().chain(other).collect();
        }
        let weights: Vec<f64> =
            ends.iter().map(|(_, place)| (place - x).norm_squared().max(f64::MIN_POSITIVE).recip()).collect();
        let sum: f64 = weights.iter().sum();
        let all = ends.iter().zip(weights).map(|((slot, place), w)| (*slot, w / sum, place));
        all.flat_map(|(slot, share, place)| Borne::shares(slot, share, &((x - place) * share))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::link::EndFrame;
    use super::super::linked_part::ControlState;
    use super::*;
    use nalgebra::{Isometry3, Rotation3, UnitQuaternion};

    /// A common motion of the ends moves every place with it, of parts with one, two and three ends; a beam bent to an arc goes along
    /// the arc to third order.
    #[test]
    fn places_go_with_their_ends() {
        let frame = |x: f64, y: f64| EndFrame { place: V3::new(x, y, 0.2), turn: UnitQuaternion::identity() };
        let rest = Places {
            interfaces: vec![frame(0.0, 0.0), frame(1.0, 0.1), frame(0.4, 1.0)],
            controls: vec![ControlState { frame: frame(-1.0, 0.0), stretch: [0.0; 6] }],
        };
        let ends = vec![
            vec![PartEnd::Control(0), PartEnd::Interface(0)],
            vec![PartEnd::Interface(0), PartEnd::Interface(1), PartEnd::Interface(2)],
            vec![PartEnd::Interface(2)],
        ];
        let surface = [[-0.5, 0.0, 0.0], [0.4, 0.3, 0.0], [0.4, 1.3, 0.0]];
        let part = |node: u32| StoredPart { nodes: vec![node], shares: vec![1.0], ..StoredPart::default() };
        let shares = Shares::new(&[part(0), part(1), part(2)], &ends, &rest, &surface);
        let motion = Isometry3::new(V3::new(0.3, -2.0, 0.7), V3::new(0.4, 1.1, -0.6));
        let came = |x: &V3, frames: &[Isometry3<f64>]| -> V3 {
            shares
                .at(x)
                .iter()
                .map(|(slot, share)| {
                    let (frame, column) = (frames[slot / SLOTS], slot % SLOTS);
                    let rotation = Rotation3::from(frame.rotation);
                    match column {
                        0 => frame.translation.vector * *share,
                        _ => rotation.matrix().column(column - 1) * *share,
                    }
                })
                .sum()
        };
        let at_rest = rest.interfaces.iter().chain(rest.controls.iter().map(|control| &control.frame));
        let frames: Vec<Isometry3<f64>> = at_rest.map(|frame| motion * frame.motion()).collect();
        for x in
            [V3::new(-0.7, 0.2, 0.1), V3::new(-1.4, 0.1, 0.0), V3::new(0.5, 0.4, 0.3), V3::new(0.4, 1.5, 0.1)]
        {
            let off = (came(&x, &frames) - (motion * nalgebra::Point3::from(x)).coords).norm();
            assert!(off < 1e-12, "{x}: {off}");
        }
        let off = |angle: f64| {
            let arc = |s: f64| {
                let place = V3::new((s * angle).sin() / angle, (1.0 - (s * angle).cos()) / angle, 0.2);
                Isometry3::from_parts(
                    (place - V3::x()).into(),
                    UnitQuaternion::from_scaled_axis(V3::z() * s * angle),
                )
            };
            let mut frames = frames.clone();
            (frames[3], frames[0]) = (arc(0.0), arc(1.0));
            (came(&V3::new(-0.7, 0.0, 0.2), &frames) - arc(0.3).translation.vector).norm()
        };
        assert!(off(0.4) < 1e-3 && off(0.4) > 7.0 * off(0.2), "{} {}", off(0.4), off(0.2));
    }
}
