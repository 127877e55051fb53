//! Draws translucent shapes after all that is opaque: they test depth and write none, so that their order is the same for
//! every eye. Their far side is left out; what lies hidden behind a body shows through it, where that is asked for.
//!
//! In: [`Ghost`]s. Out: two instances each of their [`Shapes`].

use super::error::RenderError;
use super::frame::{Drawable, FrameContents, Ghost};
use super::gpu::Gpu;
use super::parts::{Instance, Instances};
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::shader;
use super::shapes::Shapes;
use super::solid::vertex_layout;

const SHADER: [&str; 2] = [shader::VIEW, include_str!("../../shaders/ghost.wgsl")];

#[derive(Default)]
pub(super) struct GhostPass {
    /// Pipelines for visible and for hidden ghosts.
    pipelines: [EyePipelines; 2],
    /// Two per ghost: as it is seen, and where it is hidden.
    instances: Instances,
    shapes: Shapes,
}

impl DrawPass for GhostPass {
    fn name(&self) -> &'static str {
        "ghost"
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
        self.shapes.begin();
        self.instances.list.clear();
        if contents.all(Drawable::ghost).next().is_none() {
            return Ok(());
        }
        let (label, parts, buffers) = (self.name(), self.shader(), &vertex_layout());
        for (pipelines, blending) in self.pipelines.iter_mut().zip([Blending::Ghost, Blending::Hidden]) {
            pipelines.complete(gpu, kinds, &Recipe { label, parts, buffers, blending, groups: &[] });
        }
        for Ghost { shape, room_from_shape, color, through } in contents.all(Drawable::ghost) {
            self.shapes.add(gpu, shape)?;
            let [r, g, b, opacity] = *color;
            for opacity in [opacity, -opacity * through] {
                let color = [r, g, b, opacity];
                self.instances.list.push(Instance { room_from_shape: (*room_from_shape).into(), color });
            }
        }
        self.instances.upload(gpu)
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, contents: &FrameContents<'_>) {
        for (k, (ghost, shape)) in contents.all(Drawable::ghost).zip(self.shapes.drawn()).enumerate() {
            let Some(shape) = shape else { continue };
            let clip_from_shape = to.view_draw.clip_from_shape(&ghost.room_from_shape);
            if !to.shows(&shape.bounds, &clip_from_shape) {
                continue;
            }
            let ways = if ghost.through > 0.0 { 2 } else { 1 };
            for (way, pipelines) in self.pipelines.iter().enumerate().take(ways) {
                let Some(pipeline) = pipelines.pipeline(to.view_draw) else { continue };
                to.pass.set_pipeline(pipeline);
                self.instances.bind(to.pass, 1, 2 * k + way);
                shape.draw(to.pass);
            }
        }
    }

    fn is_made(&self) -> bool {
        self.pipelines.iter().any(EyePipelines::is_made)
    }
}
