//! A plate above each body that is bent further than its model holds; the body itself is hatched then.
//!
//! In: bodies whose poses have changed. Out: [`Plate`]s beside places in the room. Without such a body nothing of it is made.

use crate::base::plates::{Anchor, Plate, Tone};
use crate::world::{PlacedBody, out_of_range};
use nalgebra::{Point3, Vector3};

/// A moving body is looked at in one of this number of frames, in windows.
const EVERY: u8 = 4;

/// The state of one body's warning.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    /// Frames in which it moved since it was looked at.
    unseen: u8,
    /// The warning.
    pub text: Option<String>,
}

impl Watch {
    /// Looks at a body that may have moved: at each move, or at every fourth and after the last.
    pub fn look(&mut self, body: &PlacedBody, has_moved: bool, at_each: bool) {
        self.unseen = self.unseen.saturating_add(u8::from(has_moved));
        let is_due = self.unseen > 0 && (at_each || !has_moved || self.unseen >= EVERY);
        if is_due {
            self.unseen = 0;
            self.text = out_of_range(body);
        }
    }

    /// The plate above the highest control element.
    pub fn plate(&self, body: &PlacedBody) -> Option<Plate> {
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
        let size_m = 2.0 * body.assets.ball.1 * body.room_from_body.scaling();
        let place = Point3::new(middle.x, high.y + 0.08 * size_m, middle.z);
        let line = vec![(format!("{}: {text}", body.deformer.body), Tone::Bad)];
        Some(Plate { anchor: Anchor::Place(place.into()), lines: vec![line], plot: None, legend: None })
    }
}
