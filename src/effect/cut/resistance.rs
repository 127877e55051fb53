//! The force that cutting takes.
//!
//! In: the work that a blade has done in a frame, toughness times new area, and its way. Out: the force on the blade. Since the area grows a
//! tetrahedron at a time, the work is spread over the length l of an edge of the mesh: of what is due, W, a way s takes
//!
//! ```text
//! F s = W (1 - exp(-s/l))
//! ```
//!
//! so that the force is steady where the cut is, and the work of a whole cut is toughness times area. A blade that goes back is relieved
//! within l/8, and is pressed again where it comes to what it has not cut. The force on it never jumps up: a hand that presses does the work
//! of every rise.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

type V3 = Vector3<f64>;

/// Part of l within which a blade is relieved.
pub const RELIEVED: f64 = 0.125;

/// The resistance of a body to a blade.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Resistance {
    /// Work that is due and work that was done, J.
    due: f64,
    done: f64,
    /// Force at which the body yields, N.
    limit: f64,
    /// Way by which the edge is pressed into what is not cut, up to l/8, m; negative where it has gone back.
    pressed: f64,
    /// Direction of the cut in the room.
    #[serde(with = "crate::field::numbers")]
    along: V3,
    /// Place where the blade is resisted, in its own axes, m.
    #[serde(with = "crate::field::numbers")]
    at: V3,
}

/// The work of a blade in a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Passed {
    /// Area that it cut, m².
    pub area: f64,
    /// Sum of the places where it passed edges of the mesh, in the room, and their number.
    pub places: V3,
    pub count: usize,
}

impl Resistance {
    /// Goes on by a frame in which the blade has moved so far, m as the body has them, and has done this work at this place of its own axes.
    pub fn step(&mut self, work: f64, at: Option<V3>, moved: &V3, length: f64) {
        if let Some((at, along)) = at.filter(|_| work > 0.0).zip(moved.try_normalize(0.0)) {
            (self.at, self.along) = (at, along);
            self.pressed = self.pressed.max(0.0);
        }
        self.due += work;
        let (full, way) = (RELIEVED * length, self.along.dot(moved));
        // Only what goes beyond what was cut does work.
        let beyond = (self.pressed + way - full).clamp(0.0, way.max(0.0));
        self.pressed = (self.pressed + way).min(full);
        let force = self.force(length);
        let done = self.due * -(-beyond / length).exp_m1();
        self.limit = if beyond > 0.0 { done / beyond } else { self.due / length };
        (self.due, self.done) = (self.due - done, self.done + done);
        // Where the body resists more than before, it is pressed more before it yields.
        if self.pressed > 0.0 && self.limit > 0.0 {
            self.pressed = full * (force / self.limit).min(1.0);
        }
    }

    /// Leaves the body: what is due is not asked for.
    pub fn leave(&mut self) {
        *self = Resistance { done: self.done, ..Resistance::default() };
    }

    /// Work of cutting so far, J.
    pub fn work(&self) -> f64 {
        self.done
    }

    /// Force at which the body yields, N.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Force along the direction of the cut with which the blade presses the body, N.
    pub fn force(&self, length: f64) -> f64 {
        self.limit * (self.pressed / (RELIEVED * length)).max(0.0)
    }

    /// Distance by which the blade has gone back from what it has not cut, m.
    pub fn gap(&self) -> f64 {
        (-self.pressed).max(0.0)
    }

    pub fn along(&self) -> &V3 {
        &self.along
    }

    pub fn at(&self) -> &V3 {
        &self.at
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area that comes in lumps, one for each edge of the mesh: all work is done, the force stays near toughness times width, is relieved where
    /// the blade goes back, and is not felt again until the blade is where it was.
    #[test]
    fn lumps_of_area_become_a_steady_force() {
        let (length, step, per_length) = (5e-3, 0.5e-3, 6.0);
        let mut resistance = Resistance::default();
        let mut forces = Vec::new();
        for k in 0..200 {
            let work = if k % 10 == 0 { per_length * length } else { 0.0 };
            resistance.step(work, Some(V3::zeros()), &(V3::x() * step), length);
            forces.push(resistance.force(length));
        }
        let late = &forces[50..];
        let (least, most) =
            late.iter().fold((f64::MAX, 0.0_f64), |(least, most), f| (least.min(*f), most.max(*f)));
        let done = resistance.work() + resistance.due;
        println!("{least} to {most} N of {per_length}, {done} J");
        assert!(least > 0.6 * per_length && most < 1.6 * per_length);
        assert!((done - per_length * 0.1).abs() < 1e-12);
        let (force, work) = (resistance.force(length), resistance.work());
        let back = |resistance: &mut Resistance, by: f64| resistance.step(0.0, None, &(V3::x() * by), length);
        let by = -0.5 * resistance.pressed;
        back(&mut resistance, by);
        assert!((resistance.force(length) - 0.5 * force).abs() < 1e-12);
        let here = resistance.pressed;
        back(&mut resistance, -4.0 * length);
        assert!(resistance.force(length) == 0.0 && (resistance.gap() - 4.0 * length + here).abs() < 1e-12);
        back(&mut resistance, 4.0 * length);
        assert!((resistance.force(length) - 0.5 * force).abs() < 1e-9 && resistance.work() == work);
    }
}
