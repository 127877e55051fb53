//! The look of a body: colour, picture, material lines, sharp edges. Nothing here changes a number of the mechanics, or asks for
//! a new precomputation.

use serde::de::{self, Deserializer, SeqAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};
use std::fmt;
use std::path::PathBuf;

/// Red, green and blue in sRGB: `"#c05030"`, or `[192, 80, 48]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Color(pub [u8; 3]);

/// Lines that are fixed to the material: `true`, `false`, or their spacing, m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Lines {
    /// Lines at a round spacing that fits the body's size ([`Lines::spacing`]).
    #[default]
    Fitted,
    /// `false`.
    Off,
    Every(f64),
}

/// An image on the surface: `"wood.png"`, or with the side of one repetition, m.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Texture {
    /// PNG file, relative to the scene.
    pub image: PathBuf,
    /// Width of one repetition on the body, m; without, half of the body's longest side.
    pub size: Option<f64>,
}

/// Between two triangles of a smooth surface, degrees; what is folded more sharply keeps its edge.
pub const CREASE: f64 = 40.0;

impl Color {
    /// Linear RGB, as drawables have it.
    pub fn linear(self) -> [f32; 3] {
        self.0.map(|byte| (f32::from(byte) / 255.0).powf(2.2))
    }
}

impl Default for Color {
    /// The blue of steel in daylight, against grey and orange control elements.
    fn default() -> Color {
        Color([96, 142, 186])
    }
}

impl Lines {
    /// Spacing of the lines, m, for a body whose longest side is `longest_side_m`: the 1, 2 or 5 times a power of ten by which 10
    /// to 25 lines cross that side.
    pub fn spacing(self, longest_side_m: f64) -> Option<f64> {
        match self {
            Lines::Off => None,
            Lines::Every(spacing) => Some(spacing),
            Lines::Fitted => {
                let least = longest_side_m / 25.0;
                let power = 10f64.powf(least.log10().floor());
                let round = [1.0, 2.0, 5.0, 10.0].map(|step| step * power);
                round.into_iter().find(|step| *step >= least * (1.0 - 1e-9)).filter(|step| step.is_normal())
            }
        }
    }
}

/// Errors name the key below the body and what is wrong with it.
pub fn check(lines: Lines, texture: Option<&Texture>, crease: f64) -> Result<(), (&'static str, String)> {
    if let Lines::Every(spacing) = lines
        && !(spacing > 0.0 && spacing.is_finite())
    {
        return Err((
            "lines",
            format!("a spacing of {spacing} m: write a positive length, or false for no lines"),
        ));
    }
    if let Some(size) = texture.and_then(|texture| texture.size)
        && !(size > 0.0 && size.is_finite())
    {
        return Err(("texture", format!("size is {size} m: a positive length is needed")));
    }
    if !(0.0..=180.0).contains(&crease) {
        return Err((
            "crease",
            format!("{crease} is no angle from 0 (all edges sharp) to 180 degrees (none)"),
        ));
    }
    Ok(())
}

impl std::str::FromStr for Color {
    type Err = String;

    fn from_str(text: &str) -> Result<Color, String> {
        let wrong =
            || format!("\"{text}\" is no colour: write \"#c05030\" (red, green, blue), or [192, 80, 48]");
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6).ok_or_else(wrong)?;
        if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return Err(wrong());
        }
        let number = u32::from_str_radix(digits, 16).map_err(|error| format!("{}: {error}", wrong()))?;
        let [_, r, g, b] = number.to_be_bytes();
        Ok(Color([r, g, b]))
    }
}

impl Serialize for Color {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Color([r, g, b]) = self;
        serializer.serialize_str(&format!("#{r:02x}{g:02x}{b:02x}"))
    }
}

impl Serialize for Lines {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Lines::Fitted => serializer.serialize_bool(true),
            Lines::Off => serializer.serialize_bool(false),
            Lines::Every(spacing) => serializer.serialize_f64(*spacing),
        }
    }
}

impl<'de> Deserialize<'de> for Color {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Color, D::Error> {
        struct Reads;
        impl<'de> Visitor<'de> for Reads {
            type Value = Color;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a colour as \"#c05030\", or red, green and blue from 0 to 255 as [192, 80, 48]")
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Color, E> {
                text.parse().map_err(E::custom)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Color, A::Error> {
                let mut color = [0; 3];
                for (k, channel) in color.iter_mut().enumerate() {
                    *channel = list.next_element()?.ok_or_else(|| de::Error::invalid_length(k, &self))?;
                }
                match list.next_element::<de::IgnoredAny>()? {
                    Some(_) => Err(de::Error::invalid_length(4, &self)),
                    None => Ok(Color(color)),
                }
            }
        }
        deserializer.deserialize_any(Reads)
    }
}

impl<'de> Deserialize<'de> for Lines {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Lines, D::Error> {
        struct Reads;
        impl Visitor<'_> for Reads {
            type Value = Lines;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("true, false, or the spacing of the material lines in metres")
            }

            fn visit_bool<E>(self, on: bool) -> Result<Lines, E> {
                Ok(if on { Lines::Fitted } else { Lines::Off })
            }

            fn visit_f64<E>(self, spacing: f64) -> Result<Lines, E> {
                Ok(Lines::Every(spacing))
            }

            fn visit_i64<E>(self, spacing: i64) -> Result<Lines, E> {
                Ok(Lines::Every(spacing as f64))
            }
        }
        deserializer.deserialize_any(Reads)
    }
}

impl<'de> Deserialize<'de> for Texture {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Texture, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Table {
            image: PathBuf,
            size: Option<f64>,
        }
        struct Reads;
        impl<'de> Visitor<'de> for Reads {
            type Value = Texture;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a PNG file, or { image = \"wood.png\", size = 0.2 }")
            }

            fn visit_str<E>(self, image: &str) -> Result<Texture, E> {
                Ok(Texture { image: image.into(), size: None })
            }

            fn visit_map<A: de::MapAccess<'de>>(self, map: A) -> Result<Texture, A::Error> {
                let Table { image, size } = Table::deserialize(de::value::MapAccessDeserializer::new(map))?;
                Ok(Texture { image, size })
            }
        }
        deserializer.deserialize_any(Reads)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn fitted_lines_are_round_and_neither_few_nor_many() {
        for (longest, expected) in
            [(1.0, 0.05), (0.2, 0.01), (0.25, 0.01), (0.26, 0.02), (3e-3, 2e-4), (1800.0, 100.0)]
        {
            let spacing = Lines::Fitted.spacing(longest).unwrap();
            assert!((spacing / expected - 1.0).abs() < 1e-9, "{longest}: {spacing}");
        }
        assert_eq!(Lines::Off.spacing(1.0), None);
        assert_eq!(Lines::Fitted.spacing(0.0), None);
    }

    #[test]
    fn serialized_colors_are_read_as_they_were() {
        #[derive(Deserialize)]
        struct Body {
            color: Color,
        }
        let read =
            |text: &str| toml::from_str::<Body>(text).map(|body| body.color).map_err(|e| e.to_string());
        assert_eq!(read("color = '#c05030'"), Ok(Color([192, 80, 48])));
        assert_eq!(read("color = [192, 80, 48]"), Ok(Color([192, 80, 48])));
        for wrong in
            ["'c05030'", "'#c0503'", "'#+05030'", "[0, 1]", "[0, 1, 2, 3]", "[0, 1, 256]", "[0.1, 0, 0]", "7"]
        {
            assert!(read(&format!("color = {wrong}")).is_err(), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn every_color_is_read_back(rgb: [u8; 3]) {
            let [r, g, b] = rgb;
            prop_assert_eq!(format!("#{r:02x}{g:02X}{b:02x}").parse(), Ok(Color(rgb)));
        }

        #[test]
        fn no_text_makes_a_color_panic(text: String) {
            let _ = text.parse::<Color>();
        }

        #[test]
        fn ten_to_twenty_five_lines_cross_the_longest_side(exponent in -6.0..6.0f64) {
            let longest = 10f64.powf(exponent);
            let lines = longest / Lines::Fitted.spacing(longest).unwrap();
            prop_assert!((9.99..=25.01).contains(&lines), "{longest}: {lines}");
        }
    }
}
