//! The command line: one file per subcommand, each with its arguments and one run function, and the helpers that they
//! share.
//!
//! The exit status is 0 if all is done, 1 if the work failed, and 2 if the request or its files are wrong. Results go to
//! standard output, notices and progress to standard error.

mod accuracy;
mod bench;
mod bench_snapshot;
mod check;
mod check_stage;
mod completions;
mod convert;
mod deform;
mod demo;
mod expected;
mod export;
mod inspect;
mod manual;
mod marks;
mod new;
mod opening;
mod pack;
mod parsers;
mod pattern;
mod pattern_sound;
mod precompute;
mod print;
mod render;
mod scale;
mod serve;
mod session_args;
mod sizes;
mod stage_view;
mod track;
mod verify;
mod view;

use crate::base::diagnostic;
use crate::base::failure::Failure;
use crate::base::machine::{self, ThreadsError};
use clap::{CommandFactory, Parser, Subcommand};
use opening::Guess;
use session_args::SessionArgs;
use std::path::PathBuf;

const AFTER_HELP: &str = "\
A first tour: `greenstage` plays the demo; `greenstage new part.msh` makes a scene of your mesh, `greenstage
view part.toml` bends it. `greenstage manual start` goes on from there.
Exit status: 0 done; 1 the work failed; 2 the request or its files are wrong.";

/// Grab, bend and twist elastic finite element bodies in stereo, by precomputed Green's functions.
#[derive(Debug, Parser)]
#[command(version, about, help_template = help_template(), after_help = AFTER_HELP, max_term_width = 110)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Print details too: figures and explanations that the usual output leaves out
    #[arg(long, global = true)]
    pub verbose: bool,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    New(new::Args),
    Demo(demo::Args),
    Precompute(precompute::Args),
    View(view::Args),
    Render(render::Args),
    Deform(deform::Args),
    Export(export::Args),
    Bench(bench::Args),
    Accuracy(accuracy::Args),
    Scale(scale::Args),
    Inspect(inspect::Args),
    Check(check::Args),
    Convert(convert::Args),
    Pack(pack::Args),
    Pattern(pattern::Args),
    StageView(stage_view::Args),
    Track(track::Args),
    Verify(verify::Args),
    Manual(manual::Args),
    Completions(completions::Args),
    Man(completions::ManArgs),
}

/// The subcommands as `--help` lists them. Each stands in one group.
const GROUPS: [(&str, &[&str]); 5] = [
    ("Use", &["demo", "view", "render", "deform", "export"]),
    ("Make", &["new", "check", "inspect", "convert", "precompute", "pack"]),
    ("Stage", &["stage-view", "pattern", "track"]),
    ("Measure", &["bench", "accuracy", "scale", "verify"]),
    ("Help", &["manual", "man", "completions"]),
];

/// The help with the subcommands in groups, for which clap has nothing.
fn help_template() -> String {
    let commands = Command::augment_subcommands(clap::Command::new("greenstage"));
    let heading = *clap::builder::Styles::styled().get_header();
    let mut groups = String::new();
    for (group, names) in GROUPS {
        groups += &format!("{heading}{group}:{heading:#}\n");
        for command in names.iter().filter_map(|name| commands.find_subcommand(name)) {
            let about = command.get_about().map(ToString::to_string).unwrap_or_default();
            groups += &format!("  {:<13}{about}\n", command.get_name());
        }
    }
    format!(
        "{{about-with-newline}}{{usage-heading}} {{usage}}\n\n{groups}{heading}Options:{heading:#}\n{{options}}{{after-help}}"
    )
}

impl Command {
    /// Whether frames are drawn one after the other in the thread that runs it.
    fn draws_frames(&self) -> bool {
        matches!(self, Command::View(_) | Command::Render(_) | Command::Bench(_) | Command::Demo(_))
    }

    /// The file that it opens as a scene, and what is known of it should it be a mesh or a surface.
    fn opens(&mut self) -> Option<(&mut PathBuf, &Guess)> {
        match self {
            Command::View(view::Args { session: SessionArgs { scene, guess, .. }, .. })
            | Command::Render(render::Args { session: SessionArgs { scene, guess, .. }, .. })
            | Command::Precompute(precompute::Args { scene, guess, .. })
            | Command::Accuracy(accuracy::Args { scene, guess, .. })
            | Command::Check(check::Args { scene, guess, .. })
            | Command::Bench(bench::Args { scene: Some(scene), guess, .. }) => Some((scene, guess)),
            _ => None,
        }
    }
}

/// Runs the command that was asked for; without one, the demo. For a mesh or a surface file a scene is written first, so that
/// commands know only scenes.
pub fn run(mut cli: Cli) -> Result<(), Failure> {
    if cli.verbose {
        diagnostic::show_details();
    }
    machine::start_threads().map_err(|error| match error {
        ThreadsError::TooMany { .. } => Failure::request(error),
        ThreadsError::Start { .. } => Failure::work(error),
    })?;
    if cli.command.as_ref().is_none_or(Command::draws_frames) {
        machine::work_along();
    }
    if let Some((file, guess)) = cli.command.as_mut().and_then(Command::opens) {
        *file = opening::scene_path(file, guess)?;
    }
    match cli.command {
        Some(Command::New(args)) => new::run(&args),
        Some(Command::Demo(args)) => demo::run(&args),
        Some(Command::Precompute(args)) => precompute::run(&args),
        Some(Command::View(args)) => view::run(&args),
        Some(Command::Render(args)) => render::run(&args),
        Some(Command::Deform(args)) => deform::run(&args),
        Some(Command::Export(args)) => export::run(&args),
        Some(Command::Bench(args)) => bench::run(&args),
        Some(Command::Accuracy(args)) => accuracy::run(&args),
        Some(Command::Scale(args)) => scale::run(&args),
        Some(Command::Inspect(args)) => inspect::run(&args),
        Some(Command::Check(args)) => check::run(&args),
        Some(Command::Convert(args)) => convert::run(&args),
        Some(Command::Pack(args)) => pack::run(&args),
        Some(Command::Pattern(args)) => pattern::run(&args),
        Some(Command::StageView(args)) => stage_view::run(&args),
        Some(Command::Track(args)) => track::run(&args),
        Some(Command::Verify(args)) => verify::run(&args),
        Some(Command::Manual(args)) => manual::run(&args),
        Some(Command::Completions(args)) => completions::run(&args, Cli::command()),
        Some(Command::Man(args)) => completions::run_man(&args, Cli::command()),
        None => demo::run(&demo::Args::default()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_are_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_subcommand_stands_in_one_group_of_the_help() {
        let mut grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        let command = Cli::command();
        let mut known: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
        grouped.sort_unstable();
        known.sort_unstable();
        assert_eq!(grouped, known);
        let help = Cli::command().render_long_help().to_string();
        for (group, names) in GROUPS {
            assert!(help.contains(&format!("{group}:\n  {} ", names[0])), "{help}");
        }
        for name in known {
            assert_eq!(
                help.lines().filter(|line| line.starts_with(&format!("  {name} "))).count(),
                1,
                "{name}: {help}"
            );
        }
        assert!(help.contains("--version") && help.contains("Exit status:"), "{help}");
    }
}
