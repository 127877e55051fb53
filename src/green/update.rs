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
//! a dense system in d and f. Among the u_k are the fields of the body's loads, whose own forces do not count in [K u]_j.
//! K_R is condensed onto the nodes Q that R shares with the rest of the body and with control elements: S_R = K_QQ - K_QI
//! K_II⁻¹ K_IQ. These nodes, and those of elements that may be released, are the body's ports. Of the forces F that loads have
//! inside of R, Q bears K_QI K_II⁻¹ F_I whatever the modulus is, and what they do while Q rests becomes p/α:
//!
//! ```text
//! p = K_II⁻¹ F_I        u + (1/α - 1) p inside of R
//! ```
//!
//! Warmth has no p: it moves the shape in which R is without stress by x, so that K_R (u - x) stands for K_R u.

use super::control::FIELDS;
use super::dense::{Lu, product};
use faer::{Mat, MatRef};
use nalgebra::DMatrix;
use std::ops::Range;

/// Pivots further apart than this leave no digit.
const SINGULAR: f64 = 1e-13;

const NODES: &str = "updates/nodes";
const RELEASED: &str = "updates/released";
const FREE: &str = "updates/free";
const REGIONS: &str = "updates/regions";
const STIFFNESSES: &str = "updates/stiffnesses";
const VALUES: &str = "updates/values";
const REACTIONS: &str = "updates/reactions";
pub(super) const COLUMNS: &str = "updates/columns";
const TORQUES: &str = "updates/torques";
const WORK: &str = "updates/work";

/// The tables of the family: the mesh's node of every port; element and port of every node that may be released; the ports
/// at free nodes; region and port of every node of a Q; all S_R, column after column; fields at the ports, that of warmth less x;
/// reactions on what may be released; fields on the surface; torques of the loads on them; FᵀP. Fields stand in the order
/// affine, of loads, g, h. On the surface they are g, h, p region after region, then those of loads; torques are those on g, h
/// and p.
pub const TABLES: [&str; 10] =
    [NODES, RELEASED, FREE, REGIONS, STIFFNESSES, VALUES, REACTIONS, COLUMNS, TORQUES, WORK];

/// The changes for which a body is prepared, without the numbers of their fields.
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
    pub(super) ports: Ports,
    /// Affine fields, and those of loads.
    affine: usize,
    loads: usize,
    pub(super) values: DMatrix<f64>,
    pub(super) reactions: DMatrix<f64>,
    pub(super) columns: DMatrix<f64>,
    torques: DMatrix<f64>,
    /// FᵀP, loads × loads of each region.
    pub(super) work: DMatrix<f64>,
}

/// A change of a body.
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
    /// Additions to their affine columns on the surface, and to the columns of the loads there: a column for each.
    pub added: DMatrix<f64>,
    /// Additions to [`TORQUES`](super::TORQUES) of these columns.
    pub torques: DMatrix<f64>,
    /// The Hessian of the energy by their coefficients: S of those that are kept, in front.
    pub hessian: DMatrix<f64>,
    /// max |H - Hᵀ| / max |H| before it was made symmetric: how well the change was solved.
    pub asymmetry: f64,
}

/// A change whose system is factored, for any number of right-hand sides.
pub struct ChangedSystem<'a> {
    updates: &'a Updates,
    kept: Vec<usize>,
    /// Rows of the reactions of what is released, one for each d.
    released: Vec<usize>,
    /// First of the three rows of every port in d.
    released_at: Vec<Option<usize>>,
    /// The regions that are changed, by their numbers, with α.
    regions: Vec<(usize, f64)>,
    /// Columns of g and h: d, then f of each region; where those of each region stand.
    fields: Vec<usize>,
    own: Vec<Range<usize>>,
    /// Forces are counted in this many N, so that both equations have one unit.
    unit: f64,
    system: Lu,
    /// The fields of g and h on the surface.
    columns: Mat<f64>,
}

impl Ports {
    /// Degrees of freedom: fields beside the affine ones and those of loads.
    pub fn fields(&self) -> usize {
        3 * (self.released.len() + self.free.len())
    }

    /// The [`TABLES`] of these ports and of their fields: at the ports, reactions, on the surface, torques and work.
    pub fn tables(
        self,
        [values, reactions, columns, torques, work]: [DMatrix<f64>; 5],
    ) -> [(&'static str, DMatrix<f64>); 10] {
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
            (TORQUES, torques),
            (WORK, work),
        ]
    }
}

impl Updates {
    /// Reads the tables of a body with so many control elements, surface nodes and columns of loads; the error names the
    /// first fault.
    pub fn read(
        table: &dyn Fn(&str) -> Option<DMatrix<f64>>,
        [controls, surface, loads]: [usize; 3],
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
        let (known, inside) = (affine + loads, loads * ports.regions.len());
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
            values: matrix(VALUES, (3 * count, known + own))?,
            reactions: matrix(REACTIONS, (3 * ports.released.len(), known + own))?,
            columns: matrix(COLUMNS, (3 * surface, own + inside + loads))?,
            torques: matrix(TORQUES, (3 * (own + inside), loads))?,
            work: matrix(WORK, (loads, inside))?,
            affine,
            loads,
            ports,
        })
    }

    /// All fields but g and h.
    fn known(&self) -> usize {
        self.affine + self.loads
    }

    /// The system of a change; `None` where it is singular in f64, as where nothing holds what is left.
    pub fn prepare(&self, change: &Change) -> Option<ChangedSystem<'_>> {
        let ports = &self.ports;
        let kept = (0..self.affine / FIELDS).filter(|e| !change.released.contains(e)).collect();
        let released = ports.released.iter().enumerate().filter(|(_, [e, _])| change.released.contains(e));
        let released: Vec<usize> = released.flat_map(|(at, _)| 3 * at..3 * at + 3).collect();
        let mut released_at = vec![None; ports.nodes.len()];
        for (row, &at) in released.iter().enumerate().step_by(3) {
            released_at[ports.released[at / 3][1]] = Some(row);
        }
        let factors = (0..ports.regions.len()).zip(change.factors.iter().copied());
        let regions: Vec<(usize, f64)> = factors.filter(|(_, factor)| *factor != 1.0).collect();
        let mut fields = released.clone();
        let mut own = Vec::new();
        for (region, _) in &regions {
            let first = fields.len();
            let free = ports.regions[*region].ports.iter().filter_map(|&port| self.h(port));
            fields.extend(free.flat_map(|h| h..h + 3));
            own.push(first..fields.len());
        }
        let stiffest = regions.iter().map(|(region, _)| ports.regions[*region].stiffness.amax());
        let known = self.known();
        let of_released = released.iter().map(|&row| self.reactions[(row, known + row)].abs());
        let unit =
            Some(stiffest.chain(of_released).fold(0.0, f64::max)).filter(|unit| *unit > 0.0).unwrap_or(1.0);

        let unknown = fields.len();
        let columns = seen(&self.columns.select_columns(&fields)).to_owned();
        let mut changed = ChangedSystem {
            updates: self,
            kept,
            released,
            released_at,
            regions,
            fields,
            own,
            unit,
            system: Lu::new(Mat::zeros(0, 0)),
            columns,
        };
        let columns: Vec<usize> = changed.fields.iter().map(|field| known + field).collect();
        let mut rows =
            changed.rows(&self.values.select_columns(&columns), &self.reactions.select_columns(&columns));
        let forces = changed.forces();
        for row in forces..unknown {
            rows[(row, row)] += 1.0;
        }
        rows.columns_mut(forces, unknown - forces).scale_mut(unit);
        rows.scale_mut(1.0 / unit);
        let system = Lu::new(seen(&rows).to_owned());
        let [least, largest] = [f64::min, f64::max].map(|of| system.pivots().reduce(of).unwrap_or(1.0));
        if least.is_nan() || least <= SINGULAR * largest {
            return None;
        }
        changed.system = system;
        Some(changed)
    }

    /// Index of a port's h among g and h.
    fn h(&self, port: usize) -> Option<usize> {
        Some(3 * self.ports.released.len() + 3 * self.ports.free.binary_search(&port).ok()?)
    }
}

impl ChangedSystem<'_> {
    /// Unknowns before the forces.
    fn forces(&self) -> usize {
        self.released.len()
    }

    /// Forces of each changed region on its ports, for fields with these values at the ports.
    fn acts(&self, values: &DMatrix<f64>) -> Vec<DMatrix<f64>> {
        let act = |(number, factor): &(usize, f64)| {
            let region = self.region(*number);
            let rows: Vec<usize> = region.ports.iter().flat_map(|port| 3 * port..3 * port + 3).collect();
            &region.stiffness * values.select_rows(&rows) * (factor - 1.0)
        };
        self.regions.iter().map(act).collect()
    }

    fn region(&self, number: usize) -> &Region {
        &self.updates.ports.regions[number]
    }

    /// The two equations but for the f_i alone, of fields with these values and reactions.
    fn rows(&self, values: &DMatrix<f64>, reactions: &DMatrix<f64>) -> DMatrix<f64> {
        let mut rows = DMatrix::zeros(self.fields.len(), values.ncols());
        for (row, &at) in self.released.iter().enumerate() {
            rows.set_row(row, &reactions.row(at));
        }
        for (((number, _), act), own) in self.regions.iter().zip(self.acts(values)).zip(&self.own) {
            let mut row = own.start;
            for (place, &port) in self.region(*number).ports.iter().enumerate() {
                for axis in 0..3 {
                    let acting = act.row(3 * place + axis);
                    if self.updates.h(port).is_some() {
                        rows.set_row(row, &acting);
                        row += 1;
                    } else if let Some(first) = self.released_at[port] {
                        let sum = rows.row(first + axis) + acting;
                        rows.set_row(first + axis, &sum);
                    }
                }
            }
        }
        rows
    }

    /// d and f for fields with these values and reactions before the change, a column each.
    fn answer(&self, values: &DMatrix<f64>, reactions: &DMatrix<f64>) -> DMatrix<f64> {
        let rows = self.rows(values, reactions) * (-1.0 / self.unit);
        let mut answer = owned(self.system.solve(seen(&rows)).as_ref());
        let forces = self.forces();
        let count = self.fields.len() - forces;
        answer.rows_mut(forces, count).scale_mut(self.unit);
        answer
    }

    /// The body after the change, from the Hessian before it of the energy by the coefficients of all affine fields and loads.
    pub fn body(&self, hessian: &DMatrix<f64>) -> Updated {
        let updates = self.updates;
        let affine = self.kept.iter().flat_map(|e| FIELDS * e..FIELDS * (e + 1));
        let all: Vec<usize> = affine.chain(updates.affine..updates.known()).collect();
        let (values, reactions) =
            (updates.values.select_columns(&all), updates.reactions.select_columns(&all));
        let answer = self.answer(&values, &reactions);
        let columns: Vec<usize> = self.fields.iter().map(|field| updates.known() + field).collect();
        let whole = &values + updates.values.select_columns(&columns) * &answer;
        let mut after = hessian.select_rows(&all).select_columns(&all);
        for (row, &at) in self.released.iter().enumerate() {
            after += reactions.row(at).transpose() * answer.row(row);
        }
        for (((number, _), acting), own) in self.regions.iter().zip(self.acts(&whole)).zip(&self.own) {
            let mut row = own.start;
            for (place, &port) in self.region(*number).ports.iter().enumerate() {
                for axis in 0..3 {
                    let of_kept = values.row(3 * port + axis).transpose();
                    if updates.h(port).is_some() {
                        after -= of_kept * answer.row(row);
                        row += 1;
                    } else {
                        after += of_kept * acting.row(3 * place + axis);
                    }
                }
            }
        }
        let mut added = owned(product(self.columns.as_ref(), seen(&answer)).as_ref());
        let mut torques = DMatrix::zeros(3 * all.len(), updates.torques.ncols());
        for (row, &field) in self.fields.iter().enumerate() {
            for column in 0..all.len() {
                let more = updates.torques.rows(3 * field, 3) * answer[(row, column)];
                let mut own = torques.rows_mut(3 * column, 3);
                own += more;
            }
        }
        // Of each load, its own field and what the change makes of p.
        let (first, own, inside) = (all.len() - updates.loads, updates.ports.fields(), updates.work.ncols());
        for load in 0..updates.loads {
            let mut column = added.column_mut(first + load);
            column += updates.columns.column(own + inside + load);
            for (number, factor) in &self.regions {
                let (p, more) = (number * updates.loads + load, 1.0 / factor - 1.0);
                column.axpy(more, &updates.columns.column(own + p), 1.0);
                let mut row = torques.rows_mut(3 * (first + load), 3);
                row += updates.torques.rows(3 * (own + p), 3) * more;
                let mut yields = after.view_mut((first, first + load), (updates.loads, 1));
                yields -= updates.work.column(p) * more;
            }
        }
        let largest = after.amax();
        let asymmetry = if largest > 0.0 { (&after - after.transpose()).amax() / largest } else { 0.0 };
        Updated {
            kept: self.kept.clone(),
            added,
            torques,
            hessian: (&after + after.transpose()) * 0.5,
            asymmetry,
        }
    }

    /// Additions to the displacements of the surface for unit forces at these of its nodes, three columns each. By
    /// reciprocity, such a force moves a free port by h there, and pulls on a node that may be released by -g.
    pub fn compliance(&self, nodes: &[u32]) -> DMatrix<f64> {
        let updates = self.updates;
        let rows: Vec<usize> =
            nodes.iter().flat_map(|&node| 3 * node as usize..3 * node as usize + 3).collect();
        let at = updates.columns.select_rows(&rows).transpose();
        let mut values = DMatrix::zeros(updates.values.nrows(), rows.len());
        for port in 0..updates.ports.nodes.len() {
            if let Some(h) = updates.h(port) {
                values.rows_mut(3 * port, 3).copy_from(&at.rows(h, 3));
            }
        }
        let reactions = -at.rows(0, updates.reactions.nrows());
        owned(product(self.columns.as_ref(), seen(&self.answer(&values, &reactions))).as_ref())
    }
}

impl ChangedSystem<'_> {
    /// The addition of [`ChangedSystem::compliance`] as W M Wᵀ: the columns of g and h on the surface that W has, and M. `None`
    /// where moduli were changed.
    pub fn added_yield(&self) -> Option<(Vec<u32>, DMatrix<f64>)> {
        let k = self.released.len();
        let fields = self.fields.iter().map(|&field| field as u32).collect();
        let unit = DMatrix::identity(k, k) / self.unit;
        (k == self.fields.len()).then(|| (fields, owned(self.system.solve(seen(&unit)).as_ref())))
    }
}

/// The matrix for faer, whose products and solves of large dense matrices are faster.
fn seen(matrix: &DMatrix<f64>) -> MatRef<'_, f64> {
    MatRef::from_column_major_slice(matrix.as_slice(), matrix.nrows(), matrix.ncols())
}

fn owned(matrix: MatRef<'_, f64>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)])
}

#[cfg(test)]
mod tests;
