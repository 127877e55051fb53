//! A small library of materials, by name.

use crate::config::unknown_name;
use crate::mesh::length_unit::LARGEST_M;

/// A material of the library: isotropic, for small strains.
#[derive(Debug, PartialEq)]
pub struct LibraryMaterial {
    pub name: &'static str,
    /// Young's modulus, Pa.
    pub young: f64,
    pub poisson: f64,
    /// kg/m³.
    pub density: f64,
    /// Largest von Mises stress that it bears without yielding, Pa, where there is such a thing.
    pub yield_stress: Option<f64>,
    /// Longest sides of bodies made of it, m.
    pub largest_m: f64,
    /// Description of the material that was measured, and of what is only assumed.
    pub what: &'static str,
    /// Author, year, table.
    pub source: &'static str,
}

/// Longest side of an organ or a bone, m.
const ORGAN_M: f64 = 1.0;

/// The library; a new material is an entry here and a row in the chapter `materials`.
pub const MATERIALS: &[LibraryMaterial] = &[
    LibraryMaterial {
        name: "steel",
        young: 210e9,
        poisson: 0.3,
        density: 7850.0,
        yield_stress: Some(235e6),
        largest_m: LARGEST_M,
        what: "structural steel S235, up to 40 mm thick",
        source: "EN 1993-1-1:2005, 3.2.6 and table 3.1; density: EN 1993-1-2:2005, 3.2.2",
    },
    LibraryMaterial {
        name: "aluminium",
        young: 70e9,
        poisson: 0.3,
        density: 2700.0,
        yield_stress: Some(250e6),
        largest_m: LARGEST_M,
        what: "wrought alloy EN AW-6082 T6, extruded, up to 5 mm thick",
        source: "EN 1999-1-1:2007, 3.2.5 and table 3.2b",
    },
    LibraryMaterial {
        name: "titanium",
        young: 113.8e9,
        poisson: 0.342,
        density: 4430.0,
        yield_stress: Some(790e6),
        largest_m: LARGEST_M,
        what: "Ti-6Al-4V ELI, annealed, as in implants",
        source: "ASM data sheet MTP643, Titanium Ti-6Al-4V (Grade 5), ELI, Annealed (asm.matweb.com)",
    },
    LibraryMaterial {
        name: "rubber",
        young: 2e6,
        poisson: 0.49,
        density: 925.0,
        yield_stress: None,
        largest_m: LARGEST_M,
        what: "natural rubber, middle of 1.5 to 2.5 MPa; ν is assumed (nearly incompressible)",
        source: "Ashby, Materials Selection in Mechanical Design, 3rd ed. 2005, appendix C, natural rubber",
    },
    LibraryMaterial {
        name: "silicone",
        young: 1.32e6,
        poisson: 0.495,
        density: 1030.0,
        yield_stress: None,
        largest_m: LARGEST_M,
        what: "PDMS (Sylgard 184) cured at 25 °C; other silicones from 0.05 to 10 MPa",
        source: "Johnston et al., J. Micromech. Microeng. 24, 2014, 035017; ν: Pritchard et al., Soft Matter 9, 2013, 6037; \
                 density: the maker's data sheet",
    },
    LibraryMaterial {
        name: "liver",
        young: 5.5e3,
        poisson: 0.49,
        density: 1060.0,
        yield_stress: None,
        largest_m: ORGAN_M,
        what: "healthy, living: mean of 429 people by transient elastography; ν is assumed (nearly incompressible)",
        source: "Roulot et al., J. Hepatol. 48, 2008, 606; density: ICRU report 46, 1992",
    },
    LibraryMaterial {
        name: "muscle",
        young: 11.1e3,
        poisson: 0.49,
        density: 1050.0,
        yield_stress: None,
        largest_m: ORGAN_M,
        what: "gastrocnemius at rest, by shear-wave elastography, fibres left out; ν is assumed (nearly incompressible)",
        source: "Arda et al., Am. J. Roentgenol. 197, 2011, 532; density: ICRU report 46, 1992",
    },
    LibraryMaterial {
        name: "cartilage",
        young: 0.686e6,
        poisson: 0.098,
        density: 1100.0,
        yield_stress: None,
        largest_m: ORGAN_M,
        what: "human, lateral femoral condyle, in equilibrium after its water has moved; E from the aggregate modulus 0.701 MPa",
        source: "Athanasiou et al., J. Orthop. Res. 9, 1991, 330; density: ICRU report 46, 1992",
    },
    LibraryMaterial {
        name: "bone",
        young: 17e9,
        poisson: 0.3,
        density: 1920.0,
        yield_stress: None,
        largest_m: ORGAN_M,
        what: "cortical, human femur along its axis (11.5 GPa across it, left out); ν is assumed",
        source: "Reilly and Burstein, J. Biomech. 8, 1975, 393; density: ICRU report 46, 1992",
    },
];

/// The material called `name`; the error lists the known ones.
pub fn find_material(name: &str) -> Result<&'static LibraryMaterial, String> {
    let found = MATERIALS.iter().find(|known| known.name == name);
    found.ok_or_else(|| unknown_name("material", name, MATERIALS.iter().map(|known| known.name)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chapter_shows_the_library() {
        let chapter = include_str!("../manual/materials.md");
        for known in MATERIALS {
            let stress = known.yield_stress.map_or("–".to_owned(), |stress| format!("{}", stress * 1e-6));
            let row = format!(
                "| `{}` | {:e} | {} | {} | {stress} | {} | {} |",
                known.name, known.young, known.poisson, known.density, known.what, known.source
            );
            assert!(chapter.contains(&row), "the chapter lacks\n{row}");
        }
        let rows = chapter.lines().filter(|line| line.starts_with("| `")).count();
        assert_eq!(rows, MATERIALS.len());
    }
}
