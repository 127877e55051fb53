//! Whether effects go together: each alone and all pairs, with every model, in one body or, where that is refused, in two of a scene.
//!
//! In: models, and a number of frames. Out: [`Trial`]s: the sentence by which `check` refuses a scene, or what was seen in its frames. The
//! .green files are shared among scenes that require the same columns.
//!
//! ```text
//! effects × model → Setting → Accepted, or a refusal → .green file → Course: hands, ball, blade, force device → Ran, or Failed
//! ```

mod course;
mod setting;
pub mod tables;

pub use course::{Failed, Ran};

use crate::deform::ModelEntry;
use crate::effect::{self, EFFECTS, EffectEntry};
use crate::green::GreenFile;
use indexmap::IndexMap;
use serde::Serialize;
use setting::{Accepted, Setting, Shape};
use std::sync::Arc;

/// Result of a scene.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    Ran(Ran),
    Refused(String),
    Failed(Failed),
}

/// Effects with a model.
#[derive(Clone, Debug, Serialize)]
pub struct Trial {
    /// One, two, or the most that go together. In a pair, what is heard brings along the effect that makes it vibrate, unless the other one rubs
    /// or cuts it.
    pub effects: Vec<&'static str>,
    pub model: &'static str,
    /// Result with all in one body.
    pub together: Outcome,
    /// Result with two bodies of a scene, each of which has one of them: where one body cannot have both, and could have either.
    pub apart: Option<Outcome>,
}

type Effects = Vec<&'static EffectEntry>;

/// Every effect alone, and every pair.
pub fn sets() -> impl Iterator<Item = Effects> {
    let pairs = |(i, first): (usize, &'static EffectEntry)| {
        let others = EFFECTS[i + 1..].iter().map(move |second| vec![first, second]);
        std::iter::once(vec![first]).chain(others)
    };
    EFFECTS.iter().enumerate().flat_map(pairs)
}

/// The effects, with the one that makes a body vibrate where one of them is heard and the others make no noise.
fn with_source(mut effects: Effects) -> Effects {
    let makes_sound = effects.iter().any(|effect| effect.vibrates || effect.dissipates.is_some());
    let lacks = !makes_sound && effects.iter().any(|effect| effect.is_heard);
    effects.extend(EFFECTS.iter().filter(|effect| lacks && effect.vibrates));
    effects
}

/// All sets of effects with a model, for so many frames each.
pub fn run(model: &'static ModelEntry, frames: usize) -> Result<Vec<Trial>, String> {
    let mut bench = Bench { shape: Setting::shape_for(model)?, model, frames, files: IndexMap::new() };
    Ok(bench.trials())
}

/// The bodies of one model.
struct Bench {
    shape: &'static Shape,
    model: &'static ModelEntry,
    frames: usize,
    /// Files by what is required of each body.
    files: IndexMap<String, Result<Arc<GreenFile>, String>>,
}

impl Bench {
    /// Every effect alone, every pair, and the most that go together.
    fn trials(&mut self) -> Vec<Trial> {
        let mut trials: Vec<Trial> = sets().map(|set| self.trial(&set)).collect();
        let most = EFFECTS.iter().fold(Vec::new(), |most: Effects, effect| {
            let more = [&most[..], &[effect]].concat();
            // What is heard follows what makes it vibrate.
            if self.is_accepted(&more) { more } else { most }
        });
        trials.push(self.trial(&most));
        trials
    }

    fn is_accepted(&self, effects: &[&'static EffectEntry]) -> bool {
        Setting::judged(self.shape, self.model, &[effects.to_vec()]).is_ok()
    }

    fn trial(&mut self, set: &[&'static EffectEntry]) -> Trial {
        let both = if set.len() > 1 { with_source(set.to_vec()) } else { set.to_vec() };
        let together = self.outcome(&[both]);
        let each: Vec<Effects> = set.iter().map(|effect| with_source(vec![effect])).collect();
        let is_apart = matches!(together, Outcome::Refused(_))
            && set.len() > 1
            && each.iter().all(|effects| self.is_accepted(effects));
        let apart = is_apart.then(|| self.outcome(&each));
        let effects = set.iter().map(|effect| effect.name).collect();
        Trial { effects, model: self.model.name, together, apart }
    }

    fn outcome(&mut self, bodies: &[Effects]) -> Outcome {
        let accepted = match Setting::judged(self.shape, self.model, bodies) {
            Ok(accepted) => accepted,
            Err(refusal) => return Outcome::Refused(refusal),
        };
        let ran = match self.file(&accepted) {
            Ok(file) => course::run(&accepted, &file, self.frames),
            Err(why) => Err(Failed { frame: 0, why }),
        };
        ran.map_or_else(Outcome::Failed, Outcome::Ran)
    }

    fn file(&mut self, accepted: &Accepted) -> Result<Arc<GreenFile>, String> {
        let required: Vec<String> = accepted.required.iter().map(|required| required.describe()).collect();
        let key = format!("{} {}", required.join("; "), accepted.setting.has_gravity);
        let solve = || effect::file_of(&accepted.scene).map_err(|error| error.to_string());
        self.files.entry(key).or_insert_with(solve).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::MODELS;
    use crate::fem::TET4;

    /// Each alone and each pair in some frames, of which the second half is replayed. Whatever is refused says what to do.
    #[test]
    fn effects_run_together_or_are_refused_with_a_remedy() {
        let model = MODELS.iter().find(|model| model.name == "rotation").unwrap();
        static SHAPE: Shape = Shape { size: [0.3, 0.1, 0.06], cells: [5, 2, 1], element: &TET4, young: 1e5 };
        let trials = Bench { shape: &SHAPE, model, frames: 44, files: IndexMap::new() }.trials();
        assert_eq!(trials.len(), EFFECTS.len() * (EFFECTS.len() + 1) / 2 + 1);
        assert!(trials.last().unwrap().effects.len() > EFFECTS.len() / 2);
        for Trial { effects, together, apart, .. } in &trials {
            for outcome in std::iter::once(together).chain(apart) {
                match outcome {
                    Outcome::Failed(failed) => panic!("{effects:?}: {failed:?}"),
                    Outcome::Ran(ran) => assert!(ran.moved > 0.03, "{effects:?}: {ran:?}"),
                    Outcome::Refused(why) => {
                        let has_remedy =
                            ["write ", "leave ", "list ", "add "].iter().any(|word| why.contains(word));
                        assert!(has_remedy, "{effects:?}: {why}");
                    }
                }
            }
            let mut outcomes = std::iter::once(together).chain(apart);
            let runs = outcomes.any(|outcome| matches!(outcome, Outcome::Ran(_)));
            assert!(runs || effects.len() == 1, "{effects:?}: {together:?}, {apart:?}");
        }
    }
}
