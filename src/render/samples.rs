//! Samples a pixel: as asked for, or as the device can afford.

use super::gpu::Gpu;

/// The number of samples of each pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Samples {
    /// 4 on a graphics device; 1 on a software device, where 4 take about six times as long.
    #[default]
    Auto,
    /// 1 or 4.
    Exactly(u32),
}

impl Samples {
    pub fn on(self, gpu: &Gpu) -> u32 {
        match self {
            Samples::Auto if gpu.is_software => 1,
            Samples::Auto => 4,
            Samples::Exactly(samples) => samples,
        }
    }
}
