//! Chooses the views: which tiles each picture has, and from where each is seen.
//!
//! In: a world after a frame, and the sizes of the pictures. Out: what each picture shows of it, as [`Tile`]s with off-axis views. A
//! headset or a render node is one more `impl`: it asks for its own views of the same frame.

use super::bodies::{GpuBodies, contents};
use super::presenter::Presenter;
use super::stage_model::Camera;
use super::window_layout;
use crate::render::window::PresentTimes;
use crate::render::{RenderError, Show, Tile, Viewport};
use crate::stage::{Stage, Window};
use crate::world::World;

/// Chooses which tiles each picture has, and from where each is seen.
pub trait ViewSource {
    /// The tiles of each picture, now of these sizes in pixels.
    fn tiles(&self, world: &World, sizes: &[[u32; 2]]) -> Vec<Vec<Tile>>;
}

/// The screens of a stage, each seen off-axis by the eyes of the tracked head.
pub struct Screens {
    /// A window for each picture.
    pub layout: Vec<Window>,
    /// Whether each eye is shown what the other should see.
    pub swapped: bool,
}

impl Screens {
    /// The stage's own windows.
    pub fn new(stage: &Stage) -> Screens {
        Screens { layout: stage.layout(), swapped: stage.swap_eyes }
    }
}

impl ViewSource for Screens {
    fn tiles(&self, world: &World, sizes: &[[u32; 2]]) -> Vec<Vec<Tile>> {
        let windows = self.layout.iter().zip(sizes);
        windows.map(|(window, size)| window_layout::tiles(world, window, *size, self.swapped)).collect()
    }
}

/// A camera that looks at the room shows one eye's view of it in every picture.
impl ViewSource for Camera {
    fn tiles(&self, _: &World, sizes: &[[u32; 2]]) -> Vec<Vec<Tile>> {
        let of = |size: &[u32; 2]| {
            let view = self.view(f64::from(size[0]) / f64::from(size[1].max(1)));
            let tile =
                Tile { rect: [0, 0, size[0], size[1]], show: Show::One(Viewport::full(*size, view)[0]) };
            if size.contains(&0) { Vec::new() } else { vec![tile] }
        };
        sizes.iter().map(of).collect()
    }
}

/// Shows a frame of the world as `source` sees it, with nothing written over it: all that a presenter of one's own needs in a frame.
pub fn show(
    world: &World,
    bodies: &mut GpuBodies,
    source: &dyn ViewSource,
    presenter: &mut dyn Presenter,
) -> Result<PresentTimes, RenderError> {
    bodies.upload(presenter.gpu(), world)?;
    let tiles = source.tiles(world, &presenter.sizes());
    let instances = bodies.instances(world);
    let contents = contents(world, &instances);
    presenter.present(&tiles, &vec![&contents; tiles.len()], None)
}
