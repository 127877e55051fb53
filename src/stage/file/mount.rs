//! A rigid motion as a stage file writes it: `position` with `rotation`, `rotation_degrees`, or the three measured `axes`.

use super::super::error::TrackingFault;
use super::super::screen::ROOM_LIMIT_M;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

#[derive(Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountFile {
    pub position: Option<[f64; 3]>,
    pub rotation: Option<[f64; 3]>,
    pub rotation_degrees: Option<[f64; 3]>,
    pub axes: Option<[[f64; 3]; 3]>,
}

/// Returns the value if it is within its range.
pub fn range(what: &str, value: f64, unit: &'static str, min: f64, max: f64) -> Result<f64, TrackingFault> {
    if (min..=max).contains(&value) {
        Ok(value)
    } else {
        Err(TrackingFault::Range { what: what.to_owned(), value, unit, min, max })
    }
}

/// The motion that `file` describes; `what` names it in errors.
pub fn isometry(what: &str, file: &MountFile) -> Result<Isometry3<f64>, TrackingFault> {
    let numbers = |key: &str, numbers: [f64; 3], unit, limit: f64| -> Result<Vector3<f64>, TrackingFault> {
        for value in numbers {
            range(&format!("`{key}` in {what}"), value, unit, -limit, limit)?;
        }
        Ok(numbers.into())
    };
    let position = numbers("position", file.position.unwrap_or_default(), " of metres", ROOM_LIMIT_M)?;
    let rotation = match (file.rotation, file.rotation_degrees, file.axes) {
        (None, None, None) => UnitQuaternion::identity(),
        (Some(vector), None, None) => {
            UnitQuaternion::from_scaled_axis(numbers("rotation", vector, " of radians", 6.3)?)
        }
        (None, Some(vector), None) => {
            let degrees = numbers("rotation_degrees", vector, " of degrees", 361.0)?;
            UnitQuaternion::from_scaled_axis(degrees.map(f64::to_radians))
        }
        (None, None, Some([x, y, z])) => {
            let axis = |axis| numbers("axes", axis, "", ROOM_LIMIT_M);
            rotation_from_axes(what, [axis(x)?, axis(y)?, axis(z)?])?
        }
        _ => return Err(TrackingFault::TwoRotations { what: what.to_owned() }),
    };
    Ok(Isometry3::from_parts(Translation3::from(position), rotation))
}

/// The rotation nearest to three measured axes of any length.
fn rotation_from_axes(what: &str, axes: [Vector3<f64>; 3]) -> Result<UnitQuaternion<f64>, TrackingFault> {
    const NAMES: [char; 3] = ['x', 'y', 'z'];
    let what = || what.to_owned();
    let mut unit = Matrix3::zeros();
    for (i, axis) in axes.iter().enumerate() {
        let direction =
            axis.try_normalize(1e-9).ok_or_else(|| TrackingFault::NoAxis { what: what(), axis: NAMES[i] })?;
        unit.set_column(i, &direction);
    }
    for [i, j] in [[0, 1], [0, 2], [1, 2]] {
        let degrees = unit.column(i).angle(&unit.column(j)).to_degrees();
        if (degrees - 90.0).abs() > 5.0 {
            return Err(TrackingFault::Skewed { what: what(), first: NAMES[i], second: NAMES[j], degrees });
        }
    }
    if unit.determinant() < 0.0 {
        return Err(TrackingFault::LeftHanded { what: what() });
    }
    // The nearest rotation is U Vᵀ of the singular value decomposition.
    let svd = unit.svd(true, true);
    let nearest = svd.u.zip(svd.v_t).map_or(unit, |(u, v_t)| u * v_t);
    Ok(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest)))
}
