//! Helpers of the render tests: a device, views of a plain screen, and a bent tube to look at.
#![allow(dead_code, clippy::unwrap_used, reason = "each test file uses its part; a test may unwrap")]

use greenstage::render::{
    BodyBuffers, COLOR_FORMAT, FrameContents, Gpu, Lighting, Offscreen, RenderError, Renderer, View, Viewport,
};
use image::RgbaImage;
use nalgebra::{Matrix4, Point3, Vector3};
use std::f32::consts::{PI, TAU};

/// A device; without any adapter the test is skipped, loudly, unless GREENSTAGE_REQUIRE_GPU=1 forbids that.
pub fn require_gpu() -> Option<Gpu> {
    match Gpu::headless() {
        Ok(gpu) => Some(gpu),
        Err(error @ RenderError::NoAdapter(_)) => {
            assert!(std::env::var("GREENSTAGE_REQUIRE_GPU").as_deref() != Ok("1"), "{error}");
            eprintln!("SKIPPED: {error}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// An eye before a screen `width` wide and `height` high about `center`, facing +z turned about x by `tilt` (a table's
/// top lies back by -90°). Reversed depth, infinite far.
pub fn off_axis(center: Point3<f32>, [width, height]: [f32; 2], tilt: f32, eye: Point3<f32>) -> View {
    let rotation = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), tilt);
    let eye_on_screen = rotation.inverse() * (eye - center);
    let (distance, near) = (eye_on_screen.z, 0.02);
    let [left, right] = [-width / 2.0 - eye_on_screen.x, width / 2.0 - eye_on_screen.x];
    let [bottom, top] = [-height / 2.0 - eye_on_screen.y, height / 2.0 - eye_on_screen.y];
    #[rustfmt::skip]
    let clip_from_eye = Matrix4::new(
        2.0 * distance / width, 0.0, (right + left) / width, 0.0,
        0.0, 2.0 * distance / height, (top + bottom) / height, 0.0,
        0.0, 0.0, 0.0, near,
        0.0, 0.0, -1.0, 0.0,
    );
    let eye_from_room = rotation.inverse().to_homogeneous() * Matrix4::new_translation(&-eye.coords);
    View { clip_from_room: clip_from_eye * eye_from_room, eye_in_room: eye }
}

/// The pixel of `point`, from the top left corner.
pub fn pixel_of(view: &View, [width, height]: [u32; 2], point: Point3<f32>) -> [f32; 2] {
    let clip = view.clip_from_room * point.to_homogeneous();
    [(clip.x / clip.w * 0.5 + 0.5) * width as f32, (0.5 - clip.y / clip.w * 0.5) * height as f32]
}

/// Lighting that cannot hide anything: no background, so that what is drawn is what was asked for.
pub fn black_room() -> Lighting {
    Lighting { zenith: [0.0; 3], horizon: [0.0; 3], nadir: [0.0; 3], ..Lighting::default() }
}

pub struct Mesh {
    pub triangles: Vec<[u32; 3]>,
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    pub colors: Vec<[u8; 4]>,
}

impl Mesh {
    pub fn buffers(&self, gpu: &Gpu) -> BodyBuffers {
        let mut buffers = BodyBuffers::new(gpu, &self.triangles, &self.colors).unwrap();
        buffers.upload(gpu, &self.positions, &self.normals).unwrap();
        buffers
    }
}

/// A square of one colour, `half` wide each way, facing +z at height z.
pub fn square(half: f32, center: [f32; 3], color: [u8; 4]) -> Mesh {
    let [x, y, z] = center;
    let corner = |u: f32, v: f32| [x + u * half, y + v * half, z];
    Mesh {
        triangles: vec![[0, 1, 2], [2, 1, 3]],
        positions: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0)],
        normals: vec![[0.0, 0.0, 1.0]; 4],
        colors: vec![color; 4],
    }
}

/// A tube bent upwards along x and swept aside, about 4 `rings` × `around` / 2 vertices on outer wall, inner wall and
/// flat ends; its ends are marked as control elements. Normals are averaged from the triangles, as of a real surface.
pub fn bent_tube(rings: usize, around: usize) -> Mesh {
    let (length, radius, wall) = (0.9_f32, 0.11_f32, 0.035_f32);
    let section = |s: f32| {
        let angle = (s - 0.5) * 1.9;
        let bend = length / 1.9;
        let center =
            Vector3::new(bend * angle.sin(), bend * (1.0 - angle.cos()), 0.10 * (s * PI * 2.0).sin());
        let forward = Vector3::new(angle.cos(), angle.sin(), 0.35 * (s * PI * 2.0).cos()).normalize();
        let side = Vector3::z().cross(&forward).normalize();
        (center, side, forward.cross(&side))
    };
    // Around the wall's section: out along the outside, in across the end, back along the inside, and out again.
    let stations = |from: f32, to: f32, r0: f32, r1: f32, n: usize| {
        (0..n)
            .map(move |k| (k as f32 / n as f32, from, to, r0, r1))
            .map(|(t, from, to, r0, r1)| (from + (to - from) * t, r0 + (r1 - r0) * t))
    };
    let (outer, inner) = (radius, radius - wall);
    let path: Vec<(f32, f32)> = stations(0.0, 1.0, outer, outer, rings)
        .chain(stations(1.0, 1.0, outer, inner, 3))
        .chain(stations(1.0, 0.0, inner, inner, rings))
        .chain(stations(0.0, 0.0, inner, outer, 3))
        .collect();
    let mut mesh = Mesh { triangles: vec![], positions: vec![], normals: vec![], colors: vec![] };
    for &(s, r) in &path {
        let (center, side, up) = section(s);
        for k in 0..around {
            let (sin, cos) = (TAU * k as f32 / around as f32).sin_cos();
            mesh.positions.push((center + (side * cos + up * sin) * r).into());
            mesh.colors.push(match s {
                s if s < 0.14 => [232, 138, 36, 255],
                s if s > 0.86 => [32, 148, 196, 255],
                _ => [186, 184, 178, 0],
            });
        }
    }
    for ring in 0..path.len() {
        for k in 0..around {
            let at = |ring: usize, k: usize| ((ring % path.len()) * around + k % around) as u32;
            let [a, b, c, d] = [at(ring, k), at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1)];
            mesh.triangles.extend([[a, b, c], [c, b, d]]);
        }
    }
    let mut normals = vec![Vector3::zeros(); mesh.positions.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|node| Vector3::from(mesh.positions[node as usize]));
        let area = (b - a).cross(&(c - a));
        for &node in triangle {
            normals[node as usize] += area;
        }
    }
    mesh.normals = normals.iter().map(|n| n.normalize().into()).collect();
    mesh
}

pub fn draw_full(
    gpu: &Gpu,
    renderer: &mut Renderer,
    size: [u32; 2],
    view: View,
    contents: &FrameContents<'_>,
) -> RgbaImage {
    draw(gpu, renderer, size, &Viewport::full(size, Some(view)), contents)
}

pub fn draw(
    gpu: &Gpu,
    renderer: &mut Renderer,
    size: [u32; 2],
    viewports: &[Viewport],
    contents: &FrameContents<'_>,
) -> RgbaImage {
    assert_eq!(renderer.format, COLOR_FORMAT);
    let offscreen = Offscreen::new(gpu, renderer, size).unwrap();
    renderer.draw(gpu, &[offscreen.picture(viewports)], contents).unwrap();
    offscreen.read(gpu).unwrap().0
}

/// Left eye in the left half, right eye in the right half of a double-wide target.
pub fn side_by_side([width, height]: [u32; 2], left: Option<View>, right: Option<View>) -> [Viewport; 2] {
    let half = width / 2;
    [
        Viewport { rect: [0, 0, half, height], view: left },
        Viewport { rect: [half, 0, half, height], view: right },
    ]
}
