//! Times one evaluation of a .green file online, with the code that runs in the frame.

use super::poses::on_the_way;
use crate::base::columns::ColumnGroup;
use crate::deform::{ControlPose, ControlPoses, Deformer, ModelEntry};
use crate::green::GreenFile;
use nalgebra::{Rotation3, Vector3};
use std::sync::Arc;
use std::time::Instant;

/// A deformer and the times that its evaluations took.
pub struct TimedDeformer {
    pub deformer: Deformer,
    /// Times of one evaluation with all control elements moved, s.
    pub all_s: Vec<f64>,
    /// The same with the last control element moved alone.
    pub one_s: Vec<f64>,
    /// Columns that one evaluation with all control elements moved read, at most.
    columns_read: usize,
}

impl TimedDeformer {
    /// Errors name what the file or the model lacks.
    pub fn new(file: &Arc<GreenFile>, body: &str, model: &ModelEntry) -> Result<TimedDeformer, String> {
        let deformer = Deformer::of_model(file.clone(), body, model)?;
        Ok(TimedDeformer { deformer, all_s: Vec::new(), one_s: Vec::new(), columns_read: 0 })
    }

    /// Bytes of columns that one evaluation of all control elements reads.
    pub fn bytes_read(&self) -> f64 {
        let width = match self.deformer.groups().first() {
            Some(ColumnGroup::F16 { .. } | ColumnGroup::Int16 { .. }) => 2,
            _ => 4,
        };
        (self.columns_read * 3 * self.deformer.rest().len() * width) as f64
    }
}

/// Evaluates all deformers in turn, `rounds` times in all, so that what disturbs the machine disturbs them alike. They come to
/// each pose as a hand does, untimed, and then stay near it: a model that goes on from its last state is not timed in jumps
/// that no frame has.
pub fn time_in_turn(timed_deformers: &mut [&mut TimedDeformer], poses: &[ControlPoses], rounds: usize) {
    let mut last = None;
    for round in 0..rounds {
        let at = round * poses.len() / rounds;
        let pose = &poses[at];
        if last.replace(at) != Some(at) {
            for timed_deformer in timed_deformers.iter_mut() {
                timed_deformer.deformer.forget();
                for between in on_the_way(pose) {
                    timed_deformer.deformer.take(&between);
                }
                timed_deformer.deformer.evaluate(pose);
            }
        }
        for timed_deformer in timed_deformers.iter_mut() {
            let mut moved = jogged(pose, round, 0);
            let (all_s, columns) = timed(&mut timed_deformer.deformer, &moved);
            timed_deformer.all_s.push(all_s);
            timed_deformer.columns_read = timed_deformer.columns_read.max(columns);
            let last = moved.len() - 1;
            moved[last] = jogged(pose, round + 1, last)[last];
            timed_deformer.one_s.push(timed(&mut timed_deformer.deformer, &moved).0);
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

/// The pose with every control element from `first` on moved and turned a little as by a hand, each by another angle and fixed
/// ones too, so that all their columns are summed again.
fn jogged(poses: &ControlPoses, round: usize, first: usize) -> ControlPoses {
    let by = 1e-4 * (1.0 + (round % 97) as f64);
    let jog = |(e, pose): (usize, &ControlPose)| {
        let by = by * (1.0 + e as f64);
        let turn = Rotation3::from_scaled_axis(Vector3::new(0.2, 0.5, 1.0) * by);
        let moved = ControlPose { translation: pose.translation.add_scalar(by), matrix: turn * pose.matrix };
        if e >= first { moved } else { *pose }
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
        let rotation = crate::deform::find_model("rotation").unwrap();
        let mut timed_deformer = TimedDeformer::new(&file, "b", rotation).unwrap();
        time_in_turn(&mut [&mut timed_deformer], &[vec![ControlPose::REST; 2]], 5);
        // Three numbers of 4 bytes for each node, of twelve columns for each of two control elements at most.
        let column = (12 * timed_deformer.deformer.rest().len()) as f64;
        assert!((column..=24.0 * column).contains(&timed_deformer.bytes_read()));
        let TimedDeformer { deformer, one_s, .. } = timed_deformer;
        assert!(one_s[4] > deformer.times.deform_s, "{one_s:?} {:?}", deformer.times);
    }
}
