//! The parts that showing one frame needs.

use super::bodies::GpuBodies;
use super::presenter::Presenter;
use crate::render::BodyInstance;
use crate::session::Session;
use egui::Rect;

/// One frame on its way to the eye.
pub struct WindowFrame<'a> {
    pub presenter: &'a mut dyn Presenter,
    pub session: &'a mut Session,
    pub bodies: &'a mut GpuBodies,
    /// A body that is shown in place of the scene's, while control elements are made on it.
    pub edited: Option<BodyInstance<'a>>,
    /// The window with the panel, and its pixels that panel and messages take.
    pub covered: (usize, Vec<Rect>),
    /// Time from the frame before to this one, s.
    pub step_s: f64,
    /// Time that reading trackers took, s.
    pub track_s: f64,
}
