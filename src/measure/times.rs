//! Times of evaluations online, with the code that runs in the frame, and what each effect adds to the costs.

use super::data::EffectCost;
use super::poses::on_the_way;
use crate::base::columns::ColumnGroup;
use crate::base::extent::bounding_box;
use crate::base::statistics::{median, quantile};
use crate::deform::{ControlPose, ControlPoses, Deformer, ModelEntry};
use crate::effect::{self, EFFECTS, EffectEntry, Resolved};
use crate::green::{self, GreenError, GreenFile, Keeping, Requirements};
use crate::solve::Silent;
use nalgebra::{Rotation3, Vector3};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Number of stretches of the measurement, each with all poses: a disturbance of the machine spoils some of them alone.
pub const STRETCHES: usize = 5;

/// A deformer and the times that its evaluations took.
pub struct TimedDeformer {
    pub deformer: Deformer,
    /// The largest extent of the body, m.
    extent: f64,
    /// Times of one evaluation with all control elements moved, s, by stretches.
    all_s: [Vec<f64>; STRETCHES],
    /// Times of one evaluation with the last control element moved alone, s, by stretches.
    one_s: [Vec<f64>; STRETCHES],
    /// Columns that one evaluation with all control elements moved read, at most.
    columns_read: usize,
}

impl TimedDeformer {
    /// Errors name what the file or the model lacks.
    pub fn new(
        file: &Arc<GreenFile>,
        body: &str,
        model: &'static ModelEntry,
    ) -> Result<TimedDeformer, String> {
        let deformer = Deformer::new(file.clone(), body, model)?;
        let rest: Vec<_> = deformer.rest().iter().map(|&x| Vector3::from(x.map(f64::from))).collect();
        let (low, high) = bounding_box(&rest);
        let [all_s, one_s] = Default::default();
        Ok(TimedDeformer { deformer, extent: (high - low).amax(), all_s, one_s, columns_read: 0 })
    }

    /// The median of the calmest stretch with all control elements moved, the 99th percentile of all stretches, and the median
    /// of the calmest stretch with one element moved, s.
    pub fn times_s(&self) -> [f64; 3] {
        let p99 = quantile(self.all_s.iter().flatten().copied(), 0.99);
        [calmest(&self.all_s), p99, calmest(&self.one_s)]
    }

    /// Median time of the busiest stretch over that of the calmest.
    pub fn scatter(&self) -> f64 {
        let most = medians(&self.all_s).fold(0.0, f64::max);
        if most > 0.0 { most / calmest(&self.all_s) } else { 1.0 }
    }

    /// Bytes of columns that one evaluation of all control elements reads; `None` if the model's columns are not counted.
    pub fn bytes_read(&self) -> Option<f64> {
        let width = match self.deformer.groups().first() {
            Some(ColumnGroup::F16 { .. } | ColumnGroup::Int16 { .. }) => 2,
            _ => 4,
        };
        let bytes = (self.columns_read * 3 * self.deformer.rest().len() * width) as f64;
        (bytes > 0.0).then_some(bytes)
    }
}

fn medians(stretches: &[Vec<f64>; STRETCHES]) -> impl Iterator<Item = f64> {
    stretches.iter().filter(|times| !times.is_empty()).map(|times| median(times.iter().copied()))
}

fn calmest(stretches: &[Vec<f64>; STRETCHES]) -> f64 {
    let least = medians(stretches).fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}

/// Evaluates all deformers in turn, at least `rounds` times in all, so that what disturbs the machine disturbs them alike. They
/// come to each pose as a hand does, untimed, and then stay near it: a model that goes on from its last state is not timed in
/// jumps that no frame has. Before each timed evaluation comes an untimed one, so that none is measured with the caches
/// that another left.
pub fn time_in_turn(timed_deformers: &mut [&mut TimedDeformer], poses: &[ControlPoses], rounds: usize) {
    let near = rounds.div_ceil(STRETCHES * poses.len().max(1));
    let turns = (0..STRETCHES).flat_map(|stretch| poses.iter().map(move |pose| (stretch, pose)));
    for (turn, (stretch, pose)) in turns.enumerate() {
        for timed_deformer in timed_deformers.iter_mut() {
            timed_deformer.deformer.forget();
            for between in on_the_way(pose) {
                timed_deformer.deformer.take(&between);
            }
        }
        for round in turn * near..(turn + 1) * near {
            for timed_deformer in timed_deformers.iter_mut() {
                let (deformer, extent) = (&mut timed_deformer.deformer, timed_deformer.extent);
                deformer.evaluate(pose);
                let mut moved = jogged(pose, extent, round, 0);
                let (all_s, columns) = timed(deformer, &moved);
                let last = moved.len() - 1;
                moved[last] = jogged(pose, extent, round + 1, last)[last];
                let (one_s, _) = timed(deformer, &moved);
                timed_deformer.all_s[stretch].push(all_s);
                timed_deformer.one_s[stretch].push(one_s);
                timed_deformer.columns_read = timed_deformer.columns_read.max(columns);
            }
        }
    }
}

/// Time from poses to positions, s: coefficients and sum, without the normals, which are the same for all settings; and the
/// columns that were read.
fn timed(deformer: &mut Deformer, poses: &ControlPoses) -> (f64, usize) {
    let started = Instant::now();
    let stats = deformer.evaluate(poses).unwrap_or_default();
    (started.elapsed().as_secs_f64() - deformer.times.normals_s, stats.columns_read)
}

/// The pose of a body of this extent with every control element from `first` on moved and turned a little as by a hand, each by
/// another angle and fixed ones too, so that all their columns are summed again.
fn jogged(poses: &ControlPoses, extent: f64, round: usize, first: usize) -> ControlPoses {
    let by = 1e-4 * (1.0 + (round % 97) as f64);
    let jog = |(e, pose): (usize, &ControlPose)| {
        let by = by * (1.0 + e as f64);
        let turn = Rotation3::from_scaled_axis(Vector3::new(0.2, 0.5, 1.0) * by);
        let translation = pose.translation.add_scalar(by * extent);
        let moved = ControlPose { translation, matrix: turn * pose.matrix };
        if e >= first { moved } else { *pose }
    };
    poses.iter().enumerate().map(jog).collect()
}

/// Measures what each effect costs: the body with the effect less the body without it. For an effect that the scene does not
/// list both are without it, so its cost is 0.
pub fn of_effects(
    scene: &Resolved,
    body: &str,
    requirements_of: &dyn Fn(&Resolved) -> Requirements,
    model: &'static ModelEntry,
    poses: &ControlPoses,
    folder: &Path,
) -> Result<Vec<EffectCost>, GreenError> {
    let run = |scene: &Resolved| with_effects(scene, body, requirements_of(scene), model, poses, folder);
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
fn with_effects(
    scene: &Resolved,
    body: &str,
    requirements: Requirements,
    model: &'static ModelEntry,
    poses: &ControlPoses,
    folder: &Path,
) -> Result<[f64; 4], GreenError> {
    let precomputed = effect::precompute(scene, body, &requirements, Keeping::default(), &Silent)?;
    let offline_s: f64 = precomputed.solution.times.families_s.values().sum();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::green::{self, AFFINE, Requirements};
    use crate::scene::Scene;
    use crate::solve::Silent;

    /// The coefficients are a part of what a model costs, so more than the sum is timed.
    #[test]
    fn coefficients_are_timed_too() {
        let text = "[body.b]\n\
                    generate = { block = { size = [1.0, 1.0, 1.0], cells = [2, 2, 2] } }\n\
                    material = { young = 1.0, poisson = 0.3 }\n\
                    [body.b.control]\n\
                    low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
        let scene = Scene::parse(text, std::path::Path::new("test.toml")).unwrap();
        let body = green::precompute(&scene, "b", &Requirements::new(&[AFFINE]), &Silent).unwrap();
        let file = green::opened(&[body]).unwrap();
        let rotation = crate::deform::find_model("rotation").unwrap();
        let mut timed_deformer = TimedDeformer::new(&file, "b", rotation).unwrap();
        time_in_turn(&mut [&mut timed_deformer], &[vec![ControlPose::REST; 2]], 5);
        // Three numbers of 4 bytes for each node, of twelve columns for each of two control elements at most.
        let column = (12 * timed_deformer.deformer.rest().len()) as f64;
        assert!((column..=24.0 * column).contains(&timed_deformer.bytes_read().unwrap()));
        assert!(timed_deformer.scatter() >= 1.0);
        let TimedDeformer { deformer, one_s, .. } = timed_deformer;
        assert!(one_s[STRETCHES - 1][0] > deformer.times.deform_s, "{one_s:?} {:?}", deformer.times);
    }

    /// A stretch in which the machine is busy is reported, and has no part in the time.
    #[test]
    fn a_busy_stretch_is_told_and_not_taken() {
        let mut stretches: [Vec<f64>; STRETCHES] = std::array::from_fn(|_| vec![2e-5, 1e-5, 3e-5]);
        stretches[1] = vec![9e-5, 8e-5, 1e-3];
        assert_eq!(calmest(&stretches), 2e-5);
        assert_eq!(medians(&stretches).fold(0.0, f64::max), 9e-5);
        assert_eq!(calmest(&Default::default()), 0.0);
    }
}
