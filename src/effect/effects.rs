//! The list of effects.

use super::entry::{EffectEntry, ResolvedBody};
use super::{
    contact, cut, dynamics, expected, force_curve, ghost_equilibrium, ghost_rest, haptics, sound, stress,
};
use crate::config;
use crate::scene::Body;

/// All effects; a new one is one file and one line here.
pub const EFFECTS: &[EffectEntry] = &[
    haptics::live::ENTRY,
    expected::ENTRY,
    // Before what touches bodies, which it remakes.
    cut::ENTRY,
    // Before what gives bodies inertia, which it presses.
    contact::ENTRY,
    dynamics::ENTRY,
    sound::ENTRY,
    stress::ENTRY,
    ghost_rest::ENTRY,
    ghost_equilibrium::ENTRY,
    force_curve::ENTRY,
];

/// The effect called `name`, or what there is instead.
pub fn find_effect(name: &str) -> Result<&'static EffectEntry, String> {
    find_among(EFFECTS, name)
}

/// The one of `effects` called `name`, or what there is instead.
pub(super) fn find_among(
    effects: &'static [EffectEntry],
    name: &str,
) -> Result<&'static EffectEntry, String> {
    let found = effects.iter().find(|entry| entry.name == name);
    found.ok_or_else(|| {
        let absent = ABSENT.iter().find(|(names, _)| names.contains(&name));
        if let Some((_, fact)) = absent {
            return format!("there is no effect \"{name}\": {fact}");
        }
        if config::keys::<Body>().iter().any(|key| key == name) {
            return format!("\"{name}\" is no effect but a key: write {name} = … below [body.NAME]");
        }
        config::unknown_name("effect", name, effects.iter().map(|entry| entry.name))
    })
}

/// The name of the effect of which this holds, to be listed by whoever asks for what it does.
pub fn name_of(is_meant: fn(&EffectEntry) -> bool) -> &'static str {
    EFFECTS.iter().find(|entry| is_meant(entry)).map_or("", |entry| entry.name)
}

/// The effects that a body lists, in the order in which they act: that of the program's table.
pub fn in_order(body: &ResolvedBody) -> Vec<&'static str> {
    EFFECTS.iter().filter(|entry| body.lists(entry)).map(|entry| entry.name).collect()
}

/// Effects that people look for by these names and that the program does not have, with what it does instead.
const ABSENT: &[(&[&str], &str)] = &[
    (&["collision", "touch"], "tools touch bodies by the effect \"contact\""),
    (&["inertia", "vibration", "modes"], "inertia and vibration are in the effect \"dynamics\""),
    (&["cutting", "incision", "blade"], "blades cut bodies by the effect \"cut\""),
    (&["audio", "acoustics"], "bodies are heard by the effect \"sound\""),
];
