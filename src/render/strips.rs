//! Strips of four corners, one per instance, blended over the picture: the common part of floor, lines and quads.
//!
//! In comes a list of instances per frame; out goes one draw per view. The pipeline and the buffer are made with the
//! first instance that is ever drawn, and grow with the longest list.
//!
//! [`Line`] is straight in the room, and as wide in pixels wherever it is seen from. [`Quad`] is a translucent parallelogram
//! in the room: one colour seen from the front, another from the back. [`CustomStripsPass`] draws strips with shaders that
//! an effect brings: one pipeline and one buffer for each kind, found by its name.

use super::error::RenderError;
use super::frame::{Drawable, FrameContents, Line, Quad};
use super::gpu::Gpu;
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::shader;
use crate::base::strips::StripKind;
use std::collections::BTreeMap;
use std::marker::PhantomData;

/// An instance as it lies in its buffer.
pub(super) trait Strip: bytemuck::Pod {
    /// The shader's name.
    const NAME: &'static str;
    const SHADER: &'static [&'static str];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute];

    /// The strips of a frame, in the order in which they are blended.
    fn from_contents(contents: &FrameContents<'_>) -> Vec<Self>;
}

/// The pass of one kind of strip; it makes nothing on the device until it is used.
pub(super) struct StripPass<S> {
    strips: StripBuffer,
    kind: PhantomData<S>,
}

impl<S> Default for StripPass<S> {
    fn default() -> Self {
        Self { strips: StripBuffer::default(), kind: PhantomData }
    }
}

impl<S: Strip> DrawPass for StripPass<S> {
    fn name(&self) -> &'static str {
        S::NAME
    }

    fn shader(&self) -> &'static [&'static str] {
        S::SHADER
    }

    fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        contents: &FrameContents<'_>,
    ) -> Result<(), RenderError> {
        let strips = S::from_contents(contents);
        let shape = StripShape {
            name: S::NAME,
            parts: S::SHADER,
            attributes: S::ATTRIBUTES,
            stride: size_of::<S>() as u64,
        };
        self.strips.upload(gpu, kinds, &shape, bytemuck::cast_slice(&strips))
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, _: &FrameContents<'_>) {
        self.strips.draw(to);
    }

    fn is_made(&self) -> bool {
        self.strips.is_made()
    }
}

/// The description of a pipeline of strips.
pub(super) struct StripShape<'a> {
    pub(super) name: &'static str,
    pub(super) parts: &'a [&'a str],
    pub(super) attributes: &'a [wgpu::VertexAttribute],
    /// Bytes of an instance.
    pub(super) stride: u64,
}

/// The instances of one kind on the device, with the pipelines that draw them.
#[derive(Default)]
pub(super) struct StripBuffer {
    pipelines: EyePipelines,
    buffer: Option<wgpu::Buffer>,
    count: u32,
}

impl StripBuffer {
    pub(super) fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        shape: &StripShape<'_>,
        bytes: &[u8],
    ) -> Result<(), RenderError> {
        self.count = (bytes.len() as u64 / shape.stride) as u32;
        if self.count == 0 {
            return Ok(());
        }
        let buffers = [Some(wgpu::VertexBufferLayout {
            array_stride: shape.stride,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: shape.attributes,
        })];
        let blending = Blending::Translucent;
        let recipe =
            Recipe { label: shape.name, parts: shape.parts, buffers: &buffers, blending, groups: &[] };
        self.pipelines.complete(gpu, kinds, &recipe);
        let room = (u64::from(self.count.next_power_of_two()) * shape.stride) as usize;
        gpu.write_vertices(&mut self.buffer, shape.name, bytes, room)
    }

    pub(super) fn draw(&self, to: &mut DrawTo<'_, '_>) {
        let made = self.pipelines.pipeline(to.view_draw).zip(self.buffer.as_ref());
        if let Some((pipeline, buffer)) = made.filter(|_| self.count > 0) {
            to.pass.set_pipeline(pipeline);
            to.pass.set_vertex_buffer(0, buffer.slice(..));
            to.pass.draw(0..4, 0..self.count);
        }
    }

    /// Removes the strips of this frame.
    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    pub(super) fn is_made(&self) -> bool {
        self.buffer.is_some()
    }
}

impl Strip for Line {
    const NAME: &'static str = "lines";
    const SHADER: &'static [&'static str] = &[shader::VIEW, include_str!("../../shaders/lines.wgsl")];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute] =
        &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Float32, 4 => Float32];

    fn from_contents(contents: &FrameContents<'_>) -> Vec<Self> {
        contents.all(Drawable::lines).flatten().copied().collect()
    }
}

impl Strip for Quad {
    const NAME: &'static str = "quads";
    const SHADER: &'static [&'static str] = &[shader::VIEW, include_str!("../../shaders/quads.wgsl")];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute] = &wgpu::vertex_attr_array![
        0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Float32x4, 4 => Float32x4];

    fn from_contents(contents: &FrameContents<'_>) -> Vec<Self> {
        contents.all(Drawable::quad).copied().collect()
    }
}

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
