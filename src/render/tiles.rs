//! Targets drawn tile by tile: a window, or a picture of its size, shows a screen to one eye in a tile, or to both.
//!
//! In come [`Tile`]s with what each eye sees; out go finished targets. One-eye tiles are drawn straight into the target.
//! Two-eye tiles are drawn into two pictures of their own, which are then joined ([`Composite`]). In between, `paint`
//! may draw over each eye's picture: what it writes is then readable in every kind of stereo.
//!
//! [`EyePair`] holds both eyes' pictures of one screen: drawn in one pass where the device has multiview, in two where not.

use super::composite::{Composite, CompositePass, Inputs};
use super::error::RenderError;
use super::frame::FrameContents;
use super::gpu::Gpu;
use super::offscreen::Readback;
use super::renderer::Renderer;
use super::target::{Attachments, Picture, layered};
use super::view::Viewport;
use super::window::spec::Monitor;
use image::RgbaImage;
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::TextureUsages;

/// A rectangle of a target and what it shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// x, y of the top left pixel in the target, width, height.
    pub rect: [u32; 4],
    pub show: Show,
}

/// A viewport's `rect` lies in the eye's own picture: the tile's rectangle, or [`Composite::eye_size`]. What it leaves
/// free stays black.
#[derive(Clone, Debug, PartialEq)]
pub enum Show {
    One(Viewport),
    Two(Composite, [Viewport; 2]),
}

/// One eye's picture of a tile before the two are joined, as `paint` gets it.
#[derive(Clone, Copy)]
pub struct EyePicture<'a> {
    /// [`Target::window`], and the index of the tile in it.
    pub window: usize,
    pub tile: usize,
    /// 1 for the second eye of a two-eye tile.
    pub slot: usize,
    pub texture: &'a wgpu::TextureView,
    pub format: wgpu::TextureFormat,
    /// Size of the whole texture.
    pub texture_size: [u32; 2],
    /// The picture's place in it: x, y, width, height.
    pub rect: [u32; 4],
}

/// Draws over an eye's picture, with separate submissions.
pub type Paint<'a> = &'a mut dyn FnMut(&Gpu, &EyePicture<'_>) -> Result<(), RenderError>;

/// One target of a frame.
pub struct Target<'a> {
    /// The window's number, for `paint`; a window that is hidden has no target.
    pub window: usize,
    pub canvas: &'a mut Canvas,
    pub texture: &'a wgpu::TextureView,
    pub size: [u32; 2],
    /// The top left pixel on the desktop.
    pub desktop: [i32; 2],
    /// Monitors from whose corners interlaced eyes take turns; where none is known, from the desktop's.
    pub monitors: &'a [Monitor],
    pub tiles: &'a [Tile],
    pub contents: &'a FrameContents<'a>,
}

/// The data that a target needs besides its texture; kept from frame to frame, made anew when sizes change.
#[derive(Default)]
pub struct Canvas {
    /// Attachments of one-eye tiles; `None` as long as there are none.
    attachments: Option<Arc<Attachments>>,
    one_eye: Vec<Viewport>,
    /// The pair of each tile; `None` for a one-eye tile.
    pairs: Vec<Option<JoinedPair>>,
}

/// The two eyes' pictures of a tile and how they are joined.
struct JoinedPair {
    pictures: EyePair,
    viewports: [Viewport; 2],
    inputs: Inputs,
}

/// Draws tiles into targets of one format. The pass that joins two eyes is made when the first tile needs it.
pub struct TilePainter {
    format: wgpu::TextureFormat,
    pass: Option<CompositePass>,
}

impl TilePainter {
    pub fn new(format: wgpu::TextureFormat) -> Self {
        Self { format, pass: None }
    }

    /// Draws all targets; returns the time to encode and submit it. Targets that share their contents are drawn together.
    /// Errors: a tile outside its target, a viewport outside its picture, or a device that failed.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        renderer: &mut Renderer,
        targets: &mut [Target<'_>],
        paint: Option<Paint<'_>>,
    ) -> Result<Duration, RenderError> {
        let start = Instant::now();
        for target in targets.iter_mut() {
            self.prepare(gpu, renderer, target)?;
        }
        let mut left: Vec<&Target<'_>> = targets.iter().collect();
        while let Some(contents) = left.first().map(|target| target.contents) {
            let (same, other): (Vec<_>, Vec<_>) =
                left.into_iter().partition(|target| std::ptr::eq(target.contents, contents));
            let pictures: Vec<Picture<'_>> = same.into_iter().flat_map(pictures).collect();
            renderer.draw(gpu, &pictures, contents)?;
            left = other;
        }
        if let Some(paint) = paint {
            for target in targets.iter() {
                self.eye_pictures(target).try_for_each(|picture| paint(gpu, &picture))?;
            }
        }
        self.join(gpu, targets)?;
        Ok(start.elapsed())
    }

    /// Makes what the target's tiles need and is not there in the right size.
    fn prepare(
        &mut self,
        gpu: &Gpu,
        renderer: &Renderer,
        target: &mut Target<'_>,
    ) -> Result<(), RenderError> {
        let Target { canvas, size, tiles, .. } = target;
        canvas.one_eye.clear();
        canvas.pairs.resize_with(tiles.len(), || None);
        for (tile, slot) in tiles.iter().zip(&mut canvas.pairs) {
            tile.check(*size)?;
            match &tile.show {
                Show::One(viewport) => {
                    *slot = None;
                    canvas.one_eye.push(Viewport { rect: within(tile.rect, viewport.rect), ..*viewport });
                }
                Show::Two(composite, viewports) => {
                    if slot.as_ref().is_none_or(|pair| !pair.pictures.fits(renderer, composite.eye_size)) {
                        *slot = Some(self.pair(gpu, renderer, composite.eye_size)?);
                    }
                    if let Some(pair) = slot {
                        pair.viewports = *viewports;
                    }
                }
            }
        }
        let fits = |old: &Arc<Attachments>| [old.width, old.height] == *size;
        if canvas.one_eye.is_empty() {
            canvas.attachments = None;
        } else if !canvas.attachments.as_ref().is_some_and(fits) {
            canvas.attachments = Some(renderer.attachments(gpu, *size, 1)?);
        }
        Ok(())
    }

    fn pair(&mut self, gpu: &Gpu, renderer: &Renderer, size: [u32; 2]) -> Result<JoinedPair, RenderError> {
        let pictures = EyePair::new(gpu, renderer, size, TextureUsages::TEXTURE_BINDING)?;
        let pass = match self.pass.take() {
            Some(pass) => self.pass.insert(pass),
            None => self.pass.insert(CompositePass::new(gpu, self.format)?),
        };
        let inputs = pass.inputs(gpu, [&pictures.eyes[0], &pictures.eyes[1]])?;
        gpu.check()?;
        Ok(JoinedPair { pictures, viewports: [Viewport::full(size, None)[0]; 2], inputs })
    }

    fn eye_pictures<'a>(&self, target: &'a Target<'_>) -> impl Iterator<Item = EyePicture<'a>> + use<'a> {
        let format = self.format;
        let of_tile = move |tile: usize| {
            let whole = EyePicture {
                window: target.window,
                tile,
                slot: 0,
                texture: target.texture,
                format,
                texture_size: target.size,
                rect: target.tiles[tile].rect,
            };
            match &target.canvas.pairs[tile] {
                None => vec![whole],
                Some(pair) => {
                    let [width, height] = pair.pictures.size;
                    let of = |(slot, texture)| EyePicture {
                        slot,
                        texture,
                        texture_size: pair.pictures.size,
                        rect: [0, 0, width, height],
                        ..whole
                    };
                    pair.pictures.eyes.iter().enumerate().map(of).collect()
                }
            }
        };
        (0..target.tiles.len()).flat_map(of_tile)
    }

    /// Joins the eyes of all two-eye tiles.
    fn join(&self, gpu: &Gpu, targets: &[Target<'_>]) -> Result<(), RenderError> {
        let Some(pass) = &self.pass else { return Ok(()) };
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        for target in targets.iter().filter(|target| target.canvas.pairs.iter().any(Option::is_some)) {
            let is_drawn = target.canvas.attachments.is_some();
            let load = if is_drawn { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(wgpu::Color::BLACK) };
            let mut render = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("composite"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: target.texture,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
                })],
                ..Default::default()
            });
            for (tile, pair) in target.tiles.iter().zip(&target.canvas.pairs) {
                if let (Show::Two(composite, _), Some(pair)) = (&tile.show, pair) {
                    let corner = on_panel(target, tile.rect);
                    pass.draw(gpu, &mut render, &pair.inputs, composite, tile.rect, corner);
                }
            }
        }
        gpu.queue.submit([encoder.finish()]);
        gpu.check()
    }
}

impl Tile {
    /// Whether it depends on the place of its target on the desktop.
    pub(super) fn takes_turns(&self) -> bool {
        matches!(&self.show, Show::Two(composite, _) if composite.turns != [0, 0])
    }

    fn check(&self, [width, height]: [u32; 2]) -> Result<(), RenderError> {
        let rect @ [x, y, w, h] = self.rect;
        let fits = |start: u32, length: u32, limit: u32| {
            length > 0 && u64::from(start) + u64::from(length) <= u64::from(limit)
        };
        if fits(x, w, width) && fits(y, h, height) {
            Ok(())
        } else {
            Err(RenderError::ViewportOutside { rect, width, height })
        }
    }
}

/// Place of a tile's top left pixel on the monitor that shows most of it: a panel polarises its own rows.
fn on_panel(target: &Target<'_>, rect: [u32; 4]) -> [i32; 2] {
    let corner = [0, 1].map(|axis| target.desktop[axis].saturating_add_unsigned(rect[axis]));
    let shown = |monitor: &&Monitor| -> i64 {
        let along = |axis: usize| {
            let end = |start: i32, length: u32| i64::from(start) + i64::from(length);
            let last = end(corner[axis], rect[axis + 2]).min(end(monitor.at[axis], monitor.size[axis]));
            (last - i64::from(corner[axis].max(monitor.at[axis]))).max(0)
        };
        along(0) * along(1)
    };
    let panel = target.monitors.iter().filter(|monitor| shown(monitor) > 0).max_by_key(shown);
    panel.map_or(corner, |panel| [0, 1].map(|axis| corner[axis].wrapping_sub(panel.at[axis])))
}

/// A rectangle given in a tile, in the tile's target.
fn within([left, top, ..]: [u32; 4], [x, y, width, height]: [u32; 4]) -> [u32; 4] {
    [left.saturating_add(x), top.saturating_add(y), width, height]
}

/// The pictures to draw for one target: its one-eye tiles together, and both eyes of the others.
fn pictures<'a>(target: &'a Target<'_>) -> Vec<Picture<'a>> {
    let Canvas { attachments, one_eye, pairs } = &*target.canvas;
    let whole = attachments.iter().map(|attachments| Picture {
        attachments,
        texture: target.texture,
        viewports: one_eye,
    });
    let eyes = pairs.iter().flatten().flat_map(|pair| pair.pictures.pictures(&pair.viewports));
    whole.chain(eyes).collect()
}

/// Two pictures of one size, plain and two-dimensional, and equal in both ways of drawing. In one pass every vertex is
/// fetched once and every command is recorded once for both eyes; each eye's picture is then a layer of one texture.
pub struct EyePair {
    pub size: [u32; 2],
    /// Each eye's picture by itself.
    pub eyes: [wgpu::TextureView; 2],
    /// Both as layers of one texture, for one pass; None where they are drawn one after the other.
    both: Option<wgpu::TextureView>,
    attachments: Arc<Attachments>,
    /// One texture of two layers, or two textures: some software drivers resolve samples into the wrong layer of an array when
    /// its layers are drawn in separate passes.
    textures: Vec<wgpu::Texture>,
}

impl EyePair {
    /// The usage of a pair that is only drawn into.
    pub const NO_OTHER_USAGE: TextureUsages = TextureUsages::empty();

    /// Makes a pair for `renderer`, drawn in one pass if its `multiview` says so. `usage` is added to that of a target.
    /// Errors: as [`Attachments::new`].
    pub fn new(
        gpu: &Gpu,
        renderer: &Renderer,
        size: [u32; 2],
        usage: TextureUsages,
    ) -> Result<Self, RenderError> {
        let layers = if renderer.multiview { 2 } else { 1 };
        let attachments = renderer.attachments(gpu, size, layers)?;
        let usage = usage | TextureUsages::RENDER_ATTACHMENT;
        let textures: Vec<_> =
            (0..2 / layers).map(|_| layered(gpu, size, layers, renderer.format, 1, usage)).collect();
        let whole = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let layer = |base_array_layer| wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer,
            array_layer_count: Some(1),
            ..Default::default()
        };
        let (eyes, both) = match textures.as_slice() {
            [left, right] => ([whole(left), whole(right)], None),
            both => ([0, 1].map(|eye| both[0].create_view(&layer(eye))), Some(whole(&both[0]))),
        };
        gpu.check()?;
        Ok(Self { size, eyes, both, attachments, textures })
    }

    /// A pair that can be read back: see [`EyePair::read`].
    /// Errors: as [`EyePair::new`].
    pub fn readable(gpu: &Gpu, renderer: &Renderer, size: [u32; 2]) -> Result<Self, RenderError> {
        Self::new(gpu, renderer, size, TextureUsages::COPY_SRC)
    }

    /// Whether a pair of this size would be made for `renderer` as this one was.
    pub(super) fn fits(&self, renderer: &Renderer, size: [u32; 2]) -> bool {
        self.size == size && self.is_one_pass() == renderer.multiview
    }

    pub fn is_one_pass(&self) -> bool {
        self.both.is_some()
    }

    /// The pictures to draw: one with both eyes, or one for each. Both viewports have one rectangle.
    pub fn pictures<'a>(&'a self, viewports: &'a [Viewport; 2]) -> Vec<Picture<'a>> {
        let attachments = &*self.attachments;
        match &self.both {
            Some(texture) => vec![Picture { attachments, texture, viewports }],
            None => {
                let alone = viewports.chunks_exact(1);
                let eyes = self.eyes.iter().zip(alone);
                eyes.map(|(texture, viewports)| Picture { attachments, texture, viewports }).collect()
            }
        }
    }

    /// Reads the picture of eye 0 or 1 of a readable pair, as drawn by everything submitted so far.
    /// Errors: [`RenderError::Device`] when the device failed or was lost, [`RenderError::BufferSize`] beyond its limits.
    pub fn read(&self, gpu: &Gpu, eye: usize) -> Result<RgbaImage, RenderError> {
        let (texture, layer) = match self.textures.as_slice() {
            [left, right] => ([left, right][eye], 0),
            both => (&both[0], eye as u32),
        };
        Readback::new(gpu, self.size)?.read(gpu, texture, layer)
    }
}
