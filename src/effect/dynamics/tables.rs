//! The section of a body as it is read again: masses, stiffness and frequencies of elements and modes together.

use super::section::{FRAME, MASS, SQUARES, WHOLE};
use super::settings::NAME;
use crate::green::{FIELDS, GreenError, GreenFile};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// Part of its largest entry by which a mass matrix may miss its symmetry.
const SYMMETRY: f64 = 1e-9;

/// Tables of a body with E control elements and m modes; coordinates are the 12E coefficients, then the modes.
#[derive(Clone, Debug, PartialEq)]
pub struct Tables {
    /// ω² of each mode, (rad/s)².
    pub squares: Vec<f64>,
    /// WᵀMW.
    pub mass: DMatrix<f64>,
    /// K of the same coordinates: S, and ω² on the diagonal.
    pub stiffness: DMatrix<f64>,
    /// WᵀMX.
    pub frame: DMatrix<f64>,
    /// XᵀMX.
    pub whole: DMatrix<f64>,
    /// o_e of each control element about the body's centre, m.
    pub origins: Vec<Vector3<f64>>,
}

impl Tables {
    /// Reads the section of a body. The error names the first fault.
    pub fn read(file: &GreenFile, body: &str) -> Result<Tables, GreenError> {
        let damaged = |reason: String| GreenError::Damaged { path: file.path.clone(), reason };
        let controls = file.meta.bodies.get(body).map_or(&[][..], |meta| &meta.controls);
        let fields = FIELDS * controls.len();
        let table = |name: &str, rows: usize, columns: usize| -> Result<DMatrix<f64>, GreenError> {
            let (shape, values) = file.section::<f64>(body, NAME, name)?;
            let tensor = format!("tensor {body}/{NAME}/{name}");
            if *shape != [columns, rows] {
                return Err(damaged(format!("{tensor} is {shape:?}, should be [{columns}, {rows}]")));
            }
            match values.iter().find(|value| !value.is_finite()) {
                Some(value) => Err(damaged(format!("{tensor} holds {value}"))),
                None => Ok(DMatrix::from_column_slice(rows, columns, values)),
            }
        };
        let modes = file.range_of_effect(body, NAME).len();
        let all = fields + modes;
        let squares = table(SQUARES, modes, 1)?.as_slice().to_vec();
        if let Some(square) = squares.iter().find(|square| **square <= 0.0) {
            return Err(damaged(format!("tensor {body}/{NAME}/{SQUARES} holds {square}")));
        }
        let (mass, frame, whole) =
            (table(MASS, all, all)?, table(FRAME, all, FIELDS)?, table(WHOLE, FIELDS, FIELDS)?);
        let skew = (&mass - mass.transpose()).amax();
        if skew > SYMMETRY * mass.amax() {
            return Err(damaged(format!("tensor {body}/{NAME}/{MASS} is not symmetric: by {skew:e}")));
        }
        let known = file.stiffness(body).filter(|s| s.nrows() == fields);
        let known = known.ok_or_else(|| damaged(format!("{body} has no handle stiffness")))?;
        let mut stiffness = DMatrix::zeros(all, all);
        stiffness.view_mut((0, 0), (fields, fields)).copy_from(&known);
        squares.iter().enumerate().for_each(|(k, square)| stiffness[(fields + k, fields + k)] = *square);
        let origins = controls.iter().map(|control| Vector3::from(control.origin)).collect();
        Ok(Tables { squares, mass, stiffness, frame, whole, origins })
    }

    pub fn modes(&self) -> usize {
        self.squares.len()
    }

    /// 12E.
    pub fn fields(&self) -> usize {
        self.mass.nrows() - self.squares.len()
    }

    /// The forces on all coordinates of a body that turns at ω, for each entry of \[ω\]² row by row: WᵀM of what its acceleration
    /// G X, G = \[ω\]², differs from that of the fields with which its elements are moved. Velocities of elements that keep their
    /// directions in space change by G o_e and G in turning axes, the second not for those that are `rigid`: they have a spin, and
    /// the rest of G is no spin.
    pub fn centrifugal(&self, rigid: &[bool]) -> DMatrix<f64> {
        let mut by_elements = DMatrix::zeros(self.fields(), FIELDS - 3);
        for (e, origin) in self.origins.iter().enumerate() {
            for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
                by_elements[(FIELDS * e + i, 3 * i + j)] = origin[j];
                by_elements[(FIELDS * e + 3 + 3 * i + j, 3 * i + j)] = if rigid[e] { 0.0 } else { 1.0 };
            }
        }
        self.frame.columns(3, FIELDS - 3) - self.mass.columns(0, self.fields()) * by_elements
    }
}

/// \[ω\]² row by row.
pub fn squared(spin: &Vector3<f64>) -> [f64; 9] {
    let cross: Matrix3<f64> = spin.cross_matrix();
    let square = cross * cross;
    std::array::from_fn(|i| square[(i / 3, i % 3)])
}

/// Twelve numbers of an element seen in other axes: T and the columns of M turned by `by`.
pub fn seen(by: &Matrix3<f64>, numbers: &[f64]) -> [f64; FIELDS] {
    let turned = by * Vector3::from_column_slice(&numbers[..3]);
    let matrix = by * Matrix3::from_row_slice(&numbers[3..FIELDS]);
    std::array::from_fn(|i| if i < 3 { turned[i] } else { matrix[(i / 3 - 1, i % 3)] })
}
