//! The parts that drawing one frame into windows needs.

use super::bodies::GpuBodies;
use crate::render::BodyInstance;
use crate::render::window::Windows;
use crate::session::Session;
use egui::Rect;

/// One frame on its way into the windows.
pub struct WindowFrame<'a> {
    pub windows: &'a mut Windows,
    pub session: &'a mut Session,
    pub bodies: &'a mut GpuBodies,
    /// A body that is shown in place of the scene's, while control elements are made on it.
    pub edited: Option<BodyInstance<'a>>,
    /// The window with the panel, and its pixels that panel and messages take.
    pub covered: (usize, Vec<Rect>),
    /// From the frame before to this one, s.
    pub step_s: f64,
    /// What reading trackers took, s.
    pub track_s: f64,
}
