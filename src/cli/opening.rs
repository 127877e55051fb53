//! Opens the file that a command is given: a scene file, or a mesh or surface file for which a scene is proposed.

use crate::base::cache;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::output;
use crate::base::text::quoted;
use crate::edit::save::SCENE;
use crate::mesh::diagnostics::digits;
use crate::mesh::length_unit::{LengthUnit, find_unit};
use crate::scene::file_kind::is_mesh_or_surface;
use crate::scene::proposal::{self, Proposal, ProposalError, UnitDoubt, Wishes};
use std::io::{BufRead, IsTerminal, Write};
use std::path::{Path, PathBuf};

const FOR_A_MESH: &str = "For a mesh or surface file";

/// What is known of a mesh or surface file; all else is guessed.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Guess {
    /// Unit of its coordinates: m, in, cm, mm, um; default: metres, if the size is then plausible
    #[arg(long, value_parser = find_unit, help_heading = FOR_A_MESH)]
    pub unit: Option<&'static LengthUnit>,
    /// Material (`greenstage manual materials`); default: guessed from the file's name, else rubber
    #[arg(long, value_name = "NAME", help_heading = FOR_A_MESH)]
    pub material: Option<String>,
}

impl Guess {
    pub fn wishes(&self) -> Wishes {
        Wishes { unit: self.unit, material: self.material.clone(), ..Wishes::default() }
    }
}

/// A scene at `scene_path` for a mesh or surface file. Where the file's unit is in doubt, a person at a terminal is asked;
/// elsewhere the error names the commands that say it.
pub fn propose(file: &Path, scene_path: &Path, mut wishes: Wishes) -> Result<Proposal, Failure> {
    loop {
        match proposal::propose(file, scene_path, &wishes) {
            Err(ProposalError::Unit(doubt)) if is_a_person_there() => wishes.unit = Some(ask(&doubt)?),
            Err(ProposalError::Unit(doubt)) => return Err(Failure::wrong(commands(&doubt))),
            other => return Ok(other?),
        }
    }
}

fn is_a_person_there() -> bool {
    std::io::stdin().is_terminal() && std::io::stderr().is_terminal()
}

/// The scene file for what a command is given: that file itself, or, for a mesh or a surface file, a proposed scene. The scene
/// and its .green file then go to a folder of their own ([`cache::folder`]), so that nothing appears beside the mesh.
pub fn scene_path(path: &Path, guess: &Guess) -> Result<PathBuf, Failure> {
    if !is_mesh_or_surface(path) {
        let is_guessed = guess.unit.is_some() || guess.material.is_some();
        let told = "--unit and --material are for a mesh or surface file; a scene has the keys `unit` and `material`";
        return if is_guessed { Err(Failure::wrong(told)) } else { Ok(path.to_owned()) };
    }
    let place = place_of(path)?;
    let proposal = propose(path, &place, guess.wishes())?;
    let text = proposal.text()?;
    if std::fs::read_to_string(&place).ok().as_ref() != Some(&text) {
        output::write(&place, &SCENE, |file| file.write_all(text.as_bytes()))?;
    }
    for line in proposal.reasons.iter().chain(&proposal.warnings) {
        notice!("{}: {line}", path.display());
    }
    notice!(
        "{}: shown by {}; `greenstage new {}` writes a scene of your own",
        path.display(),
        place.display(),
        quoted(&path.display().to_string())
    );
    Ok(place)
}

/// The scene file for a mesh that has none: named after it, and after the folder that it is in.
fn place_of(mesh: &Path) -> Result<PathBuf, Failure> {
    let real = mesh.canonicalize().unwrap_or_else(|_| mesh.to_owned());
    let hash = blake3::hash(real.as_os_str().as_encoded_bytes()).to_hex();
    let stem = mesh.file_stem().unwrap_or_default().to_string_lossy();
    Ok(cache::folder().join(format!("{stem}-{}.toml", &hash[..8])))
}

/// The command line of this run, once with each unit.
fn commands(doubt: &UnitDoubt) -> String {
    let words: Vec<String> = std::env::args().skip(1).map(|word| quoted(&word)).collect();
    let choices: String = doubt
        .candidates
        .iter()
        .map(|unit| {
            format!(
                "\n  greenstage {} --unit {}    for {} long",
                words.join(" "),
                unit.name,
                doubt.extent_in(unit)
            )
        })
        .collect();
    format!(
        "{}: in metres the body would be {} m long; say which unit the file is in:{choices}",
        doubt.mesh.display(),
        digits(doubt.extent)
    )
}

fn ask(doubt: &UnitDoubt) -> Result<&'static LengthUnit, Failure> {
    let mut out = std::io::stderr().lock();
    let mut question = format!("{}: in which unit is it?\n", doubt.mesh.display());
    for (number, unit) in doubt.candidates.iter().enumerate() {
        let extent = doubt.extent_in(unit);
        question.push_str(&format!("  {}  {}: the body is {extent} long\n", number + 1, unit.plural));
    }
    question.push_str("a number, or a unit (m, in, cm, mm, um): ");
    loop {
        out.write_all(question.as_bytes()).and_then(|()| out.flush()).map_err(Failure::work)?;
        let mut line = String::new();
        if std::io::stdin().lock().read_line(&mut line).map_err(Failure::work)? == 0 {
            return Err(Failure::wrong(commands(doubt)));
        }
        let answer = line.trim();
        let chosen =
            answer.parse::<usize>().ok().and_then(|number| doubt.candidates.get(number.wrapping_sub(1)));
        if let Some(unit) = chosen.copied().or_else(|| find_unit(answer).ok()) {
            return Ok(unit);
        }
    }
}
