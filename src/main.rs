//! The binary: parse the command line, dispatch, print the error chain.

use clap::Parser;
use std::io::IsTerminal;
use std::process::ExitCode;

fn main() -> ExitCode {
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .with_env_filter(
            tracing_subscriber::EnvFilter::try_from_env("GREENSTAGE_LOG")
                .unwrap_or_else(|_| greenstage::render::LOGGED.into()),
        )
        .without_time()
        .init();
    match greenstage::cli::run(greenstage::cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::from(failure.status())
        }
    }
}
