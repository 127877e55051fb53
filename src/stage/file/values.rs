//! Names, lengths and places of a stage file, within the ranges that a room has.

use crate::stage::error::StageFault;
use crate::stage::screen::ROOM_LIMIT_M;
use nalgebra::Point3;

pub fn check_name(what: &'static str, name: &str) -> Result<(), StageFault> {
    let is_plain = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    if is_plain && (1..=64).contains(&name.len()) {
        Ok(())
    } else {
        Err(StageFault::Name { what, name: name.chars().take(64).collect() })
    }
}

pub fn length(what: &str, value: f64, min: f64, max: f64) -> Result<f64, StageFault> {
    if (min..=max).contains(&value) {
        Ok(value)
    } else {
        Err(StageFault::Length { what: what.to_owned(), value, min, max })
    }
}

pub fn point(what: &str, coordinates: [f64; 3]) -> Result<Point3<f64>, StageFault> {
    for (axis, value) in ["x", "y", "z"].into_iter().zip(coordinates) {
        length(&format!("{axis} of {what}"), value, -ROOM_LIMIT_M, ROOM_LIMIT_M)?;
    }
    Ok(coordinates.into())
}
