//! The desk: lets a person change a scene with the mouse while it is shown, and save results of it.
//!
//! In: keys, and mouse and keyboard over a panel in one window. Out: a [`Session`] whose bodies have another model, material or
//! effects, or that is on another stage (computed in the background, while the old bodies stay usable), pictures, videos and
//! files for other programs. Messages stay in the window for a few seconds. As long as the panel is hidden and there is no
//! message, nothing is laid out or drawn.

mod editor;
mod editor_panel;
mod foot;
pub mod input;
pub mod keep;
mod messages;
mod panel;
mod style;
mod units;
pub mod video;

use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::edit::save;
use crate::green::GreenFile;
use crate::interact::PickRay;
use crate::prepare::Resolved;
use crate::render::window::{Button, Glass, Input, Key, Windows};
use crate::render::{BodyInstance, Gpu, Overlay, RenderError};
use crate::session::change::Step;
use crate::session::keys::{scale, takes_over};
use crate::session::{Change, Session, Steps};
use crate::stage::Stage;
use editor::{Editor, Sketches, Unsaved};
use egui::Popup;
use input::PanelInput;
use keep::{Keeper, said};
pub use messages::After;
use messages::{Messages, Order};
use panel::Draft;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Files of earlier changes that are kept in memory.
const KEPT: usize = 4;

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
    /// Progress of the scene, before it is shown.
    pub making: Option<Arc<Steps>>,
    /// The message when the change is shown; `None`: a list of what it changed.
    told: Option<String>,
    sketches: Sketches,
    /// The files of earlier changes, so that the way back costs nothing, and where they are.
    known: Vec<Arc<GreenFile>>,
    folder: Option<tempfile::TempDir>,
    /// Number of files that were begun there.
    begun: usize,
    orders: Vec<Order>,
    /// Rectangles of panel and messages in the window.
    covered: Vec<egui::Rect>,
    /// The work about which it was warned that it would be lost.
    warned: Unsaved,
    started: Instant,
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
            making: None,
            told: None,
            sketches: Sketches::default(),
            known: Vec::new(),
            folder: None,
            begun: 0,
            orders: Vec::new(),
            covered: Vec::new(),
            warned: Unsaved::new(),
            started: Instant::now(),
        }
    }
}

impl Desk {
    /// Takes an input, and returns it if it is meant for the scene. `ray` is that of the mouse at a place of a window. A press
    /// that is kept takes over from a script as one on the scene does.
    pub fn input(
        &mut self,
        input: Input,
        session: &mut Session,
        ray: impl FnOnce(usize, [f32; 2], &Session) -> Option<PickRay>,
    ) -> Option<Input> {
        let meant = self.meant_for_scene(input, session, ray);
        let is_press = match input {
            Input::Button { pressed, .. } => pressed,
            Input::Key { key, pressed, .. } => pressed && takes_over(key),
            _ => false,
        };
        if is_press && meant.is_none() {
            session.take_over();
        }
        meant
    }

    fn meant_for_scene(
        &mut self,
        input: Input,
        session: &mut Session,
        ray: impl FnOnce(usize, [f32; 2], &Session) -> Option<PickRay>,
    ) -> Option<Input> {
        if self.takes(&input, session) {
            let is_over = self.input.is_over();
            self.sketches.open.iter_mut().filter(|_| is_over).for_each(Editor::leave);
            return None;
        }
        let Some(editor) = self.sketches.open.as_mut().filter(|_| self.is_open) else { return Some(input) };
        match input {
            Input::Cursor { window, position } => {
                let is_drawing = editor.point(ray(window, position, session), &session.world);
                (!is_drawing).then_some(input)
            }
            Input::Button { button: Button::Left, pressed, .. } => {
                if self.change.is_none() {
                    editor.press(pressed);
                }
                None
            }
            Input::Button { window, button: Button::Right, pressed } => {
                Some(Input::Button { window, button: Button::Middle, pressed })
            }
            Input::Wheel { lines, .. } if !self.input.modifiers.ctrl => {
                session.act(scale(lines.into()));
                None
            }
            Input::Key { key: Key::Char('z'), pressed, .. } if self.input.modifiers.ctrl => {
                if pressed && self.change.is_none() {
                    editor.sketch.undo();
                }
                None
            }
            _ => Some(input),
        }
    }

    /// Whether an input is meant for the panel alone.
    fn takes(&mut self, input: &Input, session: &Session) -> bool {
        if let Input::Key { window, key, pressed, .. } = *input {
            let is_free = !(self.is_open && self.input.is_writing);
            match key {
                Key::Tab if is_free => {
                    if pressed {
                        self.toggle(window, session);
                    }
                    return true;
                }
                Key::Char('k') if is_free && !self.input.modifiers.ctrl => {
                    if pressed {
                        let is_editing = self.sketches.open.is_some();
                        if !self.is_open {
                            self.toggle(window, session);
                        } else if is_editing {
                            self.orders.push(Order::Edit(None));
                        }
                        let body = self.draft.as_ref().and_then(Draft::chosen).filter(|_| !is_editing);
                        self.orders.extend(body.map(|body| Order::Edit(Some(body))));
                    }
                    return true;
                }
                Key::Char('l') if is_free && !self.input.modifiers.ctrl => {
                    self.orders.extend(pressed.then_some(Order::Release));
                    return true;
                }
                Key::Function(number @ (8 | 9 | 11 | 12)) => {
                    if pressed {
                        self.window = if self.is_open { self.window } else { window };
                        self.orders.push(match number {
                            8 => Order::Record,
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
        self.draft = session.scene.as_deref().filter(|_| self.is_open).map(Draft::new);
    }

    /// Carries out the orders, and shows what was computed meanwhile.
    pub fn step(&mut self, session: &mut Session) -> After {
        for order in std::mem::take(&mut self.orders) {
            self.follow(order, session);
        }
        if !self.warned.is_empty() && self.warned != self.sketches.unsaved() {
            self.warned.clear();
        }
        if let Some(draft) = &self.draft
            && let Err(failure) = self.sketches.load(&draft.scene)
        {
            self.messages.wrong(&said(&failure));
        }
        let Some(change) = self.change.take_if(|change| change.is_done()) else { return After::Nothing };
        match change.finish() {
            Ok(changed) => {
                let after = if changed.is_other_stage { After::NewWindows } else { After::NewBodies };
                let file = changed.file.clone();
                let before = session.file.clone();
                let what = match (self.told.take(), &session.scene) {
                    (Some(told), _) => told,
                    (None, shown) => {
                        messages::changes(shown.as_ref().unwrap_or(&changed.scene), &changed.scene)
                    }
                };
                if let Err(failure) = session.take(changed) {
                    self.messages.wrong(&said(&failure));
                    if session.file.as_ref().is_none_or(|now| !Arc::ptr_eq(now, &file)) {
                        return After::Nothing;
                    }
                } else {
                    // What was made can be taken at once: nothing lies over it.
                    let was_made = session.scene.as_ref().is_some_and(|scene| self.sketches.was_made(scene));
                    self.is_open &= !was_made;
                    let ready = "Ready: take the body with the left button. Tab: the panel, where the scene can be saved.";
                    self.messages.tell(if was_made { ready } else { &what });
                }
                self.known.extend(
                    before.filter(|before| !self.known.iter().any(|known| Arc::ptr_eq(known, before))),
                );
                let surplus = self.known.len().saturating_sub(KEPT);
                self.known.drain(..surplus);
                if after == After::NewWindows {
                    self.window = 0;
                }
                self.draft = session.scene.as_deref().filter(|_| self.is_open).map(Draft::new);
                after
            }
            Err(failure) => {
                self.told = None;
                self.refuse(&failure, session);
                After::Nothing
            }
        }
    }

    fn follow(&mut self, order: Order, session: &mut Session) {
        match order {
            Order::Apply => {
                if let Err(failure) = self.begin(session) {
                    self.refuse(&failure, session);
                }
            }
            Order::Release => match input::scene(session) {
                Ok((scene, told)) => {
                    let begun = self.path().and_then(|path| {
                        self.change_to(
                            Resolved::new(scene)?,
                            session.world.assets.stage.clone(),
                            path,
                            session,
                        )
                    });
                    match begun {
                        Ok(()) => self.told = Some(told),
                        Err(failure) => self.refuse(&failure, session),
                    }
                }
                Err(why) => self.messages.wrong(&why),
            },
            Order::GiveUp => (self.change, self.sketches.loading) = (None, None),
            Order::Reset => self.draft = session.scene.as_deref().map(Draft::new),
            Order::Picture => self.keeper.want_picture(),
            Order::Video => self.keeper.toggle_video().into_iter().for_each(|told| self.messages.say(told)),
            Order::Record if self.change.is_some() => {
                self.messages.wrong("Not recorded: bodies are being computed; record when they are shown");
            }
            Order::Record => {
                let told = keep::toggle_recording(session);
                self.messages.say(told.map_err(|failure| said(&failure)));
            }
            Order::Export(name) => {
                let exported = crate::export::find_surface(name).map_err(Failure::wrong);
                let exported = exported.and_then(|exporter| keep::export(&session.world, exporter));
                self.messages.say(exported.map_err(|failure| said(&failure)));
            }
            Order::Close => (self.is_open, self.draft) = (false, None),
            Order::Edit(None) => self.sketches.leave().iter().for_each(|told| self.messages.tell(told)),
            Order::Edit(Some(body)) => {
                if let Some(draft) = &self.draft
                    && let Err(failure) = self.sketches.begin(&draft.scene, &body)
                {
                    self.messages.wrong(&said(&failure));
                }
            }
            Order::Save(path) => match self.save(session, &path) {
                Ok(()) => self.messages.tell(&format!("Saved: {}", path.display())),
                Err(failure) => self.messages.wrong(&format!("Not saved: {}", said(&failure))),
            },
        }
    }

    fn refuse(&mut self, failure: &Failure, session: &Session) {
        self.messages.wrong(&messages::refused(failure, session.scene.as_deref()));
    }

    /// Begins to compute the draft of the panel.
    fn begin(&mut self, session: &Session) -> Result<(), Failure> {
        let Some(draft) = &self.draft else { return Ok(()) };
        let (scene, stage) = draft.wanted(session, self.sketches.open.as_ref())?;
        let scene = Resolved::new(scene)?;
        messages::try_compliance(&scene)?;
        let path = self.path()?;
        self.told = None;
        self.change_to(scene, stage, path, session)
    }

    /// Begins to compute another scene.
    fn change_to(
        &mut self,
        scene: Resolved,
        stage: Stage,
        path: PathBuf,
        session: &Session,
    ) -> Result<(), Failure> {
        let known = session.file.iter().chain(&self.known).cloned().collect();
        self.change = Some(Change::begin(session, scene, stage, path, known)?);
        Ok(())
    }

    /// Writes the draft of the panel as a scene file; from then on that is the scene shown, if the draft is.
    fn save(&mut self, session: &mut Session, path: &std::path::Path) -> Result<(), Failure> {
        let Some(draft) = &mut self.draft else { return Ok(()) };
        let (scene, _) = draft.wanted(session, self.sketches.open.as_ref())?;
        let scene = Resolved::new(scene)?;
        let is_shown = session.scene.as_ref().is_some_and(|shown| shown.body == scene.body);
        let file = session.file.as_deref().filter(|_| is_shown);
        let saved = save::save(&scene, &draft.comments(&scene), file, path)?;
        draft.was_saved(&saved);
        self.sketches.were_saved();
        if is_shown && draft.is_on_shown_stage(&scene) {
            session.scene = Some(Resolved::new(saved)?);
            session.is_saved = true;
        }
        Ok(())
    }

    /// The body on which control elements are made, which is drawn in place of the scene's.
    pub fn edited(&mut self, gpu: &Gpu, session: &Session) -> Result<Option<BodyInstance<'_>>, RenderError> {
        let editor = self.sketches.open.as_mut().filter(|_| self.is_open);
        editor.map(|editor| editor.instance(gpu, &session.world)).transpose()
    }

    /// Warns of work that no file holds, once while nothing of it changes, so that a second Escape quits; returns whether it
    /// did.
    pub fn keeps_open(&mut self) -> bool {
        let unsaved = self.sketches.unsaved();
        let warns = !unsaved.is_empty() && unsaved != self.warned;
        if warns {
            self.messages.wrong(&editor::warning(&unsaved));
        }
        self.warned = unsaved;
        warns
    }

    /// The path of the next .green file: beside nothing of the user's, until a scene is saved.
    fn path(&mut self) -> Result<PathBuf, Failure> {
        let folder = match self.folder.take() {
            Some(folder) => folder,
            None => tempfile::Builder::new().prefix("greenstage-").tempdir().map_err(Failure::work)?,
        };
        let path = folder.path().join(format!("{}.green", self.begun));
        self.begun += 1;
        self.folder = Some(folder);
        Ok(path)
    }

    /// Lays out what is to be seen of it over the next picture.
    pub fn lay_out(&mut self, windows: &mut Windows, session: &Session) {
        let time_s = self.started.elapsed().as_secs_f64();
        self.keeper.ask(windows, self.window, time_s);
        self.messages.forget_old();
        self.covered.clear();
        let is_seen = self.is_open
            || self.step_now().is_some()
            || !self.messages.is_empty()
            || self.keeper.is_recording();
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
        let step = self.step_now();
        let Desk { draft, messages, keeper, orders, is_open, sketches, .. } = self;
        let mut told = Vec::new();
        let (mut rect, mut was_over, mut has_list, mut is_writing) = (None, false, false, false);
        let mesh = overlay.lay_out_widgets(size, input, |context| {
            if is_new {
                style::apply(context);
            }
            if let Some(draft) = draft.as_mut().filter(|_| *is_open) {
                let now = panel::Now { session, step: step.as_ref(), is_recording: keeper.is_recording() };
                rect = panel::show(context, draft, sketches, &now, orders);
            } else if let Some(step) = &step {
                told.push(messages::show_step(context, step));
            }
            told.extend(messages.show(context, keeper.is_recording()));
            (was_over, has_list) = (context.is_pointer_over_egui(), Popup::is_any_open(context));
            is_writing = context.text_edit_focused();
        });
        self.covered.extend(told.into_iter().chain(rect));
        (self.input.rect, self.input.was_over) = (rect, was_over);
        (self.input.has_list, self.input.is_writing) = (has_list, is_writing);
        windows.glass = Some(Glass { window: self.window, overlay, mesh });
    }

    /// The step that is being computed.
    fn step_now(&self) -> Option<Step> {
        let change = self.change.as_ref().map(|change| &change.steps);
        let steps = change.or(self.making.as_ref()).map(|steps| steps.now());
        steps.or_else(|| self.sketches.step())
    }

    /// The window in which it is, and where it covers what is below.
    pub fn covered(&self) -> (usize, Vec<egui::Rect>) {
        (self.window, self.covered.clone())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::Leader;
    use crate::track::Script;

    /// Tab, K and L left the script to lead.
    #[test]
    fn the_keys_of_the_desk_take_over_from_a_script() {
        for (key, leader) in [
            (Key::Tab, Leader::Nobody),
            (Key::Char('k'), Leader::Nobody),
            (Key::Char('l'), Leader::Nobody),
            (Key::Function(8), Leader::Script),
        ] {
            let script = Script::find("bend").unwrap();
            let mut session = Session::new(crate::world::tests::world(), Some(script));
            let input = Input::Key { window: 0, key, pressed: true };
            assert_eq!(Desk::default().input(input, &mut session, |_, _, _| None), None);
            assert_eq!(session.input.leader(), leader, "{key:?}");
        }
    }
}
