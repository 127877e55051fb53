//! The times that the steps of the last frames took.

use egui::Color32;
use std::collections::VecDeque;

/// Steps of a frame in their order, as the overlay names them.
pub const STEPS: [&str; 8] =
    ["track", "interact", "deform", "normals", "upload", "encode", "acquire", "present"];
/// Index in [`STEPS`] of the step that waits for the images of the next frame.
pub const ACQUIRE: usize = 6;
/// Colours of [`STEPS`], and of the time that no step accounts for.
pub(super) const COLOURS: [Color32; 9] = [
    Color32::from_rgb(198, 120, 221),
    Color32::from_rgb(97, 175, 239),
    Color32::from_rgb(86, 182, 130),
    Color32::from_rgb(152, 195, 121),
    Color32::from_rgb(229, 192, 123),
    Color32::from_rgb(224, 142, 84),
    Color32::from_rgb(132, 146, 166),
    Color32::from_rgb(92, 106, 128),
    Color32::from_rgb(60, 68, 82),
];
/// Frames that are kept.
pub(super) const FRAMES: usize = 120;

/// The last frames, step by step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Newest last.
    pub frames: VecDeque<FrameSteps>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameSteps {
    /// Times of the [`STEPS`], s.
    pub steps: [f64; 8],
    /// Time from this frame to the next, with the part that no step accounts for, s.
    pub whole_s: f64,
}

impl History {
    pub fn push(&mut self, times: FrameSteps) {
        if self.frames.len() == FRAMES {
            self.frames.pop_front();
        }
        self.frames.push_back(times);
    }

    pub(super) fn mean(&self, of: impl Fn(&FrameSteps) -> f64) -> f64 {
        // A sum of nothing is -0.
        self.frames.iter().map(of).fold(0.0, std::ops::Add::add) / self.frames.len().max(1) as f64
    }

    pub(super) fn worst_s(&self) -> f64 {
        self.frames.iter().map(|frame| frame.whole_s).fold(0.0, f64::max)
    }
}
