//! Two eyes' pictures become one: beside or above each other, by colour, or taking turns pixel by pixel.
//!
//! In come two pictures of one size and a [`Composite`]; out goes a tile of a window. Colours are mixed in linear light,
//! as the device hands them out of sRGB textures and takes them back. One pass, `shaders/composite.wgsl`; its twin is
//! [`Composite::compose`].

use super::error::RenderError;
use super::gpu::Gpu;
use super::shader;
use egui::ecolor::{gamma_u8_from_linear_f32, linear_f32_from_gamma_u8};
use image::{Rgba, RgbaImage};

/// The places of the first and the second eye's picture in a tile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Composite {
    /// Width and height of each eye's picture.
    pub eye_size: [u32; 2],
    /// Origin of the second picture in the tile, from the top left; the first begins at its corner.
    pub second: [u32; 2],
    /// Columns and rows: 1 where the eyes take turns in that direction, the first eye at even pixels. Counted from the
    /// corner of the monitor, not of the window: a panel polarises its own rows, wherever a window stands.
    pub turns: [u32; 2],
    /// Matrix by which the first picture adds to red, green and blue, row by row, in linear light; clipped to 0 to 1.
    pub from_first: Matrix,
    pub from_second: Matrix,
}

/// Rows for red, green and blue of the result.
pub type Matrix = [[f32; 3]; 3];

const SAME: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Colours that red-cyan glasses let through, from the left and the right eye's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anaglyph {
    pub from_left: Matrix,
    pub from_right: Matrix,
}

/// Luminance in linear light (ITU-R BT.709).
const GREY: [f32; 3] = [0.2126, 0.7152, 0.0722];
const NOTHING: [f32; 3] = [0.0; 3];

impl Anaglyph {
    /// Red of the left eye, green and blue of the right.
    pub const COLOUR: Self =
        Self { from_left: [SAME[0], NOTHING, NOTHING], from_right: [NOTHING, SAME[1], SAME[2]] };
    /// The luminance of both: no colour, no rivalry between the eyes.
    pub const GREY: Self = Self { from_left: [GREY, NOTHING, NOTHING], from_right: [NOTHING, GREY, GREY] };
    /// Red is the left eye's luminance, green and blue are the right eye's colour.
    pub const HALF_COLOUR: Self =
        Self { from_left: [GREY, NOTHING, NOTHING], from_right: [NOTHING, SAME[1], SAME[2]] };
    /// Least squares between what the eyes see through the glasses and the pair (E. Dubois, "Conversion of a stereo
    /// pair to anaglyph with the least-squares projection method", University of Ottawa, March 2009: red-cyan glasses,
    /// linear light, both terms clipped before they are added).
    pub const DUBOIS: Self = Self {
        from_left: [[0.437, 0.449, 0.164], [-0.062, -0.062, -0.024], [-0.048, -0.050, -0.017]],
        from_right: [[-0.011, -0.032, -0.007], [0.377, 0.761, 0.009], [-0.026, -0.093, 1.234]],
    };
}

impl Composite {
    /// The first eye in the left half; of an odd width the last column stays black.
    pub fn side_by_side([width, height]: [u32; 2]) -> Self {
        let eye_size = [width / 2, height];
        Self { second: [eye_size[0], 0], ..Self::over_each_other(eye_size) }
    }

    /// The first eye in the upper half; of an odd height the last row stays black.
    pub fn top_bottom([width, height]: [u32; 2]) -> Self {
        let eye_size = [width, height / 2];
        Self { second: [0, eye_size[1]], ..Self::over_each_other(eye_size) }
    }

    /// HDMI 1.4's frame packing, the first eye above: 1920 × 2205 holds two of 1080 rows with 45 black ones between
    /// them, 1280 × 1470 two of 720 with 30. The gap is a 49th of the height in both, and so in any other size.
    pub fn frame_packing([width, height]: [u32; 2]) -> Self {
        let gap = (height + 24) / 49;
        let eye_size = [width, (height - gap) / 2];
        Self { second: [0, height - eye_size[1]], ..Self::over_each_other(eye_size) }
    }

    /// Each eye in its own colours.
    pub fn anaglyph(size: [u32; 2], Anaglyph { from_left, from_right }: Anaglyph) -> Self {
        Self { from_first: from_left, from_second: from_right, ..Self::over_each_other(size) }
    }

    /// Turns in columns (`[1, 0]`), rows (`[0, 1]`) or both, as on a checkerboard.
    pub fn interlaced(size: [u32; 2], turns: [u32; 2]) -> Self {
        Self { turns, ..Self::over_each_other(size) }
    }

    fn over_each_other(eye_size: [u32; 2]) -> Self {
        Self { eye_size, second: [0, 0], turns: [0, 0], from_first: SAME, from_second: SAME }
    }

    /// The tile of `size` pixels whose top left pixel is `panel` on its monitor, from both eyes' pictures: what the
    /// shader draws, on the CPU. A picture that is smaller than `eye_size` counts as black beyond its edge.
    pub fn compose(
        &self,
        [first, second]: [&RgbaImage; 2],
        [width, height]: [u32; 2],
        panel: [i32; 2],
    ) -> RgbaImage {
        let take_turns = self.turns != [0, 0];
        let within = |picture: &RgbaImage, pixel: [i64; 2], matrix: &Matrix| -> [f32; 3] {
            let is_inside = |axis: usize| (0..i64::from(self.eye_size[axis])).contains(&pixel[axis]);
            let found = (is_inside(0) && is_inside(1))
                .then(|| picture.get_pixel_checked(pixel[0] as u32, pixel[1] as u32))
                .flatten();
            found.map_or([0.0; 3], |Rgba([r, g, b, _])| {
                let linear = [*r, *g, *b].map(linear_f32_from_gamma_u8);
                matrix.map(|row| (0..3).map(|k| row[k] * linear[k]).sum::<f32>().clamp(0.0, 1.0))
            })
        };
        RgbaImage::from_fn(width, height, |x, y| {
            let pixel = [x, y].map(i64::from);
            let turn = |axis: usize| (pixel[axis] + i64::from(panel[axis])) & i64::from(self.turns[axis]);
            let is_odd = (turn(0) + turn(1)) & 1 == 1;
            let mut colour = [0.0; 3];
            if !(take_turns && is_odd) {
                colour = within(first, pixel, &self.from_first);
            }
            if !take_turns || is_odd {
                let pixel = [pixel[0] - i64::from(self.second[0]), pixel[1] - i64::from(self.second[1])];
                let more = within(second, pixel, &self.from_second);
                colour = [0, 1, 2].map(|k| colour[k] + more[k]);
            }
            let [r, g, b] = colour.map(gamma_u8_from_linear_f32);
            Rgba([r, g, b, 255])
        })
    }
}

/// `Composite` of `shaders/composite.wgsl`, byte for byte.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct CompositeUniform {
    from_first: [[f32; 4]; 3],
    from_second: [[f32; 4]; 3],
    corner: [i32; 2],
    panel: [i32; 2],
    eye_size: [i32; 2],
    second: [i32; 2],
    turns: [i32; 2],
    end: [i32; 2],
}

impl CompositeUniform {
    fn new(composite: &Composite, rect: [u32; 4], panel: [i32; 2]) -> Self {
        let columns = |m: &Matrix| [0, 1, 2].map(|column| [m[0][column], m[1][column], m[2][column], 0.0]);
        let signed = |pixels: [u32; 2]| pixels.map(|pixel| pixel as i32);
        Self {
            from_first: columns(&composite.from_first),
            from_second: columns(&composite.from_second),
            corner: signed([rect[0], rect[1]]),
            panel,
            eye_size: signed(composite.eye_size),
            second: signed(composite.second),
            turns: signed(composite.turns),
            end: [0; 2],
        }
    }
}

/// The pass for targets of one format.
pub(super) struct CompositePass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

/// Two eyes' pictures and where they go: what the pass reads for one tile.
pub(super) struct Inputs {
    uniform: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl CompositePass {
    pub(super) fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Result<Self, RenderError> {
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let uniform = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let picture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: false },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("composite"),
            entries: &[entry(0, uniform), entry(1, picture), entry(2, picture)],
        });
        let (label, parts) = ("composite", &shader::COMPOSITE);
        let pipeline = shader::of_whole_texture(&gpu.device, label, parts, &[Some(&layout)], format);
        gpu.check()?;
        Ok(Self { pipeline, layout })
    }

    /// The pictures are plain two-dimensional views: of two textures, or of two layers of one.
    pub(super) fn inputs(
        &self,
        gpu: &Gpu,
        [first, second]: [&wgpu::TextureView; 2],
    ) -> Result<Inputs, RenderError> {
        let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
        let uniform = gpu.buffer("composite", size_of::<CompositeUniform>() as u64, usage)?;
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(first) },
                wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::TextureView(second) },
            ],
        });
        Ok(Inputs { uniform, group })
    }

    /// Draws one tile, `rect` (x, y, width, height) of the pass's target; `panel` is its top left pixel's place.
    pub(super) fn draw(
        &self,
        gpu: &Gpu,
        pass: &mut wgpu::RenderPass<'_>,
        inputs: &Inputs,
        composite: &Composite,
        rect: [u32; 4],
        panel: [i32; 2],
    ) {
        let uniform = CompositeUniform::new(composite, rect, panel);
        gpu.queue.write_buffer(&inputs.uniform, 0, bytemuck::bytes_of(&uniform));
        let [x, y, width, height] = rect;
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &inputs.group, &[]);
        pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
        pass.set_scissor_rect(x, y, width, height);
        pass.draw(0..3, 0..1);
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::assert_layout;
    use super::*;

    #[test]
    fn the_uniform_lies_as_the_shader_reads_it() {
        let source = shader::COMPOSITE.concat();
        assert_layout!(source, "Composite", CompositeUniform:
            from_first, from_second, corner, panel, eye_size, second, turns);
    }

    #[test]
    fn frame_packing_has_the_sizes_of_hdmi() {
        let of = |size| {
            let packed = Composite::frame_packing(size);
            (packed.eye_size, packed.second)
        };
        assert_eq!(of([1920, 2205]), ([1920, 1080], [0, 1125]));
        assert_eq!(of([1280, 1470]), ([1280, 720], [0, 750]));
        assert_eq!(of([3, 1]), ([3, 0], [0, 1]));
    }

    fn plain(colour: [u8; 3]) -> RgbaImage {
        RgbaImage::from_pixel(8, 8, Rgba([colour[0], colour[1], colour[2], 255]))
    }

    /// Left white, right black: the left eye's filter alone lights up; of the Dubois matrices, each filter's rows sum
    /// to about one, so that white stays white.
    #[test]
    fn anaglyphs_put_the_left_eye_into_red_and_keep_white() {
        let [white, black] = [plain([255; 3]), plain([0; 3])];
        for anaglyph in [Anaglyph::COLOUR, Anaglyph::GREY, Anaglyph::HALF_COLOUR, Anaglyph::DUBOIS] {
            let composite = Composite::anaglyph([8, 8], anaglyph);
            let of = |pair| composite.compose(pair, [8, 8], [0, 0]).get_pixel(3, 3).0;
            let [r, g, b, _] = of([&white, &black]);
            assert!(r >= 253 && g == 0 && b == 0, "{anaglyph:?}: {r} {g} {b}");
            let [r, g, b, _] = of([&black, &white]);
            assert!(r == 0 && g >= 253 && b >= 253, "{anaglyph:?}: {r} {g} {b}");
            assert!(of([&white, &white])[..3].iter().all(|&c| c >= 253));
        }
    }

    #[test]
    fn the_eyes_take_turns_by_the_panels_pixels() {
        let [red, blue] = [plain([255, 0, 0]), plain([0, 0, 255])];
        for turns in [[1, 0], [0, 1], [1, 1]] {
            let composite = Composite::interlaced([8, 8], turns);
            for panel in [[0, 0], [1, 0], [0, 1], [-3, 5], [7, -2]] {
                let woven = composite.compose([&red, &blue], [8, 8], panel);
                for (x, y, pixel) in woven.enumerate_pixels() {
                    let on_panel = [x as i32 + panel[0], y as i32 + panel[1]];
                    let sum = on_panel[0] * turns[0] as i32 + on_panel[1] * turns[1] as i32;
                    let is_left = sum.rem_euclid(2) == 0;
                    assert_eq!(pixel.0[0] == 255, is_left, "{turns:?} {panel:?} ({x}, {y})");
                }
            }
        }
    }
}
