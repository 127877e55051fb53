//! The demo: a story in chapters, in one captioned window, or in pictures where there is no display.
//!
//! In: [`CHAPTERS`], a line each: scene, stage, text, measured values. Out: a window ([`live`]) in which anybody may take over
//! with the mouse, or pictures and a film ([`film`]). Both draw what a [`story::Story`] shows at a time; what has to be
//! precomputed is made by a separate thread ([`preparation`]), with its progress in the caption.

pub mod chapters;
pub mod film;
pub mod live;
mod measure;
pub mod preparation;
pub mod story;

pub use chapters::{CHAPTERS, Chapter};
