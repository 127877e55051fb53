//! Windows: their places on the desktop, and which part of which screen each shows to which eye.
//!
//! A [`Window`] has one [`Tile`] or more; [`Tile::visible`] gives the part of its screen that is drawn.

use super::screen::Screen;
use super::stereo::Stereo;
use nalgebra::Matrix4;

/// A window on the desktop, in physical pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    pub name: String,
    /// The monitor from whose top left corner `at` counts; None: the corner of the desktop that spans all monitors.
    pub monitor: Option<MonitorId>,
    /// Top left corner; None leaves it to the window manager, or is `monitor`'s own.
    pub at: Option<[i32; 2]>,
    /// The size that the tiles' rectangles refer to.
    pub size: [u32; 2],
    /// The window is opened in the size of its monitor, whatever `size` is.
    pub fills: bool,
    pub border: Border,
    /// One tile or more; they do not overlap.
    pub tiles: Vec<Tile>,
}

/// The frame around a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Border {
    /// No frame.
    #[default]
    None,
    /// A title bar and edges, where a window manager draws them.
    Decorated,
    /// No frame; the window manager is asked to cover the whole monitor.
    FullScreen,
    /// No frame and no window manager (X11's override-redirect): the place is exact, but a click does not give the window
    /// the keyboard.
    Unmanaged,
}

/// A monitor as the window system knows it: by number, from 0, or by name, as `DP-1`.
#[derive(Clone, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(untagged, expecting = "a monitor is given by its number, from 0, or by its name, as \"DP-1\"")]
pub enum MonitorId {
    Number(usize),
    Name(String),
}

/// A monitor's place on the desktop, in physical pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Monitor {
    pub name: String,
    pub at: [i32; 2],
    pub size: [u32; 2],
}

/// A rectangle of a window and the screen whose picture it holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// x, y of the top left pixel in the window, width, height.
    pub rect: [u32; 4],
    /// Index into [`super::Stage::screens`].
    pub screen: usize,
    /// Never [`Stereo::Separate`]: that takes two tiles.
    pub stereo: Stereo,
    /// This display has the eyes the other way round than the other displays.
    pub swap_eyes: bool,
    /// The part of the screen's picture that fills the tile: x, y from its top left, width, height, in the screen's pixels.
    pub crop: [u32; 4],
    /// Pixels of the screen that its display hides at the left, right, top and bottom; they stay black.
    pub overscan: [u32; 4],
}

/// The part of a tile's picture that is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visible {
    /// x, y, width, height in the eye's picture; the rest stays black.
    pub rect: [u32; 4],
    /// Left, right, bottom and top of that rectangle on the screen, in normalised device coordinates of the whole.
    pub on_screen: [f64; 4],
}

impl MonitorId {
    pub fn find<'a>(&self, monitors: &'a [Monitor]) -> Option<&'a Monitor> {
        match self {
            Self::Number(number) => monitors.get(*number),
            Self::Name(name) => monitors.iter().find(|monitor| monitor.name == *name),
        }
    }
}

impl std::fmt::Display for MonitorId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => write!(f, "number {number}"),
            Self::Name(name) => write!(f, "`{name}`"),
        }
    }
}

impl Window {
    /// The window's place and size on a desktop with these monitors; None if the window manager chooses the place, or if its
    /// monitor is not there.
    pub fn on_desktop(&self, monitors: &[Monitor]) -> Option<([i32; 2], [u32; 2])> {
        let Some(id) = &self.monitor else { return Some((self.at?, self.size)) };
        let monitor = id.find(monitors)?;
        let at = self.at.unwrap_or([0, 0]);
        let place = [0, 1].map(|axis| monitor.at[axis].saturating_add(at[axis]));
        Some((place, if self.fills { monitor.size } else { self.size }))
    }

    /// A tile's rectangle when the window has this size.
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
    /// The part of an eye's picture of `eye_size` pixels that the display shows, on whole pixels, and its
    /// place on the screen. The screen's corners are those of all its pixels, hidden ones included, so hiding some changes
    /// none of the others. None if nothing is left.
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
    /// The transform from the clip space of the whole screen to that of the drawn part.
    pub fn clip_from_whole(&self) -> Matrix4<f64> {
        let [left, right, bottom, top] = self.on_screen;
        let (x, y) = (2.0 / (right - left), 2.0 / (top - bottom));
        let mut matrix = Matrix4::identity();
        (matrix[(0, 0)], matrix[(0, 3)]) = (x, -x * (left + right) / 2.0);
        (matrix[(1, 1)], matrix[(1, 3)]) = (y, -y * (bottom + top) / 2.0);
        matrix
    }

    /// Converts normalised device coordinates in the drawn part to those on the whole screen.
    pub fn on_whole(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, right, bottom, top] = self.on_screen;
        [left + (right - left) * (x + 1.0) / 2.0, bottom + (top - bottom) * (y + 1.0) / 2.0]
    }
}

#[cfg(test)]
mod tests;
