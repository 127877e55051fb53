//! The desk: what a person does to a scene with the mouse while it is shown, and what is taken home from it.
//!
//! In: keys, and mouse and keyboard over a panel in one window. Out: a [`Session`] whose bodies have another model, material or
//! effects, or that is on another stage (computed in the background, while the old bodies stay usable), pictures, videos and
//! files for other programs. Messages are told in the window for a few seconds. As long as the panel is hidden and nothing is
//! told, nothing is laid out or drawn.

pub mod apng;
pub mod input;
pub mod keep;
mod messages;
mod panel;
mod style;
pub mod video;

use super::bodies::GpuBodies;
use crate::base::failure::Failure;
use crate::base::notice::notice;
use crate::green::GreenFile;
use crate::render::Overlay;
use crate::render::window::{AppError, Glass, Input, Key, Windows};
use crate::session::{Change, Session};
use input::PanelInput;
use keep::{Keeper, said};
use messages::Messages;
use panel::Draft;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// What a person asks for in the panel.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Show what the panel says.
    Apply,
    /// Show on; what is being computed is forgotten.
    GiveUp,
    /// The panel says what is shown again.
    Reset,
    Picture,
    Video,
    /// The bodies as they are, in the format of this name.
    Export(&'static str),
    Close,
}

/// The panel, and what it has begun.
pub struct Desk {
    pub is_open: bool,
    /// The window in which it is.
    window: usize,
    sizes: Vec<[u32; 2]>,
    input: PanelInput,
    messages: Messages,
    keeper: Keeper,
    draft: Option<Draft>,
    change: Option<Change>,
    /// The files of earlier changes, so that the way back costs nothing, and where they are.
    known: Vec<Arc<GreenFile>>,
    folder: Option<tempfile::TempDir>,
    orders: Vec<Order>,
    started: Instant,
}

/// What windows have to do after a change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum After {
    Nothing,
    /// The bodies are others.
    NewBodies,
    /// So is the stage, and the windows have to be opened anew.
    NewWindows,
}

impl Default for Desk {
    fn default() -> Desk {
        Desk {
            is_open: false,
            window: 0,
            sizes: Vec::new(),
            input: PanelInput::default(),
            messages: Messages::default(),
            keeper: Keeper::default(),
            draft: None,
            change: None,
            known: Vec::new(),
            folder: None,
            orders: Vec::new(),
            started: Instant::now(),
        }
    }
}

impl Desk {
    /// Takes an input; true where it is not meant for the scene.
    pub fn input(&mut self, input: &Input, session: &Session) -> bool {
        if let Input::Key { window, key, pressed, .. } = *input {
            let is_free = !(self.is_open && self.input.is_writing);
            match key {
                Key::Tab if is_free => {
                    if pressed {
                        self.toggle(window, session);
                    }
                    return true;
                }
                Key::Function(number @ (9 | 11 | 12)) => {
                    if pressed {
                        self.window = if self.is_open { self.window } else { window };
                        self.orders.push(match number {
                            9 => Order::Export("glb"),
                            11 => Order::Video,
                            _ => Order::Picture,
                        });
                    }
                    return true;
                }
                _ => {}
            }
        }
        let of = match *input {
            Input::Cursor { window, .. }
            | Input::CursorLeft { window }
            | Input::Button { window, .. }
            | Input::Wheel { window, .. }
            | Input::Key { window, .. } => window,
            _ => return false,
        };
        let size = self.sizes.get(of).copied().unwrap_or([1, 1]);
        self.is_open && of == self.window && self.input.take(input, size)
    }

    fn toggle(&mut self, window: usize, session: &Session) {
        self.is_open = !self.is_open;
        self.window = window;
        self.input = PanelInput::default();
        self.draft = session.scene.as_ref().filter(|_| self.is_open).map(|scene| Draft::of(scene, session));
    }

    /// Does what was asked for, and puts into the place of what is shown what was computed meanwhile.
    pub fn step(&mut self, session: &mut Session) -> After {
        for order in std::mem::take(&mut self.orders) {
            self.follow(order, session);
        }
        let Some(change) = self.change.take_if(|change| change.is_done()) else { return After::Nothing };
        match change.finish() {
            Ok(changed) => {
                let after = if changed.is_other_stage { After::NewWindows } else { After::NewBodies };
                let file = changed.file.clone();
                let before = session.file.clone();
                if let Err(failure) = session.take(changed) {
                    self.messages.wrong(&said(&failure));
                    if session.file.as_ref().is_none_or(|now| !Arc::ptr_eq(now, &file)) {
                        return After::Nothing;
                    }
                } else {
                    self.messages.tell("Changed.");
                }
                self.known.extend(before.filter(|before| !self.known.iter().any(|known| Arc::ptr_eq(known, before))));
                if after == After::NewWindows {
                    self.window = 0;
                }
                self.draft = session.scene.as_ref().filter(|_| self.is_open).map(|scene| Draft::of(scene, session));
                after
            }
            Err(failure) => {
                self.messages.wrong(&format!("Not changed: {}", said(&failure)));
                After::Nothing
            }
        }
    }

    fn follow(&mut self, order: Order, session: &Session) {
        match order {
            Order::Apply => {
                if let Err(failure) = self.begin(session) {
                    self.messages.wrong(&format!("Not changed: {}", said(&failure)));
                }
            }
            Order::GiveUp => self.change = None,
            Order::Reset => self.draft = session.scene.as_ref().map(|scene| Draft::of(scene, session)),
            Order::Picture => self.keeper.want_picture(),
            Order::Video => self.keeper.toggle_video().into_iter().for_each(|told| self.messages.say(told)),
            Order::Export(name) => {
                let exported = crate::export::find_surface(name).map_err(Failure::wrong);
                let exported = exported.and_then(|exporter| keep::export(&session.world, exporter));
                self.messages.say(exported.map_err(|failure| said(&failure)));
            }
            Order::Close => (self.is_open, self.draft) = (false, None),
        }
    }

    /// Begins to compute what the panel says.
    fn begin(&mut self, session: &Session) -> Result<(), Failure> {
        let Some(draft) = &self.draft else { return Ok(()) };
        let (scene, stage) = draft.wanted(session)?;
        let path = self.path()?;
        let known = session.file.iter().chain(&self.known).cloned().collect();
        self.change = Some(Change::begin(session, scene, stage, path, known)?);
        Ok(())
    }

    /// Where the next .green file goes: beside nothing of the user's, until a scene is saved.
    fn path(&mut self) -> Result<PathBuf, Failure> {
        let folder = match self.folder.take() {
            Some(folder) => folder,
            None => tempfile::Builder::new().prefix("greenstage-").tempdir().map_err(Failure::work)?,
        };
        let path = folder.path().join(format!("{}.green", self.known.len()));
        self.folder = Some(folder);
        Ok(path)
    }

    /// Lays out what is to be seen of it over the next picture.
    pub fn lay_out(&mut self, windows: &mut Windows, session: &Session) {
        let time_s = self.started.elapsed().as_secs_f64();
        self.keeper.ask(windows, self.window, time_s);
        self.messages.forget_old();
        let is_seen = self.is_open || self.change.is_some() || !self.messages.is_empty() || self.keeper.is_recording();
        if !is_seen {
            windows.glass = None;
            return;
        }
        self.sizes = windows.sizes().collect();
        let Some(&size) = self.sizes.get(self.window).filter(|size| !size.contains(&0)) else { return };
        let is_new = windows.glass.is_none();
        let mut overlay =
            windows.glass.take().map_or_else(|| Overlay::new(windows.renderer.format), |glass| glass.overlay);
        let screen = egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(size[0] as f32, size[1] as f32));
        let input = egui::RawInput {
            screen_rect: Some(screen),
            time: Some(time_s),
            events: std::mem::take(&mut self.input.events),
            ..Default::default()
        };
        let Desk { draft, messages, change, keeper, orders, is_open, .. } = self;
        let (mut is_over, mut is_writing) = (false, false);
        let mesh = overlay.lay_out_widgets(size, input, |context| {
            if is_new {
                style::apply(context);
            }
            orders.clear();
            let step = change.as_ref().map(|change| change.steps.now());
            if let Some(draft) = draft.as_mut().filter(|_| *is_open) {
                panel::show(context, draft, session, step.as_ref(), keeper.is_recording(), orders);
            } else if let Some(step) = &step {
                messages::show_step(context, step);
            }
            messages.show(context, keeper.is_recording());
            (is_over, is_writing) = (context.is_pointer_over_egui(), context.egui_wants_keyboard_input());
        });
        (self.input.is_over, self.input.is_writing) = (is_over && self.is_open, is_writing);
        windows.glass = Some(Glass { window: self.window, overlay, mesh });
    }

    /// Takes the picture that was asked for.
    pub fn take_picture(&mut self, windows: &mut Windows) {
        let told = self.keeper.take(windows, self.started.elapsed().as_secs_f64());
        told.into_iter().for_each(|told| self.messages.say(told));
    }

    /// Ends what goes on when the windows close.
    pub fn end(&mut self) {
        match self.keeper.end_video("") {
            Some(Ok(told)) => notice!("{told}"),
            Some(Err(wrong)) => notice!("note: {wrong}"),
            None => {}
        }
    }
}

/// The bodies of a changed session on the device.
pub fn new_bodies(
    windows: &Windows,
    session: &mut Session,
    device: super::device::Args,
) -> Result<GpuBodies, AppError> {
    Ok(GpuBodies::new(&windows.gpu, &mut session.world, device)?)
}
