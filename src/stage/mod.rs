//! The place of pictures and sound: screens and loudspeakers in a room, the viewer's eyes, and the off-axis projection between
//! eyes and screens.
//!
//! In: a stage file (strict TOML, or one that is built in). Out: a checked [`Stage`], whose screens give an
//! [`EyeView`] for any eye. Lengths in metres in the room's frame: x right, y up, right-handed; f64 until the
//! last step. From R. Kooima, "Generalized Perspective Projection" (2008).
mod description;
mod error;
mod file;
mod haptic;
mod layout;
mod lint;
mod loudspeaker;
mod overlap;
mod posture;
mod screen;
mod seam;
mod standing;
mod stereo;
mod summary;
pub mod tracking;
mod viewer;
mod window;

pub use description::{BUILT_IN, Grid, Stage, Workspace};
pub use error::{LocatedFault, StageError, StageFault};
pub use file::{Survey, survey};
pub use haptic::{GripButton, Haptic, HapticDevice};
pub use lint::{errors, lint};
pub use loudspeaker::{Bearing, Loudspeaker, MOST_LOUDSPEAKERS, Sound, SoundOutput, most_open};
pub use screen::{EyeView, Frustum, MIN_EYE_DISTANCE_M, NEAR_M, ROOM_LIMIT_M, Screen, Unseen};
pub use seam::{Apart, Edge, Seam};
pub use standing::{GivenPlace, HiddenPart, place_line};
pub use stereo::Stereo;
pub use tracking::Tracking;
pub use viewer::{Eye, Viewer, rotation_towards};
pub use window::{Border, Monitor, MonitorId, Tile, Visible, Window};
