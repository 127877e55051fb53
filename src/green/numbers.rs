//! Whether numbers of a .green file can be used.

/// Largest number of a column, m per unit of its field, and of a place, m: sums of them times the coefficients of poses
/// stay within single precision.
pub const LARGEST: f64 = 1e18;

/// Errors at the first number that is not finite, or whose magnitude is above `largest`.
pub fn numbers(what: &str, values: impl IntoIterator<Item = f64>, largest: f64) -> Result<(), String> {
    match values.into_iter().enumerate().find(|(_, value)| value.is_nan() || value.abs() > largest) {
        None => Ok(()),
        Some((i, value)) if value.is_finite() => {
            Err(format!("{what}: number {i} is {value:e}, of a magnitude above {largest:e}"))
        }
        Some((i, value)) => Err(format!("{what}: number {i} is {value}")),
    }
}
