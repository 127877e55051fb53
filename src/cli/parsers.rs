//! Parses the values of options that several subcommands share.

use crate::deform::find_model;
use crate::effect::find_effect;
use crate::mesh::length_unit::find_unit;
use crate::render::Samples;
use crate::scene::Storage;

pub fn samples(text: &str) -> Result<Samples, String> {
    match text {
        "auto" => Ok(Samples::Auto),
        "1" => Ok(Samples::Exactly(1)),
        "4" => Ok(Samples::Exactly(4)),
        _ => Err("samples per pixel are 1, 4 or auto".into()),
    }
}

/// The name of a model.
pub fn model(name: &str) -> Result<String, String> {
    find_model(name).map(|model| model.name.to_owned())
}

/// The name of an effect.
pub fn effect(name: &str) -> Result<String, String> {
    find_effect(name).map(|effect| effect.name.to_owned())
}

pub fn storage(text: &str) -> Result<Storage, String> {
    match text {
        "f32" => Ok(Storage::F32),
        "f16" => Ok(Storage::F16),
        "int16" => Ok(Storage::Int16),
        _ => Err("columns are stored as f32, f16 or int16".into()),
    }
}

pub fn frames(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|frames| (1..=100_000).contains(frames))
        .ok_or("a number from 1 to 100000".into())
}

/// A time in seconds, which may be nothing.
pub fn seconds(text: &str) -> Result<f64, String> {
    let is_time = |seconds: &f64| (0.0..=1e9).contains(seconds);
    text.parse()
        .ok()
        .filter(is_time)
        .ok_or_else(|| format!("\"{text}\" is no time: write seconds, as 0 or 10"))
}

pub fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|value: &f64| value.is_finite() && *value > 0.0)
        .ok_or("a positive number".into())
}

/// BODY.NAME
pub fn of_body(text: &str) -> Result<(String, String), String> {
    let parts = text.split_once('.').filter(|(body, name)| !body.is_empty() && !name.is_empty());
    let (body, name) = parts.ok_or("a body and one of its parts, as in hose.right")?;
    Ok((body.to_owned(), name.to_owned()))
}

/// BODY.REGION=PA
pub fn modulus(text: &str) -> Result<(String, String, f64), String> {
    let parts =
        text.split_once('=').and_then(|(region, young)| Some((of_body(region).ok()?, positive(young).ok()?)));
    let ((body, region), young) = parts
        .ok_or("a body's region and its modulus, a positive number of pascals, as in liver.tumour=2e4")?;
    Ok((body, region, young))
}

/// `5mm`, `0.2 in`: in metres.
pub fn length(text: &str) -> Result<f64, String> {
    let at = text.find(|c: char| c.is_alphabetic() && c != 'e' && c != 'E').unwrap_or(text.len());
    let (number, unit) = text.split_at(at);
    if unit.is_empty() {
        return Err("a length with its unit, such as 5mm".into());
    }
    Ok(positive(number.trim())? * find_unit(unit)?.metres)
}

pub fn scale(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|scale| (0.01..=4.0).contains(scale)).ok_or("a number from 0.01 to 4".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_a_unit_and_may_have_an_exponent() {
        for (text, metres) in
            [("5mm", 0.005), ("2 in", 0.0508), ("1e-3m", 1e-3), ("2.5E1 cm", 0.25), ("4e2um", 4e-4)]
        {
            let found = length(text).unwrap();
            assert!((found / metres - 1.0).abs() < 1e-14, "{text}: {found}");
        }
        for (text, why) in
            [("5", "with its unit"), ("-1mm", "positive"), ("mm", "positive"), ("5 parsec", "unknown unit")]
        {
            let error = length(text).unwrap_err();
            assert!(error.contains(why), "{text}: {error}");
        }
    }
}
