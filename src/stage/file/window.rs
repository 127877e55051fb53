//! The tables `[[window]]` and `[[monitor]]` of a stage file, and their checks.

use super::super::error::{MAX_PIXELS, PLACES, StageFault};
use super::super::screen::Screen;
use super::super::stereo::Stereo;
use super::super::window::{Border, Monitor, MonitorId, Tile, Window};
use crate::config;

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowFile {
    name: Option<String>,
    monitor: Option<MonitorId>,
    at: Option<[i32; 2]>,
    size: Option<[u32; 2]>,
    #[serde(default)]
    border: Border,
    screen: Option<String>,
    stereo: Option<Stereo>,
    #[serde(default)]
    swap_eyes: bool,
    crop: Option<[u32; 4]>,
    overscan: Option<[u32; 4]>,
    #[serde(default, rename = "tile")]
    tiles: Vec<TileFile>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct TileFile {
    screen: String,
    rect: [u32; 4],
    stereo: Option<Stereo>,
    #[serde(default)]
    swap_eyes: bool,
    crop: Option<[u32; 4]>,
    overscan: Option<[u32; 4]>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MonitorFile {
    name: String,
    at: [i32; 2],
    size: [u32; 2],
}

impl WindowFile {
    /// The names of the screens that it shows.
    pub fn shows(&self) -> impl Iterator<Item = &str> {
        self.screen.as_deref().into_iter().chain(self.tiles.iter().map(|tile| tile.screen.as_str()))
    }
}

pub fn monitor(file: MonitorFile) -> Result<Monitor, StageFault> {
    let MonitorFile { name, at, size } = file;
    match check_place(at).and_then(|()| check_size(size)) {
        Ok(()) => Ok(Monitor { name, at, size }),
        Err(message) => Err(StageFault::Monitor { name, message }),
    }
}

/// Window `number`, counted from 1, of a stage with these screens and this kind of stereo.
pub fn window(
    file: WindowFile,
    number: usize,
    screens: &[Screen],
    usual: Stereo,
) -> Result<Window, StageFault> {
    let name = file.name.clone().unwrap_or_else(|| format!("window {number}"));
    read(file, &name, screens, usual).map_err(|message| StageFault::Window { window: name, message })
}

fn read(file: WindowFile, name: &str, screens: &[Screen], usual: Stereo) -> Result<Window, String> {
    let usual = file.stereo.unwrap_or(usual);
    let fills = file.monitor.is_some() && file.size.is_none() && file.tiles.is_empty();
    let tiles = if file.tiles.is_empty() {
        let screen = file
            .screen
            .as_deref()
            .ok_or("which screen does it show? Give `screen`, or [[window.tile]] tables")?;
        let WindowFile { stereo, swap_eyes, crop, overscan, .. } = file;
        let whole = TileFile { screen: screen.to_owned(), rect: [0; 4], stereo, swap_eyes, crop, overscan };
        let tile = tile(screens, &whole, usual)?;
        let [width, height] = file.size.unwrap_or(tile.stereo.window_size([tile.crop[2], tile.crop[3]]));
        vec![Tile { rect: [0, 0, width, height], ..tile }]
    } else {
        if file.screen.is_some() || file.crop.is_some() || file.overscan.is_some() {
            return Err(
                "`screen`, `crop` and `overscan` belong into its tiles, as it has [[window.tile]]".into()
            );
        }
        let of = |part: &TileFile| {
            let made = tile(screens, part, usual)?;
            Ok(Tile { swap_eyes: part.swap_eyes != file.swap_eyes, ..made })
        };
        file.tiles.iter().map(of).collect::<Result<Vec<_>, String>>()?
    };
    let edge = |axis: usize| {
        tiles.iter().map(|tile| tile.rect[axis].saturating_add(tile.rect[axis + 2])).max().unwrap_or(0)
    };
    let size @ [width, height] = file.size.unwrap_or([edge(0), edge(1)]);
    check_size(size)?;
    file.at.map_or(Ok(()), check_place)?;
    for (i, tile) in tiles.iter().enumerate() {
        let [x, y, w, h] = tile.rect;
        if !is_within(tile.rect, size) {
            return Err(format!(
                "tile {} has {w} × {h} pixels at ({x}, {y}), which is not within the window's {width} × {height}",
                i + 1
            ));
        }
        if let Some(other) = tiles[..i].iter().position(|other| overlap(&other.rect, &tile.rect)) {
            return Err(format!("its tiles {} and {} overlap", other + 1, i + 1));
        }
    }
    let WindowFile { monitor, at, border, .. } = file;
    Ok(Window { name: name.to_owned(), monitor, at, size, fills, border, tiles })
}

fn tile(screens: &[Screen], file: &TileFile, usual: Stereo) -> Result<Tile, String> {
    let TileFile { screen: name, rect, stereo, swap_eyes, crop, overscan } = file;
    let (rect, swap_eyes) = (*rect, *swap_eyes);
    let names = screens.iter().map(|screen| screen.name.as_str());
    let screen = screens
        .iter()
        .position(|screen| screen.name == *name)
        .ok_or_else(|| config::unknown_name("screen", name, names))?;
    let pixels @ [width, height] = screens[screen].pixels;
    let stereo = stereo.unwrap_or(usual);
    if stereo == Stereo::Separate {
        return Err(format!(
            "which eye sees `{name}`? Write stereo = \"left\" in one window or tile and \"right\" in the \
             other, or a kind that holds both"
        ));
    }
    let crop @ [.., w, h] = crop.unwrap_or([0, 0, width, height]);
    if !is_within(crop, pixels) {
        return Err(format!(
            "crop {crop:?} (x, y, width, height) is not within the {width} × {height} pixels of screen `{name}`"
        ));
    }
    let overscan = overscan.unwrap_or([0; 4]);
    let tile = Tile { rect, screen, stereo, swap_eyes, crop, overscan };
    if tile.visible(&screens[screen], [w, h]).is_none() {
        return Err(format!(
            "overscan {overscan:?} (left, right, top, bottom) hides all that is shown of the {} × {} pixels of screen \
             `{name}`",
            pixels[0], pixels[1]
        ));
    }
    Ok(tile)
}

fn check_size(size @ [width, height]: [u32; 2]) -> Result<(), String> {
    match size.iter().all(|side| (1..=MAX_PIXELS).contains(side)) {
        true => Ok(()),
        false => Err(format!("it has {width} × {height} pixels: each must be between 1 and {MAX_PIXELS}")),
    }
}

fn check_place(at @ [x, y]: [i32; 2]) -> Result<(), String> {
    let (low, high) = (PLACES.start(), PLACES.end());
    match at.iter().all(|pixel| PLACES.contains(pixel)) {
        true => Ok(()),
        false => Err(format!("it stands at ({x}, {y}): both must be between {low} and {high}")),
    }
}

/// Whether a rectangle (x, y, width, height) has pixels, all of them within this width and height.
fn is_within(rect: [u32; 4], limits: [u32; 2]) -> bool {
    (0..2).all(|axis| {
        rect[axis + 2] > 0 && u64::from(rect[axis]) + u64::from(rect[axis + 2]) <= u64::from(limits[axis])
    })
}

/// Whether two rectangles (x, y, width, height) share a pixel.
fn overlap(a: &[u32; 4], b: &[u32; 4]) -> bool {
    let along = |axis: usize| {
        let end = |rect: &[u32; 4]| u64::from(rect[axis]) + u64::from(rect[axis + 2]);
        u64::from(a[axis]) < end(b) && u64::from(b[axis]) < end(a)
    };
    along(0) && along(1)
}
