//! Errors of one control element's motions, and those between them.
//!
//! In: [`ErrorsAt`] in order of increasing reach, of turns by direction, of shifts, of pulls and of presses; a [`Reach`] and the turn that
//! leads there. Out: the errors to expect. A turn has the errors of the measured directions around its own: of a cube's surface by whose
//! corners, edges and faces the directions go, its own point lies in a triangle of three of them, and those of its corners count.

use super::errors_at::{ErrorsAt, between};
use super::trial::Direction;
use super::turn::{RESTS, Reach};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Turns and shifts of one control element with their errors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionErrors {
    /// Turned along an arc or a helix, so that the body keeps its length.
    pub turned: TurnErrors,
    /// Turned in place or shifted, so that the body is stretched.
    pub shifted: Vec<ErrorsAt>,
    /// Pulled away from the others, neither turned nor shifted aside.
    pub pulled: Vec<ErrorsAt>,
    /// Pressed towards the others.
    pub pressed: Vec<ErrorsAt>,
}

/// Turns along arcs and helices: the largest errors of each kind, and where these differ those of each direction.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TurnErrors {
    /// Bent, about any axis across the body.
    pub bent: Vec<ErrorsAt>,
    /// Twisted.
    pub twisted: Vec<ErrorsAt>,
    /// Bent and twisted at once.
    pub both: Vec<ErrorsAt>,
    /// Errors of single directions; empty where those of the kinds serve for all.
    #[serde(default)]
    pub about: Vec<DirectionErrors>,
}

/// Turns about one direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DirectionErrors {
    pub direction: Direction,
    pub at: Vec<ErrorsAt>,
}

/// Distance from an arc below which a body counts as bent along it, as a part of its length.
const ARC: f64 = 0.001;
/// Part by which a turn may be larger than a measured one: by rounding.
const ROUNDING: f64 = 1.001;
/// Part of a turn below which a direction beside it does not count.
const BESIDE: f64 = 0.05;

impl MotionErrors {
    /// All errors by motions.
    pub(super) fn lists(&self) -> impl Iterator<Item = &[ErrorsAt]> {
        let MotionErrors { turned: TurnErrors { bent, twisted, both, about }, shifted, pulled, pressed } =
            self;
        let lists = [bent, twisted, both, shifted, pulled, pressed];
        lists.into_iter().chain(about.iter().map(|of| &of.at)).map(Vec::as_slice)
    }

    /// Replaces all errors.
    pub fn map(self, of: impl Fn(&ErrorsAt) -> ErrorsAt) -> MotionErrors {
        let all = |list: Vec<ErrorsAt>| list.iter().map(&of).collect();
        let MotionErrors { turned: TurnErrors { bent, twisted, both, about }, shifted, pulled, pressed } =
            self;
        let about = about.into_iter().map(|own| DirectionErrors { at: all(own.at), ..own }).collect();
        let turned = TurnErrors { bent: all(bent), twisted: all(twisted), both: all(both), about };
        MotionErrors { turned, shifted: all(shifted), pulled: all(pulled), pressed: all(pressed) }
    }

    /// Errors at a reach to which the turn `turn` leads, with components as of a [`Direction`]; `None` where that is not known. A pull has
    /// its own, and a press; an arc has those of turns. Off the arc they are those of the turn that is in the motion and of the first shift
    /// that is off as far, and beyond that on the way to those of the shifts that go as far. They start with `begin` at rest.
    pub fn at(
        &self,
        reach: Reach,
        turn: Option<&Vector3<f64>>,
        begin: Option<&ErrorsAt>,
    ) -> Option<ErrorsAt> {
        let Reach { arc, stretch, off, pull, .. } = reach;
        let along = if pull > 0.0 { &self.pulled } else { &self.pressed };
        if pull != 0.0
            && let Some(at) = between(along, Reach { turn: 0.0, ..reach }, begin)
        {
            return Some(at);
        }
        let first = *self.shifted.first().or(self.turned.bent.first())?;
        let near =
            begin.is_some() && reach.turn <= first.turn && stretch <= first.stretch && off <= first.off;
        if off <= self.turned.off() + ARC && !near {
            return self.turned.at(Reach { off: 0.0, ..reach }, turn, begin);
        }
        let turned = self.turned.at(Reach { turn: arc, arc, ..Reach::default() }, turn, begin)?;
        let aside = Reach { off, ..Reach::default() };
        let least = turned.and(&begin.map_or(first, |begin| first.begun(aside, begin)));
        if near {
            return Some(least);
        }
        // No shift is a press.
        if pull < 0.0 {
            return None;
        }
        // A shift is stretched by what the turn alone does not stretch.
        let by_the_turn = turned.stretch * (arc / turned.turn).min(1.0);
        let shifted =
            between(&self.shifted, Reach { stretch: (stretch - by_the_turn).max(0.0), ..reach }, begin)?;
        Some(least.towards(&least.and(&shifted), (off / shifted.off).min(1.0)))
    }
}

impl TurnErrors {
    /// Distance from the arc of the turns that were measured, which is rounding.
    fn off(&self) -> f64 {
        self.bent.last().map_or(0.0, |last| last.off)
    }

    /// Errors of turns about a direction, in order of increasing reach.
    pub fn of(&self, direction: Direction) -> &[ErrorsAt] {
        let own = self.about.iter().find(|of| of.direction == direction);
        match (own, direction) {
            (Some(own), _) => &own.at,
            (None, [0, ..]) => &self.bent,
            (None, [_, 0, 0]) => &self.twisted,
            (None, _) => &self.both,
        }
    }

    /// Errors of the turn: the largest of the directions around it that are known, of which the nearest must be, and where directions differ
    /// those of the next level; of an unknown turn the largest of all kinds.
    fn at(&self, reach: Reach, turn: Option<&Vector3<f64>>, begin: Option<&ErrorsAt>) -> Option<ErrorsAt> {
        let Some(around) = turn.filter(|turn| turn.norm() > RESTS).map(around) else {
            let kinds = [&self.bent, &self.twisted, &self.both].map(|kind| between(kind, reach, begin));
            return kinds.into_iter().collect::<Option<Vec<_>>>()?.into_iter().reduce(|a, b| a.and(&b));
        };
        let differ = !self.about.is_empty();
        let of = |direction: Direction| match differ {
            true => self.within(direction, reach, begin),
            false => between(self.of(direction), reach, begin),
        };
        let mut all = around.into_iter().map(|(direction, _)| of(direction));
        let nearest = all.next()??;
        Some(all.flatten().fold(nearest, |a, b| a.and(&b)))
    }

    /// Errors of the first measured turn about a direction that goes as far, for a wall may buckle anywhere between two of them. Some other
    /// turn by that angle must stretch the body as much, as one between two directions may more than either.
    fn within(&self, direction: Direction, reach: Reach, begin: Option<&ErrorsAt>) -> Option<ErrorsAt> {
        let goes_as_far = |at: &&ErrorsAt| {
            let mut others = self.about.iter().flat_map(|of| &of.at);
            reach.arc <= ROUNDING * at.angle.to_radians()
                && others.any(|other| other.angle <= at.angle && reach.stretch <= other.stretch)
        };
        let measured = self.of(direction);
        let at = measured.iter().find(goes_as_far)?;
        let is_first = at.angle == measured[0].angle;
        Some(begin.filter(|_| is_first).map_or(*at, |begin| at.begun(reach, begin)))
    }
}

/// The directions around a turn with their shares of it, the largest first: with |a| ≥ |b| ≥ |c| its components, |a| - |b| of the face
/// a, |b| - |c| of the edge between a and b, and |c| of the corner between all three.
fn around(turn: &Vector3<f64>) -> Vec<(Direction, f64)> {
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| turn[j].abs().total_cmp(&turn[i].abs()));
    let size = order.map(|i| turn[i].abs());
    let shares = [size[0] - size[1], size[1] - size[2], size[2]];
    let direction = |corners: usize| {
        let mut direction = [0; 3];
        order[..corners].iter().for_each(|&i| direction[i] = if turn[i] < 0.0 { -1 } else { 1 });
        direction
    };
    let mut found: Vec<(Direction, f64)> =
        (1..=3).map(|corners| (direction(corners), shares[corners - 1])).collect();
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    let most = found[0].1;
    found.retain(|(_, share)| *share >= BESIDE * most);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_directions_around_a_turn_sum_to_it() {
        for turn in [[0.3, -0.7, 0.2], [-0.1, 0.0, 0.5], [0.4, 0.4, -0.4], [0.0, 1.0, 0.0], [0.2, 0.3, 0.25]]
        {
            let turn = Vector3::from(turn);
            let found = around(&turn);
            let sum: Vector3<f64> =
                found.iter().map(|(direction, share)| Vector3::from(direction.map(f64::from)) * *share).sum();
            assert!(
                (sum - turn).norm() < 1e-12 && found.windows(2).all(|two| two[0].1 >= two[1].1),
                "{found:?}"
            );
        }
        assert_eq!(
            around(&Vector3::new(0.0, -1.0, 0.01)).len(),
            1,
            "a hundredth beside a bend does not count"
        );
    }

    /// A body that buckles under bends about (0, 1, 1) by more than 10°, and has no equilibrium about (0, 0, 1) by 30°.
    #[test]
    fn a_turn_has_the_errors_of_the_directions_around_it() {
        let at = |degrees: f64, force: f64| ErrorsAt {
            angle: degrees,
            turn: degrees.to_radians(),
            stretch: 1.0,
            off: 0.0,
            force: Some(force),
            torque: Some(force),
            shape: 0.0,
        };
        let levels = |forces: &[f64]| -> Vec<ErrorsAt> {
            forces.iter().zip([10.0, 30.0]).map(|(force, angle)| at(angle, *force)).collect()
        };
        let kinds = TurnErrors {
            bent: levels(&[0.1, 0.2]),
            twisted: levels(&[0.05, 0.06]),
            both: levels(&[0.3, 0.4]),
            about: Vec::new(),
        };
        let force = |errors: &TurnErrors, degrees: f64, turn: Option<[f64; 3]>| {
            let turn = turn.map(|turn| Vector3::from(turn).normalize() * degrees.to_radians());
            let turn_by = degrees.to_radians();
            let reach = Reach { turn: turn_by, arc: turn_by, ..Reach::default() };
            let found = errors.at(reach, turn.as_ref(), None)?.force?;
            Some((1e6 * found).round() / 1e6)
        };
        assert_eq!(force(&kinds, 20.0, Some([0.0, 1.0, 1.0])), Some(0.15), "bends, between two levels");
        assert_eq!(force(&kinds, 20.0, Some([-1.0, 0.0, 0.0])), Some(0.055), "twists");
        assert_eq!(force(&kinds, 20.0, Some([1.0, 1.0, 0.0])), Some(0.35), "both");
        assert_eq!(force(&kinds, 20.0, None), Some(0.35), "the largest of all kinds");
        assert_eq!(force(&kinds, 31.0, None), None, "beyond what was measured");
        let about = [([0, 1, 1], [0.1, 0.9].as_slice()), ([0, 0, 1], &[0.1])];
        let about = about.map(|(direction, forces)| DirectionErrors { direction, at: levels(forces) });
        let differ = TurnErrors { about: about.to_vec(), ..kinds };
        assert_eq!(force(&differ, 11.0, Some([0.0, 1.0, 1.0])), Some(0.9), "of the level beyond");
        assert_eq!(force(&differ, 20.0, Some([0.0, 1.0, 0.3])), Some(0.9), "of the worse of two directions");
        assert_eq!(force(&differ, 20.0, Some([0.0, 1.0, -1.0])), Some(0.2), "the other way");
        assert_eq!(force(&differ, 20.0, Some([0.0, 0.3, 1.0])), None, "the nearest is not known");
        assert_eq!(force(&differ, 20.0, Some([0.0, 0.6, 1.0])), Some(0.9), "the other direction is nearer");
    }

    fn at(angle: f64, [stretch, off]: [f64; 2], force: f64) -> ErrorsAt {
        let turn = angle.to_radians();
        ErrorsAt { angle, turn, stretch, off, force: Some(force), torque: Some(force), shape: 0.0 }
    }

    /// A turn between two directions stretches a wall more than either, but no more than some other turn by its angle.
    #[test]
    fn a_turn_may_stretch_a_body_as_much_as_others_by_its_angle() {
        let about = [([0, 1, 0], 0.1), ([0, 0, 1], 0.3)].map(|(direction, stretch)| DirectionErrors {
            direction,
            at: vec![at(30.0, [stretch, 0.0], 0.2), at(60.0, [2.0 * stretch, 0.0], 0.4)],
        });
        let errors = TurnErrors { about: about.to_vec(), ..TurnErrors::default() };
        let force = |degrees: f64, stretch: f64| {
            let arc = degrees.to_radians();
            let turn = Vector3::new(0.0, arc, 0.0);
            errors.at(Reach { turn: arc, arc, stretch, ..Reach::default() }, Some(&turn), None)?.force
        };
        assert_eq!([force(30.0, 0.1), force(30.0, 0.3)], [Some(0.2); 2]);
        assert_eq!(force(30.0, 0.4), Some(0.4), "no turn by 30° stretches it so much");
        assert_eq!([force(60.0, 0.7), force(61.0, 0.1)], [None; 2]);
    }

    /// Off an arc, a body is stretched by its turn and by its shift.
    #[test]
    fn a_shift_is_measured_by_the_stretch_that_is_not_the_turns() {
        let bent = vec![at(30.0, [0.15, 0.0], 0.1), at(60.0, [0.3, 0.0], 0.2)];
        let turned = TurnErrors { twisted: bent.clone(), both: bent.clone(), bent, about: Vec::new() };
        let shifted = vec![at(30.0, [0.1, 0.1], 0.3), at(60.0, [0.2, 0.1], 0.4)];
        let errors = MotionErrors { turned, shifted, ..MotionErrors::default() };
        let force = |degrees: f64, stretch: f64| {
            let arc = degrees.to_radians();
            errors.at(Reach { turn: arc, arc, stretch, off: 0.1, pull: 0.0 }, None, None)?.force
        };
        assert_eq!([force(60.0, 0.3), force(60.0, 0.45)], [Some(0.4); 2]);
        assert_eq!([force(60.0, 0.55), force(10.0, 0.3)], [None; 2], "more than any shift");
    }

    /// Shifts go farther than presses, but none of them is one.
    #[test]
    fn a_press_beyond_the_measured_ones_has_no_errors() {
        let pressed = vec![at(0.0, [0.01, 0.01], 0.1), at(0.0, [0.05, 0.05], 0.2)];
        let shifted = vec![at(0.0, [0.02, 0.02], 0.3), at(0.0, [0.1, 0.1], 0.4)];
        let bent = vec![at(30.0, [0.1, 0.0], 0.1)];
        let turned = TurnErrors { twisted: bent.clone(), both: bent.clone(), bent, about: Vec::new() };
        let all = MotionErrors { turned, shifted, pressed, ..MotionErrors::default() };
        let lost = MotionErrors { pressed: Vec::new(), ..all.clone() };
        let force = |errors: &MotionErrors, pull: f64| {
            let by = pull.abs();
            errors
                .at(Reach { stretch: by, off: by, pull, ..Reach::default() }, None, Some(&ErrorsAt::NONE))?
                .force
        };
        assert_eq!([force(&all, -0.05), force(&all, -0.08)], [Some(0.2), None]);
        assert!(force(&lost, -0.01).is_some_and(|error| error < 0.3), "near rest");
        assert_eq!(force(&lost, -0.05), None);
        assert_eq!(force(&all, 0.1), Some(0.4), "a pull is among the shifts");
    }
}
