//! Errors to expect at a reach, and at a part of the loads: those that were measured, those between them, and those nearer to rest
//! than the first.
//!
//! In: [`ErrorsAt`] of motions that go farther and farther, and a [`Reach`]. Out: the errors there, linear between two; nearer to rest
//! than the first, the most that forces of the second order can make; nothing beyond the last. Of the loads under which errors were
//! measured, the same part of each must act, in its direction to the body, and no others, nor forces at points.

use super::loads::AppliedLoads;
use super::trial::Deviation;
use super::turn::Reach;
use crate::green::{LoadMeta, Turning};
use nalgebra::{DVectorView, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// The largest errors of all motions up to a reach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorsAt {
    /// Angle of the turns, °.
    pub angle: f64,
    /// The reach, rad and 1.
    pub turn: f64,
    pub stretch: f64,
    pub off: f64,
    /// The errors as in [`Deviation`]; `None` where the model has no forces.
    pub force: Option<f64>,
    pub torque: Option<f64>,
    pub shape: f64,
}

impl ErrorsAt {
    pub fn new(angle: f64, reach: Reach, deviation: &Deviation) -> ErrorsAt {
        let Deviation { force, torque, shape, .. } = *deviation;
        let Reach { turn, stretch, off, .. } = reach;
        ErrorsAt { angle, turn, stretch, off, force, torque, shape }
    }

    /// The larger of each of both; no forces where one has none.
    pub fn and(&self, other: &ErrorsAt) -> ErrorsAt {
        ErrorsAt {
            angle: self.angle.max(other.angle),
            turn: self.turn.max(other.turn),
            stretch: self.stretch.max(other.stretch),
            off: self.off.max(other.off),
            force: self.force.zip(other.force).map(|(a, b)| a.max(b)),
            torque: self.torque.zip(other.torque).map(|(a, b)| a.max(b)),
            shape: self.shape.max(other.shape),
        }
    }

    /// Whether they were measured as far as this.
    fn covers(&self, reach: Reach) -> bool {
        reach.turn <= self.turn && reach.stretch <= self.stretch && reach.off <= self.off
    }

    /// `share` of the way to `next`.
    pub(super) fn towards(&self, next: &ErrorsAt, share: f64) -> ErrorsAt {
        let between = |a: f64, b: f64| a + share * (b - a);
        let both = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| between(a, b));
        ErrorsAt {
            angle: between(self.angle, next.angle),
            turn: between(self.turn, next.turn),
            stretch: between(self.stretch, next.stretch),
            off: between(self.off, next.off),
            force: both(self.force, next.force),
            torque: both(self.torque, next.torque),
            shape: between(self.shape, next.shape),
        }
    }

    /// All reaches and errors, with 0 for forces that the model does not have.
    pub(super) fn numbers(&self) -> [f64; 7] {
        let ErrorsAt { angle, turn, stretch, off, force, torque, shape } = *self;
        [off, angle, turn, stretch, shape, force.unwrap_or(0.0), torque.unwrap_or(0.0)]
    }

    /// The larger of the errors of force and torque.
    pub fn wrench(&self) -> Option<f64> {
        self.force.zip(self.torque).map(|(force, torque)| force.max(torque))
    }
}

/// An error as a part, in per cent: `13 %`, `0.4 %`, `<0.1 %`.
pub fn percent(part: f64) -> String {
    match 100.0 * part {
        value if value < 0.1 => "<0.1 %".into(),
        value if value < 9.95 => format!("{value:.1} %"),
        value if value < 1000.0 => format!("{value:.0} %"),
        _ => ">1000 %".into(),
    }
}

/// The least part of an equilibrium's force that a model is taken to have, where a smaller one cannot be distinguished from zero.
const LEAST: f64 = 0.01;

/// An error that is nothing at rest, at a share of the way to where it is `e`: not larger than the forces that the model has too
/// much, which grow as the way does, nor than those that it misses. Where the true force is f (1 + q), the model returns f and
/// misses q/(1 + q); q grows in proportion to the way.
fn begun(e: f64, share: f64) -> f64 {
    let missing = e.min(1.0 - LEAST);
    let q = share * missing / (1.0 - missing);
    (share * e).max(q / (1.0 + q)).min(e)
}

impl ErrorsAt {
    /// No errors, at rest.
    pub(super) const NONE: ErrorsAt = ErrorsAt {
        angle: 0.0,
        turn: 0.0,
        stretch: 0.0,
        off: 0.0,
        force: Some(0.0),
        torque: Some(0.0),
        shape: 0.0,
    };

    /// Errors at `reach`, nearer to rest than these, by its share of the way; they start with `begin` at rest.
    pub(super) fn begun(&self, reach: Reach, begin: &ErrorsAt) -> ErrorsAt {
        let share = |x: f64, whole: f64| if x > 0.0 { x / whole } else { 0.0 };
        let shares =
            [share(reach.turn, self.turn), share(reach.stretch, self.stretch), share(reach.off, self.off)];
        self.begun_by(shares.into_iter().fold(0.0, f64::max).min(1.0), begin)
    }

    /// Errors at `share` of the way from rest, where they start with `begin`.
    pub(super) fn begun_by(&self, share: f64, begin: &ErrorsAt) -> ErrorsAt {
        let left = 1.0 - share;
        let of = |error: Option<f64>, begin: Option<f64>| {
            error.zip(begin).map(|(error, begin)| begun(error, share) + left * begin)
        };
        ErrorsAt {
            force: of(self.force, begin.force),
            torque: of(self.torque, begin.torque),
            shape: share * self.shape + left * begin.shape,
            ..*self
        }
    }
}

/// The errors at a reach: between the measured ones, up to the first its own or, where it is known with what they begin at rest, what
/// they can have grown to; `None` beyond the last.
pub(super) fn between(measured: &[ErrorsAt], reach: Reach, begin: Option<&ErrorsAt>) -> Option<ErrorsAt> {
    let next = measured.iter().position(|at| at.covers(reach))?;
    let (to, Some(from)) = (measured[next], next.checked_sub(1).map(|last| measured[last])) else {
        let first = measured[next];
        return Some(begin.map_or(first, |begin| first.begun(reach, begin)));
    };
    let share = |x: f64, from: f64, to: f64| if x > from { (x - from) / (to - from) } else { 0.0 };
    let shares = [
        share(reach.turn, from.turn, to.turn),
        share(reach.stretch, from.stretch, to.stretch),
        share(reach.off, from.off, to.off),
    ];
    Some(from.towards(&to, shares.into_iter().fold(0.0, f64::max)))
}

/// Loads that differ by less than this part are the same.
const SAME: f64 = 0.01;

/// The part from 0 to 1; 1 too where there were no loads and are none. `turn`: of the body, against that in which it was measured.
pub(super) fn load_share(
    measured: &[f64],
    acting: &AppliedLoads,
    metas: &[LoadMeta],
    turn: &UnitQuaternion<f64>,
) -> Option<f64> {
    if !acting.points.is_empty() {
        return None;
    }
    let mut shares: Vec<f64> = Vec::new();
    let mut first = 0;
    for meta in metas {
        let of = |all: &[f64]| {
            let own = all.get(first..first + meta.columns).unwrap_or(&[0.0; 3][..meta.columns.min(3)]);
            DVectorView::from_slice(own, own.len()).into_owned()
        };
        let (then, mut now) = (of(measured), of(&acting.coefficients));
        first += meta.columns;
        if meta.turning == Turning::Fixed && meta.columns == 3 {
            now.copy_from(&(turn.inverse() * Vector3::new(now[0], now[1], now[2])));
        }
        let size = then.norm();
        if size == 0.0 {
            (now.norm() == 0.0).then_some(())?;
            continue;
        }
        let share = then.dot(&now) / (size * size);
        ((&now - &then * share).norm() <= SAME * size).then_some(())?;
        shares.push(share);
    }
    let most = shares.iter().copied().reduce(f64::max).unwrap_or(1.0);
    let least = shares.iter().copied().fold(most, f64::min);
    (least >= 0.0 && most - least <= SAME && most <= 1.0 + SAME).then_some(most.min(1.0))
}

/// Whether that is all of them.
pub(super) fn is_whole(share: f64) -> bool {
    share >= 1.0 - SAME
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::{PointLoad, Pull};

    #[test]
    fn parts_are_told_in_per_cent() {
        let told = [0.0, 0.00094, 0.004, 0.0994, 0.0996, 0.13, 9.4, 38.58].map(percent);
        assert_eq!(told, ["<0.1 %", "<0.1 %", "0.4 %", "9.9 %", "10 %", "13 %", "940 %", ">1000 %"]);
    }

    /// A body with forces x + a x² that is shown with x, or the reverse, has no larger error at a part of the way than is
    /// foreseen.
    #[test]
    fn errors_that_begin_at_zero_are_no_smaller_than_those_of_forces_of_second_order() {
        for a in [1e-3, 0.2, 3.0, 80.0_f64] {
            for share in [1e-6, 1e-3, 0.1, 0.7, 1.0] {
                let missing = |x: f64| a * x / (1.0 + a * x);
                let too_much = |x: f64| a * x;
                for error in [&missing as &dyn Fn(f64) -> f64, &too_much] {
                    let told = begun(error(1.0), share);
                    assert!(
                        told >= error(share) * (1.0 - 1e-12) && told <= error(1.0),
                        "{a} {share}: {told}"
                    );
                }
                assert!((begun(missing(1.0), share) - missing(share)).abs() < 1e-12 || missing(1.0) > 0.5);
            }
        }
    }

    #[test]
    fn the_same_part_of_each_load_is_known_and_no_other() {
        let meta = |name: &str, columns: usize| LoadMeta {
            name: name.into(),
            columns,
            turning: Turning::Fixed,
            unit: "N".into(),
        };
        let metas = [meta("gravity", 3), meta("press", 1), meta("idle", 1)];
        let all = [0.0, -9.81, 0.0, 1e5, 0.0];
        let still = UnitQuaternion::identity();
        let acting =
            |coefficients: &[f64]| AppliedLoads { coefficients: coefficients.to_vec(), points: Vec::new() };
        let of = |coefficients: &[f64]| load_share(&all, &acting(coefficients), &metas, &still);
        assert_eq!(of(&all), Some(1.0));
        assert_eq!(of(&[0.0, -4.905, 0.0, 5e4, 0.0]), Some(0.5));
        assert_eq!(of(&[1e-3, -9.81, 0.0, 1e5, 0.0]), Some(1.0), "turned by nothing");
        assert_eq!(of(&[]), Some(0.0), "none of them");
        for (other, what) in [
            ([9.81, 0.0, 0.0, 1e5, 0.0], "turned"),
            ([0.0, -9.81, 0.0, 0.0, 0.0], "one without the other"),
            ([0.0, -19.62, 0.0, 2e5, 0.0], "more"),
            ([0.0, 9.81, 0.0, -1e5, 0.0], "the other way round"),
            ([0.0, -9.81, 0.0, 1e5, 1.0], "one that was not there"),
        ] {
            assert_eq!(of(&other), None, "{what}");
        }
        let turned = |axis: Vector3<f64>| {
            load_share(&all, &acting(&all), &metas, &UnitQuaternion::from_scaled_axis(axis * 1.5))
        };
        assert_eq!(
            (turned(Vector3::x()), turned(Vector3::y())),
            (None, Some(1.0)),
            "the body, about the weight too"
        );
        let pull = Pull::Force(Vector3::x());
        let points = vec![PointLoad { nodes: [0, 1, 2], weights: [1.0, 0.0, 0.0], pull }];
        let pushed = AppliedLoads { coefficients: all.to_vec(), points };
        assert_eq!(load_share(&all, &pushed, &metas, &still), None, "a force at a point");
        assert_eq!(load_share(&[], &AppliedLoads::default(), &[], &still), Some(1.0), "a body without loads");
        assert_eq!(load_share(&[], &acting(&[0.0; 5]), &metas, &still), Some(1.0), "loads that do not act");
    }
}
