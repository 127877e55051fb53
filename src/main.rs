//! The binary: parse the command line, dispatch, print the error chain.

use clap::Parser;
use greenstage::base::{fault, guard, memory, notice, signal};
use std::io::IsTerminal;
use std::process::ExitCode;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

#[global_allocator]
static ALLOCATOR: memory::Watched = memory::Watched;

fn main() -> ExitCode {
    if let Some(status) = guard::run_if_asked() {
        return status;
    }
    quieten_mesa();
    memory::end_in_order();
    fault::end_by_what_is_sent();
    if let Err(error) = signal::watch() {
        notice::say(format_args!("note: Ctrl-C ends this program where it stands ({error})"));
    }
    let text = std::env::var("GREENSTAGE_LOG").unwrap_or_else(|_| greenstage::render::LOGGED.to_owned());
    let filter: Targets = match text.parse() {
        Ok(filter) => filter,
        Err(error) => {
            notice::say(format_args!(
                "error: GREENSTAGE_LOG is \"{text}\" ({error}); write for example info, or warn,greenstage=debug"
            ));
            return ExitCode::from(2);
        }
    };
    let layer = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .log_internal_errors(false);
    tracing_subscriber::registry().with(filter).with(layer).init();
    match greenstage::cli::run(greenstage::cli::Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            notice::say(format_args!("error: {failure}"));
            ExitCode::from(failure.status())
        }
    }
}

/// Mesa's drivers write an error wherever no desktop session has named this folder, and then work all the same.
fn quieten_mesa() {
    const NAME: &str = "XDG_RUNTIME_DIR";
    if std::env::var_os(NAME).is_none() {
        // SAFETY: no other thread runs yet that could read the environment.
        unsafe { std::env::set_var(NAME, std::env::temp_dir()) };
    }
}
