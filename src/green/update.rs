//! Releases control elements and changes the moduli of regions of a body that was solved, without factoring again.
//!
//! In: the family `updates` of a body, and what is to be changed. Out: its affine columns and handle stiffness afterwards, by
//! the formula of Sherman, Morrison and Woodbury (W. Hager, SIAM Review 31, 1989, 221-239). Let g_j be the field of a unit
//! displacement of one degree of freedom j of an element that may be released, all else held, and h_i that of a unit force
//! at a free node. The body afterwards is
//!
//! ```text
//! u = Σ_k c_k u_k + Σ_j d_j g_j + Σ_i f_i h_i
//! 0 = f_i + (α - 1) [K_R u]_i            where a region R with the modulus αE meets the rest of the body,
//! 0 = [K u]_j + (α - 1) [K_R u]_j        on what is released,
//! ```
//!
//! a dense system in d and f. Inside of R nothing acts, so K_R is condensed onto the nodes Q that it shares with the rest
//! of the body and with control elements: S_R = K_QQ - K_QI K_II⁻¹ K_IQ. These nodes, and those of elements that may be
//! released, are the body's ports.

use super::control::FIELDS;
use nalgebra::DMatrix;
use std::ops::Range;

/// Pivots further apart than this are those of a body that nothing holds any more.
const SINGULAR: f64 = 1e-13;

const NODES: &str = "updates/nodes";
const RELEASED: &str = "updates/released";
const FREE: &str = "updates/free";
const REGIONS: &str = "updates/regions";
const STIFFNESSES: &str = "updates/stiffnesses";
const VALUES: &str = "updates/values";
const REACTIONS: &str = "updates/reactions";
const COLUMNS: &str = "updates/columns";

/// The tables of the family: the mesh's node of every port; element and port of every node that may be released; the ports
/// at free nodes; region and port of every node of a Q; all S_R, column after column; fields at the ports; reactions on what
/// may be released; fields on the surface. Fields stand in the order affine, g, h; those on the surface without the affine.
pub const TABLES: [&str; 8] = [NODES, RELEASED, FREE, REGIONS, STIFFNESSES, VALUES, REACTIONS, COLUMNS];

/// What a body can be changed by, without its numbers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ports {
    /// Nodes of the mesh, ascending.
    pub nodes: Vec<u32>,
    /// Control element and port of every node that may be released; those of one element stand together.
    pub released: Vec<[usize; 2]>,
    /// Ports at free nodes, ascending.
    pub free: Vec<usize>,
    pub regions: Vec<Region>,
}

/// A region whose modulus may be changed.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// The ports of Q, ascending.
    pub ports: Vec<usize>,
    /// S_R, N/m.
    pub stiffness: DMatrix<f64>,
}

/// [`Ports`] with the fields that they cause.
#[derive(Clone, Debug)]
pub struct Updates {
    ports: Ports,
    affine: usize,
    values: DMatrix<f64>,
    reactions: DMatrix<f64>,
    columns: DMatrix<f64>,
}

/// What is changed of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// The control elements that hold nothing.
    pub released: Vec<usize>,
    /// α of every region of [`Ports::regions`].
    pub factors: Vec<f64>,
}

/// A body after a change.
#[derive(Clone, Debug)]
pub struct Updated {
    /// The control elements that still hold, ascending.
    pub kept: Vec<usize>,
    /// What is added to their affine columns on the surface: a column for each.
    pub added: DMatrix<f64>,
    /// The handle stiffness of those that are kept.
    pub stiffness: DMatrix<f64>,
    /// max |S - Sᵀ| / max |S| before it was made symmetric: how well the change was solved.
    pub asymmetry: f64,
}

impl Ports {
    /// Degrees of freedom: fields beside the affine ones.
    pub fn fields(&self) -> usize {
        3 * (self.released.len() + self.free.len())
    }

    /// With their fields, as tables: the affine ones, g and h at the ports, the reactions of all on what may be released, and
    /// g and h on the surface.
    pub fn tables(
        self,
        values: DMatrix<f64>,
        reactions: DMatrix<f64>,
        columns: DMatrix<f64>,
    ) -> [(&'static str, DMatrix<f64>); 8] {
        let numbers = |rows: usize, all: Vec<usize>| {
            DMatrix::from_iterator(rows, all.len() / rows, all.into_iter().map(|number| number as f64))
        };
        let regions = self.regions.iter().enumerate();
        let regions: Vec<usize> =
            regions.flat_map(|(r, of)| of.ports.iter().flat_map(move |&p| [r, p])).collect();
        let stiffnesses: Vec<f64> =
            self.regions.iter().flat_map(|region| region.stiffness.iter().copied()).collect();
        [
            (NODES, numbers(1, self.nodes.iter().map(|&node| node as usize).collect())),
            (RELEASED, numbers(2, self.released.concat())),
            (FREE, numbers(1, self.free)),
            (REGIONS, numbers(2, regions)),
            (STIFFNESSES, DMatrix::from_vec(1, stiffnesses.len(), stiffnesses)),
            (VALUES, values),
            (REACTIONS, reactions),
            (COLUMNS, columns),
        ]
    }
}

impl Updates {
    /// From the tables of a body with so many control elements and surface nodes; the error names the first fault.
    pub fn of(
        table: &dyn Fn(&str) -> Option<DMatrix<f64>>,
        controls: usize,
        surface: usize,
    ) -> Result<Updates, String> {
        let find = |name: &str| table(name).ok_or_else(|| format!("table {name} is missing"));
        let indices = |name: &str, below: &[usize]| -> Result<Vec<Vec<usize>>, String> {
            let found = find(name)?;
            if found.nrows() != below.len() && !found.is_empty() {
                return Err(format!("table {name} has {} rows, not {}", found.nrows(), below.len()));
            }
            let index = |(&value, &below): (&f64, &usize)| {
                let number = value as usize;
                let is_index = value >= 0.0 && number < below && number as f64 == value;
                is_index.then_some(number).ok_or_else(|| format!("table {name}: {value} is no index"))
            };
            found.column_iter().map(|column| column.iter().zip(below).map(index).collect()).collect()
        };
        let nodes: Vec<u32> =
            indices(NODES, &[u32::MAX as usize])?.concat().iter().map(|&n| n as u32).collect();
        let count = nodes.len();
        let released: Vec<[usize; 2]> =
            indices(RELEASED, &[controls, count])?.iter().map(|pair| [pair[0], pair[1]]).collect();
        let free = indices(FREE, &[count])?.concat();
        let mut regions: Vec<Region> = Vec::new();
        for pair in indices(REGIONS, &[usize::MAX >> 12, count])? {
            if pair[0] > regions.len() {
                return Err(format!("table {REGIONS}: region {} stands before its turn", pair[0]));
            }
            if pair[0] == regions.len() {
                regions.push(Region { ports: Vec::new(), stiffness: DMatrix::zeros(0, 0) });
            }
            regions[pair[0]].ports.push(pair[1]);
        }
        let stiffnesses = find(STIFFNESSES)?;
        let mut rest = stiffnesses.as_slice();
        for region in &mut regions {
            let n = 3 * region.ports.len();
            let (own, others) =
                rest.split_at_checked(n * n).ok_or_else(|| format!("table {STIFFNESSES} is cut short"))?;
            (region.stiffness, rest) = (DMatrix::from_column_slice(n, n, own), others);
        }
        let ports = Ports { nodes, released, free, regions };
        let (affine, own) = (FIELDS * controls, ports.fields());
        let matrix = |name: &str, shape: (usize, usize)| {
            let found = find(name)?;
            let is_fit = found.shape() == shape && found.iter().all(|value| value.is_finite());
            is_fit
                .then_some(found)
                .ok_or_else(|| format!("table {name} is not {} × {} numbers", shape.0, shape.1))
        };
        if !rest.is_empty() || stiffnesses.iter().any(|value| !value.is_finite()) {
            return Err(format!("table {STIFFNESSES} does not fit the regions"));
        }
        Ok(Updates {
            values: matrix(VALUES, (3 * count, affine + own))?,
            reactions: matrix(REACTIONS, (3 * ports.released.len(), affine + own))?,
            columns: matrix(COLUMNS, (3 * surface, own))?,
            affine,
            ports,
        })
    }

    /// Whether a control element may be released.
    pub fn may_release(&self, element: usize) -> bool {
        self.ports.released.iter().any(|[e, _]| *e == element)
    }

    /// The body after `change`, from its handle stiffness before; `None` where what is left is not held.
    pub fn apply(&self, change: &Change, stiffness: &DMatrix<f64>) -> Option<Updated> {
        let ports = &self.ports;
        let controls = self.affine / FIELDS;
        let kept: Vec<usize> = (0..controls).filter(|e| !change.released.contains(e)).collect();
        let affine: Vec<usize> = kept.iter().flat_map(|e| FIELDS * e..FIELDS * (e + 1)).collect();
        // d, then f of each region that is changed.
        let released = ports.released.iter().enumerate().filter(|(_, [e, _])| change.released.contains(e));
        let released: Vec<usize> = released.flat_map(|(at, _)| 3 * at..3 * at + 3).collect();
        // Of every port, the first row of its three in d.
        let mut released_at = vec![None; ports.nodes.len()];
        for (row, &at) in released.iter().enumerate().step_by(3) {
            released_at[ports.released[at / 3][1]] = Some(row);
        }
        let changed: Vec<(&Region, f64)> = ports
            .regions
            .iter()
            .zip(&change.factors)
            .map(|(r, a)| (r, a - 1.0))
            .filter(|(_, b)| *b != 0.0)
            .collect();
        let h_of = |port: usize| {
            Some(self.affine + 3 * ports.released.len() + 3 * ports.free.binary_search(&port).ok()?)
        };
        let mut fields: Vec<usize> = released.iter().map(|row| self.affine + row).collect();
        let mut own: Vec<Range<usize>> = Vec::new();
        for (region, _) in &changed {
            let first = fields.len();
            fields.extend(region.ports.iter().filter_map(|&port| h_of(port)).flat_map(|h| h..h + 3));
            own.push(first..fields.len());
        }
        let (known, unknown) = (affine.len(), fields.len());
        let all: Vec<usize> = affine.iter().chain(&fields).copied().collect();

        // What acts of each changed region on its ports, for every field.
        let values = self.values.select_columns(&all);
        let act = |(region, by): &(&Region, f64)| {
            let rows: Vec<usize> = region.ports.iter().flat_map(|port| 3 * port..3 * port + 3).collect();
            &region.stiffness * values.select_rows(&rows) * *by
        };
        let acts: Vec<DMatrix<f64>> = changed.iter().map(act).collect();

        // The rows of the two equations; forces are counted in units of `unit`, so that both have the same.
        let unit =
            released.iter().map(|&row| self.reactions[(row, self.affine + row)].abs()).fold(0.0, f64::max);
        let stiffest = changed.iter().map(|(region, _)| region.stiffness.amax()).fold(unit, f64::max);
        let unit = if stiffest > 0.0 { stiffest } else { 1.0 };
        let mut rows = DMatrix::zeros(unknown, known + unknown);
        for (row, &at) in released.iter().enumerate() {
            rows.set_row(row, &self.reactions.select_columns(&all).row(at));
        }
        for (((region, _), act), own) in changed.iter().zip(&acts).zip(&own) {
            let mut row = own.start;
            for (place, &port) in region.ports.iter().enumerate() {
                for axis in 0..3 {
                    let acting = act.row(3 * place + axis);
                    if h_of(port).is_some() {
                        rows.set_row(row, &acting);
                        rows[(row, known + row)] += 1.0;
                        row += 1;
                    } else if let Some(first) = released_at[port] {
                        let sum = rows.row(first + axis) + acting;
                        rows.set_row(first + axis, &sum);
                    }
                }
            }
        }
        let forces = own.first().map_or(unknown, |first| first.start);
        rows.columns_mut(known + forces, unknown - forces).scale_mut(unit);
        rows.scale_mut(1.0 / unit);
        let mut answer = (-rows.columns(0, known)).into_owned();
        let system = rows.columns(known, unknown).into_owned().full_piv_lu();
        let pivots = system.u().diagonal().abs();
        if unknown > 0 && pivots.min() <= SINGULAR * pivots.max() || !system.solve_mut(&mut answer) {
            return None;
        }
        answer.rows_mut(forces, unknown - forces).scale_mut(unit);

        let mut whole = DMatrix::identity(known + unknown, known);
        whole.rows_mut(known, unknown).copy_from(&answer);
        let mut after = stiffness.select_rows(&affine).select_columns(&affine);
        for (row, &at) in released.iter().enumerate() {
            let of_kept = self.reactions.row(at).select_columns(&affine).transpose();
            after += of_kept * answer.row(row);
        }
        for (((region, _), act), own) in changed.iter().zip(&acts).zip(&own) {
            let acting = act * &whole;
            let mut row = own.start;
            for (place, &port) in region.ports.iter().enumerate() {
                for axis in 0..3 {
                    let of_kept = values.row(3 * port + axis).columns(0, known).transpose();
                    if h_of(port).is_some() {
                        after -= of_kept * answer.row(row);
                        row += 1;
                    } else if released_at[port].is_none() {
                        after += of_kept * acting.row(3 * place + axis);
                    }
                }
            }
        }
        let largest = after.amax();
        let asymmetry = if largest > 0.0 { (&after - after.transpose()).amax() / largest } else { 0.0 };
        let columns: Vec<usize> = fields.iter().map(|field| field - self.affine).collect();
        Some(Updated {
            added: self.columns.select_columns(&columns) * answer,
            stiffness: (&after + after.transpose()) * 0.5,
            kept,
            asymmetry,
        })
    }
}
