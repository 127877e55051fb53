//! Draws solids of any form, such as tools: opaque, lit like styli and arrows.
//!
//! In: [`Formed`]s. Out: one instance each of their [`Shapes`].

use super::error::RenderError;
use super::frame::{Drawable, Formed, FrameContents};
use super::gpu::Gpu;
use super::parts::{Instance, Instances};
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::shapes::Shapes;
use super::solid::{SHADER, vertex_layout};

#[derive(Default)]
pub(super) struct FormedPass {
    pipelines: EyePipelines,
    instances: Instances,
    shapes: Shapes,
}

impl DrawPass for FormedPass {
    fn name(&self) -> &'static str {
        "formed"
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
        if contents.all(Drawable::formed).next().is_none() {
            return Ok(());
        }
        let (label, parts, buffers) = (self.name(), self.shader(), &vertex_layout());
        let recipe = Recipe { label, parts, buffers, blending: Blending::Opaque, groups: &[] };
        self.pipelines.complete(gpu, kinds, &recipe);
        for Formed { shape, room_from_shape, color: [r, g, b] } in contents.all(Drawable::formed) {
            self.shapes.add(gpu, shape)?;
            let color = [*r, *g, *b, 0.0];
            self.instances.list.push(Instance { room_from_shape: (*room_from_shape).into(), color });
        }
        self.instances.upload(gpu)
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, contents: &FrameContents<'_>) {
        let Some(pipeline) = self.pipelines.pipeline(to.view_draw) else { return };
        for (k, (formed, shape)) in contents.all(Drawable::formed).zip(self.shapes.drawn()).enumerate() {
            let Some(shape) = shape else { continue };
            if to.shows(&shape.bounds, &to.view_draw.clip_from_shape(&formed.room_from_shape)) {
                to.pass.set_pipeline(pipeline);
                self.instances.bind(to.pass, 1, k);
                shape.draw(to.pass);
            }
        }
    }

    fn is_made(&self) -> bool {
        self.pipelines.is_made()
    }
}
