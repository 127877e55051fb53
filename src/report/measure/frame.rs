//! Times one evaluation of a .green file online, with the code that runs in the frame.

use crate::deform::{ControlPose, ControlPoses, Deformer};
use crate::green::{FIELDS, GreenFile};
use std::sync::Arc;
use std::time::Instant;

/// A deformer and the times that its evaluations took.
pub struct TimedDeformer {
    pub deformer: Deformer,
    /// Times of one evaluation with all control elements moved, s.
    pub all_s: Vec<f64>,
    /// The same with the last control element moved alone.
    pub one_s: Vec<f64>,
}

impl TimedDeformer {
    /// Errors name what the file or the model lacks.
    pub fn new(file: &Arc<GreenFile>, body: &str, model: &str) -> Result<TimedDeformer, String> {
        let deformer = Deformer::new(file.clone(), body, model)?;
        Ok(TimedDeformer { deformer, all_s: Vec::new(), one_s: Vec::new() })
    }

    /// Bytes of columns that one evaluation of all control elements reads.
    pub fn bytes(&self, width: usize) -> f64 {
        (self.deformer.controls.len() * FIELDS * 3 * self.deformer.rest().len() * width) as f64
    }
}

/// Evaluates all deformers in turn, `rounds` times, so that what disturbs the machine disturbs them alike. Every
/// `stride`-th follows the other: neighbours share a file, and the second would find it in the cache.
pub fn time_in_turn(
    timed_deformers: &mut [TimedDeformer],
    stride: usize,
    poses: &[ControlPoses],
    rounds: usize,
) {
    let order: Vec<usize> =
        (0..stride).flat_map(|first| (first..timed_deformers.len()).step_by(stride)).collect();
    for round in 0..rounds {
        for &turn in &order {
            let timed_deformer = &mut timed_deformers[turn];
            let pose = &poses[round % poses.len()];
            let mut moved = jogged(pose, round, 0);
            timed_deformer.all_s.push(timed(&mut timed_deformer.deformer, &moved));
            let last = moved.len() - 1;
            moved[last] = jogged(pose, round + 1, last)[last];
            timed_deformer.one_s.push(timed(&mut timed_deformer.deformer, &moved));
        }
    }
}

/// Time from poses to positions, s: coefficients and sum, without the normals, which are the same for all settings.
fn timed(deformer: &mut Deformer, poses: &ControlPoses) -> f64 {
    let started = Instant::now();
    deformer.evaluate(poses);
    started.elapsed().as_secs_f64() - deformer.times.normals_s
}

/// The pose with every control element from `first` on moved a little, fixed ones too, so that all their columns are
/// summed again.
fn jogged(poses: &ControlPoses, round: usize, first: usize) -> ControlPoses {
    let by = 1e-4 * (1.0 + (round % 97) as f64);
    let jog = |(e, pose): (usize, &ControlPose)| {
        let mut pose = *pose;
        if e >= first {
            pose.translation.add_scalar_mut(by);
            pose.matrix.add_scalar_mut(by);
        }
        pose
    };
    poses.iter().enumerate().map(jog).collect()
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
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("b.green");
        let body = green::precompute(&scene, "b", &Requirements::of(&[AFFINE]), &Silent).unwrap();
        green::write(&path, &[body]).unwrap();
        let file = Arc::new(GreenFile::open(&path).unwrap());
        let mut timed_deformers = [TimedDeformer::new(&file, "b", "rotation").unwrap()];
        time_in_turn(&mut timed_deformers, 1, &[vec![ControlPose::REST; 2]], 5);
        let [TimedDeformer { deformer, one_s, .. }] = timed_deformers;
        assert!(one_s[4] > deformer.times.deform_s, "{one_s:?} {:?}", deformer.times);
    }
}
