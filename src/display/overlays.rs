//! Overlays that a lab engineer calls up over the pictures of a stage: overlay (F1), room from outside (F2), test pattern (F3).
//!
//! In: keys, and the frame as it would be drawn. Out: the frame with the overlays in it. An overlay has no depth: it is the
//! same for both eyes, and is drawn before they are joined, so that it can be read in every kind of stereo. An overlay that
//! is not called up costs nothing.

use super::caption::{self, Caption};
use super::overlay::{History, Panel, Readings, Seats};
use super::pattern::Pattern;
use super::plate_seats::{KeepClear, PlateSeats};
use super::plates::Plates;
use super::presenter::Presenter;
use super::stage_model::{Camera, Orbit, StageModel, write_names};
use super::window_layout::{self, Part};
use crate::base::plates::Plate;
use crate::render::window::{Input, Key, PresentTimes};
use crate::render::{EyePicture, FrameContents, Gpu, Overlay, RenderError, Tile};
use crate::stage::{Stage, Window};
use crate::track::tracker_set::TrackerReport;
use egui::{Id, LayerId, Order, Painter, Rect};
use nalgebra::Isometry3;

/// The overlays of all windows of a stage.
pub struct Overlays {
    /// Whether the overlay is over each screen.
    pub panels: Vec<bool>,
    pub pattern: bool,
    /// A caption over the whole of every window.
    pub caption: Option<Box<Caption>>,
    /// Steps of the frames since an overlay was called up.
    pub history: History,
    /// Seats of the plates of each screen.
    seats: Box<[ScreenSeats]>,
    /// The first window that shows a screen of this one, for each window: both eyes' windows look at the same.
    leader: Box<[usize]>,
    /// The camera from which each leader shows the room from outside, instead of its screens.
    outside: Box<[Option<Orbit>]>,
    /// The last camera of each leader, for the next time.
    kept: Box<[Option<Orbit>]>,
    overlay: Option<Overlay>,
}

/// Seats of the plates of a screen: the overlay's, and the world's.
#[derive(Clone, Debug, Default)]
struct ScreenSeats {
    panel: Seats,
    plates: PlateSeats,
}

/// The uppermost layer, over which nothing else is painted.
const ABOVE: LayerId = LayerId { order: Order::Foreground, id: Id::NULL };

/// The stage as it is in this frame.
pub struct StageFrame<'a> {
    pub stage: &'a Stage,
    pub layout: &'a [Window],
    pub sizes: &'a [[u32; 2]],
    pub swapped: bool,
    pub room_from_head: Isometry3<f64>,
    /// Reports of the trackers, if somebody wants to see them.
    pub reports: &'a [TrackerReport],
    /// Plates that the world writes over its pictures.
    pub plates: &'a [Plate],
    /// Rectangles of each screen that plates must not cover.
    pub clear: &'a [KeepClear],
    /// The window with the panel, and its pixels that panel and messages take.
    pub covered: (usize, &'a [Rect]),
    /// Time of the trackers, s.
    pub time_s: f64,
}

impl StageFrame<'_> {
    /// The pixels of a picture that panel and messages take. They lie over the window: a picture of one of two eyes has none.
    fn covered(&self, picture: &EyePicture<'_>, size: [u32; 2]) -> Vec<Rect> {
        let (window, rects) = self.covered;
        let is_there = window == picture.window && picture.texture_size == size;
        rects.iter().filter(|_| is_there).copied().collect()
    }
}

/// The layer of a picture below the overlay: the names of the room from outside, the test pattern, or the world's plates.
struct Below<'a> {
    frame: &'a StageFrame<'a>,
    part: &'a Part,
    room: Option<&'a (Camera, StageModel)>,
    is_pattern: bool,
    clear: &'a KeepClear,
    taken: &'a [Rect],
}

impl Below<'_> {
    /// `lift` is the part of the height that a caption takes.
    fn paint(&self, painter: &Painter, lift: f32, seats: &mut PlateSeats) {
        let StageFrame { stage, room_from_head, plates, time_s, .. } = self.frame;
        let (part, clear, taken) = (self.part, self.clear, self.taken);
        let screen = &stage.screens[part.screen];
        if let Some((camera, room)) = self.room {
            let view = camera.view(window_layout::aspect(screen, &part.visible));
            view.iter().for_each(|view| write_names(painter, part.rect, view, room, taken));
        } else if self.is_pattern {
            let painter = &painter.with_clip_rect(part.rect);
            let (on_screen, stage) = (part.visible.on_screen, stage.name.as_str());
            Pattern { painter, rect: part.rect, on_screen, stage, screen, eye: part.eye }.paint();
        } else {
            let time_s = *time_s;
            Plates { stage, room_from_head, plates, lift, taken, clear, time_s }.paint(painter, part, seats);
        }
    }
}

impl Overlays {
    pub fn new(stage: &Stage, layout: &[Window]) -> Self {
        let is_shared = |a: &Window, b: &Window| {
            a.tiles.iter().any(|tile| b.tiles.iter().any(|other| other.screen == tile.screen))
        };
        let leader = |window: &Window| layout.iter().position(|first| is_shared(first, window)).unwrap_or(0);
        Self {
            panels: vec![false; stage.screens.len()],
            pattern: false,
            caption: None,
            history: History::default(),
            seats: vec![ScreenSeats::default(); stage.screens.len()].into(),
            leader: layout.iter().map(leader).collect(),
            outside: vec![None; layout.len()].into(),
            kept: vec![None; layout.len()].into(),
            overlay: None,
        }
    }

    pub fn has_panel(&self) -> bool {
        self.panels.contains(&true)
    }

    /// Whether the reports of the trackers are shown anywhere.
    pub fn wants_reports(&self) -> bool {
        self.has_panel() || self.outside.iter().any(Option::is_some)
    }

    /// Takes an input that is meant for the overlays; false leaves it to the scene.
    pub fn input(&mut self, input: &Input, stage: &Stage, layout: &[Window]) -> bool {
        match *input {
            Input::Key { window, key: Key::Function(number @ 1..=3), pressed } => {
                if pressed {
                    self.toggle(number, window, stage, layout);
                }
                true
            }
            Input::Cursor { window, .. } | Input::Button { window, .. } | Input::Wheel { window, .. } => {
                let leader = self.leader[window];
                let Some(orbit) = &mut self.outside[leader] else { return false };
                orbit.handle(input);
                // What was pressed over the scene is let go there too.
                !matches!(input, Input::Button { pressed: false, .. })
            }
            Input::Focus { .. } => {
                self.outside.iter_mut().flatten().for_each(|orbit| orbit.handle(input));
                false
            }
            _ => false,
        }
    }

    fn toggle(&mut self, number: u8, window: usize, stage: &Stage, layout: &[Window]) {
        match number {
            1 => {
                let screens: Vec<usize> = layout[window].tiles.iter().map(|tile| tile.screen).collect();
                let shown = screens.iter().any(|&screen| self.panels[screen]);
                screens.iter().for_each(|&screen| self.panels[screen] = false);
                let faced = Some(stage.faced_screen()).filter(|faced| screens.contains(faced));
                if let Some(screen) = faced.or(screens.first().copied()).filter(|_| !shown) {
                    self.panels[screen] = true;
                }
                if !self.has_panel() {
                    self.history = History::default();
                }
            }
            2 => {
                if !self.leave_room(window) {
                    let leader = self.leader[window];
                    self.outside[leader] =
                        self.kept[leader].or_else(|| Some(Orbit::new(Camera::facing(stage))));
                }
            }
            // In a window that shows the room, the key calls for what cannot be seen there.
            _ => self.pattern = self.leave_room(window) || !self.pattern,
        }
    }

    /// Shows the room from outside in every window.
    pub fn show_room(&mut self, camera: Camera) {
        for window in 0..self.outside.len() {
            self.outside[self.leader[window]] = Some(Orbit::new(camera));
        }
    }

    /// Back to the window's screens; false where it shows them already.
    fn leave_room(&mut self, window: usize) -> bool {
        let leader = self.leader[window];
        let Some(orbit) = self.outside[leader].take() else { return false };
        self.kept[leader] = Some(Orbit::new(orbit.camera));
        true
    }

    /// Draws a frame: `tiles` and `contents` as they are without overlays. `readings` is asked when an overlay is shown.
    ///
    /// # Errors
    /// As of [`Presenter::present`].
    pub fn draw(
        &mut self,
        presenter: &mut dyn Presenter,
        frame: &StageFrame<'_>,
        tiles: Vec<Vec<Tile>>,
        contents: &FrameContents<'_>,
        readings: impl FnOnce(&Gpu) -> Readings,
    ) -> Result<PresentTimes, RenderError> {
        let is_plain = !self.pattern
            && !self.has_panel()
            && frame.plates.is_empty()
            && self.caption.is_none()
            && self.outside.iter().all(Option::is_none);
        if is_plain {
            return presenter.present(&tiles, &vec![contents; tiles.len()], None);
        }
        let tiles = self.tiles(frame, tiles);
        let last: Vec<usize> = tiles.iter().map(|tiles| tiles.len().saturating_sub(1)).collect();
        let Self { leader, outside, overlay, panels, pattern, history, seats, caption, .. } = self;
        let of = |orbit: &Option<Orbit>| {
            let camera = orbit.as_ref()?.camera;
            let mut room = StageModel::new(frame.stage, &frame.room_from_head, &camera.eye());
            room.add_sensors(frame.reports);
            if caption.is_some() {
                room.note.clear();
            }
            Some((camera, room))
        };
        let rooms: Vec<Option<(Camera, StageModel)>> = outside.iter().map(of).collect();
        let outer: Vec<Option<FrameContents<'_>>> =
            rooms.iter().map(|room| Some(room.as_ref()?.1.contents(*contents))).collect();
        let readings = panels.contains(&true).then(|| readings(presenter.gpu()));
        let is_captioned = caption.is_some();
        let nothing = KeepClear::default();
        let mut paint = |gpu: &Gpu, picture: &EyePicture<'_>| {
            let Some((window, &size)) = frame.layout.get(picture.window).zip(frame.sizes.get(picture.window))
            else {
                return Ok(());
            };
            let Some(part) = window_layout::part(frame.stage, window, size, picture, frame.swapped) else {
                return Ok(());
            };
            let overlay = overlay.get_or_insert_with(|| Overlay::new(picture.format));
            let room = rooms[leader[picture.window]].as_ref();
            let is_scene = room.is_none() && !*pattern;
            let clear = frame.clear.get(part.screen).filter(|_| is_scene).unwrap_or(&nothing);
            let covered = frame.covered(picture, size);
            let readings = readings.as_ref().filter(|_| panels[part.screen]);
            let caption = caption.as_ref().filter(|_| picture.tile == last[picture.window]);
            let lift = if is_captioned { Caption::MOST_HEIGHT } else { 0.0 };
            let ScreenSeats { panel: seat, plates } = &mut seats[part.screen];
            overlay.paint(gpu, picture.texture, picture.texture_size, |painter| {
                let mut taken = covered.clone();
                // The rest leaves room for the overlay, which lies above it.
                if let Some(readings) = readings {
                    let painter = &painter.clone().with_layer_id(ABOVE);
                    let (rect, held) = (part.rect, part.pixels(&clear.held));
                    let panel = Panel { painter, rect, readings, history, clear: &held, taken: &covered };
                    taken.extend(panel.paint(seat));
                }
                let below = Below { frame, part: &part, room, is_pattern: *pattern, clear, taken: &taken };
                below.paint(painter, lift, plates);
                if let Some(caption) = caption {
                    let painter = &painter.clone().with_layer_id(ABOVE);
                    caption.paint(painter, caption::whole(picture.texture_size));
                }
            })
        };
        let of = |leader: &usize| outer[*leader].as_ref().unwrap_or(contents);
        // A presenter may have fewer windows than the stage: the demo shows the room of four in one.
        let contents: Vec<&FrameContents<'_>> = leader.iter().take(tiles.len()).map(of).collect();
        presenter.present(&tiles, &contents, Some(&mut paint))
    }

    /// Windows that look at the room show it to both eyes, those with the pattern nothing below it.
    fn tiles(&self, frame: &StageFrame<'_>, mut tiles: Vec<Vec<Tile>>) -> Vec<Vec<Tile>> {
        for (index, (tiles, (window, size))) in
            tiles.iter_mut().zip(frame.layout.iter().zip(frame.sizes)).enumerate()
        {
            if let Some(orbit) = &self.outside[self.leader[index]] {
                *tiles =
                    window_layout::flat_tiles(frame.stage, window, *size, |aspect| orbit.camera.view(aspect));
            } else if self.pattern {
                *tiles = window_layout::flat_tiles(frame.stage, window, *size, |_| None);
            }
        }
        tiles
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_shows_in_its_window_what_it_calls_up() {
        let stage = Stage::find("workbench").unwrap();
        let layout = stage.layout();
        let mut overlays = Overlays::new(&stage, &layout);
        let mut press = |key: u8, window: usize| {
            let key = Key::Function(key);
            assert!(overlays.input(&Input::Key { window, key, pressed: true }, &stage, &layout));
            assert!(overlays.input(&Input::Key { window, key, pressed: false }, &stage, &layout));
            let seen =
                (0..4).map(|window| overlays.outside[overlays.leader[window]].is_some()).collect::<Vec<_>>();
            (seen, overlays.pattern, overlays.panels.clone())
        };
        let (table, no_room, no_panel) = (vec![true, true, false, false], vec![false; 4], vec![false; 2]);
        assert_eq!(press(2, 1), (table.clone(), false, no_panel.clone()), "both eyes' windows");
        assert_eq!(
            press(3, 2),
            (table.clone(), true, no_panel.clone()),
            "an operator's window keeps the room"
        );
        assert_eq!(
            press(3, 0),
            (no_room.clone(), true, no_panel.clone()),
            "over the room, the pattern is called"
        );
        assert_eq!(press(3, 1), (no_room.clone(), false, no_panel.clone()));
        assert_eq!(press(3, 1), (no_room.clone(), true, no_panel.clone()));
        assert_eq!(press(2, 0), (table, true, no_panel.clone()), "over the pattern, the room");
        assert_eq!(press(2, 1), (no_room.clone(), true, no_panel));
        assert_eq!(press(1, 2), (no_room, true, vec![false, true]));
    }

    #[test]
    fn a_window_of_many_screens_shows_one_overlay() {
        let stage = Stage::find("lbench").unwrap();
        let layout = stage.layout();
        let mut overlays = Overlays::new(&stage, &layout);
        overlays.toggle(1, 0, &stage, &layout);
        assert_eq!(overlays.panels.iter().filter(|&&shown| shown).count(), 1);
        assert!(overlays.panels[stage.faced_screen()], "where the viewer looks");
        overlays.toggle(1, 0, &stage, &layout);
        assert!(!overlays.has_panel());
    }

    #[test]
    fn a_button_pressed_over_the_scene_is_let_go_though_the_room_came_between() {
        use crate::render::window::Button;
        let stage = Stage::find("desktop").unwrap();
        let layout = stage.layout();
        let mut overlays = Overlays::new(&stage, &layout);
        let button = |pressed| Input::Button { window: 0, button: Button::Left, pressed };
        assert!(!overlays.input(&button(true), &stage, &layout));
        overlays.toggle(2, 0, &stage, &layout);
        assert!(!overlays.input(&button(false), &stage, &layout), "the scene hears of it");
        assert!(overlays.input(&button(true), &stage, &layout), "a drag turns the room");
    }
}
