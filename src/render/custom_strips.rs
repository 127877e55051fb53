//! Strips with shaders that an effect brings: one pipeline and one buffer for each kind, found by its name.

use super::error::RenderError;
use super::frame::{Drawable, FrameContents};
use super::gpu::Gpu;
use super::pass::{DrawPass, DrawTo, MadeFor};
use super::shader;
use super::strips::{StripBuffer, StripShape};
use crate::base::strips::StripKind;
use std::collections::BTreeMap;

#[derive(Default)]
pub(super) struct CustomStripsPass {
    kinds: BTreeMap<&'static str, StripBuffer>,
}

impl DrawPass for CustomStripsPass {
    fn name(&self) -> &'static str {
        "custom strips"
    }

    fn shader(&self) -> &'static [&'static str] {
        &[]
    }

    fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        contents: &FrameContents<'_>,
    ) -> Result<(), RenderError> {
        let mut numbers: BTreeMap<&'static str, (&StripKind, Vec<f32>)> = contents
            .all(Drawable::strips)
            .map(|strips| (strips.kind.name, (strips.kind, Vec::new())))
            .collect();
        for strips in contents.all(Drawable::strips) {
            if let Some((_, all)) = numbers.get_mut(strips.kind.name) {
                all.extend(&strips.instances);
            }
        }
        for (name, known) in &mut self.kinds {
            if !numbers.contains_key(name) {
                known.clear();
            }
        }
        for (kind, numbers) in numbers.values() {
            let attributes = attributes(kind);
            let stride = (4 * kind.attributes.iter().sum::<usize>()) as u64;
            let parts = [shader::VIEW, kind.shader];
            let shape = StripShape { name: kind.name, parts: &parts, attributes: &attributes, stride };
            let kind_buffer = self.kinds.entry(kind.name).or_default();
            kind_buffer.upload(gpu, kinds, &shape, bytemuck::cast_slice(numbers))?;
        }
        Ok(())
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, _: &FrameContents<'_>) {
        self.kinds.values().for_each(|kind| kind.draw(to));
    }

    fn is_made(&self) -> bool {
        self.kinds.values().any(StripBuffer::is_made)
    }
}

fn attributes(kind: &StripKind) -> Vec<wgpu::VertexAttribute> {
    let mut offset = 0;
    let attribute = |(location, &numbers): (u32, &usize)| {
        let format = match numbers {
            1 => wgpu::VertexFormat::Float32,
            2 => wgpu::VertexFormat::Float32x2,
            3 => wgpu::VertexFormat::Float32x3,
            _ => wgpu::VertexFormat::Float32x4,
        };
        let attribute = wgpu::VertexAttribute { format, offset, shader_location: location };
        offset += format.size();
        attribute
    };
    (0..).zip(kind.attributes).map(attribute).collect()
}
