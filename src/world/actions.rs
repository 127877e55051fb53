//! Carries out commands on a world: undo and redo, the way back to rest, navigation, bodies set aside.
//!
//! In: [`Action`]s, and what the hands asked for in a frame. Out: poses and places, which are set in the graph between
//! frames. All times are those of the tracker's states, so that a replay does the same.

use super::body::PlacedBody;
use super::edit_state::{Change, EditState, ElementPose, REST, Step};
use super::flow::{BodyPlace, HandState};
use super::running::{RunningEffect, World};
use crate::deform::{ControlPose, FollowedTurn, PoseLimiter};
use crate::interact::{
    Action, Ease, HandRequests, Hands, Hit, Mode, PickRay, pick, place_aside, towards_rest,
};
use crate::stage::Workspace;
use crate::track::Signal;
use nalgebra::Similarity3;
use std::collections::BTreeSet;

impl World {
    /// Carries out a command, before the styli of a frame move.
    pub(crate) fn carry_out(&mut self, action: Action) {
        let time_s = *self.graph.get(self.fields.time);
        match action {
            Action::LetGo => self.let_go(),
            Action::Reset => self.reset(),
            Action::Undo => {
                self.release();
                match self.edit.history.undo() {
                    Some(Step::Poses(changes)) => {
                        self.put_targets(changes.iter().map(|change| (change.target, change.before)));
                    }
                    Some(Step::Effect(name)) => self.ask_effect(&name, |effect| effect.undo()),
                    None => {}
                }
            }
            Action::Redo => {
                self.release();
                match self.edit.history.redo() {
                    Some(Step::Poses(changes)) => {
                        self.put_targets(changes.iter().map(|change| (change.target, change.after)));
                    }
                    Some(Step::Effect(name)) => self.ask_effect(&name, |effect| effect.redo()),
                    None => {}
                }
            }
            Action::SnapBack => self.snap_back(time_s),
            Action::ResetNavigation => {
                self.edit.navigation.reset(time_s);
                for b in 0..self.bodies.len() {
                    if self.edit.asides[b].is_aside {
                        self.edit.asides[b].toggle(time_s, &self.bodies[b].room_from_body);
                    }
                }
            }
            Action::SetMode(mode) => self.change_hands(|hands| hands.mode = mode),
            Action::SetTaking(taking) => self.set_taking(taking),
            Action::SetLoad { body, column, value } => self.set_load(body, column, value),
            Action::SetAside(b) if b < self.bodies.len() => self.set_aside(b, time_s),
            Action::SetAside(_) => {}
            Action::ScaleScene(factor) => self.edit.navigation.scale(factor),
            Action::Measure => self.measure(),
            Action::NextField => self.field_changes += 1,
            Action::Clear => self.effects.iter_mut().for_each(|effect| effect.clear()),
        }
    }

    fn ask_effect(&mut self, name: &str, ask: impl FnOnce(&mut dyn RunningEffect) -> Result<(), String>) {
        let effect = self.effects.iter_mut().find(|effect| effect.name() == name);
        if let Some(Err(message)) = effect.map(|effect| ask(effect.as_mut())) {
            self.warn(message);
        }
    }

    /// The mode of the hands: how held elements move.
    pub fn mode(&self) -> Mode {
        self.graph.get(self.fields.hands).hands.mode
    }

    /// The stylus to which keys refer: one that aims from the eye, as the mouse does, else the first that is tracked.
    pub fn cursor(&self) -> Option<usize> {
        let seen = self.tracked().filter_map(|i| {
            let stylus = self.graph.get(self.fields.styli[i].stylus).as_ref()?;
            Some((!stylus.from_eye, i))
        });
        seen.min().map(|(_, i)| i)
    }

    /// The styli that are tracked now.
    pub(super) fn tracked(&self) -> impl Iterator<Item = usize> {
        (0..self.fields.styli.len()).filter(|&i| {
            let stylus = self.graph.get(self.fields.styli[i].stylus).as_ref();
            stylus.is_some_and(|stylus| !matches!(stylus.signal, Signal::Lost { .. }))
        })
    }

    /// Numbers of changes that can be undone, and redone.
    pub fn undo_depth(&self) -> [usize; 2] {
        self.edit.history.depth()
    }

    /// The first hit of the ray of stylus `i` anywhere on the surfaces of all bodies.
    pub(super) fn hit_anywhere(&self, i: usize) -> Option<Hit> {
        let stylus = self.graph.get(self.fields.styli.get(i)?.stylus).as_ref()?;
        let ray = PickRay::from_stylus(stylus)?;
        let positions: Vec<_> = self.bodies.iter().map(|body| body.deformer.positions()).collect();
        let shapes: Vec<_> = self.bodies.iter().map(PlacedBody::whole_shape).collect();
        let bodies = self.bodies.iter().zip(&shapes).zip(&positions);
        let targets: Vec<_> = bodies.map(|((body, shape), positions)| body.whole(shape, positions)).collect();
        pick(&ray, &targets)
    }

    /// The body that stylus `i` points at, anywhere on its surface.
    pub fn pointed_body(&self, i: usize) -> Option<usize> {
        let hit = self.graph.get(self.fields.styli.get(i)?.hit).as_ref();
        let touched = hit.and_then(|hit| self.fields.targets.get(hit.target)).map(|&(body, _)| body);
        touched.or_else(|| self.hit_anywhere(i).map(|hit| hit.target))
    }

    /// The control element that can be grabbed at which stylus `i` points: body and element.
    pub fn pointed_element(&self, i: usize) -> Option<(usize, usize)> {
        let hit = self.graph.get(self.fields.styli.get(i)?.hit).as_ref()?;
        self.fields.targets.get(hit.target).copied()
    }

    /// The control element that a ray passes nearest, as `tube.right`, of those that can be grabbed; how far it passes from
    /// its nearest node, and within how far it would take it, m.
    pub fn nearest_element(&self, ray: &PickRay) -> Option<(String, f64, f64)> {
        let of = |&(b, c): &(usize, usize)| {
            let body = &self.bodies[b];
            let (missed_m, reach_m) = body.pick_target(c, true).missed_by(ray)?;
            Some((format!("{}.{}", body.deformer.body, body.deformer.controls[c].name), missed_m, reach_m))
        };
        self.fields.targets.iter().filter_map(of).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Every stylus lets go of what it holds; a button that is down grabs again.
    pub fn let_go(&mut self) {
        self.finish_grabs(&BTreeSet::new());
        self.let_go_of_points();
        self.change_hands(|hands| {
            let mode = hands.mode;
            *hands = Hands::new(hands.radius_m);
            hands.mode = mode;
        });
    }

    /// Lets go of everything and puts every body back to rest and to its place, whole and without motion; nothing can be undone.
    pub fn reset(&mut self) {
        self.let_go();
        for stylus in 0..self.fields.styli.len() {
            self.put(self.fields.styli[stylus].stylus, None);
        }
        self.put_targets((0..self.fields.targets.len()).map(|target| (target, REST)));
        for (body, fields) in self.bodies.iter_mut().zip(&self.fields.bodies) {
            for pose in &fields.poses {
                self.graph.restore(*pose, ControlPose::REST);
            }
            body.deformer.forget();
            if let Some(loads) = fields.loads {
                self.graph.restore(loads, fields.starting.clone());
            }
        }
        let first = std::mem::take(&mut self.first_memories);
        for (name, why) in self.set_memories(&first) {
            self.warn(format!("the effect {name} is not as at the start: {why}"));
        }
        self.first_memories = first;
        self.edit =
            EditState::new(&self.assets.stage.workspace, self.bodies.len(), self.fields.targets.len());
        self.place_bodies(0.0);
        self.settle();
    }

    /// Moves elements that are on their way to rest by one step, before the graph is evaluated.
    pub(super) fn ease(&mut self, time_s: f64) {
        let Some((ease, from)) = self.edit.easing.take() else { return };
        let share = ease.share(time_s);
        let step = |(target, from): &(usize, ElementPose)| {
            let (translation, matrix, turn) =
                towards_rest(&from.pose.translation, &from.pose.matrix, &from.turn.quaternion, share);
            (
                *target,
                ElementPose { pose: ControlPose { translation, matrix }, turn: FollowedTurn::new(turn) },
            )
        };
        let steps: Vec<_> = from.iter().map(step).collect();
        self.put_targets(steps);
        self.edit.easing = (share < 1.0).then_some((ease, from));
    }

    /// Enters grabs that ended into the history, and moves the scene where it was carried. Called after the graph was evaluated.
    pub(super) fn follow_hands(&mut self, time_s: f64) {
        let HandState { hands, asked } = self.graph.get(self.fields.hands);
        let mut held = hands.held();
        held.retain(|&target| target < self.fields.targets.len());
        let HandRequests { navigating, double_pressed, .. } = asked.clone();
        self.finish_grabs(&held);
        if let Some((_, from)) = &mut self.edit.easing {
            from.retain(|(target, _)| !held.contains(target));
        }
        for target in (0..self.fields.targets.len()).filter(|target| !held.contains(target)) {
            // The same pose after another number of turns is another.
            let posed = self.posed(target);
            if self.edit.before[target] != posed {
                self.edit.before[target] = posed;
            }
        }
        self.edit.held = held;
        for hand in double_pressed {
            if let Some(body) = self.pointed_body(hand) {
                self.set_aside(body, time_s);
            }
        }
        self.edit.navigation.step(&navigating, time_s);
        self.place_bodies(time_s);
    }

    /// Moves every body to its place after navigation and setting aside; what a hand holds moves along.
    pub(super) fn place_bodies(&mut self, time_s: f64) {
        let Workspace { centre, radius_m } = self.assets.stage.workspace;
        let mut moved = false;
        for b in 0..self.bodies.len() {
            let body = &self.bodies[b];
            let home = self.edit.navigation.room_from_scene * body.assets.home;
            let aside = place_aside(&centre, radius_m, b, &body.assets.ball.0, body.assets.ball.1);
            let place: Similarity3<f64> = self.edit.asides[b].place(time_s, &home, &aside);
            moved |= place != body.room_from_body;
            self.bodies[b].room_from_body = place;
            self.put(self.fields.bodies[b].place, BodyPlace(place));
        }
        if moved && !self.edit.held.is_empty() {
            self.change_hands(Hands::rebase);
        }
    }

    fn snap_back(&mut self, time_s: f64) {
        self.release();
        let away: Vec<(usize, ElementPose)> = (0..self.fields.targets.len())
            .map(|target| (target, self.posed(target)))
            .filter(|(_, posed)| {
                posed.pose != ControlPose::REST || posed.turn.against(&FollowedTurn::REST) > 1.0
            })
            .collect();
        if !away.is_empty() {
            let change = |&(target, before): &(usize, ElementPose)| Change { target, before, after: REST };
            self.edit.history.push(Step::Poses(away.iter().map(change).collect()));
            self.edit.easing = Some((Ease::start(time_s), away));
        }
    }

    fn set_aside(&mut self, b: usize, time_s: f64) {
        let targets = self.fields.targets.clone();
        let kept = self.edit.held.iter().copied().filter(|&target| targets[target].0 != b).collect();
        self.finish_grabs(&kept);
        self.change_hands(|hands| {
            hands.let_go(|target| targets.get(target).is_none_or(|&(body, _)| body == b))
        });
        self.edit.asides[b].toggle(time_s, &self.bodies[b].room_from_body);
    }

    /// Lets go of everything and enters it into the history; elements on their way to rest stay where they are.
    fn release(&mut self) {
        self.finish_grabs(&BTreeSet::new());
        self.change_hands(|hands| hands.let_go(|_| true));
        self.edit.easing = None;
    }

    /// Enters each grab that is no longer in `held` into the history.
    fn finish_grabs(&mut self, held: &BTreeSet<usize>) {
        for target in std::mem::take(&mut self.edit.held) {
            if held.contains(&target) {
                self.edit.held.insert(target);
                continue;
            }
            let (before, after) = (self.edit.before[target], self.posed(target));
            if before != after {
                self.edit.history.push(Step::Poses(vec![Change { target, before, after }]));
            }
        }
    }

    pub(super) fn change_hands(&mut self, change: impl FnOnce(&mut Hands)) {
        let mut hands = self.graph.get(self.fields.hands).clone();
        change(&mut hands.hands);
        hands.asked = HandRequests::default();
        self.graph.restore(self.fields.hands, hands);
    }

    fn pose(&self, target: usize) -> ControlPose {
        let (b, c) = self.fields.targets[target];
        *self.graph.get(self.fields.bodies[b].poses[c])
    }

    pub(super) fn posed(&self, target: usize) -> ElementPose {
        let (b, c) = self.fields.targets[target];
        ElementPose { pose: self.pose(target), turn: self.bodies[b].deformer.turn(c) }
    }

    /// Sets poses of control elements that the program chose; the limits of a hand's motion do not apply.
    pub(super) fn put_targets(&mut self, targets: impl IntoIterator<Item = (usize, ElementPose)>) {
        for (target, posed) in targets {
            let (b, c) = self.fields.targets[target];
            self.bodies[b].limiters[c] = PoseLimiter::default();
            self.bodies[b].deformer.set_turn(c, posed.turn);
            self.graph.restore(self.fields.bodies[b].poses[c], posed.pose);
        }
    }
}

#[cfg(test)]
mod tests;
