//! `greenstage completions` and `greenstage man`: what a shell and `man` know of the command line.

use super::print::print;
use crate::base::failure::Failure;
use crate::base::output;
use clap_complete::Shell;
use std::path::PathBuf;

/// Print a script that completes greenstage's commands and options in a shell
///
/// bash:  greenstage completions bash > ~/.local/share/bash-completion/completions/greenstage
/// zsh:   greenstage completions zsh > ~/.zfunc/_greenstage   (with fpath+=~/.zfunc in ~/.zshrc)
/// fish:  greenstage completions fish > ~/.config/fish/completions/greenstage.fish
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Args {
    pub shell: Shell,
}

/// Write the man pages of greenstage and of each of its commands
#[derive(Debug, clap::Args)]
pub struct ManArgs {
    /// Folder for the pages; overwrites those that are there
    #[arg(short, long)]
    pub output: PathBuf,
}

pub fn run(args: &Args, mut command: clap::Command) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "greenstage", &mut script);
    print(&String::from_utf8_lossy(&script))
}

pub fn run_man(args: &ManArgs, command: clap::Command) -> Result<(), Failure> {
    output::make_folder(&args.output)?;
    clap_mangen::generate_to(command.disable_help_subcommand(true), &args.output).map_err(Failure::work)
}
