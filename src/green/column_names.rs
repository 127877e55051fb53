//! What the columns of a body are called, for other programs and for people.
//!
//! In: a .green file. Out: a name and a unit for every column, in the order of [`GreenFile::groups`]: `right.m12` of a control
//! element, `gravity.x` or `press` of a load, `reduced.3` of a family whose columns have no names of their own.

use super::control::FIELD_NAMES;
use super::families::{AFFINE, FAMILIES, LOADS};
use super::file::GreenFile;

/// One column.
#[derive(Clone, Debug, PartialEq)]
pub struct ColumnName {
    pub name: String,
    /// Of its coefficient; "1" of a pure number.
    pub unit: String,
    pub source: ColumnSource,
}

/// What a column is the answer to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnSource {
    /// A field of a control element.
    Field {
        control: usize,
        field: usize,
    },
    Load,
    /// Nothing by itself: its coefficient follows from the others by the model's equilibrium.
    Model,
}

impl GreenFile {
    /// All columns of a body.
    pub fn column_names(&self, body: &str) -> Vec<ColumnName> {
        let Some(meta) = self.meta.bodies.get(body) else { return Vec::new() };
        let required = FAMILIES.iter().filter(|entry| meta.requirements.has(entry.family));
        required
            .flat_map(|entry| match entry.family.name {
                name if name == AFFINE.name => self.affine_names(body),
                name if name == LOADS.name => self.load_names(body),
                name => {
                    let groups = (entry.groups)(self, body);
                    let count: usize =
                        groups.iter().map(|group| group.columns(meta.surface_nodes).unwrap_or(0)).sum();
                    let numbered = |k| ColumnName {
                        name: format!("{name}.{k}"),
                        unit: "1".into(),
                        source: ColumnSource::Model,
                    };
                    (1..=count).map(numbered).collect()
                }
            })
            .collect()
    }

    fn affine_names(&self, body: &str) -> Vec<ColumnName> {
        let controls = self.meta.bodies.get(body).map_or(&[][..], |meta| &meta.controls);
        let of = |(e, name): (usize, &str)| {
            let field = |(k, field): (usize, &str)| ColumnName {
                name: format!("{name}.{field}"),
                unit: if k < 3 { "m" } else { "1" }.into(),
                source: ColumnSource::Field { control: e, field: k },
            };
            FIELD_NAMES.into_iter().enumerate().map(field).collect::<Vec<_>>()
        };
        controls.iter().map(|control| control.name.as_str()).enumerate().flat_map(of).collect()
    }

    fn load_names(&self, body: &str) -> Vec<ColumnName> {
        let loads = self.meta.bodies.get(body).map_or(&[][..], |meta| &meta.loads);
        let named =
            |name: String, unit: &str| ColumnName { name, unit: unit.to_owned(), source: ColumnSource::Load };
        loads
            .iter()
            .flat_map(|load| match load.columns {
                3 => ["x", "y", "z"].map(|axis| named(format!("{}.{axis}", load.name), &load.unit)).to_vec(),
                _ => vec![named(load.name.clone(), &load.unit)],
            })
            .collect()
    }
}
