//! The time that the mechanics of a frame took.

/// Time of the mechanics of one frame, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Pick rays and hands.
    pub interact_s: f64,
    pub deform_s: f64,
    pub normals_s: f64,
}

impl StepTimes {
    pub fn total_s(&self) -> f64 {
        self.interact_s + self.deform_s + self.normals_s
    }
}
