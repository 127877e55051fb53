//! Options of drawing: whether bodies deform on the CPU or the GPU (measured at the start unless asked), and whether both
//! eyes are drawn in one pass.

use crate::base::failure::Failure;
use crate::base::statistics::median;
use crate::base::table::seconds;
use crate::render;
use crate::render::{BodyBuffers, Gpu, RenderError, Renderer, Samples};
use crate::world::{BodyFrame, PlacedBody};
use serde_json::{Value, json};
use std::time::Instant;

/// The options of every command that draws.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct Args {
    /// Where bodies deform; auto measures both at the start and takes the faster
    #[arg(long, value_enum, default_value = "auto")]
    pub deform: DeformOn,
    /// Both eyes of a screen in one pass; auto where the device has it and is no software device
    #[arg(long, value_enum, default_value = "auto")]
    pub multiview: Multiview,
    /// Shadows: of the bodies on the floor grid (contact); on the bodies too, with ambient occlusion (soft); auto is
    /// contact, and off on a software device
    #[arg(long, value_enum, default_value = "auto")]
    pub shadows: Shadows,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Shadows {
    #[default]
    Auto,
    Off,
    Contact,
    Soft,
}

impl Shadows {
    fn on(self, gpu: &Gpu) -> render::Shadows {
        match self {
            Shadows::Auto if gpu.is_software => render::Shadows::Off,
            Shadows::Auto | Shadows::Contact => render::Shadows::Contact,
            Shadows::Off => render::Shadows::Off,
            Shadows::Soft => render::Shadows::Soft,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum DeformOn {
    #[default]
    Auto,
    Cpu,
    Gpu,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Multiview {
    #[default]
    Auto,
    On,
    Off,
}

impl Args {
    /// Sets the renderer up for both eyes and shadows; an error if the device cannot draw them so.
    pub fn apply(&self, gpu: &Gpu, renderer: &mut Renderer) -> Result<(), RenderError> {
        renderer.shadows = self.shadows.on(gpu);
        self.multiview.apply(gpu, renderer)
    }

    /// The options of a session that is recorded or replayed: the state that is compared frame by frame holds every vertex, so
    /// its bodies deform on the CPU.
    pub fn for_session(mut self, is_recorded: bool) -> Result<Args, Failure> {
        if is_recorded && self.deform == DeformOn::Gpu {
            return Err(Failure::wrong(
                "--deform gpu leaves the vertices on the graphics device, and a recording compares them in every \
                 frame: leave --deform out",
            ));
        }
        if is_recorded {
            self.deform = DeformOn::Cpu;
        }
        Ok(self)
    }
}

impl Multiview {
    fn apply(self, gpu: &Gpu, renderer: &mut Renderer) -> Result<(), RenderError> {
        match self {
            Multiview::Auto => {}
            Multiview::Off => renderer.multiview = false,
            Multiview::On if gpu.can_multiview(renderer.samples) => renderer.multiview = true,
            Multiview::On => {
                let (adapter, samples) = (gpu.adapter_name.clone(), renderer.samples);
                return Err(RenderError::NoMultiview { adapter, samples });
            }
        }
        Ok(())
    }
}

/// Describes the graphics device, for the first lines of a session, with the samples of a pixel if these were not asked for.
pub fn describe(gpu: &Gpu, samples: Samples) -> String {
    let few = match samples {
        Samples::Auto if gpu.is_software => "; 1 sample a pixel (--samples 4 smooths edges)",
        _ => "",
    };
    format!("{}{few}", gpu.describe())
}

/// The place where a body deforms, and why.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    pub on_device: bool,
    pub why: Why,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Why {
    Asked,
    /// The graphics device is software: it computes on the CPU itself, and worse.
    Software,
    /// The columns are more than the graphics device binds at once.
    TooLarge,
    /// The model computes displacements that are no sum of columns.
    Model,
    /// A field is shown, which the CPU computes from the deformed surface.
    Field,
    /// Time of one deformation on the CPU, its upload included, and on the device, s.
    Measured {
        cpu_s: f64,
        device_s: f64,
    },
}

impl Choice {
    /// The faster; the CPU where they are equal.
    pub fn by_time(cpu_s: f64, device_s: f64) -> Choice {
        Choice { on_device: device_s < cpu_s, why: Why::Measured { cpu_s, device_s } }
    }

    /// Words for logs and tables.
    pub fn describe(&self) -> String {
        let place = if self.on_device { "on the graphics device" } else { "on the CPU" };
        match self.why {
            Why::Asked => format!("deforms {place}, as asked for"),
            Why::Software => format!("deforms {place}, since the graphics device is software"),
            Why::TooLarge => {
                format!("deforms {place}, since it is larger than the graphics device can bind at once")
            }
            Why::Model => format!("deforms {place}, where its model computes the shape"),
            Why::Field => format!("deforms {place}, where its colour field is computed"),
            Why::Measured { cpu_s, device_s } => {
                format!("deforms {place}: CPU {} with upload, device {}", seconds(cpu_s), seconds(device_s))
            }
        }
    }

    /// Words of at most 40 letters for the overlay; the chosen place first.
    pub fn brief(&self) -> String {
        let ms = |s: f64| match 1e3 * s {
            ms if ms < 9.995 => format!("{ms:.2}"),
            ms if ms < 99.95 => format!("{ms:.1}"),
            ms => format!("{ms:.0}"),
        };
        let place = if self.on_device { "device" } else { "CPU" };
        match self.why {
            Why::Asked => format!("deforms on {place}, as asked for"),
            Why::Software => format!("deforms on {place}: the device is software"),
            Why::TooLarge => format!("deforms on {place}: too large for device"),
            Why::Model => format!("deforms on {place}: by its model"),
            Why::Field => format!("deforms on {place}: for its colours"),
            Why::Measured { cpu_s, device_s } => match self.on_device {
                true => format!("deforms on device {} ms, CPU {} ms", ms(device_s), ms(cpu_s)),
                false => format!("deforms on CPU {} ms, device {} ms", ms(cpu_s), ms(device_s)),
            },
        }
    }

    pub fn json(&self) -> Value {
        let on = if self.on_device { "device" } else { "cpu" };
        match self.why {
            Why::Asked => json!({ "on": on, "why": "asked" }),
            Why::Software => json!({ "on": on, "why": "software" }),
            Why::TooLarge => json!({ "on": on, "why": "too large" }),
            Why::Model => json!({ "on": on, "why": "model" }),
            Why::Field => json!({ "on": on, "why": "field" }),
            Why::Measured { cpu_s, device_s } => {
                json!({ "on": on, "why": "measured", "cpu_s": cpu_s, "device_s": device_s })
            }
        }
    }
}

/// Words of at most 40 letters for the overlay about where the bodies of a scene deform.
pub fn brief(choices: &[Choice]) -> String {
    match choices {
        [] => String::new(),
        [choice] => choice.brief(),
        several => match several.iter().filter(|choice| choice.on_device).count() {
            0 => format!("{} bodies deform on CPU", several.len()),
            on_device if on_device == several.len() => format!("{on_device} bodies deform on device"),
            on_device => {
                format!("bodies deform: {on_device} on device, {} on CPU", several.len() - on_device)
            }
        },
    }
}

/// The buffers of a body that deforms where it is asked to. On the device, the CPU sums only what can be picked.
pub fn buffers(
    gpu: &Gpu,
    body: &mut PlacedBody,
    shown: &BodyFrame,
    asked: DeformOn,
) -> Result<(BodyBuffers, Choice), RenderError> {
    let colours = body.colours(shown);
    let plain = |body: &PlacedBody| BodyBuffers::new(gpu, body.deformer.drawn_triangles(), &colours);
    let fixed = |on_device, why| Choice { on_device, why };
    let (mut buffers, choice) = match asked {
        _ if body.deformer.has_field() => (plain(body)?, fixed(false, Why::Model)),
        DeformOn::Cpu => (plain(body)?, fixed(false, Why::Asked)),
        DeformOn::Auto if gpu.is_software => (plain(body)?, fixed(false, Why::Software)),
        DeformOn::Gpu => (with_columns(gpu, body, &colours)?, fixed(true, Why::Asked)),
        DeformOn::Auto if shown.colours.is_some() => (plain(body)?, fixed(false, Why::Field)),
        DeformOn::Auto => match with_columns(gpu, body, &colours) {
            Err(RenderError::BufferSize { .. }) => (plain(body)?, fixed(false, Why::TooLarge)),
            made => {
                let mut made = made?;
                let [cpu, device] = measure(gpu, body, &mut made)?;
                let choice = Choice::by_time(cpu, device);
                (if choice.on_device { made } else { plain(body)? }, choice)
            }
        },
    };
    set_pattern(gpu, &mut buffers, body)?;
    if choice.on_device {
        let nodes = body.pickable();
        body.deformer.sum_only_at(nodes);
        deform(gpu, &mut buffers, body)?;
    }
    Ok((buffers, choice))
}

/// The buffers of a body whose surface got other triangles, where it deforms as before.
pub fn remade(
    gpu: &Gpu,
    body: &PlacedBody,
    shown: &BodyFrame,
    on_device: bool,
) -> Result<BodyBuffers, RenderError> {
    let colours = body.colours(shown);
    let mut buffers = match on_device {
        true => with_columns(gpu, body, &colours)?,
        false => BodyBuffers::new(gpu, body.deformer.drawn_triangles(), &colours)?,
    };
    set_pattern(gpu, &mut buffers, body)?;
    Ok(buffers)
}

fn set_pattern(gpu: &Gpu, buffers: &mut BodyBuffers, body: &PlacedBody) -> Result<(), RenderError> {
    buffers.set_pattern(gpu, &body.deformer.drawn(body.deformer.rest().to_vec()), &body.assets.pattern)
}

fn with_columns(gpu: &Gpu, body: &PlacedBody, colours: &[[u8; 4]]) -> Result<BodyBuffers, RenderError> {
    let deformer = &body.deformer;
    let (groups, weights) = (deformer.groups(), deformer.part_weights());
    let triangles = deformer.drawn_triangles();
    let copies = deformer.creases().map_or(&[][..], |creases| &creases.copies);
    BodyBuffers::with_columns(gpu, triangles, colours, deformer.rest(), &groups, weights, copies)
}

/// Deforms the body on the device into its state; false where nothing changed.
pub fn deform(gpu: &Gpu, buffers: &mut BodyBuffers, body: &PlacedBody) -> Result<bool, RenderError> {
    let state = &body.deformer.state;
    buffers.deform(gpu, &state.coefficients, &state.parts)
}

/// Deformations that are timed; one more goes before them.
const TIMED: usize = 3;

/// Median time of one deformation of all columns on the CPU, upload included, and on the device, s. The body is left as
/// it was.
fn measure(gpu: &Gpu, body: &mut PlacedBody, buffers: &mut BodyBuffers) -> Result<[f64; 2], RenderError> {
    let before = body.deformer.state.clone();
    let mut times = [Vec::new(), Vec::new()];
    for round in 0..=TIMED {
        let step = 1e-4 * (round + 1) as f64;
        body.deformer.state.coefficients.fill(step);
        for (on_device, times) in times.iter_mut().enumerate() {
            let started = Instant::now();
            if on_device == 1 {
                deform(gpu, buffers, body)?;
            } else {
                body.deformer.deform();
                buffers.upload(gpu, &body.deformer.drawn_positions(), &body.deformer.normals())?;
            }
            gpu.finish()?;
            if round > 0 {
                times.push(started.elapsed().as_secs_f64());
            }
        }
    }
    body.deformer.state = before;
    body.deformer.deform();
    Ok(times.map(median))
}

#[cfg(test)]
mod tests;
