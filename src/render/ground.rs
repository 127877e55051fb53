//! The bodies' shadow on the floor grid, by which their height over it is read.
//!
//! In: bodies and the grid of a frame. Out, once a frame for all screens and eyes: a map of the bodies' undersides as the floor
//! sees them, from it what they hide of a lamp overhead (`shaders/ground_map.wgsl`), and a rectangle of the floor darkened
//! by that. Made with the first frame that has bodies, a grid and shadows.

use super::error::RenderError;
use super::frame::{BodyInstance, FrameContents, Grid};
use super::gpu::Gpu;
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::shader;
use super::shadow::{DepthPass, Shadows, bounds_in_room};
use super::target::{DEPTH_FORMAT, texture};
use super::view::Bounds;
use nalgebra::Matrix4;
use wgpu::BufferUsages;

pub(super) const SHADER: [&str; 3] =
    [shader::VIEW, shader::GROUND_FLOOR, include_str!("../../shaders/ground.wgsl")];
/// Pixels of the map's side.
const MAP_PX: u32 = 256;
/// Format of the hidden part of the lamp, in 256ths.
const HIDDEN_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;
/// Tangent of the angle from the zenith to the lamp's rim: sin² is `LAMP` of `shaders/ground_map.wgsl`.
const LAMP_TANGENT: f32 = 0.655;

/// `GroundFloor` of `shaders/common/ground_floor.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct GroundFloor {
    center: [f32; 3],
    height_m: f32,
    half_size: [f32; 2],
    reach_m: f32,
    end: f32,
}

impl GroundFloor {
    /// The part of the floor that bodies in these bounds can shade; `None` where all of them are below it.
    fn under(grid: &Grid, bounds: &Bounds) -> Option<GroundFloor> {
        let top = bounds.centre.y + bounds.half.y;
        // A little more, so that the highest place is still nearer than nothing.
        let height_m = 1.01 * (top - grid.center.y);
        // Shadows of what floats far above are faint and wide: no more than a body's size around it.
        let reach_m = (height_m * LAMP_TANGENT).min(2.0 * bounds.half.norm());
        let half_size = [bounds.half.x + reach_m, bounds.half.z + reach_m];
        let center = [bounds.centre.x, grid.center.y, bounds.centre.z];
        (height_m > 0.0).then_some(GroundFloor { center, height_m, half_size, reach_m, end: 0.0 })
    }

    /// The floor's view of the bodies: left to right along x, down along z, near 0 at the floor.
    fn clip_from_room(&self) -> Matrix4<f32> {
        let ([x, y, z], [width, depth]) = (self.center, self.half_size);
        #[rustfmt::skip]
        let clip_from_room = Matrix4::new(
            1.0 / width, 0.0, 0.0, -x / width,
            0.0, 0.0, -1.0 / depth, z / depth,
            0.0, 1.0 / self.height_m, 0.0, -y / self.height_m,
            0.0, 0.0, 0.0, 1.0,
        );
        clip_from_room
    }
}

/// The pass of shadows on the ground, with nothing on the device until there is a shadow to draw.
#[derive(Default)]
pub(super) struct GroundPass {
    map: Option<GroundMap>,
    pipelines: EyePipelines,
    is_shown: bool,
}

/// The maps of heights and of the hidden part of the lamp.
struct GroundMap {
    depth: DepthPass,
    heights: wgpu::TextureView,
    hidden: wgpu::TextureView,
    floor: wgpu::Buffer,
    /// Pipeline from heights to the hidden part of the lamp.
    pipeline: wgpu::RenderPipeline,
    read_heights: wgpu::BindGroup,
    /// Layout of the group by which the picture reads the hidden part.
    layout: wgpu::BindGroupLayout,
    read_hidden: wgpu::BindGroup,
}

impl DrawPass for GroundPass {
    fn name(&self) -> &'static str {
        "ground"
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
        let has_shadows = kinds.iter().any(|kind| kind.shadows != Shadows::Off);
        let grid = contents.grid.as_ref().filter(|_| has_shadows);
        let floor =
            grid.zip(bounds_in_room(contents.bodies)).and_then(|(grid, b)| GroundFloor::under(grid, &b));
        self.is_shown = floor.is_some();
        let Some(floor) = floor else { return Ok(()) };
        let mut map = self.map.take().map_or_else(|| GroundMap::new(gpu), Ok)?;
        let groups = &[Some(&map.layout)];
        let (label, parts) = (self.name(), self.shader());
        let recipe = Recipe { label, parts, buffers: &[], blending: Blending::Translucent, groups };
        self.pipelines.complete(gpu, kinds, &recipe);
        map.draw(gpu, &floor, contents.bodies)?;
        self.map = Some(map);
        Ok(())
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, _: &FrameContents<'_>) {
        let made = self.pipelines.pipeline(to.view_draw).zip(self.map.as_ref());
        let Some((pipeline, map)) = made.filter(|_| self.is_shown) else { return };
        to.pass.set_pipeline(pipeline);
        to.pass.set_bind_group(1, &map.read_hidden, &[]);
        to.pass.draw(0..4, 0..1);
    }

    fn is_made(&self) -> bool {
        self.map.is_some()
    }
}

impl GroundMap {
    fn new(gpu: &Gpu) -> Result<GroundMap, RenderError> {
        let device = &gpu.device;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let map = |format| {
            let made = device.create_texture(&texture([MAP_PX; 2], format, 1, usage));
            made.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let (heights, hidden) = (map(DEPTH_FORMAT), map(HIDDEN_FORMAT));
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let floor = gpu.buffer("floor in shadow", size_of::<GroundFloor>() as u64, usage)?;
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("ground"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let depth = wgpu::TextureSampleType::Depth;
        let filtered = wgpu::TextureSampleType::Float { filterable: true };
        let (heights_layout, read_heights) = group(device, &floor, &heights, depth, None);
        let (layout, read_hidden) = group(device, &floor, &hidden, filtered, Some(&sampler));
        let (label, groups) = ("ground map", [None, Some(&heights_layout)]);
        let pipeline = shader::of_whole_texture(device, label, &shader::GROUND_MAP, &groups, HIDDEN_FORMAT);
        let depth = DepthPass::new(gpu, 1)?;
        gpu.check()?;
        Ok(GroundMap { depth, heights, hidden, floor, pipeline, read_heights, layout, read_hidden })
    }

    fn draw(
        &mut self,
        gpu: &Gpu,
        floor: &GroundFloor,
        bodies: &[BodyInstance<'_>],
    ) -> Result<(), RenderError> {
        gpu.queue.write_buffer(&self.floor, 0, bytemuck::bytes_of(floor));
        self.depth.upload(gpu, &[floor.clip_from_room()], bodies)?;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.depth.draw(gpu, &mut encoder, &self.heights, 0, bodies);
        let span = gpu.clock().and_then(|clock| clock.span("shadows"));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("ground"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.hidden,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
            timestamp_writes: span.map(|(query_set, begin, end)| wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(begin),
                end_of_pass_write_index: Some(end),
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(1, &self.read_heights, &[]);
        pass.draw(0..3, 0..1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }
}

/// Group 1: the floor, a map, and how it is sampled.
fn group(
    device: &wgpu::Device,
    floor: &wgpu::Buffer,
    map: &wgpu::TextureView,
    sample_type: wgpu::TextureSampleType,
    sampler: Option<&wgpu::Sampler>,
) -> (wgpu::BindGroupLayout, wgpu::BindGroup) {
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty,
        count: None,
    };
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let view_dimension = wgpu::TextureViewDimension::D2;
    let texture = wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false };
    let mut entries = vec![entry(0, uniform), entry(1, texture)];
    let mut bound = vec![
        wgpu::BindGroupEntry { binding: 0, resource: floor.as_entire_binding() },
        wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(map) },
    ];
    if let Some(sampler) = sampler {
        entries.push(entry(2, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)));
        bound.push(wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Sampler(sampler) });
    }
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some("ground"), entries: &entries };
    let layout = device.create_bind_group_layout(&descriptor);
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("ground"),
        layout: &layout,
        entries: &bound,
    });
    (layout, group)
}

#[cfg(test)]
mod tests {
    use super::super::layout::assert_layout;
    use super::*;
    use nalgebra::{Point3, Vector3};

    const BOUNDS: Bounds = Bounds { centre: Vector3::new(0.5, 1.2, -0.3), half: Vector3::new(0.3, 0.1, 0.2) };

    fn floor(height: f32) -> Option<GroundFloor> {
        GroundFloor::under(&Grid::new(Point3::new(0.0, height, 0.0), [1.0; 2], 0.1), &BOUNDS)
    }

    #[test]
    fn the_floor_lies_as_the_shaders_read_it() {
        let source = SHADER.concat();
        assert_layout!(source, "GroundFloor", GroundFloor: center, height_m, half_size, reach_m, end);
    }

    #[test]
    fn the_floor_sees_all_that_is_above_it() {
        let floor = floor(0.8).unwrap();
        let at = |x: f32, y: f32, z: f32| floor.clip_from_room().transform_point(&Point3::new(x, y, z));
        assert!(at(0.5, 0.8, -0.3).coords.norm() < 1e-6, "the middle of the floor");
        let corner = at(0.8, 1.3, -0.5);
        assert!(
            corner.z < 1.0 && corner.x < 1.0 && corner.y < 1.0 && corner.x > 0.0 && corner.y > 0.0,
            "{corner}"
        );
        assert!(super::tests::floor(1.4).is_none(), "all bodies are below it");
    }
}
