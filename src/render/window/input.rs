//! The user's input in neutral terms, so that nobody outside knows the window library.

use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent};
use winit::keyboard::{Key as LogicalKey, NamedKey};

/// Pixels of a touchpad that count as one line of a wheel.
const PIXELS_PER_LINE: f64 = 40.0;

/// One thing the user did, in the window of this index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Input {
    /// Share of the window's width from the left and of its height from the top; outside 0 to 1 while a drag leaves it.
    Cursor {
        window: usize,
        position: [f32; 2],
    },
    CursorLeft {
        window: usize,
    },
    Button {
        window: usize,
        button: Button,
        pressed: bool,
    },
    /// Lines, positive away from the user.
    Wheel {
        window: usize,
        lines: f32,
    },
    /// Key repeats are left out.
    Key {
        window: usize,
        key: Key,
        pressed: bool,
    },
    /// Width and height in pixels; zero when minimised.
    Resized {
        window: usize,
        size: [u32; 2],
    },
    /// On losing the focus, releases of held keys and buttons may never come.
    Focus {
        window: usize,
        focused: bool,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Button {
    Left,
    Middle,
    Right,
    Other(u16),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Key {
    /// A character that the key types, in lower case.
    Char(char),
    Escape,
    Enter,
    Tab,
    Backspace,
    Delete,
    Left,
    Right,
    Up,
    Down,
    PageUp,
    PageDown,
    Home,
    End,
    Shift,
    Control,
    Alt,
    /// F1 to F12.
    Function(u8),
}

/// None for events that mean nothing here.
pub(super) fn neutral(window: usize, size: [u32; 2], event: &WindowEvent) -> Option<Input> {
    match event {
        WindowEvent::CursorMoved { position, .. } => {
            let share = |pixel: f64, length: u32| (pixel / f64::from(length.max(1))) as f32;
            Some(Input::Cursor { window, position: [share(position.x, size[0]), share(position.y, size[1])] })
        }
        WindowEvent::CursorLeft { .. } => Some(Input::CursorLeft { window }),
        WindowEvent::MouseInput { state, button, .. } => {
            let button = match button {
                MouseButton::Left => Button::Left,
                MouseButton::Middle => Button::Middle,
                MouseButton::Right => Button::Right,
                MouseButton::Back => Button::Other(8),
                MouseButton::Forward => Button::Other(9),
                MouseButton::Other(number) => Button::Other(*number),
            };
            Some(Input::Button { window, button, pressed: *state == ElementState::Pressed })
        }
        WindowEvent::MouseWheel { delta, .. } => {
            let lines = match delta {
                MouseScrollDelta::LineDelta(_, lines) => *lines,
                MouseScrollDelta::PixelDelta(pixels) => (pixels.y / PIXELS_PER_LINE) as f32,
            };
            Some(Input::Wheel { window, lines })
        }
        WindowEvent::KeyboardInput { event, .. } if !event.repeat => {
            let key = neutral_key(&event.logical_key)?;
            Some(Input::Key { window, key, pressed: event.state == ElementState::Pressed })
        }
        WindowEvent::Resized(size) => Some(Input::Resized { window, size: (*size).into() }),
        WindowEvent::Focused(focused) => Some(Input::Focus { window, focused: *focused }),
        _ => None,
    }
}

fn neutral_key(key: &LogicalKey) -> Option<Key> {
    const FUNCTION: [NamedKey; 12] = [
        NamedKey::F1,
        NamedKey::F2,
        NamedKey::F3,
        NamedKey::F4,
        NamedKey::F5,
        NamedKey::F6,
        NamedKey::F7,
        NamedKey::F8,
        NamedKey::F9,
        NamedKey::F10,
        NamedKey::F11,
        NamedKey::F12,
    ];
    Some(match key {
        LogicalKey::Character(text) => Key::Char(text.chars().next()?.to_lowercase().next()?),
        LogicalKey::Named(NamedKey::Space) => Key::Char(' '),
        LogicalKey::Named(NamedKey::Escape) => Key::Escape,
        LogicalKey::Named(NamedKey::Enter) => Key::Enter,
        LogicalKey::Named(NamedKey::Tab) => Key::Tab,
        LogicalKey::Named(NamedKey::Backspace) => Key::Backspace,
        LogicalKey::Named(NamedKey::Delete) => Key::Delete,
        LogicalKey::Named(NamedKey::ArrowLeft) => Key::Left,
        LogicalKey::Named(NamedKey::ArrowRight) => Key::Right,
        LogicalKey::Named(NamedKey::ArrowUp) => Key::Up,
        LogicalKey::Named(NamedKey::ArrowDown) => Key::Down,
        LogicalKey::Named(NamedKey::PageUp) => Key::PageUp,
        LogicalKey::Named(NamedKey::PageDown) => Key::PageDown,
        LogicalKey::Named(NamedKey::Home) => Key::Home,
        LogicalKey::Named(NamedKey::End) => Key::End,
        LogicalKey::Named(NamedKey::Shift) => Key::Shift,
        LogicalKey::Named(NamedKey::Control) => Key::Control,
        LogicalKey::Named(NamedKey::Alt) => Key::Alt,
        LogicalKey::Named(named) => {
            let index = FUNCTION.iter().position(|function| function == named)?;
            Key::Function(index as u8 + 1)
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_named_by_what_they_type_in_lower_case() {
        assert_eq!(neutral_key(&LogicalKey::Character("Q".into())), Some(Key::Char('q')));
        assert_eq!(neutral_key(&LogicalKey::Named(NamedKey::F12)), Some(Key::Function(12)));
        assert_eq!(neutral_key(&LogicalKey::Named(NamedKey::Camera)), None);
        assert_eq!(neutral_key(&LogicalKey::Character("".into())), None);
    }

    #[test]
    fn a_cursor_over_a_minimised_window_divides_by_nothing() {
        let event = WindowEvent::CursorMoved {
            device_id: winit::event::DeviceId::dummy(),
            position: winit::dpi::PhysicalPosition::new(3.0, 4.0),
        };
        assert_eq!(neutral(0, [0, 8], &event), Some(Input::Cursor { window: 0, position: [3.0, 0.5] }));
    }
}
