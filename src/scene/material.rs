//! A body's material, and the two ways in which a scene names one.
//!
//! In: `material = "liver"`, `material = { name = "rubber", young = 2e6 }`, or the numbers themselves. Out: the numbers,
//! which everything else uses, and the library's entry that they started from.

use super::limit::Limit;
use super::materials::{Known, find_material};
use crate::fem::Lame;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::fmt;

/// Permitted Young's moduli, Pa: from far below any jelly to far above diamond.
const YOUNG: std::ops::RangeInclusive<f64> = 1e-12..=1e24;

#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(try_from = "Written")]
pub struct Material {
    /// The entry of the library that it was written by. Its numbers may differ from the entry's.
    #[serde(skip)]
    pub known: Option<&'static Known>,
    /// Young's modulus, Pa.
    pub young: f64,
    pub poisson: f64,
    /// kg/m³, needed only by effects with inertia.
    pub density: Option<f64>,
    /// What it bears; where that is passed, pictures and closing words say so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<Limit>,
}

impl From<&'static Known> for Material {
    fn from(known: &'static Known) -> Material {
        let Known { young, poisson, density, yield_stress, .. } = *known;
        let limit = yield_stress.map(Limit::Stress);
        Material { known: Some(known), young, poisson, density: Some(density), limit }
    }
}

impl TryFrom<Written> for Material {
    type Error = String;

    fn try_from(written: Written) -> Result<Material, String> {
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

    /// Errors name the key below the material and what is wrong with it.
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        let Material { young, poisson, density, limit, .. } = *self;
        if !YOUNG.contains(&young) {
            return Err(("", format!("Young's modulus {young} Pa must lie between 1e-12 and 1e24")));
        }
        if poisson == 0.5 {
            let message = "Poisson's ratio 0.5 is exactly incompressible: λ is infinite and the displacement method cannot \
                           solve it; write 0.49 for rubber-like materials";
            return Err(("", message.to_owned()));
        }
        if !(poisson > -1.0 && poisson < 0.5) {
            let message =
                format!("Poisson's ratio {poisson} is not physical; it must lie between -1 and 0.5");
            return Err(("", message));
        }
        if density.is_some_and(|density| !(density > 0.0 && density.is_finite())) {
            return Err(("", "density must be positive and finite, kg/m³".to_owned()));
        }
        limit.map_or(Ok(()), Limit::check).map_err(|message| (".limit", message))
    }
}

/// A material as a scene writes it: what is left out comes from the library's entry.
#[derive(Clone, Debug, Default, PartialEq)]
struct Written {
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

impl<'de> Deserialize<'de> for Written {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Written, D::Error> {
        struct NameOrTable;
        impl<'de> Visitor<'de> for NameOrTable {
            type Value = Written;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a table, or a name of `greenstage manual materials`")
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<Written, E> {
                Ok(Written { name: Some(name.to_owned()), ..Written::default() })
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Written, A::Error> {
                let Table { name, young, poisson, density, limit } =
                    Table::deserialize(MapAccessDeserializer::new(map))?;
                Ok(Written { name, young, poisson, density, limit })
            }
        }
        deserializer.deserialize_any(NameOrTable)
    }
}
