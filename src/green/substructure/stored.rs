//! The parts of a body as tables of the .green file, and read again from them.
//!
//! | table | a column for each | rows |
//! |---|---|---|
//! | `substructures/interfaces` | interface | its origin about the body's centre, m |
//! | `substructures/ends` | end of a part, part after part | the part, 1 of a control element else 0, its number |
//! | `substructures/energy` | (one) | of each part S, Z and Q, column after column |
//! | `substructures/shares` | share of a part in a surface node, part after part | the part, the node, the share |
//! | `substructures/fields` | (one) | of each share its displacements, first order, then second |

use super::body::{Joint, SolvedBody, shape};
use super::part::coordinates;
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeMap;

pub const INTERFACES: &str = "substructures/interfaces";
pub const ENDS: &str = "substructures/ends";
pub const ENERGY: &str = "substructures/energy";
pub const SHARES: &str = "substructures/shares";
pub const FIELDS: &str = "substructures/fields";
/// Names of all tables.
pub const TABLES: [&str; 5] = [INTERFACES, ENDS, ENERGY, SHARES, FIELDS];

/// A part as it is stored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredPart {
    pub ends: Vec<Joint>,
    pub stiffness: DMatrix<f64>,
    pub quadratic: DMatrix<f64>,
    pub quartic: DMatrix<f64>,
    /// Surface nodes, and the part's share in each.
    pub nodes: Vec<u32>,
    pub shares: Vec<f64>,
    /// Displacements of the nodes, m by the coordinates' units: a row for each node's axis, a column for each coordinate,
    /// then for each pair of those of the screws.
    pub fields: DMatrix<f64>,
}

/// All parts of a body, and where the interfaces rest, about its centre.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StoredParts {
    pub interfaces: Vec<Vector3<f64>>,
    pub parts: Vec<StoredPart>,
}

/// Numbers of a part with such ends: coordinates, pairs of them, pairs of the screws' alone.
fn sizes(ends: &[Joint]) -> [usize; 3] {
    let controls = ends.iter().filter(|end| matches!(end, Joint::Control(_))).count();
    let m = coordinates(ends.len(), controls);
    let screws = 6 * ends.len().saturating_sub(1);
    [m, m * (m + 1) / 2, screws * (screws + 1) / 2]
}

/// The tables of a solved body about `centre`.
pub fn tables(body: &SolvedBody, centre: &Vector3<f64>) -> BTreeMap<&'static str, DMatrix<f64>> {
    let places =
        body.interfaces.iter().flat_map(|place| (place - centre).iter().copied().collect::<Vec<_>>());
    let (mut ends, mut energy, mut shares, mut fields) = (vec![], vec![], vec![], vec![]);
    for (p, part) in body.parts.iter().enumerate() {
        for end in &part.ends {
            let [kind, number] = match end {
                Joint::Interface(i) => [0, *i],
                Joint::Control(e) => [1, *e],
            };
            ends.extend([p as f64, kind as f64, number as f64]);
        }
        let solution = &part.solution;
        for table in [&solution.stiffness, &solution.quadratic, &solution.quartic] {
            energy.extend(table.iter().copied());
        }
        for &(node, share, row) in &part.shares {
            shares.extend([p as f64, f64::from(node), share]);
            let shape = shape(solution, part.ends.len().saturating_sub(1), row);
            fields.extend((0..3).flat_map(|axis| shape.iter().map(move |u| u[axis])));
        }
    }
    let threes = |values: Vec<f64>| DMatrix::from_vec(3, values.len() / 3, values);
    let one = |values: Vec<f64>| DMatrix::from_vec(values.len(), 1, values);
    BTreeMap::from([
        (INTERFACES, threes(places.collect())),
        (ENDS, threes(ends)),
        (ENERGY, one(energy)),
        (SHARES, threes(shares)),
        (FIELDS, one(fields)),
    ])
}

impl StoredParts {
    /// Reads the parts from the tables of a body with `controls` control elements and `surface_nodes` surface nodes; the error
    /// names the first fault.
    pub fn read(
        table: &dyn Fn(&str) -> Option<DMatrix<f64>>,
        controls: usize,
        surface_nodes: usize,
    ) -> Result<StoredParts, String> {
        let get = |name: &str, rows: Option<usize>| {
            let table = table(name).ok_or_else(|| format!("it has no table {name}"))?;
            if let Some(at) = table.iter().position(|value| !value.is_finite()) {
                return Err(format!("{name}: number {at} is {}", table[at]));
            }
            match rows {
                Some(rows) if table.nrows() != rows => {
                    Err(format!("{name} has {} rows, where {rows} are needed", table.nrows()))
                }
                _ => Ok(table),
            }
        };
        let places = get(INTERFACES, Some(3))?;
        let interfaces: Vec<Vector3<f64>> =
            places.column_iter().map(|place| Vector3::new(place[0], place[1], place[2])).collect();
        let mut parts = read_ends(&get(ENDS, Some(3))?, interfaces.len(), controls)?;
        let energy = get(ENERGY, None)?;
        let mut at = 0;
        for part in &mut parts {
            let [m, of_pairs, of_screws] = sizes(&part.ends);
            for (table, [rows, columns]) in [
                (&mut part.stiffness, [m, m]),
                (&mut part.quadratic, [m, of_pairs]),
                (&mut part.quartic, [of_screws, of_screws]),
            ] {
                let values = energy.as_slice().get(at..at + rows * columns);
                let values = values.ok_or_else(|| format!("{ENERGY} ends after {} numbers", energy.len()))?;
                *table = DMatrix::from_column_slice(rows, columns, values);
                at += rows * columns;
            }
        }
        if at != energy.len() {
            return Err(format!("{ENERGY} has {} numbers, where {at} are needed", energy.len()));
        }
        read_shares(&get(SHARES, Some(3))?, &get(FIELDS, None)?, surface_nodes, &mut parts)?;
        Ok(StoredParts { interfaces, parts })
    }
}

/// A whole number below `limit`.
fn number(table: &str, value: f64, limit: usize) -> Result<usize, String> {
    if value >= 0.0 && value < limit as f64 && value.fract() == 0.0 {
        return Ok(value as usize);
    }
    Err(format!("{table}: {value} is no whole number below {limit}"))
}

/// Parts with their ends alone.
fn read_ends(table: &DMatrix<f64>, interfaces: usize, controls: usize) -> Result<Vec<StoredPart>, String> {
    let mut parts: Vec<StoredPart> = Vec::new();
    for end in table.column_iter() {
        let part = number(ENDS, end[0], parts.len() + 1)?;
        if part == parts.len() {
            parts.push(StoredPart::default());
        } else if part + 1 != parts.len() {
            return Err(format!("{ENDS}: the ends of part {part} do not stand together"));
        }
        let joint = match number(ENDS, end[1], 2)? {
            0 => Joint::Interface(number(ENDS, end[2], interfaces)?),
            _ => Joint::Control(number(ENDS, end[2], controls)?),
        };
        parts[part].ends.push(joint);
    }
    Ok(parts)
}

fn read_shares(
    shares: &DMatrix<f64>,
    fields: &DMatrix<f64>,
    surface_nodes: usize,
    parts: &mut [StoredPart],
) -> Result<(), String> {
    for share in shares.column_iter() {
        let part = number(SHARES, share[0], parts.len())?;
        if parts[part + 1..].iter().any(|later| !later.nodes.is_empty()) {
            return Err(format!("{SHARES}: the shares of part {part} do not stand together"));
        }
        parts[part].nodes.push(number(SHARES, share[1], surface_nodes)? as u32);
        parts[part].shares.push(share[2]);
    }
    let mut at = 0;
    for part in parts.iter_mut() {
        let ([m, _, of_screws], rows) = (sizes(&part.ends), 3 * part.nodes.len());
        let columns = m + of_screws;
        let values = fields.as_slice().get(at..at + rows * columns);
        let values = values.ok_or_else(|| format!("{FIELDS} ends after {} numbers", fields.len()))?;
        part.fields = DMatrix::from_row_slice(rows, columns, values);
        at += rows * columns;
    }
    if at == fields.len() {
        Ok(())
    } else {
        Err(format!("{FIELDS} has {} numbers, where {at} are needed", fields.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Contents that a damaged file might hold are refused, not computed with.
    #[test]
    fn damaged_tables_are_refused() {
        let [m, of_pairs, of_screws] = sizes(&[Joint::Control(0), Joint::Interface(0)]);
        assert_eq!([m, of_pairs, of_screws], [12, 78, 21]);
        let columns = m + of_screws;
        let whole: BTreeMap<&str, DMatrix<f64>> = BTreeMap::from([
            (INTERFACES, DMatrix::zeros(3, 1)),
            (ENDS, DMatrix::from_column_slice(3, 2, &[0.0, 1.0, 0.0, 0.0, 0.0, 0.0])),
            (ENERGY, DMatrix::zeros(m * m + m * of_pairs + of_screws * of_screws, 1)),
            (SHARES, DMatrix::from_column_slice(3, 1, &[0.0, 4.0, 1.0])),
            (FIELDS, DMatrix::zeros(3 * columns, 1)),
        ]);
        let read = |tables: &BTreeMap<&str, DMatrix<f64>>| {
            StoredParts::read(&|name| tables.get(name).cloned(), 1, 5)
        };
        let parts = read(&whole).unwrap().parts;
        assert_eq!((parts.len(), parts[0].fields.shape()), (1, (3, columns)));
        for (name, at, value, expected) in [
            (ENDS, 2, 1.0, "1 is no whole number below 1"),
            (ENDS, 1, 0.5, "0.5 is no whole number below 2"),
            (ENDS, 3, 7.0, "7 is no whole number below 2"),
            (SHARES, 1, 5.0, "5 is no whole number below 5"),
            (ENERGY, 3, f64::NAN, "number 3 is NaN"),
        ] {
            let mut broken = whole.clone();
            broken.get_mut(name).unwrap()[at] = value;
            let error = read(&broken).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
        for name in TABLES {
            let mut broken = whole.clone();
            broken.remove(name);
            assert!(read(&broken).unwrap_err().contains(name));
        }
        let mut short = whole.clone();
        short.insert(FIELDS, DMatrix::zeros(3, 1));
        assert!(read(&short).unwrap_err().contains("ends after 3 numbers"));
    }
}
