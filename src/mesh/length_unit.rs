//! The unit that a mesh file's coordinates are written in. Inside the program every length is in metres.
//!
//! In: the name of a unit, or a factor. Out: a [`Scale`], by which coordinates become metres.

use super::diagnostics::digits;
use super::tet_mesh::{LoadedMesh, TetMesh};
use crate::base::by_name::by_name;
use crate::config::unknown_name;
use nalgebra::Vector3;

/// A unit of length.
#[derive(Debug)]
pub struct LengthUnit {
    /// The name in scene files and options.
    pub name: &'static str,
    pub plural: &'static str,
    /// Metres in one.
    pub metres: f64,
}

/// All units, the longest first.
pub const UNITS: &[LengthUnit] = &[
    LengthUnit { name: "m", plural: "metres", metres: 1.0 },
    LengthUnit { name: "in", plural: "inches", metres: 0.0254 },
    LengthUnit { name: "cm", plural: "centimetres", metres: 0.01 },
    LengthUnit { name: "mm", plural: "millimetres", metres: 1e-3 },
    LengthUnit { name: "um", plural: "micrometres", metres: 1e-6 },
];

/// The unit called `name`; the error lists the known ones.
pub fn find_unit(name: &str) -> Result<&'static LengthUnit, String> {
    let found = UNITS.iter().find(|unit| unit.name == name);
    found.ok_or_else(|| unknown_name("unit of length", name, UNITS.iter().map(|unit| unit.name)))
}

by_name!(LengthUnit, find_unit);

/// Longest side of the smallest and of the largest body that hands bend, m: the latter is the width of a CAVE.
const SMALLEST_M: f64 = 1e-3;
pub const LARGEST_M: f64 = 3.0;

/// Whether a body whose longest side is `extent` may be meant, of a material whose bodies reach `largest`, m.
pub fn is_plausible(extent: f64, largest: f64) -> bool {
    (SMALLEST_M..=largest).contains(&extent)
}

/// The units but the metre in which a body of `extent` units would be plausible, the likeliest first: CAD and medical
/// images are in millimetres.
pub fn candidates(extent: f64, largest: f64) -> impl Iterator<Item = &'static LengthUnit> {
    let likely = ["mm", "um", "cm", "in"].into_iter().filter_map(|name| find_unit(name).ok());
    likely.filter(move |unit| is_plausible(extent * unit.metres, largest))
}

/// A warning about a body whose longest side is not one of bodies that hands bend.
pub fn implausible(longest: f64, largest: f64) -> Option<String> {
    if is_plausible(longest, largest) {
        return None;
    }
    let guess = candidates(longest, largest).next().map_or("another unit".to_owned(), |unit| {
        format!(
            "unit = \"{}\" beside mesh makes it {} m, if the file is in {}",
            unit.name,
            digits(longest * unit.metres),
            unit.plural
        )
    });
    Some(format!(
        "its longest side is {} m: {guess}. With a wrong unit forces are wrong (`greenstage manual \
         meshes`)",
        digits(longest)
    ))
}

/// Metres of one of the file's units of length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale(pub f64);

impl Scale {
    /// The file is in metres.
    pub const ONE: Scale = Scale(1.0);

    /// A coordinate of the file in metres. Where a metre is a whole number of units, the quotient is taken: 70 mm are
    /// then 0.07 as a scene writes it, which 70 times 0.001 is not.
    pub fn metres(self, coordinate: f64) -> f64 {
        let per_metre = (1.0 / self.0).round();
        if per_metre > 1.0 && 1.0 / per_metre == self.0 {
            coordinate / per_metre
        } else {
            coordinate * self.0
        }
    }

    fn place(self, position: &mut Vector3<f64>) {
        *position = position.map(|coordinate| self.metres(coordinate));
    }

    /// All positions in metres.
    pub fn apply(self, positions: &mut [Vector3<f64>]) {
        if self != Scale::ONE {
            positions.iter_mut().for_each(|position| self.place(position));
        }
    }

    /// A mesh as it was read, in metres.
    pub fn applied(self, mut loaded: LoadedMesh) -> LoadedMesh {
        let TetMesh { nodes, .. } = &mut loaded.mesh;
        self.apply(nodes);
        loaded
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn millimetres_become_the_metres_that_one_writes() {
        let millimetres = Scale(find_unit("mm").unwrap().metres);
        for whole in 0..2000 {
            let written: f64 = format!("{}.{:03}", whole / 1000, whole % 1000).parse().unwrap();
            assert_eq!(millimetres.metres(f64::from(whole)), written);
        }
        assert_eq!(Scale(0.0254).metres(10.0), 0.254);
        assert_eq!(Scale(1000.0).metres(2.5), 2500.0);
        assert_eq!(Scale::ONE.metres(0.1), 0.1);
        assert_eq!(implausible(2.0, LARGEST_M), None);
        assert!(
            implausible(195.0, LARGEST_M).unwrap().contains("is 195.0 m")
                && implausible(195.0, LARGEST_M).unwrap().contains("\"mm\" beside mesh makes it 0.1950 m")
        );
        assert!(implausible(1e-5, LARGEST_M).unwrap().contains("another unit"));
        assert!(find_unit("mmm").unwrap_err().contains("did you mean \"mm\"?"));
    }
}
