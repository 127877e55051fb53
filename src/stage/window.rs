//! Windows: where on the desktop each stands, and which part of which screen it shows to which eye.
//!
//! In: a checked [`Stage`]. Out: its [`Window`]s, each of one [`Tile`] or more, and for each tile the part of its
//! screen that is to be drawn ([`Tile::visible`]).

use super::{Eye, Screen, Stage, Stereo};
use nalgebra::Matrix4;

/// A window on the desktop, in physical pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    pub name: String,
    /// Top left corner on the desktop that spans all monitors, or on `monitor`; None leaves it to the window manager.
    pub at: Option<[i32; 2]>,
    pub size: [u32; 2],
    pub border: Border,
    /// At least one; they do not overlap.
    pub tiles: Vec<Tile>,
}

/// What is about a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Border {
    /// Nothing: the picture alone.
    #[default]
    None,
    /// A title bar and edges, where a window manager draws them.
    Decorated,
    /// Nothing, and the window manager is told to cover the whole monitor.
    FullScreen,
    /// Nothing, and no window manager is asked (X11's override-redirect): the place is exact, but the keyboard does not
    /// follow a click.
    Unmanaged,
}

/// A rectangle of a window and the screen whose picture it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// x, y of the top left pixel in the window, width, height.
    pub rect: [u32; 4],
    /// Index into [`Stage::screens`].
    pub screen: usize,
    /// Never [`Stereo::Separate`]: that takes two tiles.
    pub stereo: Stereo,
    /// Which part of the screen's picture fills the tile: x, y from its top left, width, height, in the screen's pixels.
    pub crop: [u32; 4],
    /// Pixels of the screen that its display hides at the left, right, top and bottom. They stay black.
    pub overscan: [u32; 4],
}

/// What of a tile's eye picture is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visible {
    /// x, y, width, height in the eye's picture; the rest stays black.
    pub rect: [u32; 4],
    /// Left, right, bottom and top of that rectangle on the screen, in normalised device coordinates of the whole.
    pub on_screen: [f64; 4],
}

impl Window {
    /// Where a tile lies when the window has another size than it was made for.
    pub fn rect(&self, tile: &Tile, size: [u32; 2]) -> [u32; 4] {
        let scaled = |axis: usize, pixel: u32| -> u32 {
            let scale = f64::from(size[axis]) / f64::from(self.size[axis].max(1));
            ((f64::from(pixel) * scale).round() as u32).min(size[axis])
        };
        let [x, y, width, height] = tile.rect;
        let (left, top) = (scaled(0, x), scaled(1, y));
        let (right, bottom) = (scaled(0, x.saturating_add(width)), scaled(1, y.saturating_add(height)));
        [left, top, right - left, bottom - top]
    }
}

impl Tile {
    /// All of a screen in the whole of a window.
    pub fn whole(stage: &Stage, screen: usize, stereo: Stereo) -> Self {
        let pixels @ [width, height] = stage.screens[screen].pixels;
        let [w, h] = stereo.window_size(pixels);
        Self { rect: [0, 0, w, h], screen, stereo, crop: [0, 0, width, height], overscan: [0; 4] }
    }

    /// The part of an eye's picture of `eye_size` pixels that the display shows, on whole pixels, and what of the
    /// screen it is. The screen's corners are those of all its pixels, hidden ones too, so hiding pixels changes none
    /// of the others. None where nothing is left.
    pub fn visible(&self, screen: &Screen, eye_size: [u32; 2]) -> Option<Visible> {
        let [left, right, top, bottom] = self.overscan.map(f64::from);
        let along = |axis: usize, before: f64, behind: f64| {
            let pixels = f64::from(screen.pixels[axis]);
            let (start, length) = (f64::from(self.crop[axis]), f64::from(self.crop[axis + 2]));
            let scale = f64::from(eye_size[axis]) / length;
            // In the eye's picture, rounded inwards; the slack is for products like 0.3·10.
            let first = ((before - start).max(0.0) * scale - 1e-9).ceil().max(0.0);
            let last = ((pixels - behind - start).min(length) * scale + 1e-9).floor();
            let ndc = |pixel: f64| 2.0 * (start + pixel / scale) / pixels - 1.0;
            (last > first).then(|| ([first as u32, (last - first) as u32], [ndc(first), ndc(last)]))
        };
        let ([x, width], [x_low, x_high]) = along(0, left, right)?;
        let ([y, height], [y_low, y_high]) = along(1, top, bottom)?;
        Some(Visible { rect: [x, y, width, height], on_screen: [x_low, x_high, -y_high, -y_low] })
    }
}

impl Visible {
    /// From the clip space of the whole screen to that of the part that is drawn.
    pub fn clip_from_whole(&self) -> Matrix4<f64> {
        let [left, right, bottom, top] = self.on_screen;
        let (x, y) = (2.0 / (right - left), 2.0 / (top - bottom));
        let mut matrix = Matrix4::identity();
        (matrix[(0, 0)], matrix[(0, 3)]) = (x, -x * (left + right) / 2.0);
        (matrix[(1, 1)], matrix[(1, 3)]) = (y, -y * (bottom + top) / 2.0);
        matrix
    }

    /// Normalised device coordinates on the whole screen of those in the part.
    pub fn on_whole(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, right, bottom, top] = self.on_screen;
        [left + (right - left) * (x + 1.0) / 2.0, bottom + (top - bottom) * (y + 1.0) / 2.0]
    }
}

impl Stage {
    /// The windows that show everything: a column per eye where each has a window of its own, the screens from the
    /// highest to the lowest.
    pub fn layout(&self) -> Vec<Window> {
        let from_top = self.screens_from_top();
        let kinds: &[Stereo] = match self.stereo {
            Stereo::Separate => &[Stereo::Left, Stereo::Right],
            _ => std::slice::from_ref(&self.stereo),
        };
        let several = self.screens.len() * kinds.len() > 1;
        let window = |screen: usize, column: usize, stereo: Stereo| {
            let tile = Tile::whole(self, screen, stereo);
            let [.., width, height] = tile.rect;
            let row = from_top.iter().position(|&other| other == screen).unwrap_or(0);
            let eyes: Vec<&str> = stereo.eyes().iter().map(|eye| Eye::name(*eye)).collect();
            Window {
                name: format!("{} {}", self.screens[screen].name, eyes.join(" and ")),
                at: several.then_some([(column as u32 * width) as i32, (row as u32 * height) as i32]),
                size: [width, height],
                border: Border::Decorated,
                tiles: vec![tile],
            }
        };
        let of = |screen: usize| {
            kinds.iter().enumerate().map(move |(column, kind)| (screen, column, *kind)).collect::<Vec<_>>()
        };
        let panes = (0..self.screens.len()).flat_map(of);
        panes.map(|(screen, column, stereo)| window(screen, column, stereo)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector4;

    fn tile(crop: [u32; 4], overscan: [u32; 4]) -> (Tile, Screen) {
        let stage = Stage::find("workbench").unwrap();
        let tile = Tile { crop, overscan, ..Tile::whole(&stage, 0, Stereo::Mono) };
        (tile, stage.screens[0].clone())
    }

    #[test]
    fn a_whole_tile_shows_the_whole_screen() {
        let (tile, screen) = tile([0, 0, 1280, 1024], [0; 4]);
        for size in [[1280, 1024], [640, 1024], [37, 11]] {
            let visible = tile.visible(&screen, size).unwrap();
            assert_eq!(visible.rect, [0, 0, size[0], size[1]]);
            assert!(visible.on_screen.iter().zip([-1.0, 1.0, -1.0, 1.0]).all(|(a, b)| (a - b).abs() < 1e-12));
        }
    }

    /// The same place of the room lands on the same pixel of the display, whatever is hidden about it.
    #[test]
    fn overscan_hides_pixels_and_moves_none() {
        let (tile, screen) = tile([0, 0, 1280, 1024], [16, 32, 8, 24]);
        let visible = tile.visible(&screen, [1280, 1024]).unwrap();
        assert_eq!(visible.rect, [16, 8, 1280 - 48, 1024 - 32]);
        for ndc in [[0.0, 0.0], [0.5, -0.7], [-0.9, 0.9]] {
            let clip = visible.clip_from_whole() * Vector4::new(ndc[0], ndc[1], 0.3, 1.0);
            let [x, y, width, height] = visible.rect.map(f64::from);
            let pixel = [x + (clip.x + 1.0) / 2.0 * width, y + (1.0 - clip.y) / 2.0 * height];
            let expected = [(ndc[0] + 1.0) / 2.0 * 1280.0, (1.0 - ndc[1]) / 2.0 * 1024.0];
            assert!((pixel[0] - expected[0]).abs() < 1e-9 && (pixel[1] - expected[1]).abs() < 1e-9);
            let back = visible.on_whole([clip.x, clip.y]);
            assert!((back[0] - ndc[0]).abs() < 1e-12 && (back[1] - ndc[1]).abs() < 1e-12);
        }
    }

    #[test]
    fn the_lower_right_quarter_is_cropped() {
        let (tile, screen) = tile([640, 512, 640, 512], [0, 10, 0, 0]);
        let visible = tile.visible(&screen, [320, 256]).unwrap();
        assert_eq!(visible.rect, [0, 0, 315, 256]);
        let expected = [0.0, 1.0 - 2.0 * 10.0 / 1280.0, -1.0, 0.0];
        assert!(visible.on_screen.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{visible:?}");
    }

    #[test]
    fn a_tile_of_which_all_is_hidden_shows_nothing() {
        let (tile, screen) = tile([0, 0, 1280, 1024], [1280, 0, 0, 0]);
        assert_eq!(tile.visible(&screen, [1280, 1024]), None);
        assert_eq!(self::tile([0, 0, 1280, 1024], [0; 4]).0.visible(&screen, [0, 4]), None);
    }

    #[test]
    fn without_windows_of_its_own_a_stage_has_one_per_screen_or_per_eye() {
        let layout = Stage::find("workbench").unwrap().layout();
        let places: Vec<_> = layout.iter().map(|w| (w.name.as_str(), w.at.unwrap())).collect();
        assert_eq!(
            places,
            [
                ("table left", [0, 1024]),
                ("table right", [1280, 1024]),
                ("wall left", [0, 0]),
                ("wall right", [1280, 0])
            ]
        );
        let desktop = Stage::find("desktop").unwrap().layout();
        assert_eq!((desktop.len(), desktop[0].at, desktop[0].size), (1, None, [1280, 800]));
        let packed = Stage { stereo: Stereo::FramePacking, ..Stage::find("desktop").unwrap() }.layout();
        assert_eq!(packed[0].size, [1280, 1633]);
    }

    #[test]
    fn tiles_grow_with_their_window_and_leave_no_gap() {
        let stage = Stage::find("workbench").unwrap();
        let part = |x, width| Tile { rect: [x, 0, width, 7], ..Tile::whole(&stage, 0, Stereo::Mono) };
        let window = Window {
            name: String::new(),
            at: None,
            size: [10, 7],
            border: Border::None,
            tiles: vec![part(0, 3), part(3, 7)],
        };
        let [a, b] = [0, 1].map(|i| window.rect(&window.tiles[i], [25, 70]));
        assert_eq!((a, b), ([0, 0, 8, 70], [8, 0, 17, 70]));
    }
}
