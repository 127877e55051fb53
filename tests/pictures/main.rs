//! Tests of pictures: golden images, passes, stereo, windows, room views. They require a graphics device.
#![allow(clippy::unwrap_used, reason = "a test fails by it")]

mod breath;
#[path = "../common/mod.rs"]
mod common;
mod desk_window;
#[path = "../display_common/mod.rs"]
mod display_common;
mod golden;
mod golden_hands;
mod golden_room;
mod golden_stereo;
mod headset;
mod hole;
mod looks;
#[path = "../render_common/mod.rs"]
mod render_common;
mod render_deform;
mod render_ghosts;
mod render_multiview;
mod render_pixels;
mod render_stereo;
mod render_window;
mod render_windows;
mod room_lines;
mod room_overlay;
mod stage_windows;
