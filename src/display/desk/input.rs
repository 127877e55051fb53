//! Turns a window's input into that of the panel, and decides what is meant for the panel and what for the scene.
//!
//! A button that is pressed over the panel belongs to it until it is let go, one that is pressed elsewhere to the scene.
//! Keys belong to the panel while a text is being written. One key releases a control element, or makes it hold again.

use crate::render::window::{Button, Input, Key};
use crate::scene::{Body, Scene, Updates};
use crate::session::Session;
use egui::{Event, Modifiers, PointerButton, Pos2, Rect, pos2, vec2};

/// Input for the panel since its last layout.
#[derive(Default)]
pub struct PanelInput {
    pub events: Vec<Event>,
    pub modifiers: Modifiers,
    /// The pointer in pixels of the window.
    pub pointer: Pos2,
    /// The panel's rectangle at its last layout.
    pub rect: Option<Rect>,
    /// Whether it had opened a list.
    pub has_list: bool,
    /// Whether the pointer was over the panel or over such a list.
    pub was_over: bool,
    /// Whether a text was being written.
    pub is_writing: bool,
    /// Buttons that were pressed over the panel and are still down.
    pressed: u32,
}

impl PanelInput {
    /// Takes an input in the panel's window, of `size` pixels; true where it is meant for the panel alone.
    pub fn take(&mut self, input: &Input, size: [u32; 2]) -> bool {
        match *input {
            Input::Cursor { position, .. } => {
                self.pointer = pos2(position[0] * size[0] as f32, position[1] * size[1] as f32);
                self.events.push(Event::PointerMoved(self.pointer));
                self.pressed > 0
            }
            Input::CursorLeft { .. } => {
                self.events.push(Event::PointerGone);
                false
            }
            Input::Button { button, pressed, .. } => self.button(button, pressed),
            Input::Wheel { lines, .. } => {
                let is_over = self.is_over();
                if is_over {
                    self.events.push(Event::MouseWheel {
                        unit: egui::MouseWheelUnit::Line,
                        delta: vec2(0.0, lines),
                        phase: egui::TouchPhase::Move,
                        source: egui::MouseWheelSource::Unknown,
                        modifiers: self.modifiers,
                    });
                }
                is_over
            }
            Input::Key { key, pressed, .. } => self.key(key, pressed),
            _ => false,
        }
    }

    /// Whether the pointer is over the panel now: it may have moved since that was laid out.
    pub fn is_over(&self) -> bool {
        match self.has_list {
            true => self.was_over,
            false => self.rect.is_some_and(|rect| rect.contains(self.pointer)),
        }
    }

    fn button(&mut self, button: Button, pressed: bool) -> bool {
        let is_own = if pressed { self.is_over() } else { self.pressed > 0 };
        if !is_own {
            if pressed {
                // A click elsewhere closes lists, and ends the writing of a text.
                self.click();
            }
            return false;
        }
        self.pressed = if pressed { self.pressed + 1 } else { self.pressed - 1 };
        let button = match button {
            Button::Left => PointerButton::Primary,
            Button::Middle => PointerButton::Middle,
            Button::Right | Button::Other(_) => PointerButton::Secondary,
        };
        self.events.push(Event::PointerButton {
            pos: self.pointer,
            button,
            pressed,
            modifiers: self.modifiers,
        });
        true
    }

    fn click(&mut self) {
        let (pos, modifiers, button) = (self.pointer, self.modifiers, PointerButton::Primary);
        let part = |pressed| Event::PointerButton { pos, button, pressed, modifiers };
        self.events.extend([part(true), part(false)]);
    }

    fn key(&mut self, key: Key, pressed: bool) -> bool {
        match key {
            Key::Shift => self.modifiers.shift = pressed,
            Key::Alt => self.modifiers.alt = pressed,
            Key::Control => (self.modifiers.ctrl, self.modifiers.command) = (pressed, pressed),
            _ => {}
        }
        // A key that was pressed for the scene is let go for it as well.
        if !self.is_writing || !pressed {
            return false;
        }
        if let (Key::Char(letter), false) = (key, self.modifiers.ctrl) {
            self.events.push(Event::Text(letter.to_string()));
            return true;
        }
        let named = match key {
            Key::Char('a') => egui::Key::A,
            Key::Enter => egui::Key::Enter,
            Key::Backspace => egui::Key::Backspace,
            Key::Delete => egui::Key::Delete,
            Key::Left => egui::Key::ArrowLeft,
            Key::Right => egui::Key::ArrowRight,
            Key::Up => egui::Key::ArrowUp,
            Key::Down => egui::Key::ArrowDown,
            Key::Home => egui::Key::Home,
            Key::End => egui::Key::End,
            Key::Tab => egui::Key::Tab,
            _ => return false,
        };
        let modifiers = self.modifiers;
        for pressed in [true, false] {
            self.events.push(Event::Key {
                key: named,
                physical_key: None,
                pressed,
                repeat: false,
                modifiers,
            });
        }
        true
    }
}

/// The scene after the key: without the control element under the cursor where there is one, else with the one again that was
/// let go of. The error says what the key would need.
pub fn scene(session: &Session) -> Result<(Scene, String), String> {
    let shown = session.scene.as_ref().ok_or("A replay cannot be changed.")?;
    let mut scene = Scene::clone(shown);
    let world = &session.world;
    if let Some((b, c)) = world.cursor().and_then(|cursor| world.pointed_element(cursor)) {
        let deformer = &world.bodies[b].deformer;
        let (body, control) = (deformer.body.clone(), deformer.controls[c].name.clone());
        let is_released = scene.body.get_mut(&body).is_some_and(|own| own.release(&control));
        return match is_released {
            true => {
                Ok((scene, format!("{body}.{control} is released; L beside all elements: it holds again.")))
            }
            false => {
                let why = scene.body.get(&body).map(|own| own.cannot_release(&body, &control));
                Err(format!("{}.", why.unwrap_or_default()))
            }
        };
    }
    let loose = |body: &Body| body.updates.iter().flat_map(Updates::loose).last().map(str::to_owned);
    let last = scene.body.iter_mut().find_map(|(name, body)| Some((loose(body)?, name.clone(), body)));
    let Some((control, name, body)) = last else {
        return Err("L releases the control element under the cursor; there is none, and none is released."
            .to_owned());
    };
    body.hold(&control);
    Ok((scene, format!("{name}.{control} holds again.")))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [200, 100];

    #[test]
    fn a_button_belongs_to_what_it_was_pressed_over() {
        let mut panel = PanelInput::default();
        let press = |pressed| Input::Button { window: 0, button: Button::Left, pressed };
        assert!(!panel.take(&press(true), SIZE) && !panel.take(&press(false), SIZE));
        panel.rect = Some(Rect::from_min_max(pos2(0.0, 0.0), pos2(90.0, 90.0)));
        assert!(panel.take(&press(true), SIZE));
        assert!(
            panel.take(&Input::Cursor { window: 0, position: [0.5, 0.5] }, SIZE),
            "a drag that leaves it"
        );
        assert_eq!(panel.pointer, pos2(100.0, 50.0));
        assert!(panel.take(&press(false), SIZE));
        assert!(!panel.take(&Input::Cursor { window: 0, position: [0.5, 0.5] }, SIZE));
    }

    #[test]
    fn keys_belong_to_a_text_only_while_it_is_written() {
        let mut panel = PanelInput::default();
        let typed = |pressed| Input::Key { window: 0, key: Key::Char('w'), pressed };
        assert!(!panel.take(&typed(true), SIZE));
        panel.is_writing = true;
        assert!(!panel.take(&typed(false), SIZE), "the head would go on for ever");
        assert!(panel.take(&typed(true), SIZE));
        assert_eq!(panel.events, [Event::Text("w".into())]);
    }
}
