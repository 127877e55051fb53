//! WGSL sources: each pass is an ordered list of shared parts and its own file, joined as text.

const VIEW: &str = include_str!("../../shaders/common/view.wgsl");
const LIGHT: &str = include_str!("../../shaders/common/light.wgsl");

pub(super) const BODY: [&str; 3] = [VIEW, LIGHT, include_str!("../../shaders/body.wgsl")];
pub(super) const SOLID: [&str; 3] = [VIEW, LIGHT, include_str!("../../shaders/solid.wgsl")];
pub(super) const BACKGROUND: [&str; 2] = [VIEW, include_str!("../../shaders/background.wgsl")];
pub(super) const GRID: [&str; 2] = [VIEW, include_str!("../../shaders/grid.wgsl")];
pub(super) const QUADS: [&str; 2] = [VIEW, include_str!("../../shaders/quads.wgsl")];
pub(super) const LINES: [&str; 2] = [VIEW, include_str!("../../shaders/lines.wgsl")];

pub(super) fn module(device: &wgpu::Device, label: &str, parts: &[&str]) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(parts.concat().into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use wgpu::naga;

    /// Without a device: the front end and the validator are the ones wgpu itself uses.
    #[test]
    fn every_shader_is_valid() {
        for (name, parts) in [
            ("body", &BODY[..]),
            ("solid", &SOLID),
            ("background", &BACKGROUND),
            ("grid", &GRID),
            ("quads", &QUADS),
            ("lines", &LINES),
        ] {
            let source = parts.concat();
            let module = naga::front::wgsl::parse_str(&source)
                .unwrap_or_else(|error| panic!("{name}.wgsl:\n{}", error.emit_to_string(&source)));
            naga::valid::Validator::new(
                naga::valid::ValidationFlags::all(),
                naga::valid::Capabilities::empty(),
            )
            .validate(&module)
            .unwrap_or_else(|error| panic!("{name}.wgsl:\n{}", error.emit_to_string(&source)));
            let mut stages: Vec<_> = module.entry_points.iter().map(|e| (e.stage, e.name.as_str())).collect();
            stages.sort_by_key(|&(_, stage)| stage);
            assert_eq!(
                stages,
                [(naga::ShaderStage::Fragment, "fragment"), (naga::ShaderStage::Vertex, "vertex")],
                "{name}.wgsl"
            );
        }
    }
}
