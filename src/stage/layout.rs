//! The windows of a stage that names none: one per screen, or one per screen and eye.

use super::description::Stage;
use super::stereo::Stereo;
use super::viewer::Eye;
use super::window::{Border, Tile, Window};

impl Tile {
    /// A tile that fills its window with the whole of a screen.
    pub fn whole(stage: &Stage, screen: usize, stereo: Stereo) -> Self {
        let pixels @ [width, height] = stage.screens[screen].pixels;
        let [w, h] = stereo.window_size(pixels);
        let crop = [0, 0, width, height];
        Self { rect: [0, 0, w, h], screen, stereo, swap_eyes: false, crop, overscan: [0; 4] }
    }
}

impl Stage {
    /// The stage's own windows, or those of [`Stage::usual_layout`] if it has none.
    pub fn layout(&self) -> Vec<Window> {
        if self.windows.is_empty() { self.usual_layout() } else { self.windows.clone() }
    }

    /// Whether a screen is shown to an eye: in one of the stage's windows, or by its kind of stereo where it has none.
    pub fn shows(&self, screen: usize, eye: Eye) -> bool {
        if self.windows.is_empty() {
            return self.stereo.eyes().contains(&eye);
        }
        let mut tiles = self.windows.iter().flat_map(|window| &window.tiles);
        tiles.any(|tile| tile.screen == screen && tile.stereo.eyes().contains(&eye))
    }

    /// Windows for all screens, from the highest to the lowest; with a column per eye if each eye has its own window.
    pub fn usual_layout(&self) -> Vec<Window> {
        let from_top = self.screens_from_top();
        let kinds: &[Stereo] = match self.stereo {
            Stereo::Separate => &[Stereo::Left, Stereo::Right],
            _ => std::slice::from_ref(&self.stereo),
        };
        let several = self.screens.len() * kinds.len() > 1;
        let height = |screen: usize| kinds[0].window_size(self.screens[screen].pixels)[1];
        let window = |screen: usize, column: usize, stereo: Stereo| {
            let tile = Tile::whole(self, screen, stereo);
            let [.., width, own_height] = tile.rect;
            let above = from_top.iter().take_while(|&&other| other != screen);
            let top = above.fold(0_u32, |sum, &other| sum.saturating_add(height(other)));
            let at = [width.saturating_mul(column as u32), top];
            let eyes: Vec<&str> = stereo.eyes().iter().map(|eye| Eye::name(*eye)).collect();
            Window {
                name: format!("{} {}", self.screens[screen].name, eyes.join(" and ")),
                monitor: None,
                fills: false,
                at: several.then_some(at.map(|pixel| i32::try_from(pixel).unwrap_or(i32::MAX))),
                size: [width, own_height],
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
