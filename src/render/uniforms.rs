//! The structs the shaders read, byte for byte: `View` and `Frame` of `shaders/common/view.wgsl`, and the per-instance
//! vertex data of bodies and solids. WGSL aligns a vec3 to 16 bytes; the gaps are spelled out.

use super::{FrameContents, View};
use nalgebra::{Matrix3, Vector3};

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

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct FrameUniform {
    to_key: [f32; 4],
    key: [f32; 4],
    to_fill: [f32; 4],
    fill: [f32; 4],
    sky: [f32; 4],
    ground: [f32; 4],
    zenith: [f32; 4],
    horizon: [f32; 4],
    nadir: [f32; 4],
    grid_center: [f32; 3],
    grid_spacing: f32,
    grid_color: [f32; 3],
    grid_line_width: f32,
    grid_half_size: [f32; 2],
    end: [f32; 2],
}

impl FrameUniform {
    pub(super) fn new(contents: &FrameContents<'_>) -> Self {
        let look = &contents.look;
        let rgb = |[r, g, b]: [f32; 3]| [r, g, b, 0.0];
        let unit = |v: Vector3<f32>| rgb(v.try_normalize(0.0).unwrap_or_else(Vector3::y).into());
        let mut uniform = Self {
            to_key: unit(look.to_key),
            key: rgb(look.key),
            to_fill: unit(look.to_fill),
            fill: rgb(look.fill),
            sky: rgb(look.sky),
            ground: rgb(look.ground),
            zenith: rgb(look.zenith),
            horizon: rgb(look.horizon),
            nadir: rgb(look.nadir),
            ..bytemuck::Zeroable::zeroed()
        };
        if let Some(grid) = &contents.grid {
            uniform.grid_center = grid.center.into();
            uniform.grid_spacing = grid.spacing;
            uniform.grid_color = grid.color;
            uniform.grid_line_width = grid.line_width / grid.spacing;
            uniform.grid_half_size = grid.half_size;
        }
        uniform
    }
}

/// Vertex data that advances once per instance.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Instance {
    pub(super) room_from_shape: [[f32; 4]; 4],
    /// Linear RGB and the share of it that glows; bodies ignore it.
    pub(super) color: [f32; 4],
}

pub(super) const INSTANCE_ATTRIBUTES: [wgpu::VertexAttribute; 5] =
    wgpu::vertex_attr_array![3 => Float32x4, 4 => Float32x4, 5 => Float32x4, 6 => Float32x4, 7 => Float32x4];

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{offset_of, size_of};
    use wgpu::naga;

    fn layout_in_wgsl(name: &str) -> (usize, Vec<(String, usize)>) {
        let source = super::super::shader::BODY.concat();
        let module = naga::front::wgsl::parse_str(&source).unwrap();
        let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        let naga::TypeInner::Struct { members, span } = &found.inner else { panic!("{name} is no struct") };
        let offsets = members.iter().map(|m| (m.name.clone().unwrap(), m.offset as usize)).collect();
        (*span as usize, offsets)
    }

    macro_rules! assert_layout {
        ($rust:ty, $wgsl:literal, $($field:ident),+) => {
            let expected = vec![$((stringify!($field).to_owned(), offset_of!($rust, $field))),+];
            assert_eq!(layout_in_wgsl($wgsl), (size_of::<$rust>(), expected));
        };
    }

    #[test]
    fn uniforms_lie_as_the_shaders_read_them() {
        assert_layout!(
            ViewUniform,
            "View",
            clip_from_room,
            direction_from_ndc,
            eye_in_room,
            front_sign,
            size_px
        );
        assert_layout!(
            FrameUniform,
            "Frame",
            to_key,
            key,
            to_fill,
            fill,
            sky,
            ground,
            zenith,
            horizon,
            nadir,
            grid_center,
            grid_spacing,
            grid_color,
            grid_line_width,
            grid_half_size
        );
        assert_eq!(INSTANCE_ATTRIBUTES[4].offset as usize, offset_of!(Instance, color));
    }

    #[test]
    fn a_singular_or_infinite_view_is_absent() {
        let eye_in_room = nalgebra::Point3::origin();
        for clip_from_room in [nalgebra::Matrix4::zeros(), nalgebra::Matrix4::from_element(f32::NAN)] {
            assert!(ViewUniform::new(&View { clip_from_room, eye_in_room }, [8, 8]).is_none());
        }
    }
}
