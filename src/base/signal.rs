//! Answers requests to end the program (Ctrl-C, SIGTERM, SIGHUP): first it cleans up what must not be left behind, then the
//! program ends as the signal would have ended it.
//!
//! In: clean-up functions, registered by code that would leave something behind, such as a half-written
//! file. One thread waits for the signals, and all others block them. No signal handler ever runs, so neither does the one
//! that METIS installs for SIGTERM while it orders; that one would jump out of whatever a thread was doing.

use libc::{SIG_BLOCK, SIG_IGN, SIG_UNBLOCK, SIGHUP, SIGINT, SIGTERM, c_int, sigset_t};
use std::mem::MaybeUninit;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::{io, ptr};

const ENDING: [(c_int, &str); 3] = [(SIGINT, "SIGINT"), (SIGTERM, "SIGTERM"), (SIGHUP, "SIGHUP")];

type Act = Box<dyn FnOnce() -> Option<String> + Send>;

/// The clean-up functions with the numbers of their [`OnEnd`], and the next number.
static ACTS: Mutex<(u64, Vec<(u64, Act)>)> = Mutex::new((0, Vec::new()));

fn acts() -> MutexGuard<'static, (u64, Vec<(u64, Act)>)> {
    ACTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A clean-up function that runs if a signal ends the program; dropping this unregisters it.
#[derive(Debug)]
#[must_use = "dropping it takes the act back"]
pub struct OnEnd {
    number: u64,
}

/// Registers a clean-up function that runs before a signal ends the program. The newest runs first, one after the other, and
/// meanwhile none can be registered or unregistered. The sentence that it returns is written to standard error. It must
/// return soon.
pub fn on_end(act: impl FnOnce() -> Option<String> + Send + 'static) -> OnEnd {
    let mut acts = acts();
    let number = acts.0;
    acts.0 += 1;
    acts.1.push((number, Box::new(act)));
    OnEnd { number }
}

impl OnEnd {
    /// Keeps the function registered for as long as the program runs.
    pub fn keep(self) {
        std::mem::forget(self);
    }
}

/// Runs `last`, after which these functions are no longer needed, and unregisters them; a signal meanwhile waits.
pub fn settle<T>(all: Vec<OnEnd>, last: impl FnOnce() -> T) -> T {
    let mut acts = acts();
    let result = last();
    acts.1.retain(|(number, _)| all.iter().all(|settled| settled.number != *number));
    drop(acts);
    all.into_iter().for_each(OnEnd::keep);
    result
}

impl Drop for OnEnd {
    fn drop(&mut self) {
        acts().1.retain(|(number, _)| *number != self.number);
    }
}

/// Blocks the signals in this thread and in all that it starts from now on, and starts the thread that waits for them. Call it
/// before there are other threads. A signal that is ignored, as under `nohup`, stays ignored.
///
/// A second signal ends the program at once. A file that grows beyond its limit (`ulimit -f`) is an error for the code
/// that writes it, as a full disk is, and no signal.
pub fn watch() -> io::Result<()> {
    // SAFETY: takes numbers alone, and sets no handler.
    unsafe { libc::signal(libc::SIGXFSZ, SIG_IGN) };
    let set = set(|signal| !is_ignored(signal));
    change_mask(SIG_BLOCK, &set)?;
    let started = std::thread::Builder::new().name("signals".into()).spawn(move || wait(&set));
    if let Err(error) = started {
        change_mask(SIG_UNBLOCK, &set)?;
        return Err(error);
    }
    Ok(())
}

/// Blocks the signals in this thread alone.
pub fn block() -> io::Result<()> {
    change_mask(SIG_BLOCK, &set(|_| true))
}

fn wait(set: &sigset_t) {
    let Some(first) = next(set) else { return };
    let settle = move || {
        let told: Vec<String> =
            std::mem::take(&mut acts().1).into_iter().rev().filter_map(|(_, act)| act()).collect();
        let name = ENDING.iter().find(|(signal, _)| *signal == first).map_or("a signal", |(_, name)| name);
        let what = if told.is_empty() { String::new() } else { format!(": {}", told.join("; ")) };
        super::diagnostic::say(format_args!("interrupted by {name}{what}"));
        end_by(first);
    };
    if std::thread::Builder::new().name("end".into()).spawn(settle).is_ok()
        && let Some(again) = next(set)
    {
        end_by(again);
    }
    end_by(first);
}

/// Ends the program as the signal ends one without a handler.
fn end_by(signal: c_int) {
    // Cannot fail for these signals; it ends the program in any case.
    let _ = signal_hook::low_level::emulate_default_handler(signal);
}

fn set(is_in: impl Fn(c_int) -> bool) -> sigset_t {
    let mut set = MaybeUninit::uninit();
    // SAFETY: sigemptyset writes the whole set, and sigaddset changes a set that was written.
    unsafe {
        libc::sigemptyset(set.as_mut_ptr());
        for (signal, _) in ENDING.into_iter().filter(|(signal, _)| is_in(*signal)) {
            libc::sigaddset(set.as_mut_ptr(), signal);
        }
        set.assume_init()
    }
}

fn is_ignored(signal: c_int) -> bool {
    let mut action = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: with no new action the call only writes the present one; zeroes are a sigaction too.
    unsafe {
        libc::sigaction(signal, ptr::null(), action.as_mut_ptr()) == 0
            && action.assume_init().sa_sigaction == SIG_IGN
    }
}

fn change_mask(how: c_int, set: &sigset_t) -> io::Result<()> {
    // SAFETY: `set` is a signal set, and the old mask is not asked for.
    match unsafe { libc::pthread_sigmask(how, set, ptr::null_mut()) } {
        0 => Ok(()),
        error => Err(io::Error::from_raw_os_error(error)),
    }
}

/// The next of the signals; `None` where waiting is not possible.
fn next(set: &sigset_t) -> Option<c_int> {
    let mut signal = 0;
    // SAFETY: both point to what the call reads and writes.
    let failed = unsafe { libc::sigwait(set, &mut signal) };
    (failed == 0).then_some(signal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_act_is_there_until_it_is_taken_back() {
        let registered = |number: u64| acts().1.iter().any(|(known, _)| *known == number);
        let act = on_end(|| None);
        let number = act.number;
        assert!(registered(number));
        drop(act);
        assert!(!registered(number));
        let act = on_end(|| None);
        let number = act.number;
        assert_eq!(settle(vec![act], || 7), 7);
        assert!(!registered(number));
    }
}
