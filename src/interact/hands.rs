//! Hands that grab: while the button is down, a control element's matrix follows the hands that hold it.
//!
//! In: the styli, what each of them points at, and the current matrices of the elements. Out: the matrices of the held
//! elements, and what the second button asks for. Every matrix is computed from the state at the grab, never from the last
//! one, so that nothing drifts. When hands, mode or scaling change, a new hold starts where the element is, so that nothing
//! jumps.

use super::carry::{Carrying, HandMotion};
use super::mode::Mode;
use super::navigate::MovingHand;
use super::pick::Hit;
use crate::track::{HeldPose, Signal, StylusState};
use nalgebra::{Isometry3, Matrix4, Point3, Similarity3, Unit, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The second button pressed and released within this time is a click; two presses within it are a double press, s.
pub const CLICK_S: f64 = 0.35;
/// During a click the hand moves along its ray by less than this fraction of the workspace's radius.
const CLICK_PUSH: f64 = 0.05;

/// All hands, and what they hold. At most two hands hold the same element; a third one grabs nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hands {
    pub mode: Mode,
    /// Moving the hand along its ray by this distance scales by e, m: the workspace's radius.
    pub radius_m: f64,
    hands: Vec<Hand>,
    holds: BTreeMap<usize, Hold>,
}

/// A control element as it is in this frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Element {
    pub room_from_body: Similarity3<f64>,
    pub room_from_element: Matrix4<f64>,
}

/// The element that is held, and its matrix now.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drag {
    pub target: usize,
    #[serde(with = "crate::field::numbers")]
    pub room_from_element: Matrix4<f64>,
}

/// The target that one hand holds, and where.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grip {
    pub target: usize,
    /// The grabbed point, rigidly carried by the hand.
    #[serde(with = "crate::field::numbers")]
    pub place_in_stylus: Point3<f64>,
    /// The grabbed point in the element's own frame.
    #[serde(with = "crate::field::numbers")]
    pub place_in_element: Point3<f64>,
}

/// The requests of the hands in one frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandRequests {
    /// Drags in the order of the targets.
    pub drags: Vec<Drag>,
    /// Hands that move the scene: their second button was pressed while they held nothing.
    pub navigating: Vec<MovingHand>,
    /// Hands that pressed the second button twice while they held nothing.
    pub double_pressed: Vec<usize>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Hand {
    stylus: HeldPose,
    grip: Option<Grip>,
    was_pressed: bool,
    second: Second,
    /// The time at which the second button was last pressed while the hand held nothing.
    last_press_s: Option<f64>,
}

/// The use of the second button until it is released.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Second {
    #[default]
    Up,
    Scales {
        since_s: f64,
    },
    Navigates,
    /// The effect has ended, and the button waits for its release.
    Spent,
}

/// An element held by one hand or two, as all were when this hold began.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Hold {
    mode: Mode,
    scaled_by: Option<usize>,
    #[serde(with = "crate::field::numbers")]
    room_from_element: Matrix4<f64>,
    /// A unit vector.
    #[serde(with = "crate::field::numbers::option")]
    axis: Option<Vector3<f64>>,
    /// See [`held_line`](super::held_line).
    #[serde(with = "crate::field::numbers::option")]
    line: Option<Vector3<f64>>,
    then: Vec<HandAtGrab>,
}

/// A hand of a hold, and the point that it held, when the hold began.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct HandAtGrab {
    hand: usize,
    #[serde(with = "crate::field::numbers")]
    room_from_hand: Isometry3<f64>,
    #[serde(with = "crate::field::numbers")]
    held: Point3<f64>,
}

impl Hands {
    pub fn new(radius_m: f64) -> Self {
        Self { mode: Mode::FREE, radius_m, hands: Vec::new(), holds: BTreeMap::new() }
    }

    /// Evaluates the styli at `time_s`. `hits` is what each of them points at, `element` gives the elements as they are shown
    /// now.
    ///
    /// When the button is pressed, the hand takes hold of the element of the hit. While the button is down, the element
    /// follows the hand, see [`carry`](super::carry()) and [`Mode::take`]; when it is released, the element stays where the
    /// last [`Drag`] put it. A press that hits nothing grabs nothing until the next press. An unusable pose is replaced by
    /// the last usable one, and a press that comes with it waits for a usable one. A lost stylus lets go, and its button
    /// must be pressed again.
    ///
    /// The second button: while the hand holds something, a click selects the next mode; while it is held down, the element
    /// does not follow but is scaled about its origin by exp(d / radius), with d the hand's motion along its ray. While the
    /// hand holds nothing, it moves the scene.
    pub fn step(
        &mut self,
        styli: &[Option<StylusState>],
        time_s: f64,
        hits: &[Option<Hit>],
        element: impl Fn(usize) -> Option<Element>,
    ) -> HandRequests {
        self.hands.resize_with(styli.len(), Hand::default);
        let mut asked = HandRequests::default();
        for (i, stylus) in styli.iter().enumerate() {
            let Some(stylus) = stylus else {
                self.hands[i] = Hand::default();
                continue;
            };
            let is_usable = self.hands[i].stylus.update(&stylus.room_from_stylus);
            let can_act = is_usable && !is_lost(stylus);
            self.grab(i, stylus, can_act, hits.get(i).and_then(Option::as_ref), &element);
            if self.second_button(i, stylus, can_act, time_s, &element) {
                asked.double_pressed.push(i);
            }
        }
        for (i, hand) in self.hands.iter().enumerate() {
            if let (Second::Navigates, Some(pose)) = (hand.second, hand.stylus.last) {
                asked.navigating.push(MovingHand { number: i, room_from_hand: pose });
            }
        }
        let held = self.held();
        self.holds.retain(|target, _| held.contains(target));
        for target in held {
            let drag = self.drag(target, &element);
            asked.drags.extend(drag);
        }
        asked
    }

    /// The held elements.
    pub fn held(&self) -> BTreeSet<usize> {
        self.hands.iter().filter_map(|hand| hand.grip).map(|grip| grip.target).collect()
    }

    /// The grip of hand `i`.
    pub fn grip(&self, i: usize) -> Option<&Grip> {
        self.hands.get(i)?.grip.as_ref()
    }

    /// The last usable pose of stylus `i`.
    pub fn room_from_stylus(&self, i: usize) -> Option<Isometry3<f64>> {
        self.hands.get(i)?.stylus.last
    }

    /// The number of unusable poses of stylus `i` since the start.
    pub fn invalid(&self, i: usize) -> u64 {
        self.hands.get(i).map_or(0, |hand| hand.stylus.invalid)
    }

    /// Lets go of the elements for which `is_taken` is true, as when they are set aside; the next press grabs again.
    pub fn let_go(&mut self, is_taken: impl Fn(usize) -> bool) {
        for hand in &mut self.hands {
            hand.grip = hand.grip.filter(|grip| !is_taken(grip.target));
        }
    }

    /// Makes holds continue from the elements' present places, as after navigation.
    pub fn rebase(&mut self) {
        self.holds.clear();
    }

    fn grab(
        &mut self,
        i: usize,
        stylus: &StylusState,
        can_act: bool,
        hit: Option<&Hit>,
        element: &impl Fn(usize) -> Option<Element>,
    ) {
        let holders =
            |target| self.hands.iter().filter(|h| h.grip.is_some_and(|g| g.target == target)).count();
        let free_hit = hit.filter(|hit| holders(hit.target) < 2);
        let hand = &mut self.hands[i];
        if !stylus.pressed || is_lost(stylus) {
            (hand.grip, hand.was_pressed) = (None, stylus.pressed);
        } else if can_act && !hand.was_pressed {
            hand.was_pressed = true;
            let grip = |(hit, room_from_stylus): (&Hit, Isometry3<f64>)| {
                let place = hit.point_in_room.cast::<f64>();
                let element_from_room = element(hit.target)?.room_from_element.try_inverse()?;
                Some(Grip {
                    target: hit.target,
                    place_in_stylus: room_from_stylus.inverse() * place,
                    place_in_element: element_from_room.transform_point(&place),
                })
            };
            hand.grip = free_hit.zip(hand.stylus.last).and_then(grip);
        }
    }

    /// Evaluates the second button of hand `i`; true if it was pressed twice.
    fn second_button(
        &mut self,
        i: usize,
        stylus: &StylusState,
        can_act: bool,
        time_s: f64,
        element: &impl Fn(usize) -> Option<Element>,
    ) -> bool {
        let hand = self.hands[i];
        let next = match (hand.second, hand.grip) {
            _ if !stylus.second => Second::Up,
            _ if is_lost(stylus) => Second::Spent,
            (Second::Up, _) if !can_act => Second::Up,
            (Second::Up, Some(_)) => Second::Scales { since_s: time_s },
            (Second::Up, None) => Second::Navigates,
            (Second::Scales { .. }, None) | (Second::Navigates, Some(_)) => Second::Spent,
            (as_it_was, _) => as_it_was,
        };
        if let (Second::Scales { since_s }, Second::Up, Some(grip)) = (hand.second, next, hand.grip)
            && is_within_click(since_s, time_s)
        {
            self.click(i, grip.target, element);
        }
        let begins = hand.second == Second::Up && next == Second::Navigates;
        self.hands[i].second = next;
        if !begins {
            return false;
        }
        let is_double = hand.last_press_s.is_some_and(|last_s| is_within_click(last_s, time_s));
        self.hands[i].last_press_s = (!is_double).then_some(time_s);
        is_double
    }

    /// A click of the second button: selects the next mode, and takes back what was scaled during the click.
    fn click(&mut self, i: usize, target: usize, element: &impl Fn(usize) -> Option<Element>) {
        let Some(hold) = self.holds.get(&target).filter(|hold| hold.scaled_by == Some(i)) else { return };
        let motion = hold.then.iter().find(|then| then.hand == i).and_then(|then| self.motion(then));
        let is_click = motion.is_some_and(|motion| motion.push().abs() < CLICK_PUSH * self.radius_m);
        if let Some(element) = element(target).filter(|_| is_click) {
            let before = Element { room_from_element: hold.room_from_element, ..element };
            let hands = hold.then.iter().map(|then| then.hand).collect();
            self.mode = self.mode.next();
            let hold = self.hold(hands, None, &before);
            self.holds.extend(hold.map(|hold| (target, hold)));
        }
    }

    fn drag(&mut self, target: usize, element: &impl Fn(usize) -> Option<Element>) -> Option<Drag> {
        let of_target = |hand: &Hand| hand.grip.is_some_and(|grip| grip.target == target);
        let hands: Vec<usize> = (0..self.hands.len()).filter(|&i| of_target(&self.hands[i])).collect();
        let scales = |&i: &usize| matches!(self.hands[i].second, Second::Scales { .. });
        let scaled_by = hands.iter().copied().find(scales);
        let goes_on = |hold: &&Hold| {
            let same_hands = hold.then.iter().map(|then| then.hand).eq(hands.iter().copied());
            same_hands && hold.mode == self.mode && hold.scaled_by == scaled_by
        };
        if self.holds.get(&target).filter(goes_on).is_none() {
            let hold = self.hold(hands, scaled_by, &element(target)?)?;
            self.holds.insert(target, hold);
        }
        let carrying = self.carrying_of(self.holds.get(&target)?, 0)?;
        self.holds.get_mut(&target)?.line = carrying.line_now();
        Some(Drag { target, room_from_element: carrying.now()? })
    }

    /// The carrying of what hand `i` holds, with the other hand of the hold where it is now.
    pub fn carrying(&self, i: usize) -> Option<Carrying> {
        let hold = self.holds.get(&self.grip(i)?.target)?;
        let mine = hold.then.iter().position(|then| then.hand == i)?;
        self.carrying_of(hold, mine)
    }

    fn carrying_of(&self, hold: &Hold, mine: usize) -> Option<Carrying> {
        let first = self.motion(hold.then.first()?)?;
        let second = hold.then.get(1).map(|then| self.motion(then));
        Some(Carrying {
            mode: hold.mode,
            room_from_element: hold.room_from_element,
            axis: hold.axis.map(Unit::new_unchecked),
            line: hold.line,
            motions: [first, second.unwrap_or(Some(first))?],
            hands: hold.then.len().min(2),
            mine,
            scaled_by: hold.scaled_by.and_then(|by| hold.then.iter().position(|then| then.hand == by)),
            radius_m: self.radius_m,
        })
    }

    fn motion(&self, then: &HandAtGrab) -> Option<HandMotion> {
        Some(HandMotion {
            room_from_hand_then: then.room_from_hand,
            room_from_hand_now: self.room_from_stylus(then.hand)?,
            held_then: then.held,
        })
    }

    /// Starts a hold now.
    fn hold(&self, hands: Vec<usize>, scaled_by: Option<usize>, element: &Element) -> Option<Hold> {
        let then = |i: usize| {
            let (pose, grip) = (self.hands[i].stylus.last?, self.hands[i].grip?);
            let held = element.room_from_element.transform_point(&grip.place_in_element);
            Some(HandAtGrab { hand: i, room_from_hand: pose, held })
        };
        Some(Hold {
            then: hands.into_iter().map(then).collect::<Option<_>>()?,
            mode: self.mode,
            scaled_by,
            room_from_element: element.room_from_element,
            line: None,
            axis: self
                .mode
                .axis_in_room(&element.room_from_body, &element.room_from_element)
                .map(Unit::into_inner),
        })
    }
}

fn is_lost(stylus: &StylusState) -> bool {
    matches!(stylus.signal, Signal::Lost { .. })
}

fn is_within_click(since_s: f64, now_s: f64) -> bool {
    (0.0..=CLICK_S).contains(&(now_s - since_s))
}

#[cfg(test)]
mod tests;
