//! Takes poses over from another world of the same bodies, after a change of model, material, effects or stage.
//!
//! In: two worlds. Out: the new one, in which every control element of the same name that holds the same nodes stands as it
//! stood in the old one, and what was done with it can be undone. On the same stage the scene stays where it was moved to, and
//! effects of the same bodies keep their memory.

use super::body::PlacedBody;
use super::edit_state::{Change, Step};
use super::running::World;
use std::collections::BTreeSet;

/// Two origins nearer to each other than this, in metres for a body of one metre, are one: they were stored as f64 and
/// summed in the same order.
const SAME: f64 = 1e-9;

impl World {
    /// Takes over what a person did in `old`; nothing is held then.
    pub fn carry_over(&mut self, old: &mut World) {
        old.let_go();
        let targets = &self.fields.targets;
        let now =
            |before: &(usize, usize)| targets.iter().position(|&place| self.is_same(place, old, *before));
        let now: Vec<Option<usize>> = old.fields.targets.iter().map(now).collect();
        let posed = now.iter().enumerate().filter_map(|(before, now)| Some(((*now)?, old.posed(before))));
        self.put_targets(posed.collect::<Vec<_>>());
        self.clock_s = old.clock_s;
        let carried = self.carry_effects(old);
        self.edit.history = old.edit.history.filter_map(|step| match step {
            Step::Poses(changes) => {
                let moved = |change: &Change| Some(Change { target: now[change.target]?, ..*change });
                let kept: Vec<Change> = changes.iter().filter_map(moved).collect();
                (!kept.is_empty()).then_some(Step::Poses(kept))
            }
            Step::Effect(name) => carried.contains(name).then(|| step.clone()),
        });
        self.change_hands(|hands| hands.mode = old.mode());
        self.field_changes = old.field_changes;
        self.carry_loads(old);
        if self.assets.stage == old.assets.stage {
            self.edit.navigation = old.edit.navigation.clone();
            for (b, body) in self.bodies.iter().enumerate() {
                let same = old.bodies.iter().position(|other| other.deformer.body == body.deformer.body);
                if let Some(aside) = same.and_then(|same| old.edit.asides.get(same)) {
                    self.edit.asides[b] = *aside;
                }
            }
            let time_s = *old.graph.get(old.fields.time);
            self.put(self.fields.time, time_s);
            self.place_bodies(time_s);
        }
        let told: BTreeSet<String> = self.warnings.iter().map(|(_, told)| told.clone()).collect();
        self.warnings.extend(old.warnings.iter().filter(|(_, warning)| !told.contains(warning)).cloned());
    }

    /// Effects go on where all bodies are those of the old world; one that cannot begins anew. Returns the names of those that go on.
    fn carry_effects(&mut self, old: &World) -> BTreeSet<String> {
        let names = |world: &World| -> Vec<String> {
            world.bodies.iter().map(|body| body.deformer.body.clone()).collect()
        };
        if names(self) != names(old) {
            return BTreeSet::new();
        }
        let memories = old.memories(|_| true);
        let refused = self.set_memories(&memories);
        for (name, why) in &refused {
            let first = old.first_memories.get(name).map(|first| first.get());
            if first != memories.get(name).map(|memory| memory.get()) {
                self.warn(format!("the effect {name} begins anew: {why}"));
            }
        }
        let goes_on =
            |name: &String| !refused.contains_key(name) && self.effects.iter().any(|e| e.name() == name);
        memories.into_keys().filter(goes_on).collect()
    }

    /// Loads of the same body and of the same names act as they did.
    fn carry_loads(&mut self, old: &World) {
        let names = |body: &PlacedBody| -> Vec<String> {
            body.deformer.load_metas().iter().map(|load| load.name.clone()).collect()
        };
        for b in 0..self.bodies.len() {
            let body = &self.bodies[b];
            let is_same = |other: &&PlacedBody| {
                other.deformer.body == body.deformer.body && names(other) == names(body)
            };
            let same = old.bodies.iter().position(|other| is_same(&other));
            let before = same.and_then(|same| Some(old.graph.get(old.fields.bodies[same].loads?).clone()));
            if let Some((field, loads)) = self.fields.bodies[b].loads.zip(before) {
                self.put(field, loads);
            }
        }
    }

    /// Whether a control element is that of another world: of the same names, and of as many nodes at the same place.
    fn is_same(&self, (b, c): (usize, usize), old: &World, (old_b, old_c): (usize, usize)) -> bool {
        let (body, other) = (&self.bodies[b].deformer, &old.bodies[old_b].deformer);
        let (control, before) = (&body.controls[c], &other.controls[old_c]);
        let apart = control.origin + body.centre - before.origin - other.centre;
        body.body == other.body
            && (&control.name, control.nodes) == (&before.name, before.nodes)
            && apart.norm() <= SAME * self.bodies[b].assets.ball.1
    }
}
