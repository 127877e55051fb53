//! Tables: matrices of f64 that families keep beside the columns, by the name of their tensor.
//!
//! In: what a family left in [`Solution::tables`](super::super::solution::Solution::tables). Out: the tensor `BODY/NAME`,
//! column after column, and the matrix again.

use super::super::bytes::Tensor;
use super::super::file::GreenFile;
use super::super::numbers::numbers;
use super::super::solution::Precomputed;
use nalgebra::DMatrix;
use safetensors::tensor::Dtype;

/// The tensor of table `name`, if it was made.
pub fn write(body: &Precomputed, name: &str) -> Vec<(String, Tensor)> {
    let tensor = |table: &DMatrix<f64>| Tensor::new(&[table.ncols(), table.nrows()], table.iter().copied());
    body.solution.tables.get(name).map(|table| (name.to_owned(), tensor(table))).into_iter().collect()
}

/// Table `name` of a body, of `rows` × `columns` finite numbers; the error names the first fault.
pub fn check(
    file: &GreenFile,
    body: &str,
    name: &str,
    [rows, columns]: [usize; 2],
) -> Result<DMatrix<f64>, String> {
    let tensor = format!("{body}/{name}");
    file.expect(&tensor, Dtype::F64, &[columns, rows])?;
    let table = DMatrix::from_column_slice(rows, columns, file.slice(&tensor));
    numbers(&format!("tensor {tensor}"), table.iter().copied(), f64::MAX)?;
    Ok(table)
}

impl GreenFile {
    /// Table `name` of a body, where the scene required its family.
    pub fn table(&self, body: &str, name: &str) -> Option<DMatrix<f64>> {
        let tensor = format!("{body}/{name}");
        let (dtype, shape, _) = self.tensors.get(&tensor)?;
        let [columns, rows] = shape[..] else { return None };
        (*dtype == Dtype::F64).then(|| DMatrix::from_column_slice(rows, columns, self.slice(&tensor)))
    }
}
