//! A surface drawn in software: orthographic, with hidden parts hidden, shaded, coloured by a number at each node.
//!
//! In: triangles, places and values. Out: a PNG file, or its bytes as a data address for a page. It needs no graphics device.

use crate::export::raster::{Raster, SAMPLES};
use egui::ecolor::linear_from_gamma;
use image::{DynamicImage, ImageFormat};
use nalgebra::{Matrix3, Vector3};
use std::io::Cursor;

/// Pixels of the longer side.
const LONGEST: f64 = 620.0;
/// Room around the body, as a part of its extent.
const ROOM: f64 = 0.06;
const BACKGROUND: [u8; 3] = [243, 244, 246];
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
    raster: Raster,
}

impl Relief {
    pub fn new(frame: Frame) -> Relief {
        Relief { frame, raster: Raster::new(frame.size, BACKGROUND) }
    }

    /// The body where it should be: grey, behind whatever is drawn later.
    pub fn ghost(&mut self, triangles: &[[u32; 3]], places: &[Vector3<f64>]) {
        self.draw(triangles, places, &|_, _| GHOST);
        self.raster.forget_depth();
    }

    /// The surface, its colour by `part` of the largest value at each node.
    pub fn surface(&mut self, triangles: &[[u32; 3]], places: &[Vector3<f64>], part: &[f64]) {
        self.draw(triangles, places, &|triangle, weights| {
            colour((0..3).map(|i| weights[i] * part[triangle[i] as usize]).sum())
        });
    }

    fn draw(&mut self, triangles: &[[u32; 3]], places: &[Vector3<f64>], colour: &Colour<'_>) {
        let samples: Vec<[f64; 3]> = places.iter().map(|place| self.frame.sample(place).into()).collect();
        let towards = self.frame.view.0.row(2).transpose();
        for triangle in triangles {
            // Light from the eye, softened: surfaces that turn away are darker.
            let [p, q, r] = triangle.map(|node| places[node as usize]);
            let normal = (q - p).cross(&(r - p));
            let light = 0.55 + 0.45 * (normal.dot(&towards) / normal.norm().max(1e-300)).abs();
            let paint = |weights| {
                let [r, g, b] = colour(triangle, weights).map(|c| linear_from_gamma((c * light) as f32));
                [r, g, b, 1.0]
            };
            self.raster.triangle(triangle.map(|node| samples[node as usize]), true, &paint);
        }
    }

    /// The picture as a PNG file.
    pub fn png(&self) -> Vec<u8> {
        let picture = DynamicImage::from(self.raster.picture()).to_rgb8();
        let mut file = Cursor::new(Vec::new());
        // Into memory, of a size that fits: nothing can fail.
        picture.write_to(&mut file, ImageFormat::Png).map_or_else(|_| Vec::new(), |()| file.into_inner())
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
        assert_eq!(picture.get_pixel(1, 1).0, BACKGROUND);
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
