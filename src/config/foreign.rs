//! Files of other programs that describe displays: their kind, and which of their numbers a stage file takes.
//!
//! In: the text of a file that is no TOML. Out: a sentence. Files are recognised by their beginning, not by their name.

use crate::base::input;
use std::io::Read;
use std::path::Path;

/// A file of another program: its kind, and what to copy from it.
struct Foreign {
    /// A mark near the file's beginning.
    mark: &'static str,
    name: &'static str,
    copy: &'static str,
}

/// The part of a text in which marks are looked for, bytes.
const HEAD: usize = 4096;

const KNOWN: [Foreign; 6] = [
    Foreign {
        mark: "<COCONFIG",
        name: "a configuration of OpenCOVER (COVISE)",
        copy: "of each Screen, which is in millimetres with z up, take centre = [originX, originZ, -originY] / 1000, width and height \
               / 1000, and where h and r are 0 tilt_degrees = 90 + p; of each Window and Channel the pixels",
    },
    Foreign {
        mark: "<pvx",
        name: "ParaView's description of a CAVE",
        copy: "of each Machine take lower_left = LowerLeft, lower_right = LowerRight, and upper_left = LowerLeft + UpperRight - \
               LowerRight",
    },
    Foreign {
        mark: "org-vrjuggler",
        name: "a configuration of VR Juggler",
        copy: "of each surface viewport take lower_left_corner, lower_right_corner and upper_left_corner",
    },
    Foreign { mark: "<MiddleVR", name: "a configuration of MiddleVR", copy: CORNERS },
    Foreign {
        mark: "\"masteraddress\"",
        name: "a configuration of SGCT",
        copy: "of each ProjectionPlane take lowerleft and upperleft, and lower_right = lowerleft + upperright - upperleft; a \
               PlanarProjection has angles alone, so its corners are to be measured",
    },
    Foreign { mark: "section Vrui", name: "a configuration of Vrui", copy: CORNERS },
];
const CORNERS: &str = "of each screen take three corners, lower_left, lower_right and upper_left";

/// Advice about a text that is another program's description of a display.
pub fn display(text: &str) -> Option<String> {
    let mut end = HEAD.min(text.len());
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    let head = &text[..end];
    let known = KNOWN.iter().find(|known| head.contains(known.mark))?;
    Some(format!(
        "this is {}; a stage file is TOML: {}. Its lengths are metres, x right, y up, z towards the viewer (`greenstage manual stages`)",
        known.name, known.copy
    ))
}

/// [`display`] for a file, of which no more than the beginning is read, and nothing of a device or a pipe.
pub fn display_at(path: &Path) -> Option<String> {
    let mut head = Vec::new();
    input::open(path).ok()?.take(HEAD as u64).read_to_end(&mut head).ok()?;
    display(&String::from_utf8_lossy(&head))
}

/// Advice about a text that is no TOML: by [`display`], or that it is XML or JSON.
pub fn advice(text: &str) -> Option<String> {
    let language = match text.trim_start_matches('\u{feff}').trim_start().chars().next() {
        Some('<') => "XML",
        Some('{') => "JSON",
        _ => return display(text),
    };
    let other = || {
        format!("this is {language}, and scenes, stages, scripts and poses are TOML (`greenstage manual`)")
    };
    Some(display(text).unwrap_or_else(other))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_other_programs_are_named_with_the_numbers_to_copy() {
        for (text, name, copy) in [
            ("<?xml version=\"1.0\"?>\n<COCONFIG version=\"1\">", "OpenCOVER", "tilt_degrees = 90 + p"),
            ("<?xml version=\"1.0\" ?>\n<pvx>\n", "ParaView", "lower_left = LowerLeft"),
            ("{\n  \"version\": 1,\n  \"masteraddress\": \"127.0.0.1\"", "SGCT", "lowerleft"),
            ("section Vrui\n", "Vrui", "three corners"),
            ("<VTKFile>", "XML", "TOML"),
        ] {
            let told = advice(text).unwrap();
            assert!(told.contains(name) && told.contains(copy), "{told}");
        }
        assert_eq!((advice("name = 3,5"), display("<VTKFile>")), (None, None));
    }
}
