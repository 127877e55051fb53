//! A surface drawn in software: orthographic, with hidden parts hidden, shaded, coloured by a number at each node.
//!
//! In: triangles, places and values. Out: a PNG file, or its bytes as a data address for a page. It needs no graphics device.

use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use nalgebra::{Matrix3, Vector3};

/// Pixels of the longer side, and how many samples a pixel has along each axis.
const LONGEST: f64 = 620.0;
const SAMPLES: usize = 2;
/// Room around the body, as a part of its extent.
const ROOM: f64 = 0.06;
const BACKGROUND: [f64; 3] = [0.953, 0.957, 0.965];
const GHOST: [f64; 3] = [0.80, 0.82, 0.84];

/// Colours from nothing to the largest value (matplotlib's viridis, CC0; S. van der Walt and N. Smith, 2015): equal steps of
/// the value look equally large, also without colours.
pub const COLOURS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 45, 123],
    [59, 82, 139],
    [44, 114, 142],
    [33, 145, 140],
    [40, 174, 128],
    [94, 201, 98],
    [173, 220, 48],
    [253, 231, 37],
];

/// The colour of a part of the largest value.
pub fn colour(part: f64) -> [f64; 3] {
    let at = part.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let i = (at as usize).min(COLOURS.len() - 2);
    let share = at - i as f64;
    std::array::from_fn(|c| {
        (f64::from(COLOURS[i][c]) * (1.0 - share) + f64::from(COLOURS[i + 1][c]) * share) / 255.0
    })
}

/// Directions of a picture in space: to the right, upwards, towards the eye. Rows of a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View(Matrix3<f64>);

/// The colour of a triangle at the weights of its corners.
type Colour<'a> = dyn Fn(&[u32; 3], [f64; 3]) -> [f64; 3] + 'a;

impl View {
    /// Looks at the side where the points extend furthest, from a little above, with Y upwards as far as it goes.
    pub fn facing(points: &[Vector3<f64>]) -> View {
        let count = points.len().max(1) as f64;
        let mean = points.iter().sum::<Vector3<f64>>() / count;
        let spread: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
        let eigen = spread.symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        let mut towards: Vector3<f64> = eigen.eigenvectors.column(least).into();
        let size = eigen.eigenvalues.max();
        // A straight bar is as thin in two directions: from the front then, and a little from above in any case.
        let is_slender = eigen.eigenvalues.iter().filter(|value| **value < 0.01 * size).count() > 1;
        if !towards.iter().all(|x| x.is_finite()) || size <= 0.0 || is_slender {
            towards = Vector3::z();
        }
        if towards.z < 0.0 || (towards.z == 0.0 && towards.x < 0.0) {
            towards = -towards;
        }
        let up = [Vector3::y(), Vector3::z(), Vector3::x()]
            .into_iter()
            .find(|up| up.cross(&towards).norm() > 0.5)
            .unwrap_or_else(Vector3::y);
        let towards = (towards + 0.35 * (up - towards * up.dot(&towards))).normalize();
        let right = up.cross(&towards).normalize();
        View(Matrix3::from_rows(&[right.transpose(), towards.cross(&right).transpose(), towards.transpose()]))
    }

    fn place(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.0 * point
    }
}

/// The part of the view that pictures show: the same for those that are compared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    view: View,
    low: [f64; 2],
    /// Samples for each metre.
    scale: f64,
    /// Pixels.
    pub size: [usize; 2],
}

impl Frame {
    /// Around all points; `None` where they have no extent or are not finite.
    pub fn around<'a>(view: View, points: impl Iterator<Item = &'a Vector3<f64>>) -> Option<Frame> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in points {
            let at = view.place(point);
            for axis in 0..2 {
                (low[axis], high[axis]) = (low[axis].min(at[axis]), high[axis].max(at[axis]));
            }
        }
        let extent = (high[0] - low[0]).max(high[1] - low[1]);
        if !extent.is_normal() || extent <= 0.0 {
            return None;
        }
        let pixel = (1.0 + 2.0 * ROOM) * extent / LONGEST;
        let size = [0, 1].map(|axis| {
            (((high[axis] - low[axis] + 2.0 * ROOM * extent) / pixel).ceil() as usize)
                .clamp(1, LONGEST as usize)
        });
        let low = low.map(|low| low - ROOM * extent);
        Some(Frame { view, low, scale: SAMPLES as f64 / pixel, size })
    }

    /// Sample coordinates, y downwards, and depth towards the eye.
    fn sample(&self, point: &Vector3<f64>) -> Vector3<f64> {
        let at = self.view.place(point);
        let height = (SAMPLES * self.size[1]) as f64;
        Vector3::new((at.x - self.low[0]) * self.scale, height - (at.y - self.low[1]) * self.scale, at.z)
    }
}

/// A picture while surfaces are drawn into it.
pub struct Relief {
    frame: Frame,
    colours: Vec<[f64; 3]>,
    depth: Vec<f64>,
}

impl Relief {
    pub fn new(frame: Frame) -> Relief {
        let count = frame.size[0] * frame.size[1] * SAMPLES * SAMPLES;
        Relief { frame, colours: vec![BACKGROUND; count], depth: vec![f64::NEG_INFINITY; count] }
    }

    /// The body where it should be: grey, behind whatever is drawn later.
    pub fn ghost(&mut self, triangles: &[[u32; 3]], places: &[Vector3<f64>]) {
        self.draw(triangles, places, &|_, _| GHOST);
        self.depth.fill(f64::NEG_INFINITY);
    }

    /// The surface, its colour by `part` of the largest value at each node.
    pub fn surface(&mut self, triangles: &[[u32; 3]], places: &[Vector3<f64>], part: &[f64]) {
        self.draw(triangles, places, &|triangle, weights| {
            colour((0..3).map(|i| weights[i] * part[triangle[i] as usize]).sum())
        });
    }

    fn draw(&mut self, triangles: &[[u32; 3]], places: &[Vector3<f64>], colour: &Colour<'_>) {
        let wide = SAMPLES * self.frame.size[0];
        let high = SAMPLES * self.frame.size[1];
        let samples: Vec<Vector3<f64>> = places.iter().map(|place| self.frame.sample(place)).collect();
        for triangle in triangles {
            let [a, b, c] = triangle.map(|node| samples[node as usize]);
            let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
            if area.abs() < 1e-12 || !area.is_finite() {
                continue;
            }
            // Light from the eye, softened: surfaces that turn away are darker.
            let [p, q, r] = triangle.map(|node| places[node as usize]);
            let normal = (q - p).cross(&(r - p));
            let towards = self.frame.view.0.row(2).transpose();
            let light = 0.55 + 0.45 * (normal.dot(&towards) / normal.norm().max(1e-300)).abs();
            let range = |x: [f64; 3], most: usize| {
                let low = x.iter().copied().fold(f64::INFINITY, f64::min).floor().max(0.0) as usize;
                let high = x.iter().copied().fold(f64::NEG_INFINITY, f64::max).ceil().max(0.0) as usize;
                low..(high + 1).min(most)
            };
            for y in range([a.y, b.y, c.y], high) {
                for x in range([a.x, b.x, c.x], wide) {
                    let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                    let u = ((px - a.x) * (c.y - a.y) - (c.x - a.x) * (py - a.y)) / area;
                    let v = ((b.x - a.x) * (py - a.y) - (px - a.x) * (b.y - a.y)) / area;
                    let weights = [1.0 - u - v, u, v];
                    if weights.iter().any(|w| *w < -1e-9) {
                        continue;
                    }
                    let depth = weights[0] * a.z + weights[1] * b.z + weights[2] * c.z;
                    let at = y * wide + x;
                    if depth > self.depth[at] {
                        self.depth[at] = depth;
                        self.colours[at] = colour(triangle, weights).map(|c| c * light);
                    }
                }
            }
        }
    }

    /// The picture as a PNG file.
    pub fn png(&self) -> Vec<u8> {
        let [width, height] = self.frame.size;
        let mut bytes = Vec::with_capacity(3 * width * height);
        for y in 0..height {
            for x in 0..width {
                let inside = (0..SAMPLES * SAMPLES)
                    .map(|i| (SAMPLES * y + i / SAMPLES) * SAMPLES * width + SAMPLES * x + i % SAMPLES);
                let mut sum = [0.0; 3];
                inside.for_each(|at| (0..3).for_each(|c| sum[c] += self.colours[at][c]));
                let mean = sum.map(|c| c / (SAMPLES * SAMPLES) as f64);
                bytes.extend(mean.map(|c| (255.0 * c.clamp(0.0, 1.0)).round() as u8));
            }
        }
        let mut file = Vec::new();
        let written = PngEncoder::new(&mut file).write_image(
            &bytes,
            width as u32,
            height as u32,
            image::ExtendedColorType::Rgb8,
        );
        // Into memory, of a size that fits: nothing can fail.
        written.map_or_else(|_| Vec::new(), |()| file)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two squares across the view, the nearer one smaller: each pixel has the colour of what is in front.
    #[test]
    fn what_is_nearer_hides_what_is_behind() {
        let square = |half: f64, z: f64| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .map(|[x, y]| Vector3::new(half * x, half * y, z))
        };
        let places = [square(1.0, 0.0), square(0.5, 0.1)].concat();
        let triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
        let view = View(Matrix3::identity());
        let frame = Frame::around(view, places.iter()).unwrap();
        let part = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0];
        let mut relief = Relief::new(frame);
        relief.surface(&triangles, &places, &part);
        let picture = image::load_from_memory(&relief.png()).unwrap().to_rgb8();
        let [width, height] = frame.size.map(|size| size as u32);
        assert_eq!((picture.width(), picture.height()), (width, height));
        assert_eq!(picture.get_pixel(width / 2, height / 2).0, COLOURS[8]);
        assert_eq!(picture.get_pixel(width / 8, height / 2).0, COLOURS[0]);
        assert_eq!(picture.get_pixel(1, 1).0, BACKGROUND.map(|c| (255.0 * c).round() as u8));
        // Drawn the other way round it is the same.
        let mut other = Relief::new(frame);
        other.surface(&[triangles[2], triangles[3], triangles[0], triangles[1]], &places, &part);
        assert_eq!(other.png(), relief.png());
        // The ghost is behind everything.
        let mut ghost = Relief::new(frame);
        ghost.ghost(&triangles, &places.iter().map(|p| p + Vector3::new(0.0, 0.0, 9.0)).collect::<Vec<_>>());
        ghost.surface(&triangles, &places, &part);
        assert_eq!(ghost.png(), relief.png());
    }

    #[test]
    fn a_view_is_a_rotation_that_looks_at_the_flat_side() {
        let plate: Vec<Vector3<f64>> = (0..60)
            .map(|i| Vector3::new(f64::from(i % 10), 0.02 * f64::from(i % 3), f64::from(i / 10)))
            .collect();
        let bar: Vec<Vector3<f64>> = (0..20).map(|i| Vector3::new(f64::from(i), 0.0, 0.0)).collect();
        for points in [plate.clone(), bar, vec![Vector3::zeros(); 3], Vec::new()] {
            let View(rows) = View::facing(&points);
            assert!(
                (rows * rows.transpose() - Matrix3::identity()).amax() < 1e-12 && rows.determinant() > 0.0
            );
        }
        assert!(View::facing(&plate).0[(2, 1)].abs() > 0.8, "a plate is seen from above");
        assert!(Frame::around(View(Matrix3::identity()), [Vector3::zeros(); 2].iter()).is_none());
    }

    #[test]
    fn the_colours_grow_lighter_all_the_way() {
        let light =
            |part: f64| colour(part).iter().zip([0.2126, 0.7152, 0.0722]).map(|(c, w)| c * w).sum::<f64>();
        let all: Vec<f64> = (0..=40).map(|i| light(f64::from(i) / 40.0)).collect();
        assert!(all.windows(2).all(|pair| pair[1] > pair[0]), "{all:?}");
        assert_eq!(colour(2.0), colour(1.0));
    }
}
