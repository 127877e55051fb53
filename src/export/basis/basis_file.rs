//! One kind of file that holds columns, and for whom it is made.

use super::body_basis::BodyBasis;
use crate::base::output::Kind;
use std::io::{self, Write};

/// One kind of file that holds columns.
pub struct BasisFile {
    /// The suffix by which it is chosen, as `.iv`.
    pub suffix: &'static str,
    /// A description in one line.
    pub about: &'static str,
    /// Recognises an earlier file of this kind; others are never overwritten.
    pub kind: Kind,
    /// Approximate size in bytes.
    pub size: fn(&[BodyBasis], Profile) -> u64,
    /// Largest size that it may have.
    pub most: Option<u64>,
    /// Whether it can be made for [`Profile::Viewer`] too.
    pub is_for_viewers: bool,
    pub write: fn(&[BodyBasis], Profile, &mut dyn Write) -> io::Result<()>,
}

/// The kind of program for which a file is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Profile {
    /// Every column as it is
    #[default]
    Full,
    /// At most 8 morph targets, with weights from 0 to 1: a few motions, each forwards and backwards (.glb)
    Viewer,
}

/// Motions that a file for viewers has at most, each as two targets.
pub const VIEWER_MOTIONS: usize = 4;

/// Numbers of all fields, those of the rest shape too.
pub fn numbers(bodies: &[BodyBasis]) -> u64 {
    bodies.iter().map(|body| 3 * (body.rest.len() * (1 + body.columns.len())) as u64).sum()
}

pub fn triangles(bodies: &[BodyBasis]) -> u64 {
    bodies.iter().map(|body| body.triangles.len() as u64).sum()
}
