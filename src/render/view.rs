//! One eye's picture of one screen, the struct `View` of `shaders/common/view.wgsl` that the shaders read of it, and boxes
//! around shapes, so that shapes that an eye cannot see are not drawn ([`Bounds`]).

use nalgebra::{Matrix3, Matrix4, Point3, RowVector4, Vector3};

/// One eye's picture of one screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Off-axis projection times the eye's pose: depth reversed (1 at the near plane, 0 at infinity).
    pub clip_from_room: Matrix4<f32>,
    pub eye_in_room: Point3<f32>,
}

/// A rectangle of a target and what is drawn there: a view, or black when the eye is behind its screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewport {
    /// x, y of the top left pixel, width, height.
    pub rect: [u32; 4],
    pub view: Option<View>,
}

impl Viewport {
    /// One eye over the whole target.
    pub fn full([width, height]: [u32; 2], view: Option<View>) -> [Self; 1] {
        [Self { rect: [0, 0, width, height], view }]
    }
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct ViewUniform {
    clip_from_room: [[f32; 4]; 4],
    direction_from_ndc: [[f32; 4]; 3],
    eye_in_room: [f32; 3],
    front_sign: f32,
    size_px: [f32; 2],
    end: [f32; 2],
}

impl ViewUniform {
    /// An eye that sees nothing beside one that does: every vertex falls outside of the picture.
    pub(super) const HIDDEN: Self = Self {
        clip_from_room: [[0.0; 4], [0.0; 4], [0.0; 4], [2.0, 2.0, 0.0, 1.0]],
        direction_from_ndc: [[0.0; 4]; 3],
        eye_in_room: [0.0; 3],
        front_sign: 0.0,
        // So large that the width of a line does not bring it back.
        size_px: [1e6; 2],
        end: [0.0; 2],
    };

    /// None when the view shows nothing: a singular or not finite matrix, as of an eye in the plane of its screen.
    pub(super) fn new(view: &View, size_px: [u32; 2]) -> Option<Self> {
        let m = &view.clip_from_room;
        if !m.iter().chain(view.eye_in_room.iter()).all(|x| x.is_finite()) {
            return None;
        }
        // A point at infinity in direction d lands at (x, y) = (m₀·d, m₁·d) / m₃·d, so d = M⁻¹ (x, y, 1).
        let ndc_from_direction = Matrix3::from_fn(|row, column| m[([0, 1, 3][row], column)]);
        let inverse = ndc_from_direction.try_inverse()?;
        // Rows x, y, w of an unmirrored picture are right, up and forward: a left-handed frame.
        let front_sign = -ndc_from_direction.determinant().signum();
        let column = |k: usize| [inverse[(0, k)], inverse[(1, k)], inverse[(2, k)], 0.0];
        Some(Self {
            clip_from_room: (*m).into(),
            direction_from_ndc: [column(0), column(1), column(2)],
            eye_in_room: view.eye_in_room.into(),
            front_sign,
            size_px: size_px.map(|side| side as f32),
            end: [0.0; 2],
        })
    }
}

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
    pub fn around(points: &[[f32; 3]]) -> Bounds {
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
    use super::super::layout::assert_layout;
    use super::*;

    #[test]
    fn a_view_lies_as_the_shaders_read_it() {
        let source = crate::render::body::SHADER.concat();
        assert_layout!(source, "View", ViewUniform:
            clip_from_room, direction_from_ndc, eye_in_room, front_sign, size_px);
    }

    #[test]
    fn a_singular_or_infinite_view_is_absent() {
        let eye_in_room = Point3::origin();
        for clip_from_room in [Matrix4::zeros(), Matrix4::from_element(f32::NAN)] {
            assert!(ViewUniform::new(&View { clip_from_room, eye_in_room }, [8, 8]).is_none());
        }
    }

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
        assert_eq!(Bounds::around(&points), bounds);
        assert_eq!(Bounds::around(&[]).half, Vector3::zeros());
    }
}
