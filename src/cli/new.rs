//! `greenstage new`: from a mesh or surface file to a scene file, with the reason for every choice.

use super::opening::{self, Guess};
use super::parsers;
use super::print::print;
use crate::base::diagnostic::Severity;
use crate::base::failure::Failure;
use crate::base::output;
use crate::base::output::Kind;
use crate::base::text::quoted;
use crate::deform::find_model;
use crate::edit::save::SCENE;
use crate::effect::{EffectEntry, find_effect};
use crate::green;
use crate::mesh::LoadedMesh;
use crate::mesh::formats::files_of;
use crate::mesh::surface_files::is_surface_file;
use crate::scene::proposal::pull::{self, length, poses_path};
use crate::scene::proposal::{Proposal, Wishes};
use crate::session::open;
use std::path::{Path, PathBuf};

const AFTER_HELP: &str = "\
Examples:
  greenstage new part.msh                                   beside it, part.toml
  greenstage new part.stl --unit mm --material steel        a surface is filled with tetrahedra
  greenstage new part.msh --fixed base --grab tip -o scenes/part.toml
  greenstage new part.stl --unit mm --pull 5mm              how much force for 5 mm?
  greenstage new part.msh --effects contact,cut             with a probe and a blade in the hands

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
    #[arg(long, conflicts_with = "unit", value_parser = parsers::positive)]
    pub metres_per_unit: Option<f64>,
    /// A node group of the file that stays where it is; may be given several times
    #[arg(long, value_name = "GROUP")]
    pub fixed: Vec<String>,
    /// A node group of the file that can be grabbed; may be given several times
    #[arg(long, value_name = "GROUP")]
    pub grab: Vec<String>,
    /// Model of deformation: rotation, reduced, linear, …; `greenstage manual scene` compares the models
    #[arg(long, value_parser = parsers::model)]
    pub model: Option<String>,
    /// Opt-in effects, such as haptics,stress (forces in newtons, colours by stress) or contact,cut (with a probe and a
    /// blade in the hands); `greenstage manual scene` lists them
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = parsers::effect)]
    pub effects: Vec<String>,
    /// Ask how much force this takes: with the element, model and effects that are made for forces, and poses for
    /// `greenstage deform` that pull and push each control element that can be grabbed by so much, such as 5mm
    #[arg(long, value_name = "LENGTH", value_parser = parsers::length)]
    pub pull: Option<f64>,
    /// Stage on which it is shown: a built-in one or a file
    #[arg(long)]
    pub stage: Option<String>,
    /// Edge of the cells that fill a surface, m; default: for 10 to 20 thousand nodes
    #[arg(long, value_parser = parsers::positive)]
    pub cell: Option<f64>,
    /// Overwrite the scene file if there is one
    #[arg(long)]
    pub force: bool,
}

const POSES: Kind =
    Kind { name: "a pose file", recognizes: |head| head.windows(8).any(|window| window == b"[[pose]]") };

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.mesh.is_dir() || args.mesh.extension().is_some_and(|extension| extension == "toml") {
        return Err(Failure::wrong(format!(
            "{}: is no mesh or surface file, for which a scene is proposed; `greenstage manual meshes` lists the formats",
            args.mesh.display()
        )));
    }
    if args.cell.is_some() && !is_surface_file(&args.mesh) {
        let message = "--cell fills a surface; a mesh of tetrahedra is taken as it is";
        return Err(Failure::wrong(format!("{}: {message}", args.mesh.display())));
    }
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
    let poses = args.pull.map(|by_m| (by_m, poses_path(&path)));
    if let Some((_, poses)) = &poses {
        if poses.exists() && !args.force {
            return Err(Failure::wrong(format!(
                "{}: already exists; overwrite it with --force",
                poses.display()
            )));
        }
        output::try_path(poses, &POSES, &files_of(&args.mesh))?;
    }
    let lists =
        |of: fn(&EffectEntry) -> bool| args.effects.iter().filter_map(|name| find_effect(name).ok()).any(of);
    let (is_touched, is_cut) = (lists(|effect| effect.presses_points), lists(|effect| effect.is_cut));
    let wishes = Wishes {
        is_touched,
        is_cut,
        effects: args.effects.clone(),
        pull_m: args.pull,
        scale: args.metres_per_unit,
        model: args.model.clone(),
        stage: args.stage.clone(),
        fixed: args.fixed.clone(),
        grab: args.grab.clone(),
        cell: args.cell,
        ..args.guess.wishes()
    };
    let mut proposal = opening::propose(&args.mesh, &path, wishes)?;
    refuse_unsuited(&mut proposal, args)?;
    let stage = open::stage(&proposal.scene, args.stage.as_deref())?;
    if is_touched || is_cut {
        proposal.add_tools(is_cut, is_touched, 2.0 * stage.workspace.radius_m);
    }
    let text = proposal.text()?;
    let mut staged = vec![output::stage(&path, &SCENE, |file| file.write_all(text.as_bytes()))?];
    if let Some((by_m, poses)) = &poses {
        let text = pull::poses(&proposal.scene, &proposal.mesh, *by_m)?;
        staged.push(output::stage(poses, &POSES, |file| file.write_all(text.as_bytes()))?);
    }
    output::put_all(staged, &[])?;
    print(&told(&proposal, &path, args.pull))
}

/// Refuses a model that was asked for and cannot show this body; a body that it shows badly is told so.
fn refuse_unsuited(proposal: &mut Proposal, args: &Args) -> Result<(), Failure> {
    let asked = args.model.as_ref().and_then(|name| find_model(name).ok());
    let Some(fits) = asked.and_then(|model| model.fits) else { return Ok(()) };
    let loaded = LoadedMesh { mesh: proposal.mesh.clone(), notices: Vec::new() };
    let prepared = green::prepare_mesh(&proposal.scene, &proposal.body, loaded)?;
    match fits(&prepared) {
        Err((Severity::Error, why)) => Err(Failure::wrong(format!(
            "{}: {why}; without --model, `greenstage new` takes one that suits",
            args.mesh.display()
        ))),
        Err((_, why)) => {
            proposal.warnings.push(why);
            Ok(())
        }
        Ok(()) => Ok(()),
    }
}

fn told(proposal: &Proposal, path: &Path, pull_m: Option<f64>) -> String {
    let named = quoted(&path.display().to_string());
    let reasons: String = proposal.reasons.iter().map(|reason| format!("  {reason}\n")).collect();
    let mut warnings: String = proposal.warnings.iter().map(|warning| format!("note: {warning}\n")).collect();
    if let Some(by_m) = pull_m.filter(|by_m| pull::is_much(&proposal.mesh, *by_m)) {
        let by = length(by_m);
        warnings +=
            &format!("note: {by} is more than a quarter of the body: the models do not tell when it tears\n");
    }
    let by_m = pull_m.unwrap_or_else(|| pull::usual_m(&proposal.mesh));
    let force = match pull_m {
        Some(_) => pull::command(path),
        // The same again, with the question.
        None => {
            let same = std::env::args().skip(1).filter(|word| word != "--force").map(|word| quoted(&word));
            let by = length(by_m).replace(' ', "");
            format!("greenstage {} --pull {by} --force", same.collect::<Vec<_>>().join(" "))
        }
    };
    let next = [
        (force, &*format!("how much force for {}, and what stress", length(by_m))),
        (format!("greenstage view {named}"), "solves it once, then you bend it"),
        (format!("greenstage check {named}"), "what can be found wrong, without solving"),
        ("an editor".to_owned(), "every line of the scene has its reason beside it"),
    ];
    let next: String = next.iter().map(|(command, what)| format!("  {command}\n      {what}\n")).collect();
    format!("{}: written\n{reasons}{warnings}\nNext:\n{next}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::{EFFECTS, Resolved};
    use crate::mesh::{Block, block, save};
    use crate::scene::proposal::choice::{ERRORS, FORCES};
    use clap::Parser;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn the_effects_that_a_pull_lists_are_there() {
        for name in FORCES.into_iter().chain([ERRORS]) {
            assert_eq!(parsers::effect(name).as_deref(), Ok(name));
        }
    }

    /// A scene that `precompute` would refuse is not written.
    #[test]
    fn a_model_that_does_not_suit_the_body_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for (thickness, is_plate) in [(0.1, false), (0.005, true)] {
            let mesh = folder.path().join(format!("{thickness}.msh"));
            let size = [0.3, 0.2, thickness];
            save(&mesh, &block(&Block { size, cells: [6, 4, 1] }).unwrap(), None).unwrap();
            let line = Line::parse_from(["new", mesh.to_str().unwrap(), "--model", "plate"]);
            let found = run(&line.args);
            assert_eq!(found.is_ok(), is_plate, "{found:?}");
            assert_eq!(mesh.with_extension("toml").exists(), is_plate);
            if let Err(why) = found {
                let why = why.to_string();
                assert!(why.contains("m thick") && why.contains("without --model"), "{why}");
            }
        }
    }

    /// `check` accepts what was proposed, with the tools that touch and cut.
    #[test]
    fn a_scene_with_effects_can_be_shown() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = folder.path().join("bar.msh");
        let bar = Block { size: [0.3, 0.1, 0.1], cells: [6, 2, 2] };
        save(&mesh, &block(&bar).unwrap(), None).unwrap();
        let alone = EFFECTS.iter().filter(|effect| !effect.is_heard).map(|effect| effect.name);
        for effects in alone.chain(["contact,cut,haptics,sound", "contact,dynamics,haptics,sound"]) {
            let mesh = mesh.to_str().unwrap();
            let line =
                Line::parse_from(["new", mesh, "--force", "--effects", effects, "--material", "steel"]);
            run(&line.args).unwrap();
            let scene = Resolved::load(Path::new(mesh).with_extension("toml").as_path());
            let scene = scene.unwrap_or_else(|error| panic!("{effects}: {error}"));
            let required = scene.bodies["bar"].requirements(&scene, "bar", &scene.body["bar"]);
            assert!(required.is_ok(), "{effects}: {}", required.unwrap_err());
            let styli: Vec<_> =
                scene.tool.values().map(|tool| (tool.shape.is_blade(), tool.stylus)).collect();
            let asked = [(effects.contains("cut"), true), (effects.contains("contact"), false)];
            let asked = asked.into_iter().filter(|(is_asked, _)| *is_asked).zip(1..);
            let asked: Vec<_> = asked.map(|((_, is_blade), stylus)| (is_blade, Some(stylus))).collect();
            assert_eq!(styli, asked, "{effects}");
        }
    }
}
