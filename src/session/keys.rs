//! Turns keys and the wheel of a window into commands to the world.

use crate::interact::{Action, Axis, Freedom, Mode};
use crate::render::window::Key;
use crate::track::mouse::BINDINGS;
use crate::world::World;

/// Forgets what effects have drawn of the past.
pub const CLEAR: Key = Key::Char('c');

/// One line of the wheel scales the scene by this factor.
const SCALE_PER_LINE: f64 = 1.1;
/// Largest number of lines of the wheel that count at once; a device that reports more is faulty.
const MOST_LINES: f64 = 20.0;

/// Shows another field in colours.
pub const NEXT_FIELD: Key = Key::Char('v');

/// Whether a key takes over from a script when it is pressed: function and modifier keys do not, nor does the one that changes the
/// picture only.
pub fn takes_over(key: Key) -> bool {
    !matches!(key, Key::Function(_) | Key::Shift | Key::Control | Key::Alt) && key != NEXT_FIELD
}

/// The command of a key when it is pressed, with or without Ctrl, if it has one.
pub fn action(key: Key, control: bool, world: &World) -> Option<Action> {
    let only = |freedom| Action::SetMode(Mode { freedom, axis: None });
    let along = |axis| Action::SetMode(world.mode().along(axis));
    Some(match (key, control) {
        (Key::Char('z'), true) => Action::Undo,
        (Key::Char('y'), true) => Action::Redo,
        // Ctrl may still be down from undo and redo.
        (Key::Backspace, _) => Action::SnapBack,
        (Key::Home, _) => Action::ResetNavigation,
        (_, true) => return None,
        (Key::Char('f'), _) => only(Freedom::Free),
        (Key::Char('t'), _) => only(Freedom::Translate),
        (Key::Char('g'), _) => only(Freedom::Rotate),
        (Key::Char('x'), _) => along(Axis::X),
        (Key::Char('y'), _) => along(Axis::Y),
        (Key::Char('z'), _) => along(Axis::Z),
        (Key::Char('h'), _) => Action::SetTaking(world.taking()?.next()),
        (Key::Char('m'), _) => Action::Measure,
        (Key::Char('p'), _) => Action::SetAside(world.pointed_body(world.cursor()?)?),
        _ => return None,
    })
}

/// The command of this many `lines` of the wheel, with Ctrl and nothing in the hand.
pub fn scale(lines: f64) -> Action {
    let lines = if lines.is_finite() { lines.clamp(-MOST_LINES, MOST_LINES) } else { 0.0 };
    Action::ScaleScene(SCALE_PER_LINE.powf(lines))
}

/// The list of mouse buttons and keys and what they do, for `--help` and the start of a session.
pub fn bindings() -> String {
    let rows: Vec<String> = BINDINGS.iter().map(|(input, what)| format!("  {input:<36} {what}")).collect();
    format!("Mouse and keyboard:\n{}", rows.join("\n"))
}

/// The name by which [`crate::track::Mouse`] knows a key, if it does; a letter is written into `typed`.
pub fn name(key: Key, typed: &mut [u8; 4]) -> Option<&str> {
    Some(match key {
        Key::Char(c) => c.encode_utf8(typed),
        Key::Left => "ArrowLeft",
        Key::Right => "ArrowRight",
        Key::Up => "ArrowUp",
        Key::Down => "ArrowDown",
        Key::Control => "Control",
        Key::Shift => "Shift",
        _ => return None,
    })
}
