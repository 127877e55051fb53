//! `greenstage new`: from a mesh or surface file to a scene file, with the reason for every choice.

use super::opening::{self, Guess, SCENE};
use super::print::print;
use crate::base::failure::Failure;
use crate::base::output;
use crate::mesh::formats::files_of;
use crate::scene::proposal::{Proposal, Wishes};
use std::path::{Path, PathBuf};

const AFTER_HELP: &str = "\
Examples:
  greenstage new part.msh                                   beside it, part.toml
  greenstage new part.stl --unit mm --material steel        a surface is filled with tetrahedra
  greenstage new part.msh --fixed base --grab tip -o scenes/part.toml

Then `greenstage view part.toml`. Every line of the file has its reason beside it; change what you
like. `greenstage manual materials` lists the materials, `greenstage inspect part.msh` the node groups.";

/// Make a scene file from a mesh or surface file, with the reason for every guess
///
/// Guesses what you do not give: the unit of length, the cell size for filling a surface, material, model, and which part is
/// fixed and which can be grabbed (node groups of the file, or else two ends of the body). If the size is implausible in metres,
/// it asks for the unit; without a terminal it prints the command for either unit and ends with status 2.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    /// Mesh (.msh, .vtk, …) or surface (.stl, .obj, .ply); `greenstage manual meshes` lists the formats
    pub mesh: PathBuf,
    /// The scene file; default: beside the mesh, with the extension .toml
    #[arg(short, long)]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub guess: Guess,
    /// Metres in one unit of the file, where no unit has a name
    #[arg(long, conflicts_with = "unit", value_parser = super::parsers::positive)]
    pub scale: Option<f64>,
    /// A node group of the file that stays where it is; may be given several times
    #[arg(long, value_name = "GROUP")]
    pub fixed: Vec<String>,
    /// A node group of the file that can be grabbed; may be given several times
    #[arg(long, value_name = "GROUP")]
    pub grab: Vec<String>,
    /// How it deforms: rotation, reduced, linear, …; `greenstage manual scene` compares the models
    #[arg(long)]
    pub model: Option<String>,
    /// Where it is shown: a built-in stage or a stage file
    #[arg(long)]
    pub stage: Option<String>,
    /// Of a surface: edge of the cells that it is filled with, m; default: for 10 to 20 thousand nodes
    #[arg(long, value_parser = super::parsers::positive)]
    pub cell: Option<f64>,
    /// Overwrite the scene file if there is one
    #[arg(long)]
    pub force: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let path = args.output.clone().unwrap_or_else(|| args.mesh.with_extension("toml"));
    if path.extension().is_none_or(|extension| extension != "toml") {
        return Err(Failure::wrong(format!("{}: a scene file's name ends in .toml", path.display())));
    }
    if path.exists() && !args.force {
        return Err(Failure::wrong(format!(
            "{}: already exists; name another file with -o, or overwrite it with --force",
            path.display()
        )));
    }
    output::make_folder_of(&path)?;
    output::try_path(&path, &SCENE, &files_of(&args.mesh))?;
    let wishes = Wishes {
        scale: args.scale,
        model: args.model.clone(),
        stage: args.stage.clone(),
        fixed: args.fixed.clone(),
        grab: args.grab.clone(),
        cell: args.cell,
        ..args.guess.wishes()
    };
    let proposal = opening::propose(&args.mesh, &path, wishes)?;
    let text = proposal.text()?;
    output::write(&path, &SCENE, |file| file.write_all(text.as_bytes()))?;
    print(&told(&proposal, &path))
}

fn told(proposal: &Proposal, path: &Path) -> String {
    let named = path.display();
    let reasons: String = proposal.reasons.iter().map(|reason| format!("  {reason}\n")).collect();
    let warnings: String = proposal.warnings.iter().map(|warning| format!("note: {warning}\n")).collect();
    let next = [
        (format!("greenstage view {named}"), "solves it once, then you bend it"),
        (format!("greenstage check {named}"), "what can be found wrong, without solving"),
        ("an editor".to_owned(), "every line of the scene has its reason beside it"),
    ];
    let width = next.iter().map(|(command, _)| command.chars().count()).max().unwrap_or(0) + 2;
    let next: String = next.iter().map(|(command, what)| format!("  {command:<width$}{what}\n")).collect();
    format!("{named}: written\n{reasons}{warnings}\nNext:\n{next}")
}
