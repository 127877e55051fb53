//! Kinds of stereo: how the two eyes' pictures of a screen reach its display, and how large the window is.

use super::viewer::Eye;
use crate::config;

/// The way in which the two eyes' pictures of a screen reach its display.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(try_from = "String")]
pub enum Stereo {
    /// One window per eye.
    Separate,
    /// The left eye's picture in the left half of a window twice as wide as the screen's pixels.
    SideBySide,
    /// Side by side in a window as wide as the screen: half the columns for each eye.
    SideBySideHalf,
    /// The left eye's picture in the upper half of a window twice as high.
    TopBottom,
    /// One above the other in a window as high as the screen: half the rows for each eye.
    TopBottomHalf,
    /// HDMI 1.4: 1920 × 2205 with a gap of 45 rows, or 1280 × 1470 with 30, the left eye above.
    FramePacking,
    /// Red for the left eye, green and blue for the right: the colours of both pictures.
    Anaglyph,
    /// Luminance alone.
    AnaglyphGrey,
    /// Luminance for the left eye, colour for the right.
    AnaglyphHalfColour,
    /// Dubois' least squares.
    AnaglyphDubois,
    /// Even rows of the desktop for the left eye, odd ones for the right.
    Rows,
    /// Even columns for the left eye.
    Columns,
    /// The left eye where column and row are both even or both odd.
    Checkerboard,
    /// One picture, seen from midway between the eyes.
    Mono,
    /// One picture, seen by the left eye.
    Left,
    /// One picture, seen by the right eye.
    Right,
}

/// Words of catalogues for what projectors and glasses do, and which kinds show that.
const OTHER_WORDS: [(&[&str], &str); 2] = [
    (
        &["active", "quad_buffered", "quad", "quadbuffer", "shutter", "frame_sequential"],
        "quad-buffered windows are not supported. A projector for shutter glasses takes \
         \"side_by_side_half\", \"top_bottom_half\" or \"frame_packing\" (its 3D menu)",
    ),
    (
        &["passive", "polarised", "polarized", "polarisation", "3d", "stereo"],
        "polarised glasses: \"left\" and \"right\" in two windows (two projectors), \
         \"side_by_side_half\" or \"top_bottom_half\" (one), \"rows\" (flat panel)",
    ),
];

impl TryFrom<String> for Stereo {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        Self::named(&name)
    }
}

impl Stereo {
    /// All kinds, with their names in a stage file.
    pub const ALL: [(&str, Stereo); 16] = [
        ("separate", Stereo::Separate),
        ("side_by_side", Stereo::SideBySide),
        ("side_by_side_half", Stereo::SideBySideHalf),
        ("top_bottom", Stereo::TopBottom),
        ("top_bottom_half", Stereo::TopBottomHalf),
        ("frame_packing", Stereo::FramePacking),
        ("anaglyph", Stereo::Anaglyph),
        ("anaglyph_grey", Stereo::AnaglyphGrey),
        ("anaglyph_half_colour", Stereo::AnaglyphHalfColour),
        ("anaglyph_dubois", Stereo::AnaglyphDubois),
        ("rows", Stereo::Rows),
        ("columns", Stereo::Columns),
        ("checkerboard", Stereo::Checkerboard),
        ("mono", Stereo::Mono),
        ("left", Stereo::Left),
        ("right", Stereo::Right),
    ];

    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }

    /// # Errors
    /// A sentence with all names and the nearest one.
    pub fn named(name: &str) -> Result<Self, String> {
        let names = || Self::ALL.iter().map(|(known, _)| *known);
        let found = Self::ALL.iter().find(|(known, _)| *known == name);
        let word = name.to_lowercase().replace(['-', ' '], "_");
        let known_as = OTHER_WORDS.iter().find(|(words, _)| words.contains(&word.as_str()));
        found.map(|(_, kind)| *kind).ok_or_else(|| match known_as {
            Some((_, advice)) => {
                format!("unknown kind of stereo \"{name}\": {advice} (`greenstage manual stages`)")
            }
            None => config::unknown_name("kind of stereo", name, names()),
        })
    }

    /// The eyes for which a screen is drawn, in the order of drawing.
    pub fn eyes(self) -> &'static [Eye] {
        match self {
            Self::Mono => &[Eye::Centre],
            Self::Left => &[Eye::Left],
            Self::Right => &[Eye::Right],
            _ => &[Eye::Left, Eye::Right],
        }
    }

    /// The kind after the eyes were swapped.
    pub fn swapped(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
            other => other,
        }
    }

    /// The size in pixels of a window that shows a whole screen of `pixels`.
    pub fn window_size(self, [width, height]: [u32; 2]) -> [u32; 2] {
        match self {
            Self::SideBySide => [2 * width, height],
            Self::TopBottom => [width, 2 * height],
            // 45 of 1080 and 30 of 720 rows are both a 24th.
            Self::FramePacking => [width, 2 * height + (height + 12) / 24],
            _ => [width, height],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_the_name_that_files_use() {
        #[derive(serde::Deserialize)]
        struct File {
            stereo: Stereo,
        }
        for (name, kind) in Stereo::ALL {
            let file: File = toml::from_str(&format!("stereo = \"{name}\"")).unwrap();
            assert_eq!((file.stereo, kind.name(), Stereo::named(name)), (kind, name, Ok(kind)));
        }
        assert!(Stereo::named("top-bottom").unwrap_err().contains("did you mean \"top_bottom"));
    }

    #[test]
    fn frame_packing_has_hdmis_sizes() {
        assert_eq!(Stereo::FramePacking.window_size([1920, 1080]), [1920, 2205]);
        assert_eq!(Stereo::FramePacking.window_size([1280, 720]), [1280, 1470]);
        assert_eq!(Stereo::SideBySide.window_size([1280, 1024]), [2560, 1024]);
        assert_eq!(Stereo::TopBottomHalf.window_size([1280, 1024]), [1280, 1024]);
    }
}
