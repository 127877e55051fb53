//! Draws a world into offscreen pictures: one per screen and eye, per screen with both eyes joined, or per window.

use super::bodies::{GpuBodies, contents};
use super::overlay::{FrameSteps, History, Panel, Readings, Seats};
use super::plate_seats::{KeepClear, PlateSeats, keep_clear};
use super::plates::Plates;
use super::presenter::{Images, Presenter};
use super::view_source::{Screens, ViewSource};
use super::{device, window_layout};
use crate::base::plates::Plate;
use crate::render::window::Monitor;
use crate::render::{COLOR_FORMAT, DrawCounts, EyePicture, Gpu, Overlay, RenderError, Samples};
use crate::stage::{self, Stage, Stereo, Window};
use crate::world::{StepTimes, World};
use image::RgbaImage;
use std::collections::BTreeSet;

/// Images of every picture of a stage.
pub struct Targets {
    pub images: Images,
    screens: Screens,
    /// Names of the pictures' files.
    names: Vec<String>,
    pub bodies: GpuBodies,
    /// Made with the first thing that is written over a picture.
    overlay: Option<Overlay>,
    /// The overlay is shown on the screen that the viewer looks at, where it is asked for.
    panel: Option<(History, Seats)>,
    /// Seats of the plates.
    seats: PlateSeats,
}

/// The kind of pictures to make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pictures {
    /// One per screen and eye.
    Eyes,
    /// One per screen, with both eyes joined by this kind of stereo.
    Joined(Stereo),
    /// One per window, as it would be presented.
    Windows,
}

/// A picture and the screen and eye it belongs to.
pub type NamedImage<'a> = (&'a str, RgbaImage);

/// Time of the drawing of one frame, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawTimes {
    pub upload_s: f64,
    pub encode_s: f64,
    pub draw_s: f64,
}

impl Targets {
    /// Targets of `scale` times the screens' own pixels, or the windows'.
    pub fn new(
        world: &mut World,
        asked_for: Pictures,
        samples: Samples,
        scale: f64,
        asked: device::Args,
    ) -> Result<Targets, RenderError> {
        let mut images = Images::new(samples)?;
        asked.apply(&images.gpu, &mut images.renderer)?;
        let mut bodies = GpuBodies::new(&images.gpu, world, asked)?;
        bodies.looks_at_each = true;
        let stage = &world.assets.stage;
        let (layout, names): (Vec<Window>, Vec<String>) = windows(stage, asked_for).into_iter().unzip();
        for window in &layout {
            let (place, size) = match (asked_for, window.tiles.as_slice()) {
                // Whole pixels of the screen first, so that both halves of a picture come out alike.
                (Pictures::Eyes | Pictures::Joined(_), [tile]) => {
                    let pixels = window_layout::scaled(stage.screens[tile.screen].pixels, scale);
                    ([0, 0], tile.stereo.window_size(pixels))
                }
                _ => {
                    let place = window.on_desktop(&stage.monitors);
                    let (at, size) = place.unwrap_or(([0, 0], window.size));
                    (window_layout::moved(at, scale), window_layout::scaled(size, scale))
                }
            };
            images.add(size, place)?;
        }
        let monitor = |monitor: &stage::Monitor| Monitor {
            name: monitor.name.clone(),
            at: window_layout::moved(monitor.at, scale),
            size: window_layout::scaled(monitor.size, scale),
        };
        if asked_for == Pictures::Windows {
            images.monitors = stage.monitors.iter().map(monitor).collect();
        }
        let swapped = asked_for != Pictures::Eyes && stage.swap_eyes;
        Ok(Targets {
            images,
            screens: Screens { layout, swapped },
            names,
            bodies,
            overlay: None,
            panel: None,
            seats: PlateSeats::default(),
        })
    }

    /// Adds the overlay on the screen that the viewer looks at.
    pub fn with_overlay(self) -> Targets {
        Targets { panel: Some((History::default(), Seats::default())), ..self }
    }

    /// Pictures of a frame.
    pub fn count(&self) -> usize {
        self.images.count()
    }

    /// Numbers of shapes that the last frame drew and left out.
    pub fn draw_counts(&self) -> DrawCounts {
        self.images.renderer.counts
    }

    /// Draws the world into all images and waits for the device.
    pub fn draw(&mut self, world: &World) -> Result<DrawTimes, RenderError> {
        let upload_s = self.bodies.upload(&self.images.gpu, world)?;
        let sizes = self.images.sizes();
        let tiles = self.screens.tiles(world, &sizes);
        let instances = self.bodies.instances(world);
        let contents = contents(world, &instances);
        let contents = vec![&contents; tiles.len()];
        let plates = self.bodies.plates(world);
        let drawn = if self.panel.is_none() && plates.is_empty() {
            self.images.present(&tiles, &contents, None)?
        } else {
            let readings = self.panel.as_ref().map(|_| Readings {
                device: self.images.gpu.adapter_name.clone(),
                deformation: self.bodies.deformation(),
                source: "offscreen; present is the drawing".to_owned(),
                warnings: world.warnings.clone(),
                ..Readings::take(world)
            });
            let overlay = self.overlay.get_or_insert_with(|| Overlay::new(COLOR_FORMAT));
            let panel = readings.as_ref().zip(self.panel.as_mut());
            let (clear, seats, Screens { layout, swapped }) =
                (keep_clear(world), &mut self.seats, &self.screens);
            let mut over = Over { world, plates: &plates, clear, swapped: *swapped, panel, seats };
            let mut paint = |gpu: &Gpu, picture: &EyePicture<'_>| {
                let (window, size) = (&layout[picture.window], sizes[picture.window]);
                over.paint(overlay, gpu, picture, window, size)
            };
            self.images.present(&tiles, &contents, Some(&mut paint))?
        };
        let [encode_s, draw_s] = [drawn.encode, drawn.present].map(|time| time.as_secs_f64());
        if let Some((history, _)) = &mut self.panel {
            let StepTimes { interact_s, deform_s, normals_s } = world.frame.times;
            let steps = [0.0, interact_s, deform_s, normals_s, upload_s, encode_s, 0.0, draw_s];
            history.push(FrameSteps { steps, whole_s: steps.iter().sum() });
        }
        Ok(DrawTimes { upload_s, encode_s, draw_s })
    }

    /// Reads all pictures back, named by screen and eye; and the time it took, s.
    pub fn read(&self) -> Result<(Vec<NamedImage<'_>>, f64), RenderError> {
        let (images, read_s) = self.images.read()?;
        Ok((self.names.iter().map(String::as_str).zip(images).collect(), read_s))
    }
}

/// Plates and overlay over the pictures of a world.
struct Over<'a> {
    world: &'a World,
    plates: &'a [Plate],
    /// Rectangles to keep clear on each screen.
    clear: Vec<KeepClear>,
    swapped: bool,
    panel: Option<(&'a Readings, &'a mut (History, Seats))>,
    seats: &'a mut PlateSeats,
}

impl Over<'_> {
    fn paint(
        &mut self,
        overlay: &mut Overlay,
        gpu: &Gpu,
        picture: &EyePicture<'_>,
        window: &Window,
        size: [u32; 2],
    ) -> Result<(), RenderError> {
        let (World { assets, room_from_head, .. }, plates) = (self.world, self.plates);
        let stage = &assets.stage;
        let Some(part) = window_layout::part(stage, window, size, picture, self.swapped) else {
            return Ok(());
        };
        let is_faced = part.screen == stage.faced_screen();
        let nothing = KeepClear::default();
        let clear = self.clear.get(part.screen).unwrap_or(&nothing);
        let time_s = *self.world.graph.get(self.world.fields.time);
        // Only the plates of the screen that the viewer looks at have seats.
        let mut none = PlateSeats::default();
        let seats = if is_faced { &mut *self.seats } else { &mut none };
        let mut panel = self.panel.as_mut().filter(|_| is_faced);
        overlay.paint(gpu, picture.texture, picture.texture_size, |painter| {
            let mut taken = Vec::new();
            if let Some((readings, (history, seats))) = &mut panel {
                let (rect, held) = (part.rect, part.pixels(&clear.held));
                taken = Panel { painter, rect, readings, history, clear: &held, taken: &[] }.paint(seats);
            }
            let plates = Plates { stage, room_from_head, plates, lift: 0.0, taken: &taken, clear, time_s };
            plates.paint(painter, &part, seats);
        })
    }
}

/// The pictures to be made, by name: SCREEN-EYE, or SCREEN-STEREO where both eyes are in one, or the window's own name.
fn windows(stage: &Stage, pictures: Pictures) -> Vec<(Window, String)> {
    let stereo = match pictures {
        Pictures::Eyes => None,
        Pictures::Joined(stereo) => Some(stereo),
        Pictures::Windows => {
            let layout = stage.layout();
            let names = file_names(layout.iter().map(|window| window.name.as_str()));
            return layout.into_iter().zip(names).collect();
        }
    };
    let usual = match stage.stereo.eyes() {
        [_] => stage.stereo,
        _ => Stereo::Separate,
    };
    let stage = Stage { stereo: stereo.unwrap_or(usual), ..stage.clone() };
    let named = |window: Window| {
        let tile = &window.tiles[0];
        let kind = match tile.stereo.eyes() {
            [eye] => eye.name(),
            _ => tile.stereo.name(),
        };
        let name = format!("{}-{kind}", stage.screens[tile.screen].name);
        (window, name)
    };
    stage.usual_layout().into_iter().map(named).collect()
}

/// Names of windows as names of files: letters, digits and `-`; one that was there before gets a number.
fn file_names<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let mut unique = |name: &str| {
        let plain: String = name.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
        let numbered = (2..).map(|number| format!("{plain}-{number}"));
        let free = std::iter::once(plain.clone()).chain(numbered).find(|name| !taken.contains(name));
        let free = free.unwrap_or(plain);
        taken.insert(free.clone());
        free
    };
    names.map(&mut unique).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_of_one_name_make_two_files_in_the_folder() {
        let names = file_names(["wall left", "../a/b", "wall left", "wall-left", "é"].into_iter());
        assert_eq!(names, ["wall-left", "---a-b", "wall-left-2", "wall-left-3", "é"]);
    }
}
