//! Hard cases: bodies, materials, units, supports, poses and files with which a solver can go wrong in silence.
//!
//! In: nothing; every case is built in memory. Out: [`CaseRow`]s: whether the case was solved, solved with a warning or
//! refused, as required; in which words; and the error that was measured, with the bound it must keep.
//!
//! The base case is a block of 1 × 1 × 2 m in 5 × 5 × 10 cells, of E = 1 MPa and ν = 0.3, held at both ends of z.

mod case;
mod materials;
mod meshes;
mod poses;
mod supports;

pub use case::{CaseRow, CaseRows, Outcome};

/// Builds, solves and judges all cases, in the order of their numbers. Errors where a reference cannot be solved.
pub fn run() -> CaseRows {
    let mut rows = Vec::new();
    for cases in [materials::rows, meshes::rows, supports::rows, poses::rows] {
        rows.extend(cases()?);
    }
    rows.sort_by_key(|row| row.number);
    Ok(rows)
}
