//! One eye's picture of one screen, and the struct `View` of `shaders/common/view.wgsl` that the shaders read of it.

use nalgebra::{Matrix3, Matrix4, Point3};

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
}
