//! What the .green file holds of bodies, for other programs: the surface at rest and every column, so that they can sum.
//!
//! In: [`BodyBasis`] of each body. Out: one file, by one of [`BASIS_FILES`].
//!
//! To add a format: write a file with a [`BasisFile`], add it to the list, and name it in the chapter `export` of the manual.

mod body_basis;
mod gltf;
mod inventor;
mod inventor_names;
mod motions;
mod vtu;

pub use body_basis::{BodyBasis, Choice, Column, Handle};
pub use motions::{Motion, motions};

use super::free_poses;
use crate::base::failure::Failure;
use crate::base::output::Kind;
use crate::green::{AFFINE, GreenFile};
use crate::prepare;
use crate::scene::Scene;
use std::io::{self, Write};
use std::sync::Arc;

/// One kind of file that holds columns.
pub struct BasisFile {
    /// By which it is chosen, as `.iv`.
    pub suffix: &'static str,
    /// What it is, in one line.
    pub about: &'static str,
    /// Recognises an earlier file of this kind; others are never overwritten.
    pub kind: Kind,
    /// About how many bytes it will take.
    pub size: fn(&[BodyBasis], Profile) -> u64,
    /// It may take no more.
    pub most: Option<u64>,
    /// The error says what the profile lacks.
    pub check: fn(&[BodyBasis], Profile) -> Result<(), String>,
    pub write: fn(&[BodyBasis], Profile, &mut dyn Write) -> io::Result<()>,
}

/// For whom a file is made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Profile {
    /// Every column as it is
    #[default]
    Full,
    /// At most 8 morph targets, with weights from 0 to 1: a few motions, each forwards and backwards (.glb)
    Viewer,
}

/// All of them; a new one is one file and one line here.
pub const BASIS_FILES: &[BasisFile] = &[inventor::FILE, gltf::FILE, vtu::FILE];

/// Refuses a body without columns, before anything is solved for it.
pub fn refuse(scene: &Scene, name: &str) -> Result<(), Failure> {
    let body = &scene.body[name];
    if prepare::requirements(scene, name, body)?.has(AFFINE) {
        return Ok(());
    }
    let message = format!(
        "the model \"{}\" has no columns to sum: write the surface of a pose (-o OUT.stl, .ply or .obj), or model = \"linear\" \
         into the scene, whose displacements are a sum",
        body.model
    );
    Err(Failure::request(scene.invalid(&format!("body.{name}.model"), message)))
}

/// The bodies called `names`, from the file; the error says which of them is no sum of columns.
pub fn read(
    scene: &Scene,
    file: &Arc<GreenFile>,
    names: &[&str],
    choice: Choice<'_>,
) -> Result<Vec<BodyBasis>, Failure> {
    let mut missed = Vec::new();
    let asked = &free_poses::found(scene, choice.asked, Some(file), &mut missed)?[..];
    if let Some(missed) = missed.first() {
        return Err(Failure::work(anyhow::anyhow!("{}", missed.why)));
    }
    names.iter().map(|name| BodyBasis::read(scene, file, name, Choice { asked, ..choice })).collect()
}

/// Numbers of all fields, those of the rest shape too.
fn numbers(bodies: &[BodyBasis]) -> u64 {
    bodies.iter().map(|body| 3 * (body.rest.len() * (1 + body.columns.len())) as u64).sum()
}

fn triangles(bodies: &[BodyBasis]) -> u64 {
    bodies.iter().map(|body| body.triangles.len() as u64).sum()
}

/// A profile is for some formats alone.
fn full_only(_: &[BodyBasis], profile: Profile) -> Result<(), String> {
    match profile {
        Profile::Full => Ok(()),
        Profile::Viewer => {
            Err("--profile viewer makes morph targets, which .glb files have: name OUT.glb".to_owned())
        }
    }
}
