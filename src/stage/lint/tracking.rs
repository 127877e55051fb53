//! Finds mistakes in a stage's trackers, sensors and styli that load and then do nothing, or something else than was meant.

use crate::base::diagnostic::{Diagnostic, Severity};
use crate::stage::description::Stage;

/// Longest unit of a tracker, m: a metre, within the error of a measured scale.
const LONGEST_UNIT_M: f64 = 1.1;
/// Shortest unit of a tracker, m: a millimetre, within the same error.
const SHORTEST_UNIT_M: f64 = 0.9e-3;

pub fn lint(stage: &Stage, found: &mut Vec<Diagnostic>) {
    for (name, tracker) in &stage.tracking.trackers {
        let scale = tracker.frame.room_from_tracker.scaling();
        let is_haptic = stage.haptics.iter().any(|haptic| haptic.tracker() == *name);
        if is_haptic || (SHORTEST_UNIT_M..=LONGEST_UNIT_M).contains(&scale) {
            continue;
        }
        // Whoever takes it for millimetres per unit writes 25.4.
        let instead = Some(scale * 1e-3).filter(|scale| (SHORTEST_UNIT_M..=LONGEST_UNIT_M).contains(scale));
        let instead =
            instead.map_or(String::new(), |scale| format!("; write {}?", (scale * 1e9).round() / 1e9));
        let message = format!(
            "scale = {scale}: a unit of the tracker is {scale} m long in the room, where inches are 0.0254 and centimetres \
             0.01{instead}"
        );
        warn(found, format!("tracker.{name}.room_from_tracker"), message);
    }
    for (name, stylus) in &stage.tracking.styli {
        let has_grip = stage.is_felt_in(name);
        if stylus.grab.is_none() && !has_grip {
            let message = "it has no `grab`: it points, and can never grab; `greenstage track` shows the numbers of \
                           the buttons";
            warn(found, format!("stylus.{name}"), message);
        }
    }
    for (name, sensor) in &stage.tracking.sensors {
        let is_head = stage.tracking.head.as_ref() == Some(name);
        let is_used = is_head
            || stage.tracking.styli.values().any(|stylus| stylus.sensor == *name)
            || stage.haptics.iter().any(|haptic| haptic.tracker() == sensor.tracker);
        if !is_used {
            let message = "nothing uses it: `head` in [viewer], or `sensor` in a [stylus.NAME], names one";
            warn(found, format!("sensor.{name}"), message);
        }
    }
}

fn warn(found: &mut Vec<Diagnostic>, place: String, message: impl Into<String>) {
    found.push(Diagnostic::new(Severity::Warning, place, message));
}
