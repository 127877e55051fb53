//! Films: an MP4 file by ffmpeg where that is installed, and an animated PNG, which needs nothing.
//!
//! In: pictures of one size, each with the time at which it is shown. Out: one file.

pub mod apng;
pub mod mp4;
mod palette;
