//! The rigid solids of a frame: pen, ray and hit point of each stylus, arrows, balls. In come [`StylusShape`]s, [`Arrow`]s
//! and [`Ball`](super::frame::Ball)s, out go instances of four procedural surfaces of revolution that are made and
//! uploaded once.

use super::error::RenderError;
use super::frame::{Arrow, Drawable, FrameContents, StylusShape};
use super::gpu::Gpu;
use super::parts::{Instance, Instances, instance_layout};
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::shader;
use super::view::Bounds;
use nalgebra::{Matrix4, Point3, Quaternion, UnitQuaternion, Vector2, Vector3};
use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::ops::Range;
use wgpu::BufferUsages;

pub(super) const SHADER: [&str; 3] = [shader::VIEW, shader::LIGHT, include_str!("../../shaders/solid.wgsl")];
/// Segments around the axis; at 48 pixels of diameter a chord stays within 0.1 pixel of its arc.
const SEGMENTS: u32 = 32;
const RAY_RADIUS: f32 = 0.010;
const HIT_RADIUS: f32 = 0.040;
/// Straight pieces of a bent ray.
const BEND_PIECES: usize = 24;
/// Radius of an arrow's head against its shaft's.
const HEAD_RADIUS: f32 = 2.6;
/// Linear RGB of ray, ring and hit point.
const IDLE: [f32; 3] = [0.02, 0.85, 0.16];
const PRESSED: [f32; 3] = [0.95, 0.78, 0.04];

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct SolidVertex {
    pub position: [f32; 3],
    pub normal: [f32; 3],
    /// sRGB, and the weight of the instance's colour instead.
    pub color: [u8; 4],
}

const ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Unorm8x4];

pub(super) fn vertex_layout() -> [Option<wgpu::VertexBufferLayout<'static>>; 2] {
    let per_vertex = wgpu::VertexBufferLayout {
        array_stride: size_of::<SolidVertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &ATTRIBUTES,
    };
    [Some(per_vertex), Some(instance_layout())]
}

#[derive(Default)]
pub(super) struct SolidPass {
    pipelines: EyePipelines,
    meshes: Option<SolidMeshes>,
    instances: Instances,
    /// Number of instances of each surface, one after the other.
    counts: [u32; 4],
}

impl DrawPass for SolidPass {
    fn name(&self) -> &'static str {
        "solid"
    }

    fn shader(&self) -> &'static [&'static str] {
        &SHADER
    }

    fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        contents: &FrameContents<'_>,
    ) -> Result<(), RenderError> {
        self.instances.list.clear();
        self.counts = instances(contents, &mut self.instances.list);
        if self.instances.list.is_empty() {
            return Ok(());
        }
        let (label, parts, buffers) = (self.name(), self.shader(), &vertex_layout());
        self.pipelines.complete(
            gpu,
            kinds,
            &Recipe { label, parts, buffers, blending: Blending::Opaque, groups: &[] },
        );
        if self.meshes.is_none() {
            self.meshes = Some(SolidMeshes::new(gpu)?);
        }
        self.instances.upload(gpu)
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, _: &FrameContents<'_>) {
        let made = self.pipelines.pipeline(to.view_draw).zip(self.meshes.as_ref());
        let Some((pipeline, meshes)) = made.filter(|_| !self.instances.list.is_empty()) else { return };
        to.pass.set_pipeline(pipeline);
        to.pass.set_index_buffer(meshes.indices.slice(..), wgpu::IndexFormat::Uint32);
        to.pass.set_vertex_buffer(0, meshes.vertices.slice(..));
        let mut first = 0;
        for ((range, bounds), count) in meshes.ranges.iter().zip(&meshes.bounds).zip(self.counts) {
            for instance in first..first + count as usize {
                let room_from_shape = Matrix4::from(self.instances.list[instance].room_from_shape);
                if to.shows(bounds, &to.view_draw.clip_from_shape(&room_from_shape)) {
                    self.instances.bind(to.pass, 1, instance);
                    to.pass.draw_indexed(range.clone(), 0, 0..1);
                }
            }
            first += count as usize;
        }
    }

    fn is_made(&self) -> bool {
        self.meshes.is_some()
    }
}

/// The four surfaces in one pair of buffers, each a range of indices.
struct SolidMeshes {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    /// Ranges in the order of [`instances`].
    ranges: [Range<u32>; 4],
    bounds: [Bounds; 4],
}

impl SolidMeshes {
    fn new(gpu: &Gpu) -> Result<Self, RenderError> {
        let mut mesh = Revolved::default();
        let ranges = [mesh.pen(), mesh.cylinder(), mesh.sphere(), mesh.cone()];
        let (vertices, indices) = (bytemuck::cast_slice(&mesh.vertices), bytemuck::cast_slice(&mesh.indices));
        let bounds = ranges.clone().map(|range| {
            let used = &mesh.indices[range.start as usize..range.end as usize];
            let points: Vec<_> = used.iter().map(|&index| mesh.vertices[index as usize].position).collect();
            Bounds::around(&points)
        });
        let buffer = |bytes: &[u8], usage| -> Result<wgpu::Buffer, RenderError> {
            let buffer = gpu.buffer("solids", bytes.len() as u64, usage | BufferUsages::COPY_DST)?;
            gpu.queue.write_buffer(&buffer, 0, bytes);
            Ok(buffer)
        };
        let vertices = buffer(vertices, BufferUsages::VERTEX)?;
        Ok(Self { vertices, indices: buffer(indices, BufferUsages::INDEX)?, ranges, bounds })
    }
}

/// Appends the instances of all pens, then all rays and shafts, then all hit points and balls, then all arrow heads;
/// returns how many there are of each.
fn instances(contents: &FrameContents<'_>, all: &mut Vec<Instance>) -> [u32; 4] {
    let accent = |stylus: &StylusShape| if stylus.pressed { PRESSED } else { IDLE };
    let glowing = |room_from_shape: Matrix4<f32>, [r, g, b]: [f32; 3], glow: f32| Instance {
        room_from_shape: room_from_shape.into(),
        color: [r, g, b, glow],
    };
    let start = all.len();
    for stylus in contents.all(Drawable::stylus) {
        let room_from_pen = stylus.room_from_stylus * Matrix4::new_scaling(stylus.size_m);
        all.push(glowing(room_from_pen, accent(stylus), 0.6));
    }
    let pens_end = all.len();
    for stylus in contents.all(Drawable::stylus) {
        let pieces = ray(stylus).map(|piece| glowing(piece, accent(stylus), 1.0));
        all.extend(pieces);
    }
    for arrow in contents.all(Drawable::arrow) {
        let [shaft, _] = shaft_and_head(arrow);
        all.extend(shaft.map(|room_from_shaft| glowing(room_from_shaft, arrow.color, arrow_glow(arrow))));
    }
    let rays_end = all.len();
    for stylus in contents.all(Drawable::stylus) {
        if let Some(hit) = stylus.hit {
            let room_from_hit =
                Matrix4::new_translation(&hit.coords) * Matrix4::new_scaling(stylus.size_m * HIT_RADIUS);
            // Paler than the ray, so that it stands out at the ray's end.
            all.push(glowing(room_from_hit, accent(stylus).map(|c| 0.55 * c + 0.45), 0.9));
        }
    }
    for ball in contents.all(Drawable::ball) {
        let room_from_ball =
            Matrix4::new_translation(&ball.center.coords) * Matrix4::new_scaling(ball.radius_m);
        all.push(glowing(room_from_ball, ball.color, 0.0));
    }
    let balls_end = all.len();
    for arrow in contents.all(Drawable::arrow) {
        let [_, head] = shaft_and_head(arrow);
        all.extend(head.map(|room_from_head| glowing(room_from_head, arrow.color, arrow_glow(arrow))));
    }
    [pens_end - start, rays_end - pens_end, balls_end - rays_end, all.len() - balls_end].map(|n| n as u32)
}

/// Added to the glow of shapes that are shown through whatever stands before them; `THROUGH` in the shader.
const THROUGH: f32 = 2.0;

fn arrow_glow(arrow: &Arrow) -> f32 {
    0.4 + if arrow.through { THROUGH } else { 0.0 }
}

/// The pieces of a stylus' ray: one along the ray or to its hit, or many along the curve to it.
fn ray(stylus: &StylusShape) -> impl Iterator<Item = Matrix4<f32>> {
    let m = &stylus.room_from_stylus;
    let tip = Point3::from(m.fixed_view::<3, 1>(0, 3).into_owned());
    let forward =
        (-m.fixed_view::<3, 1>(0, 2).into_owned()).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    let end = stylus.hit.unwrap_or(tip + forward * stylus.ray_length_m);
    let radius = stylus.size_m * RAY_RADIUS;
    let (control, pieces) = match stylus.bend {
        Some(control) => (control, BEND_PIECES),
        None => (nalgebra::center(&tip, &end), 1),
    };
    // B(t) = (1 - t)² tip + 2 t (1 - t) control + t² end.
    let point = move |piece: usize| {
        let t = piece as f32 / pieces as f32;
        tip + (control - tip) * (2.0 * t * (1.0 - t)) + (end - tip) * (t * t)
    };
    (0..pieces).filter_map(move |piece| along(&point(piece), &(point(piece + 1) - point(piece)), radius))
}

/// An arrow's cylinder and cone; None for one of no length.
fn shaft_and_head(arrow: &Arrow) -> [Option<Matrix4<f32>>; 2] {
    let length = arrow.along.norm();
    let head = (length / 3.0).min(8.0 * arrow.radius_m) / length.max(f32::MIN_POSITIVE);
    let neck = arrow.from + arrow.along * (1.0 - head);
    [
        along(&arrow.from, &(arrow.along * (1.0 - head)), arrow.radius_m),
        along(&neck, &(arrow.along * head), HEAD_RADIUS * arrow.radius_m),
    ]
}

/// A unit shape along -Z laid from a place along a way; None for a way of no length.
fn along(from: &Point3<f32>, way: &Vector3<f32>, radius: f32) -> Option<Matrix4<f32>> {
    let length = way.norm();
    if !(length.is_finite() && length > 0.0) {
        return None;
    }
    // (1 + a·b, a × b) of -z and the way; a half turn about x where the way is exactly backwards and the shortest
    // rotation is not unique.
    let direction = way / length;
    let turn = Quaternion::from_parts(1.0 - direction.z, -Vector3::z().cross(&direction));
    let rotation = UnitQuaternion::try_new(turn, 1e-6)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
    let scaling = Matrix4::new_nonuniform_scaling(&Vector3::new(radius, radius, length));
    Some(Matrix4::new_translation(&from.coords) * rotation.to_homogeneous() * scaling)
}

/// Surfaces of revolution about the z axis, collected into one mesh.
#[derive(Default)]
struct Revolved {
    vertices: Vec<SolidVertex>,
    indices: Vec<u32>,
}

impl Revolved {
    /// A pen of unit length: tip at the origin, body along +Z; parts meet in sharp edges.
    fn pen(&mut self) -> Range<u32> {
        const STEEL: [u8; 4] = [188, 194, 202, 0];
        const GRAPHITE: [u8; 4] = [74, 82, 96, 0];
        const LIGHT: [u8; 4] = [150, 158, 170, 0];
        const ACCENT: [u8; 4] = [0, 0, 0, 255];
        let start = self.indices.len() as u32;
        self.revolve(&[(0.0, 0.0), (0.0, 0.006)], STEEL);
        self.revolve(&[(0.0, 0.006), (0.17, 0.036)], STEEL);
        self.revolve(&[(0.17, 0.036), (0.17, 0.041)], ACCENT);
        self.revolve(&[(0.17, 0.041), (0.21, 0.041)], ACCENT);
        self.revolve(&[(0.21, 0.041), (0.21, 0.038)], ACCENT);
        self.revolve(&[(0.21, 0.038), (0.45, 0.044), (0.86, 0.040)], GRAPHITE);
        self.revolve(&[(0.86, 0.040), (0.90, 0.039)], LIGHT);
        let cap: Vec<_> =
            (0..=6).map(|k| quarter(k as f32 / 6.0)).map(|(z, r)| (0.90 + 0.10 * z, 0.037 * r)).collect();
        self.revolve(&cap, GRAPHITE);
        start..self.indices.len() as u32
    }

    /// Radius 1 from z = 0 to z = -1, open at both ends.
    fn cylinder(&mut self) -> Range<u32> {
        self.revolve(&[(-1.0, 1.0), (0.0, 1.0)], [0, 0, 0, 255])
    }

    /// Radius 1 at z = 0, closed there, to a tip at z = -1.
    fn cone(&mut self) -> Range<u32> {
        let start = self.indices.len() as u32;
        self.revolve(&[(-1.0, 0.0), (0.0, 1.0)], [0, 0, 0, 255]);
        self.revolve(&[(0.0, 1.0), (0.0, 0.0)], [0, 0, 0, 255]);
        start..self.indices.len() as u32
    }

    /// Radius 1 about the origin.
    fn sphere(&mut self) -> Range<u32> {
        let profile: Vec<_> = (0..=16)
            .map(|k| {
                let (sin, cos) = (PI * k as f32 / 16.0).sin_cos();
                (-cos, sin.max(0.0))
            })
            .collect();
        self.revolve(&profile, [0, 0, 0, 255])
    }

    /// Turns a profile of (z, r), given so that outside is to its left for r upwards and z to the right, about z.
    /// Normals are smooth along the profile.
    fn revolve(&mut self, profile: &[(f32, f32)], color: [u8; 4]) -> Range<u32> {
        let start = self.indices.len() as u32;
        let base = self.vertices.len() as u32;
        let point = |k: usize| Vector2::new(profile[k].0, profile[k].1);
        for k in 0..profile.len() {
            let tangent = point((k + 1).min(profile.len() - 1)) - point(k.saturating_sub(1));
            let (z, r) = profile[k];
            for segment in 0..=SEGMENTS {
                let (sin, cos) = (TAU * segment as f32 / SEGMENTS as f32).sin_cos();
                self.vertices.push(SolidVertex {
                    position: [r * cos, r * sin, z],
                    normal: [tangent.x * cos, tangent.x * sin, -tangent.y],
                    color,
                });
            }
        }
        let ring = SEGMENTS + 1;
        for k in 0..profile.len() as u32 - 1 {
            for segment in 0..SEGMENTS {
                let a = base + k * ring + segment;
                self.indices.extend([a, a + 1, a + ring, a + ring, a + 1, a + ring + 1]);
            }
        }
        start..self.indices.len() as u32
    }
}

/// A quarter circle from (0, 1) to (1, 0).
fn quarter(share: f32) -> (f32, f32) {
    (share * FRAC_PI_2).sin_cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stylus(hit: Option<Point3<f32>>) -> StylusShape {
        let room_from_stylus = Matrix4::new_translation(&Vector3::new(1.0, 2.0, 3.0));
        StylusShape { room_from_stylus, size_m: 0.2, ray_length_m: 5.0, hit, bend: None, pressed: false }
    }

    fn end(piece: &Matrix4<f32>) -> Point3<f32> {
        Point3::from_homogeneous(piece * Point3::new(0.0, 0.0, -1.0).to_homogeneous()).unwrap()
    }

    #[test]
    fn the_ray_runs_from_the_tip_to_the_hit_or_along_minus_z() {
        let end = |shape: &StylusShape| {
            let pieces: Vec<_> = ray(shape).collect();
            assert_eq!(pieces.len(), 1);
            end(&pieces[0])
        };
        let free = end(&stylus(None));
        assert!((free - Point3::new(1.0, 2.0, -2.0)).norm() < 1e-5, "{free}");
        let on_axis = (1..50).map(|i| Point3::new(1.0, 2.0, 3.0 - 0.0371 * i as f32));
        for hit in [Point3::new(0.3, 2.5, -1.0), Point3::new(1.0, 2.0, 4.0)].into_iter().chain(on_axis) {
            let reached = end(&stylus(Some(hit)));
            assert!((reached - hit).norm() < 1e-5, "{reached}");
        }
    }

    #[test]
    fn a_bent_ray_leaves_along_the_stylus_and_its_pieces_join_up_to_the_hit() {
        let hit = Point3::new(1.5, 2.0, 2.0);
        let shape = StylusShape { bend: Some(Point3::new(1.0, 2.0, 2.3)), ..stylus(Some(hit)) };
        let pieces: Vec<_> = ray(&shape).collect();
        assert_eq!(pieces.len(), BEND_PIECES);
        let start = |piece: &Matrix4<f32>| Point3::from(piece.fixed_view::<3, 1>(0, 3).into_owned());
        assert!(pieces.windows(2).all(|two| (end(&two[0]) - start(&two[1])).norm() < 1e-5));
        assert!((end(&pieces[BEND_PIECES - 1]) - hit).norm() < 1e-5);
        let first = (end(&pieces[0]) - start(&pieces[0])).normalize();
        assert!(first.dot(&-Vector3::z()) > 0.99, "{first}");
    }

    #[test]
    fn a_hit_at_the_tip_and_a_broken_pose_draw_no_ray() {
        assert_eq!(ray(&stylus(Some(Point3::new(1.0, 2.0, 3.0)))).count(), 0);
        let broken = StylusShape { room_from_stylus: Matrix4::from_element(f32::NAN), ..stylus(None) };
        assert_eq!(ray(&broken).count(), 0);
    }

    #[test]
    fn an_arrow_ends_in_the_tip_of_its_head() {
        let arrow = |along| Arrow {
            from: Point3::new(1.0, 0.0, 0.0),
            along,
            radius_m: 0.01,
            color: [1.0; 3],
            through: false,
        };
        let [shaft, head] = shaft_and_head(&arrow(Vector3::new(0.0, 0.5, 0.0))).map(Option::unwrap);
        assert!((end(&shaft) - Point3::new(1.0, 0.42, 0.0)).norm() < 1e-5, "{}", end(&shaft));
        assert!((end(&head) - Point3::new(1.0, 0.5, 0.0)).norm() < 1e-5);
        assert_eq!(shaft_and_head(&arrow(Vector3::zeros())), [None, None]);
    }

    /// Each triangle turns counter-clockwise seen from outside, and its vertices' normals point there too.
    #[test]
    fn solids_are_oriented_outward() {
        let mut mesh = Revolved::default();
        mesh.pen();
        mesh.cylinder();
        mesh.sphere();
        mesh.cone();
        for triangle in mesh.indices.chunks_exact(3) {
            let [a, b, c] = [0, 1, 2].map(|k| mesh.vertices[triangle[k] as usize]);
            let [p, q, r] = [a, b, c].map(|v| Vector3::from(v.position));
            let area = (q - p).cross(&(r - p));
            if area.norm() > 1e-8 {
                let normal = Vector3::from(a.normal) + Vector3::from(b.normal) + Vector3::from(c.normal);
                assert!(area.dot(&normal) > 0.0, "{p} {q} {r}");
            }
        }
    }
}
