//! Measures what each effect costs: the body with the effect less the body without it. For an effect that the scene does
//! not list both are without it, so its cost is 0.

use crate::deform::{ControlPoses, Deformer, ModelEntry};
use crate::effect::{EFFECTS, EffectEntry, Resolved, add_sections};
use crate::green::{self, GreenError, GreenFile, Precomputed, Requirements};
use crate::report::data::EffectCost;
use crate::solve::Silent;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

pub fn measure(
    scene: &Resolved,
    body: &str,
    requirements_of: &dyn Fn(&Resolved) -> Requirements,
    model: &'static ModelEntry,
    poses: &ControlPoses,
    folder: &Path,
) -> Result<Vec<EffectCost>, GreenError> {
    let run = |scene: &Resolved| run(scene, body, requirements_of(scene), model, poses, folder);
    // Each effect alone beside none: two may share what they need.
    let with = |only: Option<&EffectEntry>| run(&scene.with_effects(body, |effect| Some(effect) == only));
    let without = with(None)?;
    EFFECTS
        .iter()
        .map(|effect| {
            let listed = scene.bodies[body].lists(effect);
            let found = if listed { with(Some(effect))? } else { without };
            let [offline_s, file_bytes, memory_bytes, frame_s] =
                std::array::from_fn(|cost| (found[cost] - without[cost]).max(0.0));
            Ok(EffectCost {
                effect: effect.name.into(),
                listed,
                offline_s,
                file_bytes,
                memory_bytes,
                frame_s,
            })
        })
        .collect()
}

/// Costs of one body with the effects that a scene lists: time of the effects' own offline step, s; size of the file,
/// bytes; memory, bytes, and time in the frame, s.
fn run(
    scene: &Resolved,
    body: &str,
    requirements: Requirements,
    model: &'static ModelEntry,
    poses: &ControlPoses,
    folder: &Path,
) -> Result<[f64; 4], GreenError> {
    let solution = green::solve(scene, body, &requirements, &Silent)?;
    let stiffness_s: f64 = solution.times.families_s.values().sum();
    let mut precomputed = Precomputed {
        name: body.to_owned(),
        fingerprint: String::new(),
        requirements,
        storage: scene.body[body].storage,
        plan: None,
        solution,
        sections: BTreeMap::new(),
    };
    let started = Instant::now();
    add_sections(scene, &mut precomputed, &Silent)?;
    let offline_s = stiffness_s + started.elapsed().as_secs_f64();
    let path = folder.join("effects.green");
    let file_bytes = green::write(&path, std::slice::from_ref(&precomputed))? as f64;
    let file = Arc::new(GreenFile::open(&path)?);
    let tensors: usize = file.tensors().map(|(.., size)| size).sum();
    let damaged = |reason: String| GreenError::Damaged { path: path.clone(), reason };
    let mut deformer = Deformer::new(file, body, model).map_err(damaged)?;
    deformer.evaluate(poses);
    const ROUNDS: u32 = 1000;
    let started = Instant::now();
    let asked = (0..ROUNDS).filter(|_| std::hint::black_box(deformer.respond()).is_some()).count();
    let frame_s = if asked == 0 { 0.0 } else { started.elapsed().as_secs_f64() / f64::from(ROUNDS) };
    Ok([offline_s, file_bytes, tensors as f64, frame_s])
}
