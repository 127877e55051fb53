//! Faults of memory (SIGSEGV, SIGBUS), and the same signals as another process sends them.
//!
//! Rust's own handler reports a stack overflow, and returns from any other fault so that the instruction faults again
//! without a handler. After a signal that a watchdog sent, nothing faults again, and the program would go on. This handler
//! sends such a signal once more, so that it ends the program as usual, and leaves faults to Rust's handler.

use libc::{SIGBUS, SIGSEGV, c_int, c_void, siginfo_t};
use std::ptr::null_mut;
use std::sync::OnceLock;

const FAULTS: [c_int; 2] = [SIGSEGV, SIGBUS];

/// Rust's own actions for [`FAULTS`].
static BEFORE: OnceLock<[libc::sigaction; FAULTS.len()]> = OnceLock::new();

/// Makes such a signal end the program wherever it comes from.
pub fn end_by_what_is_sent() {
    // SAFETY: all zeros is a value of this struct: no handler, no flags, no mask.
    let nothing: libc::sigaction = unsafe { std::mem::zeroed() };
    let before = FAULTS.map(|signal| {
        let mut before = nothing;
        // SAFETY: the call only reads the action; `before` outlives it.
        unsafe { libc::sigaction(signal, std::ptr::null(), &raw mut before) };
        before
    });
    BEFORE.get_or_init(|| before);
    let mut action = nothing;
    let handler: extern "C" fn(c_int, *mut siginfo_t, *mut c_void) = answer;
    action.sa_sigaction = handler as *const () as usize;
    // Where a stack has overflowed, the thread's other one is there.
    action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
    for signal in FAULTS {
        // SAFETY: `action` outlives the call, and the handler calls only what POSIX allows in one.
        unsafe { libc::sigaction(signal, &raw const action, null_mut()) };
    }
}

extern "C" fn answer(signal: c_int, info: *mut siginfo_t, _: *mut c_void) {
    // SAFETY: the system hands a handler with SA_SIGINFO a valid pointer.
    let is_fault = unsafe { (*info).si_code } > 0;
    let at = FAULTS.iter().position(|fault| *fault == signal);
    match at.and_then(|at| BEFORE.get().map(|before| before[at])).filter(|_| is_fault) {
        // The instruction faults again, and Rust's handler takes it.
        // SAFETY: `before` is what the system gave, and outlives the call.
        Some(before) => unsafe { _ = libc::sigaction(signal, &raw const before, null_mut()) },
        None => send_again(signal),
    }
}

/// Ends the program by a signal as it ends one without a handler; for handlers.
pub(super) fn send_again(signal: c_int) {
    // SAFETY: takes numbers alone; raised within its handler, the signal comes when that has ended.
    unsafe {
        libc::signal(signal, libc::SIG_DFL);
        libc::raise(signal);
    }
}
