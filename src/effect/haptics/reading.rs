//! The current state of a force device and its loop, for the overlay.

use super::loop_state::LoopState;
use super::thread::LoopTiming;
use crate::base::fixed::{FORCE, TIME, clipped, fixed};
use crate::base::plates::{Tone, Words};

/// The current state of a force device and its loop.
#[derive(Clone, Debug, PartialEq)]
pub struct HapticReading {
    pub name: String,
    pub state: LoopState,
    pub timing: LoopTiming,
    pub max_force_n: f64,
    /// Whether the stylus holds something that is felt, or its tool touches something.
    pub holds: bool,
}

impl HapticReading {
    /// Rows for a force device: its state and force, the timing of its loop, and whether the force was softened.
    pub fn rows(&self) -> Vec<Words> {
        let HapticReading { state, timing, .. } = self;
        let (word, ink) = match () {
            () if state.room_from_handle.is_none() => ("no device", Tone::Bad),
            () if !self.holds => ("nothing held", Tone::Quiet),
            () if state.gain >= 1.0 => ("felt", Tone::Good),
            () if state.gain > 0.0 => ("fading in", Tone::Fair),
            () => ("no force", Tone::Bad),
        };
        let force_n = state.push.force.norm();
        let scale = FORCE.scale(force_n.max(self.max_force_n));
        let limited = if state.limited { "  at its limit" } else { "" };
        let (passive, passive_ink) =
            if state.observer.energy < 0.0 { ("brakes", Tone::Fair) } else { ("passive", Tone::Good) };
        let mut rows = vec![
            vec![(format!("haptic {:<14}", clipped(&self.name, 14)), Tone::Plain), (word.into(), ink)],
            vec![
                ("force ".into(), Tone::Quiet),
                (scale.number(force_n), Tone::Plain),
                (
                    format!(" of {} {}", scale.part(self.max_force_n).trim_start(), scale.plain_name()),
                    Tone::Quiet,
                ),
                (limited.into(), Tone::Fair),
            ],
            vec![
                ("rate ".into(), Tone::Quiet),
                (fixed(timing.rate_hz, 8, 0), Tone::Plain),
                (" Hz  late ".into(), Tone::Quiet),
                (timing.late.to_string(), Tone::Plain),
                ("  out ".into(), Tone::Quiet),
                (timing.missed.to_string(), Tone::Plain),
            ],
            vec![
                ("work p50 ".into(), Tone::Quiet),
                (TIME.quantity(timing.work_p50_s), Tone::Plain),
                (" p99 ".into(), Tone::Quiet),
                (TIME.quantity(timing.work_p99_s), Tone::Plain),
            ],
            vec![
                (format!("{passive:<8}"), passive_ink),
                ("braked ".into(), Tone::Quiet),
                (fixed(1e3 * state.observer.braked, 9, 3), Tone::Plain),
                (" mJ in all".into(), Tone::Quiet),
            ],
        ];
        if state.gain > 0.0 && state.age_s > state.spacing_s {
            rows.push(vec![(
                format!(
                    "late by {} ms: bears {} N/m",
                    fixed(1e3 * state.age_s, 7, 1),
                    fixed(state.bearable, 8, 0)
                ),
                Tone::Fair,
            )]);
        }
        if state.gain > 0.0 && state.stiffer > 1.0 {
            let text = format!("softened: {} times too stiff for it", fixed(state.stiffer, 7, 1));
            rows.push(vec![(text, Tone::Fair)]);
        }
        rows
    }
}
