//! The forces of a body's model at poses within a frame, by an instance of the model of its own.
//!
//! In: the body as it was in the last frame, from whose memory the instance goes on, so that it keeps nothing of its own from frame to
//! frame. Out: ∂V/∂P at any poses, and near the last ones to first order where the model can.

use crate::deform::{ControlPose, DeformationModel, Deformer, PoseSlope};

/// Energy and forces of the model at some poses.
pub struct Felt {
    /// V, J.
    pub energy: f64,
    /// ∂V/∂P.
    pub slopes: Vec<PoseSlope>,
}

pub struct Forces {
    pub(super) model: Box<dyn DeformationModel>,
    /// Largest distance of two elements, m; 1 where all have the same origin.
    pub size: f64,
}

impl Forces {
    pub fn new(deformer: &Deformer) -> Result<Forces, String> {
        let controls = &deformer.controls;
        let pairs = controls.iter().flat_map(|a| controls.iter().map(|b| (a.origin - b.origin).norm()));
        let size = Some(pairs.fold(0.0, f64::max)).filter(|size| *size > 0.0).unwrap_or(1.0);
        Ok(Forces { model: deformer.another_model()?, size })
    }

    /// Begins where the body is; `None` where its model has no forces.
    pub fn begin(&mut self, deformer: &Deformer) -> Option<Felt> {
        deformer.lend(self.model.as_mut()).ok()?;
        self.at(&deformer.poses)
    }

    /// `None` where these poses have no frame or no equilibrium.
    pub fn at(&mut self, poses: &[ControlPose]) -> Option<Felt> {
        let mut slopes = vec![PoseSlope::default(); poses.len()];
        let found = self.model.respond(poses, &mut slopes).filter(|found| found.is_defined)?;
        Some(Felt { energy: found.energy, slopes })
    }

    /// Prepares for slopes beside the last ones.
    pub fn prepare(&mut self) {
        let mut anew = true;
        while !self.model.prepare_beside(anew) {
            anew = false;
        }
    }

    /// ∂V/∂P at poses near the last ones of [`Forces::at`].
    pub fn beside(&mut self, poses: &[ControlPose]) -> Option<Vec<PoseSlope>> {
        let mut slopes = vec![PoseSlope::default(); poses.len()];
        match self.model.respond_beside(poses, &mut slopes) {
            Some(found) => found.is_defined.then_some(slopes),
            None => self.at(poses).map(|felt| felt.slopes),
        }
    }
}

/// a - b, element by element.
pub fn difference(a: &[PoseSlope], b: &[PoseSlope]) -> Vec<PoseSlope> {
    let less = |(a, b): (&PoseSlope, &PoseSlope)| PoseSlope {
        translation: a.translation - b.translation,
        matrix: a.matrix - b.matrix,
    };
    a.iter().zip(b).map(less).collect()
}
