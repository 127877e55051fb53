//! The tables `[sound]` and `[[loudspeaker]]` of a stage file: output, device, loudest level, places.

use super::values::point;
use crate::stage::error::StageFault;
use crate::stage::loudspeaker::{Loudspeaker, MOST_LOUDSPEAKERS, Sound, SoundOutput, USUAL_LOUDEST_DB};

/// The range of the loudest level, dB: from that of a quiet room to the threshold of pain.
const LOUDEST_DB: std::ops::RangeInclusive<f64> = 40.0..=130.0;
/// The longest name of a loudspeaker or of a device, in characters.
const LONGEST_NAME: usize = 256;

#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoundFile {
    output: Option<SoundOutput>,
    device: Option<String>,
    loudest_db: Option<f64>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoudspeakerFile {
    name: Option<String>,
    position: [f64; 3],
}

/// The loudspeaker of this number, from 1.
pub fn loudspeaker(file: &LoudspeakerFile, number: usize) -> Result<Loudspeaker, StageFault> {
    let name = file.name.clone().unwrap_or_else(|| format!("loudspeaker {number}"));
    let fault = |message: String| StageFault::Loudspeaker { number, message };
    if number > MOST_LOUDSPEAKERS {
        return Err(fault(format!("a stage has at most {MOST_LOUDSPEAKERS}; remove it")));
    }
    check_text("name", &name).map_err(fault)?;
    let position = point(&format!("the position of loudspeaker {number}"), file.position)?;
    Ok(Loudspeaker { name, position })
}

/// The whole of a stage's sound; `loudspeakers` are those that can be used, of `given` in the file.
pub fn sound(file: &SoundFile, loudspeakers: Vec<Loudspeaker>, given: usize) -> Result<Sound, StageFault> {
    let fault = |message: String| StageFault::Sound { message };
    let usual = if given > 0 { SoundOutput::Loudspeakers } else { SoundOutput::Stereo };
    let output = file.output.unwrap_or(usual);
    if output == SoundOutput::Loudspeakers && given == 0 {
        let message = "output is \"loudspeakers\", and the stage has none: add a [[loudspeaker]] with its \
                       position for each, or write output = \"stereo\"";
        return Err(fault(message.to_owned()));
    }
    if let Some(device) = &file.device {
        check_text("device", device).map_err(fault)?;
    }
    let loudest_db = file.loudest_db.unwrap_or(USUAL_LOUDEST_DB);
    if !LOUDEST_DB.contains(&loudest_db) {
        return Err(fault(format!(
            "loudest_db is {loudest_db}: it must be a number of dB re 20 µPa between {} and {}",
            LOUDEST_DB.start(),
            LOUDEST_DB.end()
        )));
    }
    Ok(Sound { output, device: file.device.clone(), loudest_db, loudspeakers })
}

fn check_text(key: &str, text: &str) -> Result<(), String> {
    let length = text.chars().count();
    match (1..=LONGEST_NAME).contains(&length) && !text.chars().any(char::is_control) {
        true => Ok(()),
        false => Err(format!("{key} has {length} characters: use 1 to {LONGEST_NAME}, all in one line")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::{BUILT_IN, Stage, StageError};
    use nalgebra::Point3;
    use proptest::prelude::*;
    use std::path::Path;

    fn stage(tables: &str) -> Result<Stage, StageError> {
        Stage::parse(&format!("{}\n{tables}\n", BUILT_IN[0].1), Path::new("bench.toml"))
    }

    const TWO: &str = "[[loudspeaker]]\nposition = [-1, 1.2, 0]\n[[loudspeaker]]\nname = \"right front\"\nposition = [1, 1.2, 0]\n";

    #[test]
    fn the_output_follows_from_the_loudspeakers_unless_it_is_given() {
        assert_eq!(stage("").unwrap().sound, Sound::default());
        let sound = stage(TWO).unwrap().sound;
        assert_eq!((sound.output, sound.loudest_db), (SoundOutput::Loudspeakers, 94.0));
        let names: Vec<&str> = sound.loudspeakers.iter().map(|one| one.name.as_str()).collect();
        assert_eq!(names, ["loudspeaker 1", "right front"]);
        assert_eq!(sound.loudspeakers[1].position, Point3::new(1.0, 1.2, 0.0));
        let given = format!("{TWO}[sound]\noutput = \"headphones\"\ndevice = \"hw:1,0\"\nloudest_db = 100\n");
        let sound = stage(&given).unwrap().sound;
        assert_eq!((sound.output, sound.loudest_db), (SoundOutput::Headphones, 100.0));
        assert_eq!((sound.device.as_deref(), sound.loudspeakers.len()), (Some("hw:1,0"), 2));
    }

    #[test]
    fn what_cannot_sound_is_refused_with_its_line_and_the_remedy() {
        let line = BUILT_IN[0].1.lines().count() + 2;
        for (tables, expected) in [
            ("[sound]\noutput = \"loudspeakers\"", "add a [[loudspeaker]] with its position"),
            (
                "[sound]\nloudest_db = nan",
                "loudest_db is NaN: it must be a number of dB re 20 µPa between 40 and 130",
            ),
            ("[sound]\nloudest_db = 200", "between 40 and 130"),
            ("[sound]\ndevice = \"\"", "device has 0 characters"),
            ("[[loudspeaker]]\nposition = [0, inf, 0]", "y of the position of loudspeaker 1 is inf"),
            (
                "[[loudspeaker]]\nname = \"a\\nb\"\nposition = [0, 1, 0]",
                "loudspeaker 1: name has 3 characters",
            ),
        ] {
            let error = stage(tables).unwrap_err().to_string();
            assert!(error.starts_with(&format!("bench.toml:{line}: ")), "{error}");
            assert!(error.contains(expected), "{error}");
        }
        let error = stage("[[loudspeaker]]\npositon = [0, 1, 0]").unwrap_err().to_string();
        assert!(error.contains("did you mean `position`?"), "{error}");
        let error = stage("[sound]\noutput = \"headphone\"").unwrap_err().to_string();
        assert!(error.contains("did you mean `headphones`?"), "{error}");
        let error = stage(&TWO.repeat(9)).unwrap_err().to_string();
        assert!(error.contains("loudspeaker 17: a stage has at most 16"), "{error}");
    }

    proptest! {
        /// Any text in these tables is read or refused with a line of the file.
        #[test]
        fn no_text_in_the_tables_panics(lines in proptest::collection::vec(prop::sample::select(vec![
            "[sound]", "[[loudspeaker]]", "[[sound]]", "output = \"stereo\"", "output = 3", "device = \"x\"",
            "loudest_db = -inf", "loudest_db = 80", "name = \"\"", "name = \"a\"", "position = [1e308, 0, 0]",
            "position = [0, 1]", "position = [0, 0, 0]", "[loudspeaker]",
        ]), 0..8)) {
            if let Err(error) = stage(&lines.join("\n")) {
                prop_assert!(error.to_string().starts_with("bench.toml:"), "{error}");
            }
        }

        #[test]
        fn places_come_back_in_order(places in proptest::collection::vec(prop::array::uniform3(-50.0..50.0f64), 1..16)) {
            let tables: String = places.iter().map(|place| format!("[[loudspeaker]]\nposition = {place:?}\n")).collect();
            let found = stage(&tables).unwrap().sound.loudspeakers;
            let expected: Vec<Point3<f64>> = places.into_iter().map(Point3::from).collect();
            prop_assert_eq!(found.into_iter().map(|one| one.position).collect::<Vec<_>>(), expected);
        }
    }
}
