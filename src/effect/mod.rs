//! Opt-in effects: one that no scene lists costs nothing, neither precomputation, file, memory, pipeline nor time in the frame.
//!
//! Each effect is one entry of [`EFFECTS`] in a separate file or folder; a body lists those it wants, whose entries and settings
//! [`Resolved`] holds. What they require is precomputed ([`requirements`]), with tensors of their own in the .green file
//! ([`add_sections`]). They join a world when it is made ([`attach`], [`world`]), and a live session starts their devices and
//! threads ([`start`]). A [`RunningEffect`] takes part in the four phases of a frame, input, solve, surface and show, in the order of
//! [`EFFECTS`], and its `memory` lasts from frame to frame.

mod contact;
mod cut;
mod dynamics;
mod effects;
mod entry;
pub mod expected;
pub mod force_curve;
pub mod ghost_equilibrium;
mod ghost_rest;
pub mod haptics;
mod resolved;
pub mod settings;
pub mod sound;
pub mod stress;

pub use effects::{EFFECTS, find_effect, in_order, name_of};
pub use entry::{EffectEntry, EffectInput, ListedEffect, Precompute, Resolved, ResolvedBody, SolveFurther};
pub use resolved::requirements;

use crate::base::failure::Failure;
use crate::green::{
    self, Assembled, Further, GreenError, GreenFile, Keeping, Precomputed, Requirements, Solution, Tensor,
    is_column,
};
use crate::solve::{Progress, Silent};
use crate::stage::Stage;
use crate::world::{RunningEffect, World};
use std::sync::Arc;
use std::time::Instant;

/// Precomputes a body of the scene with the sections of its effects; the time that each effect takes is in
/// [`StepTimes::families_s`](crate::green::StepTimes), by its name.
pub fn precompute(
    scene: &Resolved,
    name: &str,
    requirements: &Requirements,
    keeping: Keeping<'_>,
    progress: &dyn Progress,
) -> Result<Precomputed, GreenError> {
    let of_body = &scene.bodies[name];
    let solves: Vec<_> = of_body.entries().filter_map(|effect| Some((effect.name, effect.solve?))).collect();
    let further = |assembled: &Assembled<'_>, solution: &mut Solution, progress: &dyn Progress| {
        for (effect, solve) in &solves {
            let started = Instant::now();
            solve(scene, assembled, solution, progress)?;
            solution.times.families_s.insert((*effect).to_owned(), started.elapsed().as_secs_f64());
        }
        Ok(())
    };
    let further: Option<Further<'_>> = (!solves.is_empty()).then_some(&further);
    let fits = of_body.model.fits;
    let mut body = green::precompute_kept(scene, name, requirements, fits, further, keeping, progress)?;
    add_sections(scene, &mut body, progress)?;
    Ok(body)
}

/// The .green file of all bodies of a scene, with what its model and effects require; nothing is left on the disk.
pub fn file_of(scene: &Resolved) -> Result<Arc<GreenFile>, Failure> {
    let made = |name: &String| {
        let required = scene.requirements(name)?;
        Ok(precompute(scene, name, &required, Keeping::default(), &Silent)?)
    };
    let bodies: Vec<_> = scene.bodies.keys().map(made).collect::<Result<_, Failure>>()?;
    Ok(green::opened(&bodies)?)
}

/// Makes the tensors of those effects of a body that have any, and adds them to the sections of the body.
pub fn add_sections(
    scene: &Resolved,
    body: &mut Precomputed,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    for effect in scene.bodies[&body.name].entries() {
        let Some(precompute) = effect.precompute else { continue };
        let named = |(tensor, content)| (format!("{}/{tensor}", effect.name), content);
        let started = Instant::now();
        let tensors = precompute(scene, body, progress)?;
        let took = started.elapsed().as_secs_f64();
        *body.solution.times.families_s.entry(effect.name.to_owned()).or_default() += took;
        if scene.body[&body.name].updates.is_some() && tensors.iter().any(|(tensor, _)| is_column(tensor)) {
            return Err(GreenError::Updates { body: body.name.clone(), effect: effect.name });
        }
        body.sections.extend(tensors.into_iter().map(named));
    }
    Ok(())
}

/// Fails if the section of an effect of a body is not what the effect makes.
pub fn check_sections(scene: &Resolved, file: &GreenFile, body: &str) -> Result<(), GreenError> {
    let checks = scene.bodies[body].entries().filter_map(|effect| effect.check_section);
    checks.into_iter().try_for_each(|check| check(file, body))
}

/// The sections of a body after something in it was released or changed: those that an effect measured no longer hold and are
/// replaced, the others stay.
pub fn sections_after_change(scene: &Resolved, file: &GreenFile, body: &str) -> Vec<(String, Tensor)> {
    let sections = scene.bodies[body].entries().filter(|effect| effect.precompute.is_some());
    let tensors = |effect: &EffectEntry| match effect.section_after_change {
        Some(changed) => {
            let named = |(tensor, content)| (format!("{}/{tensor}", effect.name), content);
            changed(scene, body).into_iter().map(named).collect()
        }
        None => file.section_tensors(body, effect.name),
    };
    sections.flat_map(tensors).collect()
}

/// The effect of `entry` where a body of the scene lists it.
fn listed<'a>(entry: &EffectEntry, scene: &'a Resolved, file: &'a GreenFile) -> Option<EffectInput<'a>> {
    let bodies = scene.bodies.iter().enumerate().filter(|(_, (_, body))| body.lists(entry));
    let bodies: Vec<_> = bodies.map(|(b, (name, _))| (b, name.as_str())).collect();
    (!bodies.is_empty()).then_some(EffectInput { scene, file, bodies })
}

/// Joins those of `entries` that the scene lists to its new world.
pub fn attach(
    entries: &[EffectEntry],
    scene: &Resolved,
    file: &GreenFile,
    world: &mut World,
) -> Result<Vec<Box<dyn RunningEffect>>, Failure> {
    let mut running = Vec::new();
    for entry in entries {
        if let Some((attach, listed)) = entry.attach.zip(listed(entry, scene, file)) {
            running.extend(attach(&listed, world)?);
        }
    }
    Ok(running)
}

/// A world of the scene with those of `entries` that it lists.
pub fn world(
    entries: &[EffectEntry],
    scene: &Resolved,
    file: &Arc<GreenFile>,
    stage: Stage,
) -> Result<World, Failure> {
    let mut world = World::new(scene, &scene.models(), file, stage)?;
    let effects = attach(entries, scene, file, &mut world)?;
    world.join(effects)?;
    Ok(world)
}

/// Starts what the effects of a scene have in a live session.
pub fn start(
    scene: &Resolved,
    file: &GreenFile,
    world: &World,
) -> Result<Vec<Box<dyn RunningEffect>>, Failure> {
    let mut running = Vec::new();
    for entry in EFFECTS {
        if let Some((start, listed)) = entry.start.zip(listed(entry, scene, file)) {
            running.extend(start(&listed, world)?);
        }
    }
    Ok(running)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::strips::{StripKind, Strips};
    use crate::deform::{Deformer, LINEAR, MODELS, ROTATION};
    use crate::green::{AFFINE, FAMILIES, Family, STIFFNESS};
    use crate::render::Drawable;
    use crate::scene::Scene;
    use crate::track::TrackerState;
    use crate::world::Frame;
    use std::path::Path;
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
    use std::thread::JoinHandle;

    /// An effect that stands in no list: it keeps the mean of every column.
    const MEANS: EffectEntry = EffectEntry {
        name: "means",
        summary: "the mean of every column",
        requirements: &[AFFINE],
        precompute: Some(|_, body, _| {
            let fields = &body.solution.fields;
            let mean = |column: usize| {
                let sum: f64 = (0..3 * fields.nodes).map(|row| fields.row(row)[column]).sum();
                sum / (3 * fields.nodes) as f64
            };
            let means = Tensor::new(&[fields.columns], (0..fields.columns).map(mean));
            Ok(vec![("columns".into(), means)])
        }),
        ..EffectEntry::NOTHING
    };

    /// A scene with these effects, which may include those above that stand in no list.
    fn scene(effects: &str) -> Resolved {
        let text = "\n\
                    generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }\n\
                    material = { young = 1.0, poisson = 0.3 }\n\
                    [body.b.control]\n\
                    low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
        let text = format!("[body.b]\neffects = [{effects}]{text}");
        let scene = Scene::parse(&text, Path::new("test.toml")).unwrap();
        Resolved::among(scene, const { &[MEANS, HALO] }).unwrap()
    }

    #[test]
    fn an_effect_with_tensors_of_its_own_fills_its_section_of_the_file() {
        let scene = scene("\"means\"");
        let required = requirements(&LINEAR, [&MEANS]);
        assert_eq!(required.describe(), "affine, means");
        let mut body = green::precompute(&scene, "b", &required, &Silent).unwrap();
        let error = green::opened(std::slice::from_ref(&body)).unwrap_err().to_string();
        assert!(error.contains("the section b/means/ of the effect means is missing"), "{error}");

        add_sections(&scene, &mut body, &Silent).unwrap();
        let file = green::opened(&[body]).unwrap();
        file.check_belongs(&scene, "b", &required).unwrap();
        let other = file.check_belongs(&scene, "b", &requirements(&LINEAR, [])).unwrap_err().to_string();
        assert!(other.contains("is stale"), "{other}");
        let (shape, means) = file.section::<f64>("b", "means", "columns").unwrap();
        assert_eq!((shape, means.len()), (&[24][..], 24));
        // Both control elements shifted by 1 along x shift every node by it: a third of all numbers.
        assert!((means[0] + means[12] - 1.0 / 3.0).abs() < 1e-9, "{means:?}");
        assert!(file.section::<f32>("b", "means", "columns").is_err());
        let missing = file.section::<f64>("b", "means", "rows").unwrap_err().to_string();
        assert!(missing.contains("tensor b/means/rows is missing"), "{missing}");
        assert!(Deformer::new(file, "b", &LINEAR).unwrap().wrenches().is_none());
    }

    /// An effect that stands in no list: a strip above each body that lists it, and a thread that counts until its end.
    const HALO: EffectEntry = EffectEntry {
        name: "halo",
        summary: "a strip, and a thread that counts",
        attach: Some(|listed, _| {
            let ends = Arc::new(AtomicBool::new(false));
            let seen = ends.clone();
            let thread = std::thread::spawn(move || {
                let mut count = 1_u64;
                while !seen.load(Ordering::Acquire) {
                    count += 1;
                    std::thread::yield_now();
                }
                count
            });
            let bodies = listed.bodies.iter().map(|(b, _)| *b).collect();
            Ok(Some(Box::new(Halo { bodies, ends, thread: Some(thread) })))
        }),
        ..EffectEntry::NOTHING
    };

    const STRIP: StripKind = StripKind { name: "halo", shader: "", attributes: &[3] };

    static COUNTED: AtomicU64 = AtomicU64::new(0);

    struct Halo {
        bodies: Vec<usize>,
        ends: Arc<AtomicBool>,
        thread: Option<JoinHandle<u64>>,
    }

    impl RunningEffect for Halo {
        fn name(&self) -> &'static str {
            HALO.name
        }

        fn show(&mut self, world: &World, frame: &mut Frame) {
            let place = |b: &usize| {
                <[f32; 3]>::from(world.bodies[*b].room_from_body.isometry.translation.vector.cast())
            };
            let instances = self.bodies.iter().flat_map(place).collect();
            frame.drawables.push(Drawable::Strips(Strips { kind: &STRIP, instances }));
        }
    }

    impl Drop for Halo {
        fn drop(&mut self) {
            self.ends.store(true, Ordering::Release);
            COUNTED.store(self.thread.take().unwrap().join().unwrap(), Ordering::Release);
        }
    }

    #[test]
    fn an_effect_joins_the_worlds_of_scenes_that_list_it_and_no_others() {
        let [unlisted, scene] = ["", "\"halo\""].map(scene);
        let body = green::precompute(&scene, "b", &Requirements::new(&[AFFINE]), &Silent).unwrap();
        let file = green::opened(&[body]).unwrap();
        let mut world =
            World::new(&scene, &scene.models(), &file, Stage::find("workbench").unwrap()).unwrap();
        assert!(attach(&[HALO], &unlisted, &file, &mut world).unwrap().is_empty(), "it is not listed");
        let mut running = attach(&[HALO], &scene, &file, &mut world).unwrap();
        for time_s in [0.0, 0.1] {
            world.step(&TrackerState { time_s, ..Default::default() }.into());
            running.iter_mut().for_each(|effect| world.show_by(effect.as_mut()));
            let place = world.bodies[0].room_from_body.isometry.translation.vector.cast::<f32>();
            let strips: Vec<_> = world.frame.all(Drawable::strips).collect();
            let [strips] = strips[..] else { panic!("{strips:?}") };
            assert_eq!((strips.kind.name, &strips.instances[..]), ("halo", place.as_slice()));
        }
        drop(running);
        assert!(COUNTED.load(Ordering::Acquire) > 0, "the thread ran, and has ended");
    }

    #[test]
    fn the_stiffness_comes_from_the_family_that_haptics_requires() {
        let by_stiffness = |family: &Family| family.name == STIFFNESS.name;
        let online = MODELS.iter().filter(|model| model.energy.is_some_and(|of| of.iter().any(by_stiffness)));
        for model in online {
            let is_own = Requirements::new(model.requirements).has(STIFFNESS);
            assert_eq!(requirements(model, []).has(STIFFNESS), is_own, "{}", model.name);
            assert!(requirements(model, EFFECTS).has(STIFFNESS), "{}", model.name);
        }
        assert!(haptics::live::ENTRY.requirements().has(STIFFNESS));
        assert_eq!((haptics::live::ENTRY.bytes(&LINEAR, 2), MEANS.bytes(&LINEAR, 2)), (24 * 24 * 8, 0));
        assert_eq!(haptics::live::ENTRY.bytes(&ROTATION, 2), 24 * 24 * 8 + 24 * 25 * 26 / 6 * 8);
    }

    /// A section must not stand where a family's tensors or the surface do.
    #[test]
    fn names_of_effects_and_families_differ() {
        let mut names: Vec<&str> = EFFECTS.iter().map(|effect| effect.name).collect();
        names.extend(FAMILIES.iter().map(|entry| entry.family.name));
        names.extend(["rest", "triangles", "tags", "basis", "scale", "control"]);
        let all = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), all, "{names:?}");
    }
}
