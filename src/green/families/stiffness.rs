//! The family `stiffness`: the handle stiffness S = Φᵀ(C - BᵀA⁻¹B)Φ, with which control elements resist.
//!
//! In: the affine fields of all control elements. Out: `stiffness`, 12E × 12E, f64, and how far it is from reciprocity.

use super::super::bytes::Tensor;
use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution};
use super::affine::AFFINE;
use super::table;
use crate::fem::{NodeFields, Partition, StiffnessMatrix};
use crate::solve::Progress;
use nalgebra::DMatrix;

pub const STIFFNESS: Family = Family { name: "stiffness", from: &[AFFINE] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: STIFFNESS,
    holds: "the 12E × 12E handle stiffness S: forces and moments on the control elements",
    suits: None,
    compute: Some(compute),
    solves: false,
    write,
    check,
    groups: |_, _| Vec::new(),
    fixed_bytes: |control_elements| 8 * (FIELDS * control_elements).pow(2),
    is_derived: true,
    column_names: None,
};

/// S is symmetric to this part of its largest entry.
const SYMMETRY: f64 = 1e-9;

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    progress.begin("handle stiffness", 0);
    let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
    let Solution { element, mesh, fields, .. } = &*solution;
    // S_ij = a(u⁽ⁱ⁾, u⁽ʲ⁾), the strain energies of the basis fields: the generalised force on field i for a unit of field j.
    // It equals the reactions' work Φᵀ f_b with f_b = Bᵀ u + C b, but where a held part is stiff, f_b is left over of sums
    // that are larger by its contrast; strains of a rigid motion are 0 there.
    let s = element.energies(mesh, assembled.lame, fields).map_err(unfit)?;
    solution.asymmetry = Some(reciprocity(assembled.k, assembled.partition, fields));
    solution.tables.insert(STIFFNESS.name, s);
    progress.end();
    Ok(())
}

/// Asymmetry of the reactions' work Φᵀ f_b, relative to its largest number.
fn reciprocity(k: &StiffnessMatrix, partition: &Partition, fields: &NodeFields) -> f64 {
    let reaction = partition.reaction(k, fields);
    let m = fields.columns;
    let mut work = DMatrix::<f64>::zeros(m, m);
    for (row, &node) in partition.controlled.iter().enumerate() {
        for axis in 0..3 {
            // On controlled nodes the fields are what was prescribed, Φ.
            let phi = fields.row(3 * node as usize + axis);
            let force = reaction.row(3 * row + axis);
            for (i, phi) in phi.iter().enumerate().filter(|(_, phi)| **phi != 0.0) {
                for (j, force) in force.iter().enumerate() {
                    work[(i, j)] += phi * force;
                }
            }
        }
    }
    let difference = (&work - work.transpose()).amax();
    if difference == 0.0 { 0.0 } else { difference / work.amax() }
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    meta.accuracy.asymmetry = body.solution.asymmetry;
    table::write(body, STIFFNESS.name)
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let fields = FIELDS * body.controls.len();
    let s = table::check(file, name, STIFFNESS.name, [fields, fields])?;
    let (tensor, largest) = (format!("tensor {name}/stiffness"), s.amax());
    for j in 0..s.ncols() {
        for i in 0..j {
            if (s[(i, j)] - s[(j, i)]).abs() > SYMMETRY * largest {
                return Err(format!(
                    "{tensor} is not symmetric: {:e} and {:e} at ({i}, {j})",
                    s[(i, j)],
                    s[(j, i)]
                ));
            }
        }
    }
    Ok(())
}

impl Solution {
    /// S, N/m and N and N·m by the fields' units; only where it was required.
    pub fn stiffness(&self) -> Option<&DMatrix<f64>> {
        self.tables.get(STIFFNESS.name)
    }
}

impl GreenFile {
    /// The handle stiffness S, where the scene required it.
    pub fn stiffness(&self, body: &str) -> Option<DMatrix<f64>> {
        self.table(body, STIFFNESS.name)
    }
}
