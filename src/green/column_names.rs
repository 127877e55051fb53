//! Names of the columns of a body, for other programs and for people.

use super::families::{FAMILIES, names_of_fields, names_of_loads};
use super::family::{ColumnName, ColumnSource};
use super::file::{GreenFile, LoadMeta};
use crate::scene::Body;

impl GreenFile {
    /// Name and unit of every column of a body, in the order of [`GreenFile::groups`]: `right.m12` of a control element,
    /// `gravity.x` or `press` of a load, `reduced.3` of a family that does not name its columns.
    pub fn column_names(&self, body: &str) -> Vec<ColumnName> {
        let Some(meta) = self.meta.bodies.get(body) else { return Vec::new() };
        let required = FAMILIES.iter().filter(|entry| meta.requirements.has(entry.family));
        required
            .flat_map(|entry| match entry.column_names {
                Some(names) => names(meta),
                None => {
                    let groups = (entry.groups)(self, body);
                    let count = groups.iter().map(|g| g.columns(meta.surface_nodes).unwrap_or(0)).sum();
                    numbered(entry.family.name, count)
                }
            })
            .chain(
                self.effects_with_columns(body).into_iter().flat_map(|(name, count)| numbered(name, count)),
            )
            .collect()
    }
}

/// Names of the columns of a body's control elements and loads, which are known from its scene before anything is solved.
pub fn column_names_of(body: &Body) -> Vec<ColumnName> {
    let loads: Vec<LoadMeta> = body.loads().iter().map(LoadMeta::new).collect();
    let mut names = names_of_fields(body.control.keys().map(String::as_str));
    names.extend(names_of_loads(&loads));
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
