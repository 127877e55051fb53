//! The binary: parse the command line, dispatch, print the error chain.

use clap::Parser;
use greenstage::base::{diagnostic, fault, guard, memory, signal};
use std::io::IsTerminal;
use std::process::ExitCode;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

#[global_allocator]
static ALLOCATOR: memory::Allocator = memory::Allocator;

/// Stack of the working thread and of the threads that libraries start, bytes. The main thread has the stack that the shell
/// allows (`ulimit -s`).
const STACK: usize = 8 << 20;

fn main() -> ExitCode {
    if let Some(status) = guard::run_if_asked() {
        return status;
    }
    quieten_mesa();
    give_libraries_a_stack();
    memory::end_in_order();
    fault::end_by_what_is_sent();
    if let Err(error) = signal::watch() {
        diagnostic::say(format_args!("note: Ctrl-C ends this program where it stands ({error})"));
    }
    match std::thread::Builder::new().name("work".into()).stack_size(STACK).spawn(work) {
        // A thread that panicked has printed its message.
        Ok(worker) => worker.join().unwrap_or(ExitCode::from(101)),
        // No thread can be started: the main thread works, on its own stack.
        Err(_) => work(),
    }
}

fn work() -> ExitCode {
    let text = std::env::var("GREENSTAGE_LOG").unwrap_or_else(|_| greenstage::render::LOGGED.to_owned());
    let filter: Targets = match text.parse() {
        Ok(filter) => filter,
        Err(error) => {
            diagnostic::say(format_args!(
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
            diagnostic::say(format_args!("error: {failure}"));
            ExitCode::from(failure.status())
        }
    }
}

/// Gives threads that libraries start a stack of [`STACK`] bytes. Otherwise they have the size that the shell allows the
/// main thread, and where it is small, Mesa's drivers overflow it.
fn give_libraries_a_stack() {
    #[cfg(target_env = "gnu")]
    {
        use std::mem::MaybeUninit;
        unsafe extern "C" {
            fn pthread_setattr_default_np(attributes: *const libc::pthread_attr_t) -> libc::c_int;
        }
        let mut attributes = MaybeUninit::<libc::pthread_attr_t>::uninit();
        // SAFETY: the first call fills the attributes, which outlive the others; glibc has the last one since 2.18.
        unsafe {
            if libc::pthread_attr_init(attributes.as_mut_ptr()) == 0 {
                libc::pthread_attr_setstacksize(attributes.as_mut_ptr(), STACK);
                pthread_setattr_default_np(attributes.as_ptr());
                libc::pthread_attr_destroy(attributes.as_mut_ptr());
            }
        }
    }
}

/// Sets `XDG_RUNTIME_DIR` where no desktop session has set it: without it Mesa's drivers print an error, and then work all
/// the same.
fn quieten_mesa() {
    const NAME: &str = "XDG_RUNTIME_DIR";
    if std::env::var_os(NAME).is_none() {
        // SAFETY: no other thread runs yet that could read the environment.
        unsafe { std::env::set_var(NAME, std::env::temp_dir()) };
    }
}
