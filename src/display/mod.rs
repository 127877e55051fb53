//! Shows a session on screens or in images.
//!
//! In: a [`Session`](crate::session::Session) and a stage. Out: windows ([`application`]) or PNG files ([`pictures`]), in
//! which [`render`](crate::render) draws each screen and eye off-axis. A [`ViewSource`](view_source::ViewSource) says what is seen, a
//! [`Presenter`](presenter::Presenter) shows it: a headset would be one of each. A lab engineer can call up [`overlays`] in them:
//! times and readings, the stage from outside, the test pattern. The crate's first page lists the functions of a frame.

pub mod application;
pub mod bodies;
pub mod caption;
mod contact_sheet;
pub mod desk;
pub mod device;
pub mod film;
mod legend;
pub mod model_window;
pub mod offscreen;
pub mod overlay;
pub mod overlays;
pub mod pattern;
pub mod pictures;
mod plate_seats;
mod plates;
mod plot;
pub mod presenter;
pub mod screen_windows;
pub mod stage_model;
pub mod view_source;
pub mod window_layout;
