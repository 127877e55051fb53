//! The effect `sound`.

mod radiation;
mod tones;
mod voice;
