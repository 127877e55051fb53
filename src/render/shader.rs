//! WGSL sources: each pass is an ordered list of shared parts and its own file, joined as text. A drawing pass lists its
//! parts in its own file ([`DrawPass::shader`](super::pass::DrawPass::shader)).

/// The parameter by which the entry points of a drawing pass get the eye that they draw.
const EYE: &str = "    @builtin(view_index) eye: u32,\n";

/// The source of a drawing pass: for both eyes at once, or for one, which needs no feature of the device.
pub(super) fn drawing(parts: &[&str], both_eyes: bool) -> String {
    let source = parts.concat();
    if both_eyes { source } else { source.replace(EYE, "") }
}

pub(super) const VIEW: &str = include_str!("../../shaders/common/view.wgsl");
pub(super) const LIGHT: &str = include_str!("../../shaders/common/light.wgsl");
pub(super) const SURFACE: &str = include_str!("../../shaders/common/surface.wgsl");
/// Parts by which a point of a body finds the light that reaches it: all of it, or by the shadow maps.
pub(super) const SEEN: [&str; 2] = [
    include_str!("../../shaders/common/unshadowed.wgsl"),
    include_str!("../../shaders/common/shadowed.wgsl"),
];
/// Parts for bodies in their own colours, and in those of a field.
pub(super) const PAINT: [&str; 2] =
    [include_str!("../../shaders/common/plain.wgsl"), include_str!("../../shaders/common/field.wgsl")];
/// Within a model's range, and beyond it.
pub(super) const HATCH: [&str; 2] =
    [include_str!("../../shaders/common/hatch_none.wgsl"), include_str!("../../shaders/common/hatch.wgsl")];
/// Parts without an image on the body, and with one.
pub(super) const IMAGE: [&str; 2] = [
    include_str!("../../shaders/common/image_none.wgsl"),
    include_str!("../../shaders/common/image_triplanar.wgsl"),
];
pub(super) const GROUND_FLOOR: &str = include_str!("../../shaders/common/ground_floor.wgsl");

pub(super) const SHADOW: [&str; 1] = [include_str!("../../shaders/shadow.wgsl")];
pub(super) const GROUND_MAP: [&str; 2] = [GROUND_FLOOR, include_str!("../../shaders/ground_map.wgsl")];

pub(super) const COMPOSITE: [&str; 1] = [include_str!("../../shaders/composite.wgsl")];

const CHUNK: &str = include_str!("../../shaders/common/chunk.wgsl");
const SUM: &str = include_str!("../../shaders/deform.wgsl");
pub(super) const DEFORM_F32: [&str; 3] = [CHUNK, include_str!("../../shaders/common/columns_f32.wgsl"), SUM];
pub(super) const DEFORM_F16: [&str; 3] = [CHUNK, include_str!("../../shaders/common/columns_f16.wgsl"), SUM];
pub(super) const DEFORM_INT16: [&str; 3] =
    [CHUNK, include_str!("../../shaders/common/columns_int16.wgsl"), SUM];
pub(super) const PARTS: [&str; 2] = [CHUNK, include_str!("../../shaders/parts.wgsl")];
pub(super) const COPIES: [&str; 2] = [CHUNK, include_str!("../../shaders/copies.wgsl")];
pub(super) const NORMALS: [&str; 2] = [CHUNK, include_str!("../../shaders/normals.wgsl")];

pub(super) fn module(device: &wgpu::Device, label: &str, source: &str) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(source.into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
}

/// The pipeline that draws a whole texture of this format, without depth, from what `groups` bind.
pub(super) fn of_whole_texture(
    device: &wgpu::Device,
    label: &str,
    parts: &[&str],
    groups: &[Option<&wgpu::BindGroupLayout>],
    format: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let module = module(device, label, &parts.concat());
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: groups,
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(label),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::body::Kind;
    use wgpu::naga;

    fn stages(
        name: &str,
        source: &str,
        needed: naga::valid::Capabilities,
    ) -> Vec<(naga::ShaderStage, String)> {
        let module = naga::front::wgsl::parse_str(source)
            .unwrap_or_else(|error| panic!("{name}.wgsl:\n{}", error.emit_to_string(source)));
        naga::valid::Validator::new(naga::valid::ValidationFlags::all(), needed)
            .validate(&module)
            .unwrap_or_else(|error| panic!("{name}.wgsl:\n{}", error.emit_to_string(source)));
        let mut stages: Vec<_> = module.entry_points.iter().map(|e| (e.stage, e.name.clone())).collect();
        stages.sort_by(|a, b| a.1.cmp(&b.1));
        stages
    }

    /// No device is needed: the front end and the validator are the ones wgpu itself uses.
    #[test]
    fn every_shader_is_valid() {
        use naga::ShaderStage::{Compute, Fragment, Vertex};
        use naga::valid::Capabilities;
        for pass in
            crate::render::renderer::PASSES.iter().map(|new| new()).filter(|pass| !pass.shader().is_empty())
        {
            let (name, parts) = (pass.name(), pass.shader());
            let expected = [(Fragment, "fragment".to_owned()), (Vertex, "vertex".to_owned())];
            let one = drawing(parts, false);
            assert_eq!(stages(name, &one, Capabilities::empty()), expected, "{name}.wgsl");
            let both = drawing(parts, true);
            assert_eq!(stages(name, &both, Capabilities::MULTIVIEW), expected, "{name}.wgsl");
            assert!(both != one, "{name}.wgsl has no line{EYE}");
        }
        for (patterned, image) in [(false, false), (true, false), (true, true)] {
            for (field, shadowed) in [(false, false), (false, true), (true, false), (true, true)] {
                for hatched in [false, true] {
                    let kind = Kind { patterned, image, field, hatched, shadowed };
                    let parts = crate::render::body::shader(kind);
                    let name = format!("{kind:?}");
                    stages(&name, &drawing(&parts, false), Capabilities::empty());
                    stages(&name, &drawing(&parts, true), Capabilities::MULTIVIEW);
                }
            }
        }
        let shadow = stages("shadow", &SHADOW.concat(), Capabilities::empty());
        assert_eq!(shadow, [(Vertex, "vertex".to_owned())]);
        let ground = stages("ground_map", &GROUND_MAP.concat(), Capabilities::empty());
        assert_eq!(ground.len(), 2);
        let composite = stages("composite", &COMPOSITE.concat(), Capabilities::empty());
        assert_eq!(composite, [(Fragment, "fragment".to_owned()), (Vertex, "vertex".to_owned())]);
        for (name, parts) in [
            ("deform of f32", &DEFORM_F32[..]),
            ("deform of f16", &DEFORM_F16),
            ("deform of int16", &DEFORM_INT16),
            ("parts", &PARTS),
            ("copies", &COPIES),
            ("normals", &NORMALS),
        ] {
            let found = stages(name, &parts.concat(), Capabilities::empty());
            assert_eq!(found, [(Compute, "compute".to_owned())], "{name}");
        }
    }
}
