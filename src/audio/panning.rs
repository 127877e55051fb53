//! Amplitude panning over loudspeakers anywhere in a room, for a head that walks.
//!
//! In: the loudspeakers' places, the viewer's place by the stage file; then a head and a direction. Out: a gain per loudspeaker,
//! Σ g² = 1. Between the three loudspeakers of a triangle around the direction p, with the unit directions l from the head to them
//! (Pulkki 1997): p ∥ g₁ l₁ + g₂ l₂ + g₃ l₃.
//!
//! The triangles are those of the loudspeakers' convex hull and stay the same while the head walks, so that gains never jump.
//! Two kinds of corners have no loudspeaker of their own, and hand their gain to others. A flat face of
//! four or more loudspeakers has a middle: the sum of their unit directions, so that the equation still holds.
//! A direction that no loudspeaker covers has an imaginary one (F. Zotter and M. Frank, "All-round ambisonic panning and decoding",
//! J. Audio Eng. Soc. 60(10), 2012), whose neighbours sound instead.

use super::hull::{faces, triangles};
use super::paths::MOST_CHANNELS;
use crate::stage::most_open;
use nalgebra::{Matrix3, Point3, Vector3};

/// Triangles that meet at less than this make one flat face, degrees.
const FLAT_DEGREES: f64 = 3.0;
/// Angle below which the viewer sees two loudspeakers as one, of which the second stays silent, degrees.
const SAME_DEGREES: f64 = 1.0;
/// Share of the viewer's distance to a side of the hull up to which the head comes near that side; beyond, it is taken to be there.
const NEAREST: f64 = 0.1;
/// Shortest distance of a loudspeaker from the viewer, m.
const LEAST_M: f64 = 0.01;

/// Loudspeakers and the triangles between them.
#[derive(Clone, Debug)]
pub struct Panner {
    viewer: Point3<f64>,
    corners: Vec<Corner>,
    triangles: Vec<[usize; 3]>,
    /// Sides of the hull: a point, and the outward normal.
    sides: Vec<(Point3<f64>, Vector3<f64>)>,
}

/// A corner of the triangles.
#[derive(Clone, Debug)]
struct Corner {
    place: Place,
    /// The loudspeakers that sound for it.
    sounds: Vec<usize>,
    /// Share of its gain that each of them gets.
    share: f64,
}

#[derive(Clone, Debug)]
enum Place {
    InRoom(Point3<f64>),
    /// Middle of these corners.
    Middle(Vec<usize>),
}

impl Panner {
    pub fn new(loudspeakers: &[Point3<f64>], viewer: Point3<f64>) -> Panner {
        let mut corners: Vec<Corner> = Vec::new();
        let mut directions: Vec<Vector3<f64>> = Vec::new();
        let mut points: Vec<Vector3<f64>> = Vec::new();
        for (channel, place) in loudspeakers.iter().enumerate().take(MOST_CHANNELS) {
            let direction = (place - viewer).normalize();
            let is_new =
                directions.iter().all(|other| other.dot(&direction) < SAME_DEGREES.to_radians().cos());
            if (place - viewer).norm() > LEAST_M && is_new {
                directions.push(direction);
                points.push(place - viewer);
                corners.push(Corner { place: Place::InRoom(*place), sounds: vec![channel], share: 1.0 });
            }
        }
        let real = corners.len();
        let usual_m = points.iter().map(Vector3::norm).sum::<f64>() / real.max(1) as f64;
        let usual_m = if real > 0 { usual_m } else { 1.0 };
        while let Some((way, _)) = most_open(&directions) {
            directions.push(way);
            points.push(way * usual_m);
            let place = Place::InRoom(viewer + way * usual_m);
            corners.push(Corner { place, sounds: Vec::new(), share: 0.0 });
        }
        let mut panner = Panner { viewer, corners, triangles: Vec::new(), sides: Vec::new() };
        let used = triangles(&points).concat();
        // A loudspeaker within the hull of the others would stay silent; as directions, all are corners.
        let shape = if (0..points.len()).all(|k| used.contains(&k)) { points } else { directions };
        panner.close(&shape, real);
        panner
    }

    /// Makes triangles of the hull's faces, and says what sounds for imaginary loudspeakers.
    fn close(&mut self, shape: &[Vector3<f64>], real: usize) {
        for face in faces(shape, FLAT_DEGREES) {
            let is_real = face.iter().all(|&corner| corner < real);
            if is_real && face.len() > 3 {
                let sounds = face.iter().flat_map(|&corner| self.corners[corner].sounds.clone()).collect();
                let middle = self.corners.len();
                self.corners.push(Corner { place: Place::Middle(face.clone()), sounds, share: 1.0 });
                let around = face.iter().zip(face.iter().cycle().skip(1));
                self.triangles.extend(around.map(|(&a, &b)| [middle, a, b]));
            } else {
                self.triangles.extend((1..face.len() - 1).map(|k| [face[0], face[k], face[k + 1]]));
            }
            for k in 1..face.len() - 1 {
                let places = [face[0], face[k], face[k + 1]].map(|corner| self.corners[corner].in_room());
                if let [Some(first), Some(second), Some(third)] = places {
                    self.sides.push((first, (second - first).cross(&(third - first)).normalize()));
                }
            }
        }
        let all: Vec<usize> = self.corners[..real].iter().flat_map(|corner| corner.sounds.clone()).collect();
        for corner in real..shape.len() {
            let mut near: Vec<usize> = self
                .triangles
                .iter()
                .filter(|triangle| triangle.contains(&corner))
                .flat_map(|triangle| triangle.iter().filter(|&&other| other < real))
                .flat_map(|&other| self.corners[other].sounds.clone())
                .collect();
            near.sort_unstable();
            near.dedup();
            let sounds = if near.is_empty() { all.clone() } else { near };
            self.corners[corner].share = 1.0 / (sounds.len().max(1) as f64).sqrt();
            self.corners[corner].sounds = sounds;
        }
    }

    /// The head, or the last place on the way to it from the viewer's that is well within the hull.
    fn within(&self, head: &Point3<f64>) -> Point3<f64> {
        let share = |(point, normal): &(Point3<f64>, Vector3<f64>)| {
            let [before, now] = [self.viewer, *head].map(|place| (point - place).dot(normal));
            if now >= NEAREST * before { 1.0 } else { (1.0 - NEAREST) * before / (before - now) }
        };
        let least = self.sides.iter().map(share).fold(1.0, f64::min);
        self.viewer + (head - self.viewer) * least.max(0.0)
    }

    /// Unit directions of all corners from a place; for a middle the sum of those that it stands for.
    fn directions(&self, from: &Point3<f64>) -> Vec<Vector3<f64>> {
        let mut directions: Vec<Vector3<f64>> = Vec::with_capacity(self.corners.len());
        for corner in &self.corners {
            // The corners around a middle stand before it.
            directions.push(match &corner.place {
                Place::InRoom(place) => (place - from).normalize(),
                Place::Middle(around) => around.iter().map(|&corner| directions[corner]).sum(),
            });
        }
        directions
    }

    /// The gains by which the loudspeakers sound as from this direction, all at one distance from the head; Σ g² = 1. Without a
    /// loudspeaker all are 0.
    pub fn gains(&self, head: &Point3<f64>, direction: &Vector3<f64>) -> [f64; MOST_CHANNELS] {
        let directions = self.directions(&self.within(head));
        let weights = |&triangle: &[usize; 3]| {
            let inverse = Matrix3::from_columns(&triangle.map(|corner| directions[corner])).try_inverse()?;
            Some((triangle, (inverse * direction).normalize()))
        };
        // The least weight is not negative in the triangle around the direction alone.
        let best = self.triangles.iter().filter_map(weights).max_by(|a, b| a.1.min().total_cmp(&b.1.min()));
        let mut gains = [0.0; MOST_CHANNELS];
        let Some((triangle, weights)) = best else { return gains };
        for (corner, weight) in triangle.into_iter().zip(&weights) {
            let Corner { sounds, share, .. } = &self.corners[corner];
            sounds.iter().for_each(|&channel| gains[channel] += weight.max(0.0) * share);
        }
        let power = gains.iter().map(|gain| gain * gain).sum::<f64>().sqrt();
        if power > 0.0 { gains.map(|gain| gain / power) } else { gains }
    }
}

impl Corner {
    fn in_room(&self) -> Option<Point3<f64>> {
        match self.place {
            Place::InRoom(place) => Some(place),
            Place::Middle(_) => None,
        }
    }
}

#[cfg(test)]
mod tests;
