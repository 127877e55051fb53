//! Messages between Haply's Inverse Service and its clients, as JSON.
//!
//! In: a state message, strictly read. Out: where the arm is and what is pressed, or the command for a force. After the
//! service's public documentation (docs.haply.co/inverseSDK, versions 3.5 and 3.1).

use super::device::{Push, Reading};
use crate::stage::GripButton;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::de::IgnoredAny;
use std::collections::BTreeMap;

/// The contents of one message of the service.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Name of the first arm.
    pub id: Option<String>,
    /// The key at which this version of the service reads its force.
    pub key: ForceKey,
    /// `None`: there is no arm, or it does not say where it is.
    pub reading: Option<Reading>,
}

/// The key of the force in `set_cursor_force`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ForceKey {
    /// The key since version 3.5.
    Vector,
    /// The key of version 3.1.
    Values,
}

#[derive(serde::Deserialize)]
struct StateMessage {
    /// Present since version 3.5.
    session_id: Option<IgnoredAny>,
    #[serde(default)]
    inverse3: Vec<Arm>,
    #[serde(default)]
    wireless_verse_grip: Vec<Grip>,
    #[serde(default)]
    verse_grip: Vec<Grip>,
    #[serde(default)]
    custom_verse_grip: Vec<Grip>,
}

#[derive(serde::Deserialize)]
struct Arm {
    device_id: String,
    state: Option<ArmState>,
}

#[derive(serde::Deserialize)]
struct ArmState {
    cursor_position: Option<Xyz>,
    /// The mode since version 3.5; before, the key is `mode`.
    control_mode: Option<IgnoredAny>,
}

#[derive(serde::Deserialize)]
struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(serde::Deserialize)]
struct Grip {
    #[serde(default)]
    device_id: String,
    state: Option<GripState>,
}

#[derive(serde::Deserialize)]
struct GripState {
    orientation: Option<Xyzw>,
    /// Buttons of a wireless grip, by their names.
    #[serde(default)]
    buttons: BTreeMap<String, bool>,
    /// The one of a grip on a wire.
    #[serde(default)]
    button: bool,
}

#[derive(serde::Deserialize)]
struct Xyzw {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

/// Reads a message of the service. Other keys are ignored, because every version adds some.
pub fn parse(text: &str, arrived_s: f64, buttons: [GripButton; 2]) -> Result<State, String> {
    let said: StateMessage = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let has_mode = |arm: &Arm| arm.state.as_ref().is_some_and(|state| state.control_mode.is_some());
    let is_new = said.session_id.is_some() || said.inverse3.iter().any(has_mode);
    let key = if is_new { ForceKey::Vector } else { ForceKey::Values };
    let Some(arm) = said.inverse3.into_iter().next() else {
        return Ok(State { id: None, key, reading: None });
    };
    if arm.device_id.is_empty() || arm.device_id.len() > 64 {
        return Err(format!("a device_id of {} bytes", arm.device_id.len()));
    }
    let lists = [said.wireless_verse_grip, said.verse_grip, said.custom_verse_grip];
    let told = |grip: Grip| grip.state.map(|state| (grip.device_id, state));
    let grips: Vec<(String, GripState)> = lists.into_iter().flatten().filter_map(told).collect();
    let first = grips.first();
    let orientation = first.and_then(|(_, state)| state.orientation.as_ref());
    let rotation = orientation.map(|q| Quaternion::new(q.w, q.x, q.y, q.z));
    let rotation = rotation.map(|q| UnitQuaternion::try_new(q, 0.5).ok_or("an orientation of no length"));
    let rotation = rotation.transpose()?.unwrap_or_else(UnitQuaternion::identity);
    // Some grips stand in two lists, each with other buttons.
    let is_pressed = |button: GripButton| {
        let is_same = |(id, _): &&(String, GripState)| first.is_some_and(|(first, _)| first == id);
        grips.iter().filter(is_same).any(|(_, state)| {
            let is_named = state.buttons.get(button.name()).copied().unwrap_or(false);
            is_named || button == GripButton::A && state.button
        })
    };
    let buttons = buttons.map(is_pressed);
    let place = arm.state.and_then(|state| state.cursor_position);
    let reading = place.map(|Xyz { x, y, z }| {
        let pose = Isometry3::from_parts(Translation3::new(x, y, z), rotation);
        Reading { buttons, ..Reading::at(pose, arrived_s) }
    });
    Ok(State { id: Some(arm.device_id), key, reading })
}

/// The command for the arm `id` to push with a force.
pub fn force_command(id: &str, key: ForceKey, push: &Push) -> String {
    let [x, y, z] = push.force.into();
    let force = serde_json::json!({ "x": x, "y": y, "z": z });
    let set = match key {
        ForceKey::Vector => serde_json::json!({ "vector": force }),
        ForceKey::Values => serde_json::json!({ "values": force }),
    };
    let command = serde_json::json!({ "device_id": id, "commands": { "set_cursor_force": set } });
    serde_json::json!({ "inverse3": [command] }).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    const USUAL: [GripButton; 2] = [GripButton::A, GripButton::B];

    const STATE: &str = r#"{ "inverse3": [{ "device_id": "0A1B", "config": { "handedness": "right" },
        "state": { "cursor_position": { "x": 0.01, "y": -0.12, "z": 0.2 }, "cursor_velocity": { "x": 0, "y": 0, "z": 0 } } }],
        "wireless_verse_grip": [{ "device_id": "77", "state": {
            "orientation": { "x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8 }, "buttons": { "a": true, "b": false, "c": true } } }] }"#;

    #[test]
    fn a_state_message_is_read() {
        let state = parse(STATE, 7.0, USUAL).unwrap();
        let reading = state.reading.unwrap();
        assert_eq!((state.id.as_deref(), reading.buttons), (Some("0A1B"), [true, false]));
        assert_eq!(reading.arrived_s, 7.0);
        assert_eq!(reading.device_from_handle.translation.vector, Vector3::new(0.01, -0.12, 0.2));
        assert!((reading.device_from_handle.rotation.angle() - 2.0 * 0.8f64.acos()).abs() < 1e-12);
        let nothing = State { id: None, key: ForceKey::Values, reading: None };
        assert_eq!((state.key, parse("{}", 0.0, USUAL).unwrap()), (ForceKey::Values, nothing));
        assert_eq!(pressed(STATE, [GripButton::C, GripButton::B]), [true, false]);
    }

    fn pressed(text: &str, buttons: [GripButton; 2]) -> [bool; 2] {
        parse(text, 0.0, buttons).unwrap().reading.unwrap().buttons
    }

    /// Messages from the documentation of 3.5: an arm with `control_mode`, a grip on a wire with one `button`, and one grip in
    /// two lists.
    #[test]
    fn messages_of_the_service_3_5_are_read() {
        let wired = r#"{ "session_id": 7, "inverse3": [{ "device_id": "049D", "state": {
            "cursor_position": { "x": 0.0, "y": -0.12, "z": 0.15 }, "control_domain": "cartesian", "control_mode": "idle" },
            "status": { "calibrated": true, "in_use": false, "power_supply": true, "ready": true, "started": true } }],
            "verse_grip": [{ "device_id": "61548", "state": { "button": true, "hall": 0,
            "orientation": { "x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8 } }, "status": { "error": 0, "ready": true } }],
            "wireless_verse_grip": [], "custom_verse_grip": [] }"#;
        let state = parse(wired, 0.0, USUAL).unwrap();
        assert_eq!((state.id.as_deref(), state.key), (Some("049D"), ForceKey::Vector));
        assert_eq!(state.reading.unwrap().buttons, [true, false]);
        assert_eq!(pressed(wired, [GripButton::C, GripButton::B]), [false, false]);
        let without = wired.replace("\"session_id\": 7, ", "");
        assert_eq!(parse(&without, 0.0, USUAL).unwrap().key, ForceKey::Vector, "by the arm's control_mode");
        let twice = wired.replace(
            "\"wireless_verse_grip\": []",
            r#""wireless_verse_grip": [{ "device_id": "3", "state": {
            "buttons": { "down": false, "up": true, "right": false, "left": false }, "trigger": 3 } }]"#,
        );
        let twice = twice.replace(
            "\"custom_verse_grip\": []",
            r#""custom_verse_grip": [{ "device_id": "3", "state": {
            "buttons": { "a": false, "b": true, "c": false }, "extension_data": [0, 3] } }]"#,
        );
        assert_eq!(pressed(&twice, [GripButton::Up, GripButton::B]), [true, true]);
        assert_eq!(pressed(&twice, USUAL), [false, true], "the wired one is another");
    }

    #[test]
    fn a_force_command_is_what_the_service_documents() {
        let push = Push { force: Vector3::new(1.0, -2.5, 0.0), torque: Vector3::x() };
        let force = serde_json::json!({"x": 1.0, "y": -2.5, "z": 0.0});
        for (key, expected) in [
            (ForceKey::Vector, serde_json::json!({ "vector": force })),
            (ForceKey::Values, serde_json::json!({ "values": force })),
        ] {
            let text = force_command("0A\"1B", key, &push);
            let value: serde_json::Value = serde_json::from_str(&text).unwrap();
            let arm = &value["inverse3"][0];
            assert_eq!(arm["device_id"], "0A\"1B");
            assert_eq!(arm["commands"]["set_cursor_force"], expected);
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in ".*") {
            let _ = parse(&text, 0.0, USUAL);
        }

        #[test]
        fn no_mutation_panics(at in 0..STATE.len(), byte in 0u8..128, cut in 0..STATE.len()) {
            let mut bytes = STATE.as_bytes().to_vec();
            bytes[at] = byte;
            bytes.truncate(cut.max(1));
            if let Ok(text) = std::str::from_utf8(&bytes) {
                let _ = parse(text, 0.0, USUAL);
            }
        }
    }
}
