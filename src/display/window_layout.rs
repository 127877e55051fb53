//! Lays out the windows of a stage: the tiles with the view of each eye, the screen under the cursor, and the parts that the
//! drawing of one frame needs ([`WindowFrame`]).

use super::bodies::GpuBodies;
use super::presenter::Presenter;
use crate::render::window::{MonitorChoice, WindowSpec};
use crate::render::{Anaglyph, BodyInstance, Composite, EyePicture, Show, Tile, View, Viewport};
use crate::session::Session;
use crate::stage;
use crate::stage::{Border, Eye, MonitorId, NEAR_M, Screen, Stage, Stereo, Visible, Window};
use crate::world::World;
use egui::{Pos2, Rect, pos2, vec2};
use nalgebra::Isometry3;

/// The composite that joins both eyes' pictures of a tile; `None` where it shows one eye.
pub fn composite(stereo: Stereo, size: [u32; 2]) -> Option<Composite> {
    Some(match stereo {
        Stereo::SideBySide | Stereo::SideBySideHalf => Composite::side_by_side(size),
        Stereo::TopBottom | Stereo::TopBottomHalf => Composite::top_bottom(size),
        Stereo::FramePacking => Composite::frame_packing(size),
        Stereo::Anaglyph => Composite::anaglyph(size, Anaglyph::COLOUR),
        Stereo::AnaglyphGrey => Composite::anaglyph(size, Anaglyph::GREY),
        Stereo::AnaglyphHalfColour => Composite::anaglyph(size, Anaglyph::HALF_COLOUR),
        Stereo::AnaglyphDubois => Composite::anaglyph(size, Anaglyph::DUBOIS),
        Stereo::Rows => Composite::interlaced(size, [0, 1]),
        Stereo::Columns => Composite::interlaced(size, [1, 0]),
        Stereo::Checkerboard => Composite::interlaced(size, [1, 1]),
        Stereo::Separate | Stereo::Mono | Stereo::Left | Stereo::Right => return None,
    })
}

/// The windows to be opened, at `scale` times their places and sizes.
pub fn specs(stage: &Stage, windows: &[Window], scale: f64) -> Vec<WindowSpec> {
    let spec = |window: &Window| WindowSpec {
        title: format!("greenstage – {} – {}", stage.name, window.name),
        monitor: window.monitor.clone().map(|id| match id {
            MonitorId::Number(number) => MonitorChoice::Number(number),
            MonitorId::Name(name) => MonitorChoice::Name(name),
        }),
        position: window.at.map(|at| moved(at, scale)),
        size: scaled(window.size, scale),
        fills: window.fills && scale == 1.0,
        decorated: window.border == Border::Decorated,
        fullscreen: window.border == Border::FullScreen && scale == 1.0,
        unmanaged: window.border == Border::Unmanaged,
    };
    windows.iter().map(spec).collect()
}

/// A place on the desktop, at `scale` times its coordinates.
pub fn moved(at: [i32; 2], scale: f64) -> [i32; 2] {
    at.map(|pixel| (f64::from(pixel) * scale).round() as i32)
}

pub fn scaled(size: [u32; 2], scale: f64) -> [u32; 2] {
    size.map(|pixels| ((f64::from(pixels) * scale).round() as u32).max(1))
}

/// The tiles of a window of `size` pixels; with `swapped` each eye gets the other's picture. Tiles and eyes for which the window
/// has become too small are left out.
pub fn tiles(world: &World, window: &Window, size: [u32; 2], swapped: bool) -> Vec<Tile> {
    shown(window, size, &mut |tile, eye_size, eye| viewport(world, tile, eye_size, seen(tile, eye, swapped)))
}

/// The tiles of a window that shows both eyes one picture: `view` makes it for a ratio of width to height, or nothing.
pub fn flat_tiles(
    stage: &Stage,
    window: &Window,
    size: [u32; 2],
    view: impl Fn(f64) -> Option<View>,
) -> Vec<Tile> {
    shown(window, size, &mut |tile, eye_size, _| {
        let screen = &stage.screens[tile.screen];
        match tile.visible(screen, eye_size) {
            Some(visible) => Viewport { rect: visible.rect, view: view(aspect(screen, &visible)) },
            None => Viewport { rect: [0, 0, eye_size[0], eye_size[1]], view: None },
        }
    })
}

/// Width to height on the screen of the part that is visible.
pub fn aspect(screen: &Screen, Visible { on_screen: [left, right, bottom, top], .. }: &Visible) -> f64 {
    screen.width_m() * (right - left) / (screen.height_m() * (top - bottom))
}

/// Both eyes' viewports of every tile, from the tile, the size of an eye's picture, and the eye.
fn shown(
    window: &Window,
    size: [u32; 2],
    viewport: &mut dyn FnMut(&stage::Tile, [u32; 2], Eye) -> Viewport,
) -> Vec<Tile> {
    let mut of_tile = |tile: &stage::Tile| {
        let (rect, composite, eye_size) = drawn(window, tile, size)?;
        let mut viewport = |eye: Eye| viewport(tile, eye_size, eye);
        let show = match (composite, tile.stereo.eyes()) {
            (Some(composite), _) => Show::Two(composite, [viewport(Eye::Left), viewport(Eye::Right)]),
            (None, eyes) => Show::One(viewport(*eyes.first()?)),
        };
        Some(Tile { rect, show })
    };
    window.tiles.iter().filter_map(&mut of_tile).collect()
}

/// The part of a screen that an eye's picture shows.
pub struct Part {
    pub screen: usize,
    /// The eye to which it is shown.
    pub eye: Eye,
    /// Pixels of the picture's texture.
    pub rect: Rect,
    pub visible: Visible,
}

impl Part {
    /// The pixel at these normalised device coordinates of the whole screen (x right, y up, -1 to 1).
    pub fn pixel(&self, [x, y]: [f64; 2]) -> Pos2 {
        let [left, right, bottom, top] = self.visible.on_screen;
        let share = [(x - left) / (right - left), (top - y) / (top - bottom)].map(|share| share as f32);
        self.rect.min + vec2(share[0] * self.rect.width(), share[1] * self.rect.height())
    }

    /// Pixels of rectangles: left, right, bottom and top in normalised device coordinates of the whole screen.
    pub fn pixels(&self, rects: &[[f64; 4]]) -> Vec<Rect> {
        let pixels = |[left, right, bottom, top]: &[f64; 4]| {
            Rect::from_min_max(self.pixel([*left, *top]), self.pixel([*right, *bottom]))
        };
        rects.iter().map(pixels).collect()
    }
}

/// The part of the room that a picture of `window`, now of `size` pixels, shows.
pub fn part(
    stage: &Stage,
    window: &Window,
    size: [u32; 2],
    picture: &EyePicture<'_>,
    swapped: bool,
) -> Option<Part> {
    let tile = window.tiles.iter().filter(|tile| drawn(window, tile, size).is_some()).nth(picture.tile)?;
    let eye = *tile.stereo.eyes().get(picture.slot)?;
    let [left, top, width, height] = picture.rect;
    let visible = tile.visible(&stage.screens[tile.screen], [width, height])?;
    let [x, y, width, height] = visible.rect.map(|pixels| pixels as f32);
    let rect = Rect::from_min_size(pos2(left as f32 + x, top as f32 + y), vec2(width, height));
    Some(Part { screen: tile.screen, eye: seen(tile, eye, swapped), rect, visible })
}

/// The view of the room in a part of a picture; `None` where the eye sees nothing of its screen.
pub fn view_of(stage: &Stage, room_from_head: &Isometry3<f64>, part: &Part) -> Option<View> {
    let eye = stage.viewer.eye_in_room(room_from_head, part.eye);
    let view = stage.screens[part.screen].view(&eye, NEAR_M).ok()?;
    Some(through(&part.visible, View { clip_from_room: view.clip_from_room, eye_in_room: view.eye_in_room }))
}

/// The eye whose picture stands in `eye`'s place. If the tile and all windows swap the eyes, both are where they were.
fn seen(tile: &stage::Tile, eye: Eye, swapped: bool) -> Eye {
    if swapped != tile.swap_eyes { eye.other() } else { eye }
}

/// A tile's rectangle in its window, how its eyes are joined, and their pictures' size; `None` without pixels.
fn drawn(
    window: &Window,
    tile: &stage::Tile,
    size: [u32; 2],
) -> Option<([u32; 4], Option<Composite>, [u32; 2])> {
    let rect = window.rect(tile, size);
    let composite = composite(tile.stereo, [rect[2], rect[3]]);
    let eye_size = composite.map_or([rect[2], rect[3]], |composite| composite.eye_size);
    (!eye_size.contains(&0)).then_some((rect, composite, eye_size))
}

/// An eye's view of the part of the screen that the tile shows.
fn viewport(world: &World, tile: &stage::Tile, eye_size: [u32; 2], eye: Eye) -> Viewport {
    let [width, height] = eye_size;
    let Some(visible) = tile.visible(&world.assets.stage.screens[tile.screen], eye_size) else {
        return Viewport { rect: [0, 0, width, height], view: None };
    };
    Viewport { rect: visible.rect, view: world.view(tile.screen, eye).map(|view| through(&visible, view)) }
}

/// The view of a whole screen cut to the part of it that is drawn.
fn through(visible: &Visible, view: View) -> View {
    let clip_from_room = visible.clip_from_whole() * view.clip_from_room.cast::<f64>();
    View { clip_from_room: clip_from_room.cast(), ..view }
}

/// The screen under the cursor and the place on it (x right, y up, -1 to 1), from a place in the window as a share of
/// its width and height. Beyond the window, the nearest tile's screen goes on.
pub fn at_cursor(
    stage: &Stage,
    window: &Window,
    size: [u32; 2],
    position: [f64; 2],
) -> Option<(usize, [f64; 2])> {
    let pixel = [position[0] * f64::from(size[0]), position[1] * f64::from(size[1])];
    let away = |rect: [u32; 4]| -> f64 {
        let beyond = |axis: usize| {
            let (low, high) = (f64::from(rect[axis]), f64::from(rect[axis]) + f64::from(rect[axis + 2]));
            (low - pixel[axis]).max(pixel[axis] - high).max(0.0)
        };
        beyond(0) + beyond(1)
    };
    let rects = window.tiles.iter().map(|tile| (tile, window.rect(tile, size)));
    let (tile, rect) = rects.min_by(|(_, a), (_, b)| away(*a).total_cmp(&away(*b)))?;
    let mut at = [0, 1].map(|axis| pixel[axis] - f64::from(rect[axis]));
    let mut eye_size = [rect[2], rect[3]];
    if let Some(Composite { eye_size: half, second, .. }) = composite(tile.stereo, eye_size) {
        eye_size = half;
        // Beside or above each other, each eye's picture is the whole screen.
        for axis in 0..2 {
            if second[axis] > 0 && at[axis] >= f64::from(second[axis]) {
                at[axis] -= f64::from(second[axis]);
            }
        }
    }
    let visible = tile.visible(&stage.screens[tile.screen], eye_size)?;
    let [x, y, width, height] = visible.rect.map(f64::from);
    let ndc = [2.0 * (at[0] - x) / width - 1.0, 1.0 - 2.0 * (at[1] - y) / height];
    Some((tile.screen, visible.on_whole(ndc)))
}

/// One frame on its way to the eye.
pub struct WindowFrame<'a> {
    pub presenter: &'a mut dyn Presenter,
    pub session: &'a mut Session,
    pub bodies: &'a mut GpuBodies,
    /// A body that is shown in place of the scene's, while control elements are made on it.
    pub edited: Option<BodyInstance<'a>>,
    /// The window with the panel, and its pixels that panel and messages take.
    pub covered: (usize, Vec<Rect>),
    /// Time from the frame before to this one, s.
    pub step_s: f64,
    /// Time that reading trackers took, s.
    pub track_s: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cursor(stereo: Stereo, position: [f64; 2]) -> [f64; 2] {
        let stage = Stage { stereo, ..Stage::find("desktop").unwrap() };
        let window = &stage.layout()[0];
        let (screen, ndc) = at_cursor(&stage, window, scaled(window.size, 0.5), position).unwrap();
        assert_eq!(screen, 0);
        ndc.map(|x| (x * 1e6).round() / 1e6)
    }

    #[test]
    fn the_cursor_points_at_the_same_place_in_either_eyes_picture() {
        assert_eq!(cursor(Stereo::Mono, [0.75, 0.25]), [0.5, 0.5]);
        assert_eq!(cursor(Stereo::Anaglyph, [0.75, 0.25]), [0.5, 0.5]);
        assert_eq!(cursor(Stereo::SideBySide, [0.375, 0.25]), [0.5, 0.5]);
        assert_eq!(cursor(Stereo::SideBySide, [0.875, 0.25]), [0.5, 0.5]);
        assert_eq!(cursor(Stereo::TopBottomHalf, [0.75, 0.625]), [0.5, 0.5]);
        assert_eq!(cursor(Stereo::Mono, [1.25, 0.5]), [1.5, 0.0], "a drag leaves the window");
    }
    /// Screen and eye of each picture, tile by tile.
    fn eyes(stage: &Stage, swapped: bool) -> Vec<(String, Eye)> {
        let window = &stage.layout()[0];
        let mut eyes = Vec::new();
        shown(window, window.size, &mut |tile, [width, height], eye| {
            eyes.push((stage.screens[tile.screen].name.clone(), seen(tile, eye, swapped)));
            Viewport { rect: [0, 0, width, height], view: None }
        });
        eyes
    }

    #[test]
    fn a_projector_that_swaps_the_eyes_is_swapped_back_when_all_are() {
        use Eye::{Left, Right};
        let named = |eyes: [(&str, Eye); 4]| eyes.map(|(screen, eye)| (screen.to_owned(), eye));
        let stage = Stage::find("lbench").unwrap();
        let expected = [("front", Right), ("front", Left), ("table", Left), ("table", Right)];
        assert_eq!(eyes(&stage, false), named(expected), "the upper half comes first");
        let expected = [("front", Left), ("front", Right), ("table", Right), ("table", Left)];
        assert_eq!(eyes(&stage, true), named(expected));
    }

    /// A tile that shows part of a screen of which some is hidden: every place of the screen is on the pixel that it
    /// has on the whole one, moved by the crop.
    #[test]
    fn a_cropped_and_overscanned_tile_keeps_each_place_on_its_pixel() {
        let stage = Stage::find("desktop").unwrap();
        let screen = &stage.screens[0];
        let [crop, overscan] = [[100, 50, 640, 400], [110, 0, 0, 360]];
        let tile = stage::Tile { crop, overscan, ..stage::Tile::whole(&stage, 0, Stereo::Mono) };
        let window = Window { size: [640, 400], tiles: vec![tile], ..stage.layout()[0].clone() };
        let window = &Window {
            tiles: vec![stage::Tile { rect: [0, 0, 640, 400], ..window.tiles[0].clone() }],
            ..window
        };
        let eye = nalgebra::Point3::from(stage.viewer.room_from_head.translation.vector);
        let seen = screen.view(&eye, 0.05).unwrap();
        let view = View { clip_from_room: seen.clip_from_room, eye_in_room: seen.eye_in_room };
        let visible = window.tiles[0].visible(screen, [640, 400]).unwrap();
        // Ten columns at the left and ten rows at the bottom are hidden.
        assert_eq!(visible.rect, [10, 0, 630, 390]);
        let [columns, rows] = screen.pixels.map(f64::from);
        for pixel in [[111.0, 51.0], [400.0, 200.0], [739.0, 438.0]] {
            let place = screen.point([2.0 * pixel[0] / columns - 1.0, 1.0 - 2.0 * pixel[1] / rows]);
            let clip = through(&visible, view).clip_from_room * place.cast::<f32>().to_homogeneous();
            let [x, y, width, height] = visible.rect.map(|pixels| pixels as f32);
            let drawn =
                [x + (clip.x / clip.w + 1.0) / 2.0 * width, y + (1.0 - clip.y / clip.w) / 2.0 * height];
            let expected = [pixel[0] as f32 - 100.0, pixel[1] as f32 - 50.0];
            assert!((0..2).all(|k| (drawn[k] - expected[k]).abs() < 1e-3), "{drawn:?} is not {expected:?}");
        }
    }
}
