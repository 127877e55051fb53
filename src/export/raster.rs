//! Triangles drawn in software, with hidden parts hidden where that is asked for, and what egui paints: no graphics device.

use egui::ecolor::{gamma_u8_from_linear_f32, linear_f32_from_gamma_u8};
use egui::epaint::{ClippedPrimitive, ImageData, Primitive, textures::TexturesDelta};
use egui::{Painter, Pos2, Rect, Rgba, TextureId, vec2};
use image::RgbaImage;

/// Samples of a pixel along each axis.
pub const SAMPLES: usize = 2;

/// A picture while it is drawn; places are in samples, y downwards, depth towards the eye.
pub struct Raster {
    size: [usize; 2],
    colours: Vec<[f32; 3]>,
    depth: Vec<f64>,
}

/// Linear colour over what is there, by its last number.
pub type Paint = [f32; 4];

impl Raster {
    /// A raster of this many `pixels`, in an sRGB colour.
    pub fn new(pixels: [usize; 2], background: [u8; 3]) -> Raster {
        let size = pixels.map(|pixels| pixels * SAMPLES);
        let [r, g, b] = background.map(linear_f32_from_gamma_u8);
        let count = size[0] * size[1];
        Raster { size, colours: vec![[r, g, b]; count], depth: vec![f64::NEG_INFINITY; count] }
    }

    /// Puts everything drawn earlier behind all that follows.
    pub fn forget_depth(&mut self) {
        self.depth.fill(f64::NEG_INFINITY);
    }

    /// A triangle; `paint` is asked with the weights of its corners.
    pub fn triangle(&mut self, corners: [[f64; 3]; 3], hides: bool, paint: &dyn Fn([f64; 3]) -> Paint) {
        let [a, b, c] = corners;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        if area.abs() < 1e-9 || !area.is_finite() {
            return;
        }
        let range = |axis: usize| {
            let all = [a[axis], b[axis], c[axis]];
            let low = all.into_iter().fold(f64::INFINITY, f64::min).floor().max(0.0) as usize;
            let high = all.into_iter().fold(f64::NEG_INFINITY, f64::max).ceil().max(0.0) as usize;
            low..high.min(self.size[axis])
        };
        for y in range(1) {
            for x in range(0) {
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let u = ((px - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (py - a[1])) / area;
                let v = ((b[0] - a[0]) * (py - a[1]) - (px - a[0]) * (b[1] - a[1])) / area;
                let weights = [1.0 - u - v, u, v];
                // What lies on an edge belongs to both sides where parts hide each other, and to one where they are mixed.
                if weights.iter().any(|w| *w < if hides { -1e-9 } else { 0.0 }) {
                    continue;
                }
                let (at, depth) =
                    (y * self.size[0] + x, weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]);
                if hides && depth <= self.depth[at] {
                    continue;
                }
                if hides {
                    self.depth[at] = depth;
                }
                let [r, g, b, share] = paint(weights);
                for (old, new) in self.colours[at].iter_mut().zip([r, g, b]) {
                    *old = *old * (1.0 - share) + new * share;
                }
            }
        }
    }

    /// Lines and words over what is there; a point of egui's is a pixel.
    pub fn paint(&mut self, paint: impl Fn(&Painter)) {
        let context = egui::Context::default();
        let [wide, high] = self.size.map(|size| (size / SAMPLES) as f32);
        let screen = Rect::from_min_size(Pos2::ZERO, vec2(wide, high));
        let mut input = egui::RawInput { screen_rect: Some(screen), ..Default::default() };
        input.viewports.entry(input.viewport_id).or_default().native_pixels_per_point = Some(SAMPLES as f32);
        let output =
            context.run_pass(input, |context| paint(&context.layer_painter(egui::LayerId::background())));
        let primitives = context.tessellate(output.shapes, output.pixels_per_point);
        self.painted(&primitives, &output.textures_delta);
    }

    /// Adds the shapes that egui has painted, at [`SAMPLES`] pixels per point.
    fn painted(&mut self, primitives: &[ClippedPrimitive], textures: &TexturesDelta) {
        let image_of = |id: &TextureId| {
            let whole = textures.set.get(id)?.iter().rev().find(|delta| delta.pos.is_none())?;
            let ImageData::Color(image) = &whole.image;
            Some(image)
        };
        for primitive in primitives {
            let Primitive::Mesh(mesh) = &primitive.primitive else { continue };
            let image = image_of(&mesh.texture_id);
            for three in mesh.indices.chunks_exact(3) {
                let Some([a, b, c]) = corners(three, &mesh.vertices) else { continue };
                let place =
                    |v: &egui::epaint::Vertex| [v.pos.x, v.pos.y, 0.0].map(|x| f64::from(x) * SAMPLES as f64);
                let paint = |w: [f64; 3]| {
                    let mix = |of: [f32; 3]| of.iter().zip(w).map(|(x, w)| x * w as f32).sum::<f32>();
                    let colours = [a, b, c].map(|v| Rgba::from(v.color).to_array());
                    let vertex: [f32; 4] = std::array::from_fn(|k| mix(colours.map(|colour| colour[k])));
                    let uv = [mix([a.uv.x, b.uv.x, c.uv.x]), mix([a.uv.y, b.uv.y, c.uv.y])];
                    let texel = image.map_or(1.0, |image| covered(image, uv));
                    let share = vertex[3] * texel;
                    // egui's colours are multiplied by their opacity.
                    let plain = |k: usize| if vertex[3] > 0.0 { vertex[k] / vertex[3] } else { 0.0 };
                    [plain(0), plain(1), plain(2), share]
                };
                self.triangle([a, b, c].map(place), false, &paint);
            }
        }
    }

    pub fn picture(&self) -> RgbaImage {
        let [wide, high] = self.size.map(|size| size / SAMPLES);
        RgbaImage::from_fn(wide as u32, high as u32, |x, y| {
            let mut sum = [0.0_f32; 3];
            for i in 0..SAMPLES * SAMPLES {
                let (row, column) = (SAMPLES * y as usize + i / SAMPLES, SAMPLES * x as usize + i % SAMPLES);
                let colour = self.colours[row * self.size[0] + column];
                sum.iter_mut().zip(colour).for_each(|(sum, value)| *sum += value);
            }
            let [r, g, b] = sum.map(|sum| gamma_u8_from_linear_f32(sum / (SAMPLES * SAMPLES) as f32));
            image::Rgba([r, g, b, 255])
        })
    }
}

fn corners<'a, T>(three: &[u32], all: &'a [T]) -> Option<[&'a T; 3]> {
    Some([all.get(three[0] as usize)?, all.get(three[1] as usize)?, all.get(three[2] as usize)?])
}

/// Coverage of a texture at a place.
fn covered(image: &egui::ColorImage, uv: [f32; 2]) -> f32 {
    let at = |k: usize| ((uv[k] * image.size[k] as f32) as usize).min(image.size[k].saturating_sub(1));
    image.pixels.get(at(1) * image.size[0] + at(0)).map_or(1.0, |pixel| f32::from(pixel.a()) / 255.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_nearer_hides_and_what_is_mixed_shines_through() {
        let square = |raster: &mut Raster, z: f64, hides: bool, paint: Paint| {
            let [a, b, c, d] = [[0.0, 0.0, z], [20.0, 0.0, z], [20.0, 20.0, z], [0.0, 20.0, z]];
            raster.triangle([a, b, c], hides, &|_| paint);
            raster.triangle([a, c, d], hides, &|_| paint);
        };
        let mut raster = Raster::new([10, 10], [255; 3]);
        square(&mut raster, 1.0, true, [1.0, 0.0, 0.0, 1.0]);
        square(&mut raster, 0.0, true, [0.0, 1.0, 0.0, 1.0]);
        assert_eq!(raster.picture().get_pixel(5, 3).0, [255, 0, 0, 255]);
        square(&mut raster, 0.0, false, [0.0, 0.0, 1.0, 0.5]);
        assert_eq!(raster.picture().get_pixel(7, 2).0, [188, 0, 188, 255]);
    }

    /// Left of x = 6.35 pixels: of the samples at 6.25 and 6.75 the first is inside; half of the light is 188 in sRGB.
    #[test]
    fn a_triangle_covers_the_samples_up_to_its_edge() {
        let mut raster = Raster::new([10, 10], [255; 3]);
        let (right, black) = (6.35 * SAMPLES as f64, |_: [f64; 3]| [0.0, 0.0, 0.0, 1.0]);
        let [a, b, c, d] = [[0.0, 0.0, 0.0], [right, 0.0, 0.0], [right, right, 0.0], [0.0, right, 0.0]];
        raster.triangle([a, b, c], true, &black);
        raster.triangle([a, c, d], true, &black);
        let picture = raster.picture();
        for (at, grey) in [([5, 2], 0), ([6, 2], 188), ([7, 2], 255), ([2, 6], 188), ([2, 7], 255)] {
            assert_eq!(picture.get_pixel(at[0], at[1]).0, [grey, grey, grey, 255], "{at:?}");
        }
    }
}
