//! Bodies in the colours of a field on their surface: von Mises stress, largest principal strain, or displacement.
//!
//! In: the deformed surface, and which material lies behind each of its triangles, from a section of the .green file. Out: a
//! code for every vertex ([`field_code`](crate::render::field_code)), a [`Legend`](crate::base::legend::Legend) with the value under each ray, a warning where a limit
//! of the scene is passed, and closing words. Stress and strain are those of [`SurfaceStress`](crate::deform::SurfaceStress); the CPU computes them, once for
//! every deformation.
mod shown;
mod stressed_body;
#[cfg(test)]
mod tests;

pub use stressed_body::{NAME, Peaks, StressedBody, SurfaceLoads, share};

use super::entry::EffectEntry;

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: NAME,
    summary: "colours by von Mises stress, largest strain or displacement, with a legend; says where a limit is passed",
    needs_inside: true,
    shows_stress: true,
    precompute: Some(stressed_body::section),
    attach: Some(shown::attach),
    ..EffectEntry::NOTHING
};
