//! The binary: parse the command line, dispatch, print the error chain.

use clap::Parser;
use greenstage::base::{memory, notice, signal};
use std::io::IsTerminal;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: memory::Watched = memory::Watched;

fn main() -> ExitCode {
    memory::end_in_order();
    if let Err(error) = signal::watch() {
        notice::say(format_args!("note: Ctrl-C ends this program where it stands ({error})"));
    }
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("GREENSTAGE_LOG")
                .unwrap_or_else(|_| greenstage::render::LOGGED.into()),
        )
        .without_time()
        .log_internal_errors(false)
        .init();
    match greenstage::cli::run(greenstage::cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            notice::say(format_args!("error: {failure}"));
            ExitCode::from(failure.status())
        }
    }
}
