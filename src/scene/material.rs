//! A body's material, and the two ways in which a scene names one.
//!
//! In: `material = "liver"`, `material = { name = "rubber", young = 2e6 }`, or the numbers themselves. Out: the numbers,
//! which everything else uses, and the library's entry that they started from.

use super::limit::Limit;
use super::materials::{LibraryMaterial, MATERIALS, find_material};
use crate::base::diagnostic::Severity;
use crate::base::quantity::quantity;
use crate::fem::Lame;
use crate::mesh::length_unit::LARGEST_M;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// Young's moduli that are softer than any tissue and look like gigapascals, as data sheets write them, Pa.
const GIGAPASCALS: std::ops::RangeInclusive<f64> = 2.0..=500.0;
/// Entries of the library above this modulus have moduli that are often written in MPa, Pa.
const STIFF: f64 = 1e9;
/// Density, kg/m³, above which no material is softer than the modulus below it, Pa.
const HEAVY: f64 = 2000.0;
const SOFT: f64 = 1e6;

/// A modulus below this, Pa, belongs to nothing that keeps its shape; 1 is left to bodies without units.
const SOFTEST: f64 = 0.1;
/// Densities that look like g/cm³, kg/m³.
const GRAMS: std::ops::RangeInclusive<f64> = 0.5..=25.0;

/// Permitted Young's moduli, Pa: from far below any jelly to far above diamond.
const YOUNG: std::ops::RangeInclusive<f64> = 1e-12..=1e24;

#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(try_from = "WrittenMaterial")]
pub struct Material {
    /// The entry of the library that it was written by. Its numbers may differ from the entry's.
    #[serde(skip)]
    pub known: Option<&'static LibraryMaterial>,
    /// Young's modulus, Pa.
    pub young: f64,
    pub poisson: f64,
    /// kg/m³, needed only by effects with inertia.
    pub density: Option<f64>,
    /// Limit of the material; where it is passed, pictures and closing words say so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<Limit>,
}

impl From<&'static LibraryMaterial> for Material {
    fn from(known: &'static LibraryMaterial) -> Material {
        let LibraryMaterial { young, poisson, density, yield_stress, .. } = *known;
        let limit = yield_stress.map(Limit::Stress);
        Material { known: Some(known), young, poisson, density: Some(density), limit }
    }
}

impl TryFrom<WrittenMaterial> for Material {
    type Error = String;

    fn try_from(written: WrittenMaterial) -> Result<Material, String> {
        let known = written.name.as_deref().map(find_material).transpose()?;
        let missing = |key: &str| {
            format!(
                "missing field `{key}`; write {{ young = 1.0e6, poisson = 0.3 }}, or a name of `greenstage manual materials`"
            )
        };
        Ok(Material {
            known,
            young: written.young.or(known.map(|known| known.young)).ok_or_else(|| missing("young"))?,
            poisson: written
                .poisson
                .or(known.map(|known| known.poisson))
                .ok_or_else(|| missing("poisson"))?,
            density: written.density.or(known.map(|known| known.density)),
            limit: written.limit.or(known.and_then(|known| known.yield_stress).map(Limit::Stress)),
        })
    }
}

impl Material {
    pub fn lame(&self) -> Lame {
        Lame::from_young_poisson(self.young, self.poisson)
    }

    /// Longest side of a body made of it, m.
    pub fn largest_m(&self) -> f64 {
        self.known.map_or(LARGEST_M, |known| known.largest_m)
    }

    /// Doubt about a modulus that was probably written in another unit than Pa.
    pub fn doubt(&self) -> Option<(Severity, String)> {
        let Material { known, young, poisson, density, .. } = *self;
        let modulus = quantity(young, "Pa");
        if GIGAPASCALS.contains(&young) {
            let message = format!(
                "Young's modulus {modulus} is softer than any tissue. If {young} GPa is meant, write {young}e9"
            );
            return Some((Severity::Note, message));
        }
        let note = |message: String| Some((Severity::Note, message));
        if young < SOFTEST {
            return note(format!(
                "Young's modulus {modulus} is softer than anything that keeps its shape. Moduli are in Pa"
            ));
        }
        if let Some(density) = density.filter(|density| GRAMS.contains(density) && young > SOFT) {
            return note(format!(
                "{density} kg/m³ is as light as a foam, but Young's modulus is {modulus}. If {density} g/cm³ is meant, write {}",
                1e3 * density
            ));
        }
        let warn = |message: String| Some((Severity::Warning, message));
        let is_like = |entry: &&LibraryMaterial| match known {
            Some(known) => known == *entry,
            None => entry.young > STIFF && (entry.poisson - poisson).abs() < 0.03,
        };
        let in_megapascals = |entry: &&LibraryMaterial| (1e6 * young / entry.young).ln().abs() < 0.2;
        if let Some(entry) = MATERIALS.iter().filter(is_like).find(in_megapascals) {
            return warn(format!(
                "Young's modulus {modulus} is that of a soft rubber, and {} has {}. If {young} MPa is meant, write {:e}",
                entry.name,
                quantity(entry.young, "Pa"),
                1e6 * young
            ));
        }
        if let Some(known) = known.filter(|known| !(0.01..=100.0).contains(&(young / known.young))) {
            return warn(format!(
                "Young's modulus {modulus} is not that of {}, which has {}. Moduli are in Pa",
                known.name,
                quantity(known.young, "Pa")
            ));
        }
        let density = density.filter(|density| *density > HEAVY && young < SOFT)?;
        warn(format!(
            "{density} kg/m³ is as heavy as stone or metal, but Young's modulus {modulus} is that of a soft rubber. Moduli \
             are in Pa"
        ))
    }

    /// Errors name the key below the material and what is wrong with it.
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        let Material { young, poisson, density, limit, .. } = *self;
        if !YOUNG.contains(&young) {
            return Err(("", format!("Young's modulus {} Pa must lie between 1e-12 and 1e24", plain(young))));
        }
        if poisson == 0.5 {
            let message =
                "Poisson's ratio 0.5 is incompressible, which displacements cannot solve: write 0.49";
            return Err(("", message.to_owned()));
        }
        if !(poisson > -1.0 && poisson < 0.5) {
            let message =
                format!("Poisson's ratio {} is not physical; it must lie between -1 and 0.5", plain(poisson));
            return Err(("", message));
        }
        if density.is_some_and(|density| !(density > 0.0 && density.is_finite())) {
            return Err(("", "density must be positive and finite, kg/m³".to_owned()));
        }
        limit.map_or(Ok(()), Limit::check).map_err(|message| (".limit", message))
    }
}

/// A number as it is usually written, in few digits however large or small it is.
fn plain(value: f64) -> String {
    if value == 0.0 || (1e-6..1e15).contains(&value.abs()) { value.to_string() } else { format!("{value:e}") }
}

/// A material as a scene writes it: what is left out comes from the library's entry.
#[derive(Clone, Debug, Default, PartialEq)]
struct WrittenMaterial {
    name: Option<String>,
    young: Option<f64>,
    poisson: Option<f64>,
    density: Option<f64>,
    limit: Option<Limit>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    name: Option<String>,
    young: Option<f64>,
    poisson: Option<f64>,
    density: Option<f64>,
    limit: Option<Limit>,
}

impl<'de> Deserialize<'de> for WrittenMaterial {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<WrittenMaterial, D::Error> {
        struct NameOrTable;
        impl<'de> Visitor<'de> for NameOrTable {
            type Value = WrittenMaterial;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table, or a name of `greenstage manual materials`")
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<WrittenMaterial, E> {
                Ok(WrittenMaterial { name: Some(name.to_owned()), ..WrittenMaterial::default() })
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<WrittenMaterial, A::Error> {
                let Table { name, young, poisson, density, limit } =
                    Table::deserialize(MapAccessDeserializer::new(map))?;
                Ok(WrittenMaterial { name, young, poisson, density, limit })
            }
        }
        deserializer.deserialize_any(NameOrTable)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn material(written: &str) -> Material {
        toml::from_str(written).unwrap()
    }

    #[test]
    fn a_modulus_in_another_unit_is_doubted() {
        for written in [
            "name = \"steel\"\nyoung = 210000.0",
            "young = 210000.0\npoisson = 0.3",
            "young = 7.0e4\npoisson = 0.33\ndensity = 2700.0",
            "name = \"liver\"\nyoung = 5.5",
            "name = \"rubber\"\nyoung = 2.0e9",
            "young = 210.0\npoisson = 0.3",
            "young = 5.0e4\npoisson = 0.4\ndensity = 8900.0",
            "young = 1.0e-3\npoisson = 0.3",
            "young = 2.1e11\npoisson = 0.3\ndensity = 7.85",
        ] {
            let (_, said) = material(written).doubt().unwrap_or_else(|| panic!("{written} passes"));
            assert!(said.len() < 160, "{said}");
        }
        let (_, steel) = material("name = \"steel\"\nyoung = 210000.0").doubt().unwrap();
        assert!(steel.contains("210 kPa") && steel.ends_with("write 2.1e11"), "{steel}");
    }

    #[test]
    fn plausible_moduli_pass() {
        for known in MATERIALS {
            assert_eq!(Material::from(known).doubt(), None, "{}", known.name);
        }
        for written in [
            "young = 1.0e6\npoisson = 0.3",
            "name = \"steel\"\nyoung = 193.0e9",
            "young = 2.5e4\npoisson = 0.49\ndensity = 1100.0",
            "young = 600.0\npoisson = 0.3",
            "young = 1.0\npoisson = 0.3\ndensity = 1.0",
            "young = 3.0e5\npoisson = 0.3\ndensity = 20.0",
        ] {
            assert_eq!(material(written).doubt(), None, "{written}");
        }
    }

    #[test]
    fn a_modulus_beyond_all_is_not_printed_in_300_digits() {
        let (_, said) = material("young = 1.0e300\npoisson = 0.3").check().unwrap_err();
        assert!(said.len() < 100 && said.contains("1e300"), "{said}");
    }
}
