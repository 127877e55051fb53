//! Shadows: which there are, and depth of the bodies as lights see them.
//!
//! In: the bodies of a frame. Out: maps of depth, drawn once a frame for all screens and both eyes, since they do not depend
//! on who looks. Soft shadows are the share of a disc in the key light's map that the light reaches; the sky is six
//! more such lights with wide discs, which is ambient occlusion without a look at the screen: in stereo, what is made from
//! the picture of one eye does not agree with that of the other.

use super::error::RenderError;
use super::frame::BodyInstance;
use super::gpu::Gpu;
use super::lighting::Lighting;
use super::parts::{Instance, Instances, instance_layout};
use super::shader;
use super::target::{DEPTH_FORMAT, layered};
use super::view::Bounds;
use nalgebra::{Matrix4, Point3, RowVector4, Vector3};
use wgpu::BufferUsages;

/// Shadows that a renderer draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shadows {
    #[default]
    Off,
    /// Shadows of the bodies on the floor grid.
    Contact,
    /// Contact shadows, and on the bodies the key light's soft shadows and ambient occlusion.
    Soft,
}

/// The key light, and those that stand for the sky: `SKY_LIGHTS` of `shaders/common/shadowed.wgsl` and one.
const LIGHTS: usize = 7;
/// Pixels of a map's side.
const MAP_PX: u32 = 1024;

/// `ShadowLight` of `shaders/common/shadowed.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct ShadowLight {
    map_from_room: [[f32; 4]; 4],
    to_light: [f32; 3],
    texel_m: f32,
}

/// The smallest box along the room's axes around the boxes of all bodies; `None` without bodies, or where one is not finite.
pub(super) fn bounds_in_room(bodies: &[BodyInstance<'_>]) -> Option<Bounds> {
    let of_patch = |room_from_body: &Matrix4<f32>, bounds: &Bounds| {
        let centre = room_from_body.transform_point(&Point3::from(bounds.centre)).coords;
        let half = room_from_body.fixed_view::<3, 3>(0, 0).abs() * bounds.half;
        (centre - half, centre + half)
    };
    let patches = bodies.iter().flat_map(|body| {
        body.buffers.patches.iter().map(|patch| of_patch(&body.room_from_body, &patch.bounds))
    });
    let (low, high) = patches.reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))?;
    let bounds = Bounds { centre: (low + high) / 2.0, half: (high - low) / 2.0 };
    let is_finite = bounds.centre.iter().chain(bounds.half.iter()).all(|x| x.is_finite());
    (is_finite && bounds.half.max() > 0.0).then_some(bounds)
}

/// Draws the depth of bodies: a pipeline, and a matrix for each light.
pub(super) struct DepthPass {
    pipeline: wgpu::RenderPipeline,
    matrices: wgpu::Buffer,
    group: wgpu::BindGroup,
    stride: u32,
    instances: Instances,
}

impl DepthPass {
    pub(super) fn new(gpu: &Gpu, lights: u32) -> Result<DepthPass, RenderError> {
        let device = &gpu.device;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shadow"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: true,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("shadow"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let module = shader::module(device, "shadow", &shader::SHADOW.concat());
        let positions = wgpu::VertexBufferLayout {
            array_stride: 12,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &wgpu::vertex_attr_array![0 => Float32x3],
        };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("shadow"),
            layout: Some(&pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("vertex"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[Some(positions), Some(instance_layout())],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(true),
                depth_compare: Some(wgpu::CompareFunction::Less),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: None,
            multiview_mask: None,
            cache: None,
        });
        let stride = 64_u32.next_multiple_of(device.limits().min_uniform_buffer_offset_alignment);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let matrices = gpu.buffer("views of lights", u64::from(stride * lights), usage)?;
        let one = wgpu::BufferBinding { buffer: &matrices, offset: 0, size: wgpu::BufferSize::new(64) };
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shadow"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::Buffer(one) }],
        });
        Ok(DepthPass { pipeline, matrices, group, stride, instances: Instances::default() })
    }

    /// Uploads what the lights look at in this frame.
    pub(super) fn upload(
        &mut self,
        gpu: &Gpu,
        clip_from_room: &[Matrix4<f32>],
        bodies: &[BodyInstance<'_>],
    ) -> Result<(), RenderError> {
        for (light, matrix) in clip_from_room.iter().enumerate() {
            let offset = light as u64 * u64::from(self.stride);
            gpu.queue.write_buffer(&self.matrices, offset, bytemuck::cast_slice(matrix.as_slice()));
        }
        let of_body = |body: &BodyInstance<'_>| Instance {
            room_from_shape: body.room_from_body.into(),
            color: [0.0; 4],
        };
        self.instances.list.clear();
        self.instances.list.extend(bodies.iter().map(of_body));
        self.instances.upload(gpu)
    }

    /// Draws all bodies into the map of a light; its time counts as that of `shadows`.
    pub(super) fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        map: &wgpu::TextureView,
        light: u32,
        bodies: &[BodyInstance<'_>],
    ) {
        let span = gpu.clock().and_then(|clock| clock.span("shadows"));
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("shadow"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: map,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(1.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            timestamp_writes: span.map(|(query_set, begin, end)| wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: Some(begin),
                end_of_pass_write_index: Some(end),
            }),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[light * self.stride]);
        for (k, body) in bodies.iter().enumerate() {
            let buffers = body.buffers;
            pass.set_index_buffer(buffers.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.set_vertex_buffer(0, buffers.positions.slice(..));
            self.instances.bind(&mut pass, 1, k);
            pass.draw_indexed(0..3 * buffers.triangle_count as u32, 0, 0..1);
        }
    }
}

/// The maps of all lights, and what the bodies' shader needs to read them: group 1.
pub(super) struct ShadowMaps {
    depth: DepthPass,
    layers: Vec<wgpu::TextureView>,
    lights: wgpu::Buffer,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) group: wgpu::BindGroup,
}

impl ShadowMaps {
    pub(super) fn new(gpu: &Gpu) -> Result<ShadowMaps, RenderError> {
        let device = &gpu.device;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING;
        let maps = layered(gpu, [MAP_PX; 2], LIGHTS as u32, DEPTH_FORMAT, 1, usage);
        let layer = |light| {
            maps.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2),
                base_array_layer: light,
                array_layer_count: Some(1),
                ..Default::default()
            })
        };
        let bytes = (LIGHTS * size_of::<ShadowLight>()) as u64;
        let lights = gpu.buffer("lights", bytes, BufferUsages::UNIFORM | BufferUsages::COPY_DST)?;
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let uniform = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let texture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Depth,
            view_dimension: wgpu::TextureViewDimension::D2Array,
            multisampled: false,
        };
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shadows"),
            entries: &[
                entry(0, uniform),
                entry(1, texture),
                entry(2, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)),
            ],
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadows"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::LessEqual),
            ..Default::default()
        });
        let all = maps.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shadows"),
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: lights.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&all) },
                wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Sampler(&sampler) },
            ],
        });
        let layers = (0..LIGHTS as u32).map(layer).collect();
        let depth = DepthPass::new(gpu, LIGHTS as u32)?;
        gpu.check()?;
        Ok(ShadowMaps { depth, layers, lights, layout, group })
    }

    /// Draws the maps of a frame.
    pub(super) fn draw(
        &mut self,
        gpu: &Gpu,
        lighting: &Lighting,
        bodies: &[BodyInstance<'_>],
    ) -> Result<(), RenderError> {
        let Some(bounds) = bounds_in_room(bodies) else { return Ok(()) };
        let lights = directions(lighting).map(|to_light| light(&bounds, to_light));
        gpu.queue.write_buffer(&self.lights, 0, bytemuck::cast_slice(&lights));
        let clip_from_map =
            Matrix4::new(2.0, 0.0, 0.0, -1.0, 0.0, -2.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let clip_from_room = lights.map(|light| clip_from_map * Matrix4::from(light.map_from_room));
        self.depth.upload(gpu, &clip_from_room, bodies)?;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for (light, map) in (0..).zip(&self.layers) {
            self.depth.draw(gpu, &mut encoder, map, light, bodies);
        }
        gpu.queue.submit([encoder.finish()]);
        Ok(())
    }
}

/// Towards the key light, and towards six places of the sky: three high ones, and between them three low ones.
fn directions(lighting: &Lighting) -> [Vector3<f32>; LIGHTS] {
    let sky = |k: usize| {
        let (elevation, turn) = (if k.is_multiple_of(2) { 62f32 } else { 24.0 }, 20.0 + 60.0 * k as f32);
        let ((up, out), (z, x)) = (elevation.to_radians().sin_cos(), turn.to_radians().sin_cos());
        Vector3::new(out * x, up, out * z)
    };
    let key = lighting.to_key.try_normalize(0.0).unwrap_or_else(Vector3::y);
    std::array::from_fn(|k| if k == 0 { key } else { sky(k - 1) })
}

/// The map of a light that sees the whole of the bounds: u, v, and depth from 0 near the light to 1.
fn light(bounds: &Bounds, to_light: Vector3<f32>) -> ShadowLight {
    let radius = 1.05 * bounds.half.norm();
    let across = if to_light.y.abs() < 0.9 { Vector3::y() } else { Vector3::x() };
    let u = across.cross(&to_light).normalize();
    let v = to_light.cross(&u);
    let row = |axis: Vector3<f32>| {
        let scaled = axis / (2.0 * radius);
        RowVector4::new(scaled.x, scaled.y, scaled.z, 0.5 - scaled.dot(&bounds.centre))
    };
    let last = RowVector4::new(0.0, 0.0, 0.0, 1.0);
    let map_from_room = Matrix4::from_rows(&[row(u), row(-v), row(-to_light), last]);
    let texel_m = 2.0 * radius / MAP_PX as f32;
    ShadowLight { map_from_room: map_from_room.into(), to_light: to_light.into(), texel_m }
}

#[cfg(test)]
mod tests {
    use super::super::layout::assert_layout;
    use super::*;

    #[test]
    fn a_light_lies_as_the_shaders_read_it() {
        let source = {
            let kind = crate::render::body::Kind {
                patterned: true,
                image: false,
                field: false,
                hatched: false,
                shadowed: true,
            };
            crate::render::body::shader(kind).concat()
        };
        assert_layout!(source, "ShadowLight", ShadowLight: map_from_room, to_light, texel_m);
    }

    #[test]
    fn a_map_holds_the_bounds_and_is_nearer_towards_the_light() {
        let bounds = Bounds { centre: Vector3::new(1.0, 2.0, -3.0), half: Vector3::new(0.5, 0.1, 0.3) };
        for to_light in directions(&Lighting::default()) {
            assert!((to_light.norm() - 1.0).abs() < 1e-6 && to_light.y > 0.3, "{to_light}");
            let map_from_room = Matrix4::from(light(&bounds, to_light).map_from_room);
            let at = |x: Vector3<f32>| map_from_room.transform_point(&Point3::from(x));
            for k in 0..8 {
                let corner = Vector3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32) * 2.0;
                let corner = bounds.centre + bounds.half.component_mul(&(corner - Vector3::repeat(1.0)));
                assert!(at(corner).iter().all(|x| (0.0..=1.0).contains(x)), "{}", at(corner));
            }
            let step = at(bounds.centre + 0.1 * to_light) - at(bounds.centre);
            assert!(step.z < 0.0 && step.xy().norm() < 1e-6, "{step}");
        }
    }
}
