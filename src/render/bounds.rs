//! Boxes around shapes, and whether a view meets them: shapes that an eye cannot see are not drawn.

use nalgebra::{Matrix4, RowVector4, Vector3};

/// A box along the axes of its shape's frame that holds the whole shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub centre: Vector3<f32>,
    pub half: Vector3<f32>,
}

/// Rounding of the products below, as a part of their terms.
const ROUNDING: f32 = 1e-5;

impl Bounds {
    /// The smallest box around `points`; around none, the origin alone.
    pub fn of(points: &[[f32; 3]]) -> Bounds {
        let Some(first) = points.first() else {
            return Bounds { centre: Vector3::zeros(), half: Vector3::zeros() };
        };
        // Four points a turn, by comparisons instead of f32::min: that is vectorised.
        let mut low: [[f32; 3]; 4] = [*first; 4];
        let mut high = low;
        let mut take = |lane: usize, point: &[f32; 3]| {
            for axis in 0..3 {
                let (x, low, high) = (point[axis], &mut low[lane][axis], &mut high[lane][axis]);
                *low = if x < *low { x } else { *low };
                *high = if x > *high { x } else { *high };
            }
        };
        let mut fours = points.chunks_exact(4);
        for four in &mut fours {
            (0..4).for_each(|lane| take(lane, &four[lane]));
        }
        fours.remainder().iter().for_each(|point| take(0, point));
        let low = low.map(Vector3::from).into_iter().fold(Vector3::from(*first), |a, b| a.inf(&b));
        let high = high.map(Vector3::from).into_iter().fold(Vector3::from(*first), |a, b| a.sup(&b));
        Bounds { centre: (low + high) / 2.0, half: (high - low) / 2.0 }
    }

    /// False only if the box lies wholly outside one of the planes of the view: left, right, bottom, top or near. The
    /// depth range has no far plane. A matrix or box that is not finite is visible.
    pub fn is_visible(&self, clip_from_shape: &Matrix4<f32>) -> bool {
        let row = |i: usize| clip_from_shape.row(i).into_owned();
        let (x, y, z, w) = (row(0), row(1), row(2), row(3));
        let outside = |plane: RowVector4<f32>| {
            let normal = Vector3::new(plane[0], plane[1], plane[2]);
            let size = normal.abs().dot(&(self.centre.abs() + self.half)) + plane[3].abs();
            let farthest_in = normal.dot(&self.centre) + plane[3] + normal.abs().dot(&self.half);
            farthest_in < -ROUNDING * size
        };
        // Depth is reversed: nearer than the near plane is z > w.
        ![w + x, w - x, w + y, w - y, w - z].into_iter().any(outside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks along -z from the origin, 90° wide, near plane at 0.1: reversed depth, infinite far.
    fn view() -> Matrix4<f32> {
        Matrix4::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, -1.0, 0.0)
    }

    fn at(x: f32, y: f32, z: f32) -> Bounds {
        Bounds { centre: Vector3::new(x, y, z), half: Vector3::repeat(0.5) }
    }

    #[test]
    fn boxes_before_the_eye_are_visible_and_others_are_not() {
        for seen in [at(0.0, 0.0, -5.0), at(5.4, 0.0, -5.0), at(0.0, -5.9, -5.0), at(0.0, 0.0, 0.0)] {
            assert!(seen.is_visible(&view()), "{seen:?}");
        }
        for unseen in [at(0.0, 0.0, 5.0), at(6.1, 0.0, -5.0), at(0.0, -6.1, -5.0), at(0.0, 0.0, 0.41)] {
            assert!(!unseen.is_visible(&view()), "{unseen:?}");
        }
        assert!(at(0.0, 0.0, -1e6).is_visible(&view()), "there is no far plane");
        assert!(at(f32::NAN, 0.0, 0.0).is_visible(&view()), "what is not known is drawn");
    }

    #[test]
    fn a_box_holds_its_points() {
        let points =
            [[1.0, 2.0, 3.0], [-1.0, 0.0, 3.0], [0.0, 5.0, -3.0], [0.0; 3], [0.5; 3], [0.0, 1.0, 0.0]];
        let bounds = Bounds { centre: Vector3::new(0.0, 2.5, 0.0), half: Vector3::new(1.0, 2.5, 3.0) };
        assert_eq!(Bounds::of(&points), bounds);
        assert_eq!(Bounds::of(&[]).half, Vector3::zeros());
    }
}
