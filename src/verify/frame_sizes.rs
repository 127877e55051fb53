//! Frames by the size of the model, with bodies deformed on the CPU and on the device.
//!
//! Each body is a generated tube with 24 columns, whose surface nodes are the size, drawn for both eyes on every screen of a
//! stage. It needs no offline stage. All coefficients change in every frame.

use crate::base::columns::{ColumnGroup, Storage, StoredColumns};
use crate::base::failure::Failure;
use crate::base::statistics::median;
use crate::deform::{Places, Superposition, SurfaceNormals};
use crate::green::FIELDS;
use crate::render::{
    BodyBuffers, BodyInstance, DrawCounts, EyePair, FrameContents, Gpu, Pattern, Renderer, View, Viewport,
};
use crate::stage::{Eye, NEAR_M, Stage};
use nalgebra::Point3;
use std::f32::consts::TAU;
use std::time::Instant;

/// Control elements, of twelve columns each.
pub const ELEMENTS: usize = 2;

/// An open tube along x, 1 m long, of about the nodes asked for, and its stored columns.
struct Tube {
    rest: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    stored: Vec<StoredColumns>,
}

impl Tube {
    fn new(nodes: usize, storage: Storage) -> Tube {
        let around = ((nodes as f64 / 1.6).sqrt() as usize).max(3);
        let along = nodes.div_ceil(around).max(2);
        let place = |i: usize| {
            let (sin, cos) = (TAU * (i % around) as f32 / around as f32).sin_cos();
            [(i / around) as f32 / (along - 1) as f32 - 0.5, 0.1 * cos, 0.1 * sin]
        };
        let rest: Vec<[f32; 3]> = (0..around * along).map(place).collect();
        let cell = |i: usize| {
            let next = i / around * around + (i + 1) % around;
            [[i, i + around, next], [next, i + around, next + around]].map(|t| t.map(|node| node as u32))
        };
        let triangles = (0..around * (along - 1)).flat_map(cell).collect();
        let column = |e: usize, k: usize| -> Vec<f64> {
            let share = |x: f64| if e == 0 { 0.5 - x } else { 0.5 + x };
            let number = |x: [f64; 3], axis: usize| match k {
                0..3 if axis == k => share(x[0]),
                3.. if axis == (k - 3) / 3 => share(x[0]) * x[(k - 3) % 3],
                _ => 0.0,
            };
            rest.iter().flat_map(|x| [0, 1, 2].map(|axis| number(x.map(f64::from), axis))).collect()
        };
        let stored = (0..ELEMENTS)
            .map(|e| StoredColumns::new(storage, &(0..FIELDS).map(|k| column(e, k)).collect::<Vec<_>>()))
            .collect();
        Tube { rest, triangles, stored }
    }

    fn groups(&self) -> Vec<ColumnGroup<'_>> {
        self.stored.iter().map(StoredColumns::group).collect()
    }
}

/// Time of the parts of one frame, s.
#[derive(Clone, Copy, Default)]
pub struct Parts {
    pub deform_s: f64,
    pub normals_s: f64,
    pub upload_s: f64,
    pub draw_s: f64,
}

/// Measurement of one size, with bodies deformed on the CPU or on the device.
pub struct Row {
    pub nodes: usize,
    pub on_device: bool,
    /// The median of each part.
    pub parts: Parts,
    /// Median of the sum.
    pub frame_s: f64,
    pub counts: DrawCounts,
    pub buffer_bytes: u64,
}

/// Settings of the measurement.
pub struct Request<'a> {
    /// Surface nodes of each body.
    pub sizes: &'a [usize],
    pub storage: Storage,
    /// Frames for each figure.
    pub frames: usize,
    /// Whether bodies deform on the device, in turn.
    pub on_device: &'a [bool],
    pub stage: &'a Stage,
}

/// Measures all sizes, wherever the bodies may deform; also the bytes of depth and samples, and if every target had its own.
pub fn measure(
    gpu: &Gpu,
    renderer: &mut Renderer,
    request: &Request<'_>,
) -> Result<(Vec<Row>, [u64; 2]), Failure> {
    let stage = request.stage;
    let views = views(stage);
    let pairs: Vec<EyePair> = stage
        .screens
        .iter()
        .map(|screen| EyePair::readable(gpu, renderer, screen.pixels))
        .collect::<Result<_, _>>()?;
    let attachments = renderer.attachment_bytes();
    let mut rows = Vec::new();
    for &size in request.sizes {
        let tube = Tube::new(size, request.storage);
        for &on_device in request.on_device {
            let before = gpu.made.buffer_bytes();
            let mut bench = Bench::new(gpu, &tube, on_device)?;
            let buffer_bytes = gpu.made.buffer_bytes() - before;
            let mut frames = Vec::new();
            for frame in 0..=request.frames {
                let time = bench.frame(gpu, renderer, stage, &pairs, &views, frame)?;
                frames.extend((frame > 0).then_some(time));
            }
            let median = |pick: fn(&Parts) -> f64| median(frames.iter().map(pick));
            let parts = Parts {
                deform_s: median(|p| p.deform_s),
                normals_s: median(|p| p.normals_s),
                upload_s: median(|p| p.upload_s),
                draw_s: median(|p| p.draw_s),
            };
            let frame_s = median(|p| p.deform_s + p.normals_s + p.upload_s + p.draw_s);
            let (nodes, counts) = (tube.rest.len(), renderer.counts);
            rows.push(Row { nodes, on_device, parts, frame_s, counts, buffer_bytes });
        }
    }
    Ok((rows, attachments))
}

/// Both eyes' views of every screen.
fn views(stage: &Stage) -> Vec<[Option<View>; 2]> {
    let view = |screen: usize, eye: Eye| {
        let place = stage.viewer.eye_in_room(&stage.viewer.room_from_head, eye);
        let view = stage.screens[screen].view(&place, NEAR_M).ok()?;
        Some(View { clip_from_room: view.clip_from_room, eye_in_room: view.eye_in_room })
    };
    (0..stage.screens.len()).map(|screen| [Eye::Left, Eye::Right].map(|eye| view(screen, eye))).collect()
}

/// One body, and what deforms it.
struct Bench<'a> {
    tube: &'a Tube,
    buffers: BodyBuffers,
    sum: Superposition,
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    surface_normals: SurfaceNormals,
    u: Vec<[f32; 3]>,
}

impl<'a> Bench<'a> {
    fn new(gpu: &Gpu, tube: &'a Tube, on_device: bool) -> Result<Bench<'a>, Failure> {
        let colors = vec![[96, 142, 186, 0]; tube.rest.len()];
        let groups = tube.groups();
        let mut buffers = if on_device {
            BodyBuffers::with_columns(gpu, &tube.triangles, &colors, &tube.rest, &groups, None, &[])?
        } else {
            BodyBuffers::new(gpu, &tube.triangles, &colors)?
        };
        // As scenes have it.
        let pattern = Pattern { line_spacing_m: Some(0.05), ..Pattern::default() };
        buffers.set_pattern(gpu, &tube.rest, &pattern)?;
        let nodes = tube.rest.len();
        Ok(Bench {
            tube,
            buffers,
            sum: Superposition::new(&groups, nodes),
            positions: tube.rest.clone(),
            normals: vec![[0.0; 3]; nodes],
            surface_normals: SurfaceNormals::new(&tube.triangles, nodes),
            u: vec![[0.0; 3]; nodes],
        })
    }

    fn frame(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        stage: &Stage,
        pairs: &[EyePair],
        views: &[[Option<View>; 2]],
        frame: usize,
    ) -> Result<Parts, Failure> {
        let c: Vec<f64> = (0..ELEMENTS)
            .flat_map(|e| (0..FIELDS).map(move |k| 0.1 * ((frame * 5 + 3 * k + e) as f64 * 0.3).sin()))
            .collect();
        let mut parts = Parts::default();
        gpu.read_clock()?;
        if self.buffers.is_deformed_here() {
            let started = Instant::now();
            self.buffers.deform(gpu, &c, &[])?;
            gpu.finish()?;
            parts.deform_s = started.elapsed().as_secs_f64();
            // Both passes are done: the clock tells how the time splits.
            let spans = gpu.read_clock()?;
            if let Some((_, normals_s)) = spans.iter().find(|(name, _)| *name == "normals") {
                parts.normals_s = normals_s.min(parts.deform_s);
                parts.deform_s -= parts.normals_s;
            }
        } else {
            self.deform_on_cpu(&c, &mut parts);
            let started = Instant::now();
            self.buffers.upload(gpu, &self.positions, &self.normals)?;
            gpu.finish()?;
            parts.upload_s = started.elapsed().as_secs_f64();
        }
        let (low, high) = (Point3::new(-0.5, -0.1, -0.1), Point3::new(0.5, 0.1, 0.1));
        let place = stage.workspace.room_from_body(low, high).map(|place| place.to_homogeneous().cast());
        let room_from_body = place.unwrap_or_else(nalgebra::Matrix4::identity);
        let bodies = [BodyInstance { buffers: &self.buffers, room_from_body }];
        let contents = FrameContents { bodies: &bodies, ..Default::default() };
        let viewports: Vec<[Viewport; 2]> = pairs
            .iter()
            .zip(views)
            .map(|(pair, views)| views.map(|view| Viewport::full(pair.size, view)[0]))
            .collect();
        let pictures: Vec<_> =
            pairs.iter().zip(&viewports).flat_map(|(pair, viewports)| pair.pictures(viewports)).collect();
        let started = Instant::now();
        renderer.draw(gpu, &pictures, &contents)?;
        gpu.wait()?;
        parts.draw_s = started.elapsed().as_secs_f64();
        Ok(parts)
    }

    fn deform_on_cpu(&mut self, c: &[f64], parts: &mut Parts) {
        let started = Instant::now();
        let places = Places { rest: &self.tube.rest, positions: &mut self.positions };
        self.sum.update_places(&self.tube.groups(), c, &mut self.u, places);
        parts.deform_s = started.elapsed().as_secs_f64();
        let started = Instant::now();
        self.surface_normals.write(&self.positions, &self.tube.triangles, &mut self.normals);
        parts.normals_s = started.elapsed().as_secs_f64();
    }
}
