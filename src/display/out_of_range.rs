//! A label above each body that is bent further than its model holds; the body itself is red then.
//!
//! In: bodies whose poses have changed. Out: [`Label`]s in the room, written over each eye's picture where that eye sees their
//! place. Without such a body nothing of it is made.

use super::lettering::{INK, write};
use super::window_layout::Part;
use crate::stage::Stage;
use crate::world::{PlacedBody, out_of_range};
use egui::{Align2, Color32, Painter};
use nalgebra::{Isometry3, Point3, Vector3};

/// A label's plate, of the body's own red.
const PLATE: Color32 = Color32::from_rgb(120, 22, 32);
/// Of a moving body, every so many frames are looked at in windows.
const EVERY: u8 = 4;

#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    pub place: Point3<f64>,
    pub text: String,
}

/// What is known of one body.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    /// Frames in which it moved since it was looked at.
    unseen: u8,
    /// What it says of itself.
    pub text: Option<String>,
}

impl Watch {
    /// Looks at a body that may have moved: at each move, or at every fourth and after the last.
    pub fn look(&mut self, body: &mut PlacedBody, moved: bool, at_each: bool) {
        self.unseen = self.unseen.saturating_add(u8::from(moved));
        let is_due = self.unseen > 0 && (at_each || !moved || self.unseen >= EVERY);
        if is_due {
            self.unseen = 0;
            self.text = out_of_range(body);
            body.recolour |= body.out_of_range != self.text.is_some();
            body.out_of_range = self.text.is_some();
        }
    }

    /// Above the highest control element.
    pub fn label(&self, body: &PlacedBody) -> Option<Label> {
        let text = self.text.clone()?;
        let positions = body.deformer.kept_positions();
        let room_from_surface = body.room_from_surface();
        let place = |node: u32| {
            let position = Vector3::from(*positions.get(node as usize)?).cast::<f64>();
            Some(room_from_surface * Point3::from(position))
                .filter(|place| place.iter().all(|x| x.is_finite()))
        };
        let places = body.pickable().into_iter().filter_map(place);
        let (low, high) = places.map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))?;
        let middle = nalgebra::center(&low, &high);
        let size_m = 2.0 * body.ball.1 * body.room_from_body.scaling();
        let place = Point3::new(middle.x, high.y + 0.08 * size_m, middle.z);
        Some(Label { place, text: format!("{}: {text}", body.deformer.body) })
    }
}

/// Writes the labels that an eye sees in its part of a picture.
pub fn write_labels(
    painter: &Painter,
    part: &Part,
    stage: &Stage,
    room_from_head: &Isometry3<f64>,
    labels: &[Label],
) {
    let eye = stage.viewer.eye_in_room(room_from_head, part.eye);
    let Ok(view) = stage.screens[part.screen].view(&eye, 0.05) else { return };
    let size = (part.rect.height() / 45.0).clamp(11.0, 26.0);
    for label in labels {
        let clip = view.clip_from_room.cast::<f64>() * label.place.to_homogeneous();
        if clip.w <= clip.z {
            continue;
        }
        let place = part.pixel([clip.x / clip.w, clip.y / clip.w]);
        if part.rect.contains(place) {
            write(painter, (place, Align2::CENTER_BOTTOM), &label.text, size, [INK, PLATE]);
        }
    }
}
