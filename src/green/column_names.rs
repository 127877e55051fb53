//! What the columns of a body are called, for other programs and for people.
//!
//! In: a .green file. Out: a name and a unit for every column, in the order of [`GreenFile::groups`]: `right.m12` of a control
//! element, `gravity.x` or `press` of a load, `reduced.3` of a family whose columns have no names of their own. The names of
//! control elements and loads a scene alone tells.

use super::control::FIELD_NAMES;
use super::families::{AFFINE, FAMILIES, LOADS};
use super::file::{GreenFile, LoadMeta};
use crate::scene::Body;

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
                name if name == AFFINE.name => affine_names(meta.controls.iter().map(|c| c.name.as_str())),
                name if name == LOADS.name => load_names(&meta.loads),
                name => {
                    let groups = (entry.groups)(self, body);
                    numbered(name, groups.iter().map(|g| g.columns(meta.surface_nodes).unwrap_or(0)).sum())
                }
            })
            .chain(
                self.effects_with_columns(body).into_iter().flat_map(|(name, count)| numbered(name, count)),
            )
            .collect()
    }
}

/// Those of a body's control elements and loads, which its scene tells before anything is solved.
pub fn column_names_of(body: &Body) -> Vec<ColumnName> {
    let loads: Vec<LoadMeta> = body.loads().iter().map(LoadMeta::of).collect();
    let mut names = affine_names(body.control.keys().map(String::as_str));
    names.extend(load_names(&loads));
    names
}

/// Whether a name is of a family whose columns are numbered: how many there are, is known when they are solved.
pub fn is_numbered(name: &str) -> bool {
    FAMILIES.iter().any(|entry| name.split('.').next() == Some(entry.family.name))
}

/// `count` columns without names of their own.
fn numbered(of: &str, count: usize) -> Vec<ColumnName> {
    let name = |k| ColumnName { name: format!("{of}.{k}"), unit: "1".into(), source: ColumnSource::Model };
    (1..=count).map(name).collect()
}

fn affine_names<'a>(controls: impl Iterator<Item = &'a str>) -> Vec<ColumnName> {
    let of = |(e, name): (usize, &'a str)| {
        FIELD_NAMES.into_iter().enumerate().map(move |(k, field)| ColumnName {
            name: format!("{name}.{field}"),
            unit: if k < 3 { "m" } else { "1" }.into(),
            source: ColumnSource::Field { control: e, field: k },
        })
    };
    controls.enumerate().flat_map(of).collect()
}

fn load_names(loads: &[LoadMeta]) -> Vec<ColumnName> {
    let named =
        |name: String, unit: &str| ColumnName { name, unit: unit.to_owned(), source: ColumnSource::Load };
    let of = |load: &LoadMeta| match load.columns {
        3 => ["x", "y", "z"].map(|axis| named(format!("{}.{axis}", load.name), &load.unit)).to_vec(),
        _ => vec![named(load.name.clone(), &load.unit)],
    };
    loads.iter().flat_map(of).collect()
}
