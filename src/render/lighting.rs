//! Lights and background, and the struct `Lighting` of `shaders/common/view.wgsl` that the shaders read of them.

use nalgebra::Vector3;

/// Fixed in the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// Towards the main light, any length but zero.
    pub to_key: Vector3<f32>,
    pub key: [f32; 3],
    /// Towards the weaker light that opens the shadows.
    pub to_fill: Vector3<f32>,
    pub fill: [f32; 3],
    /// Light from above and from below, as it falls on a surface facing it.
    pub sky: [f32; 3],
    pub ground: [f32; 3],
    /// The background straight up, level and straight down.
    pub zenith: [f32; 3],
    pub horizon: [f32; 3],
    pub nadir: [f32; 3],
}

impl Default for Lighting {
    /// A warm key from the upper left front, a cool fill from the right, a dark blue room.
    fn default() -> Self {
        Self {
            to_key: Vector3::new(-0.62, 0.70, 0.36),
            key: [2.30, 2.14, 1.90],
            to_fill: Vector3::new(0.90, -0.10, 0.40),
            fill: [0.13, 0.18, 0.27],
            sky: [0.22, 0.27, 0.36],
            ground: [0.035, 0.030, 0.030],
            zenith: [0.010, 0.014, 0.024],
            horizon: [0.040, 0.052, 0.076],
            nadir: [0.006, 0.008, 0.012],
        }
    }
}

/// WGSL aligns a vec3 to 16 bytes; the fourth numbers fill the gaps.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct LightingUniform {
    to_key: [f32; 4],
    key: [f32; 4],
    to_fill: [f32; 4],
    fill: [f32; 4],
    sky: [f32; 4],
    ground: [f32; 4],
    zenith: [f32; 4],
    horizon: [f32; 4],
    nadir: [f32; 4],
}

impl LightingUniform {
    pub(super) fn new(lighting: &Lighting) -> Self {
        let rgb = |[r, g, b]: [f32; 3]| [r, g, b, 0.0];
        let unit = |v: Vector3<f32>| rgb(v.try_normalize(0.0).unwrap_or_else(Vector3::y).into());
        Self {
            to_key: unit(lighting.to_key),
            key: rgb(lighting.key),
            to_fill: unit(lighting.to_fill),
            fill: rgb(lighting.fill),
            sky: rgb(lighting.sky),
            ground: rgb(lighting.ground),
            zenith: rgb(lighting.zenith),
            horizon: rgb(lighting.horizon),
            nadir: rgb(lighting.nadir),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::assert_layout;
    use super::*;

    #[test]
    fn the_lighting_lies_as_the_shaders_read_it() {
        let source = crate::render::body::SHADER.concat();
        assert_layout!(source, "Lighting", LightingUniform:
            to_key, key, to_fill, fill, sky, ground, zenith, horizon, nadir);
    }
}
