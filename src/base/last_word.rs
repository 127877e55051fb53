//! The last message on a connection: what its peer is told if the program dies, prepared beforehand.
//!
//! In: a connection and the message that leaves its peer safe, as bytes. Out: nothing, until a signal that nobody asked for
//! (a fault, an abort, a limit) ends the program, or [`speak`] is called. Then every message is sent and its connection closed
//! for sending, so that no running thread can send anything after it. All other sending goes through [`LastWord::before`], so
//! that a last message never interrupts it. The handler calls only functions that POSIX lists as async-signal-safe. SIGKILL
//! and a power cut end the program without a last message.

use libc::{c_int, c_void, siginfo_t};
use std::io::{Error, Result};
use std::net::TcpStream;
use std::os::fd::AsRawFd;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU8, AtomicUsize, Ordering::Relaxed, Ordering::SeqCst};
use std::sync::{Once, OnceLock};

/// The longest message, bytes.
const LONGEST: usize = 512;
/// At most so many connections have a last message at once.
const MOST: usize = 16;
/// Stands for no socket.
const FREE: i32 = -1;
const TAKEN: i32 = -2;
/// How long the process waits for its peers to read before it ends, ms, however much they still say.
const LINGER_MS: i64 = 200;
const ROUND_MS: c_int = 5;
/// How long another thread has to finish what it is sending, ms. It may be the thread that died.
const SENDING_MS: usize = 20;

/// Signals that end a process unless they are caught. [`super::signal`] answers the requests to end (SIGTERM, SIGINT, SIGHUP).
const FATAL: [c_int; 15] = [
    libc::SIGABRT,
    libc::SIGBUS,
    libc::SIGFPE,
    libc::SIGILL,
    libc::SIGSEGV,
    libc::SIGSYS,
    libc::SIGTRAP,
    libc::SIGQUIT,
    libc::SIGXCPU,
    libc::SIGXFSZ,
    libc::SIGALRM,
    libc::SIGVTALRM,
    libc::SIGPROF,
    libc::SIGUSR1,
    libc::SIGUSR2,
];

/// Signals that would stop the process without its peers being told: Ctrl-Z, and a terminal that it may not use.
const STOPPING: [c_int; 3] = [libc::SIGTSTP, libc::SIGTTIN, libc::SIGTTOU];

struct Slot {
    socket: AtomicI32,
    /// Its connection is being written to.
    is_sending: AtomicBool,
    length: AtomicUsize,
    bytes: [AtomicU8; LONGEST],
}

static SLOTS: [Slot; MOST] = [const {
    Slot {
        socket: AtomicI32::new(FREE),
        is_sending: AtomicBool::new(false),
        length: AtomicUsize::new(0),
        bytes: [const { AtomicU8::new(0) }; LONGEST],
    }
}; MOST];

/// The slots are being read for the last time: no socket of theirs is closed any more, lest its number be another's.
static SPEAKING: AtomicBool = AtomicBool::new(false);

/// The previous action for each signal of [`FATAL`].
static BEFORE: OnceLock<[libc::sigaction; FATAL.len()]> = OnceLock::new();

/// A connection's last message. Dropping it discards the message, except in a panic, which sends it.
pub struct LastWord {
    slot: &'static Slot,
    /// Its own handle of the socket: the number stays this connection's.
    socket: Option<TcpStream>,
}

impl LastWord {
    /// Prepares `bytes` to be the last that `stream` sends.
    ///
    /// # Errors
    /// More than 512 bytes, or more than 16 connections; no handle left for the socket.
    pub fn new(stream: &TcpStream, bytes: &[u8]) -> Result<LastWord> {
        if bytes.len() > LONGEST {
            return Err(Error::other(format!("a last word of {} bytes: at most {LONGEST}", bytes.len())));
        }
        catch_fatal_signals();
        let socket = stream.try_clone()?;
        let take = |slot: &&Slot| slot.socket.compare_exchange(FREE, TAKEN, SeqCst, SeqCst).is_ok();
        let slot = SLOTS
            .iter()
            .find(take)
            .ok_or_else(|| Error::other(format!("more than {MOST} connections with a last word")))?;
        slot.bytes.iter().zip(bytes).for_each(|(kept, byte)| kept.store(*byte, Relaxed));
        slot.length.store(bytes.len(), Relaxed);
        slot.socket.store(socket.as_raw_fd(), SeqCst);
        Ok(LastWord { slot, socket: Some(socket) })
    }

    /// Does `send`, which writes to the connection, and which no last word interrupts; `None` once that was said. One thread
    /// at a time.
    pub fn before<T>(&self, send: impl FnOnce() -> T) -> Option<T> {
        struct Sending(&'static AtomicBool);
        impl Drop for Sending {
            fn drop(&mut self) {
                self.0.store(false, SeqCst);
            }
        }
        self.slot.is_sending.store(true, SeqCst);
        let _sending = Sending(&self.slot.is_sending);
        (!SPEAKING.load(SeqCst)).then(send)
    }
}

impl Drop for LastWord {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.slot.speak();
        }
        self.slot.socket.store(FREE, SeqCst);
        if SPEAKING.load(SeqCst) {
            std::mem::forget(self.socket.take());
        }
    }
}

/// Sends every last message now, and gives the peers a moment to read it; for an end that does not wait for the threads.
pub fn speak() {
    SPEAKING.store(true, SeqCst);
    SLOTS.iter().for_each(Slot::speak);
    let end = now_ms() + LINGER_MS;
    SLOTS.iter().for_each(|slot| slot.linger(end));
}

impl Slot {
    /// Sends the message, when what is being sent now is out, and closes the connection for sending.
    fn speak(&self) {
        let socket = self.socket.load(SeqCst);
        if socket < 0 {
            return;
        }
        for _ in 0..SENDING_MS {
            if !self.is_sending.load(SeqCst) {
                break;
            }
            // SAFETY: no entries: it only waits.
            unsafe { libc::poll(null_mut(), 0, 1) };
        }
        let mut bytes = [0; LONGEST];
        self.bytes.iter().zip(&mut bytes).for_each(|(kept, byte)| *byte = kept.load(Relaxed));
        let length = self.length.load(Relaxed).min(LONGEST);
        let flags = libc::MSG_NOSIGNAL | libc::MSG_DONTWAIT;
        // SAFETY: `bytes` outlives the call and is `length` long at least. Its result does not matter: nothing can be done.
        unsafe { libc::send(socket, bytes.as_ptr().cast::<c_void>(), length, flags) };
        // SAFETY: takes numbers alone.
        unsafe { libc::shutdown(socket, libc::SHUT_WR) };
    }

    /// Waits until the peer has closed its side too, or until `end`, reading what it still says, once at least: a connection
    /// that is closed with bytes unread is reset, and a reset may overtake the message.
    fn linger(&self, end: i64) {
        let socket = self.socket.load(SeqCst);
        if socket < 0 {
            return;
        }
        let mut bytes = [0_u8; 1024];
        let mut is_over = false;
        while !is_over {
            is_over = now_ms() >= end;
            let mut asked = libc::pollfd { fd: socket, events: libc::POLLIN, revents: 0 };
            // SAFETY: one entry, which outlives the call.
            if unsafe { libc::poll(&raw mut asked, 1, ROUND_MS) } <= 0 {
                continue;
            }
            // SAFETY: `bytes` outlives the call and has the length that is said.
            let read = unsafe {
                libc::recv(socket, bytes.as_mut_ptr().cast::<c_void>(), bytes.len(), libc::MSG_DONTWAIT)
            };
            // Closed, or broken.
            if read <= 0 {
                return;
            }
        }
    }
}

/// A clock that POSIX lets a handler read.
fn now_ms() -> i64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `now` outlives the call.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut now) };
    1000 * now.tv_sec + now.tv_nsec / 1_000_000
}

/// From the first call on, signals that would end the process at once first send the last messages, and those that would
/// stop it are ignored.
fn catch_fatal_signals() {
    static CAUGHT: Once = Once::new();
    CAUGHT.call_once(|| {
        // SAFETY: all zeros is a value of this struct: no handler, no flags, no mask.
        let nothing: libc::sigaction = unsafe { std::mem::zeroed() };
        let before = FATAL.map(|signal| {
            let mut before = nothing;
            // SAFETY: asks alone; `before` outlives the call.
            unsafe { libc::sigaction(signal, std::ptr::null(), &raw mut before) };
            before
        });
        let before = BEFORE.get_or_init(|| before);
        let mut action = nothing;
        let handler: extern "C" fn(c_int, *mut siginfo_t, *mut c_void) = die;
        action.sa_sigaction = handler as *const () as usize;
        // Where a stack has overflowed, the thread's other one is there.
        action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
        // SAFETY: `action` outlives the call.
        unsafe { libc::sigfillset(&raw mut action.sa_mask) };
        for (signal, before) in FATAL.into_iter().zip(before) {
            // What is ignored does not end the process.
            if before.sa_sigaction != libc::SIG_IGN {
                // SAFETY: the handler keeps to what may be called in one.
                unsafe { libc::sigaction(signal, &raw const action, null_mut()) };
            }
        }
        for signal in STOPPING {
            // SAFETY: takes numbers alone, and sets no handler.
            unsafe { libc::signal(signal, libc::SIG_IGN) };
        }
    });
}

/// Sends the last messages, and then lets the signal do what it would have done without this handler.
extern "C" fn die(signal: c_int, info: *mut siginfo_t, _: *mut c_void) {
    speak();
    if signal == libc::SIGABRT {
        super::memory::conclude();
    }
    let at = FATAL.iter().position(|fatal| *fatal == signal);
    let before = at.and_then(|at| BEFORE.get().map(|before| before[at]));
    // SAFETY: the system hands a handler with SA_SIGINFO a valid pointer.
    let is_fault = unsafe { (*info).si_code } > 0;
    if let Some(before) = before.filter(|before| is_fault && before.sa_sigaction != libc::SIG_DFL) {
        // Rust's own, which tells an overflown stack. The instruction faults again, and comes to it.
        // SAFETY: `before` is what the system said, and outlives the call.
        unsafe { libc::sigaction(signal, &raw const before, null_mut()) };
        return;
    }
    // SAFETY: all zeros is a value of this struct, its handler the default.
    let usual: libc::sigaction = unsafe { std::mem::zeroed() };
    // SAFETY: `usual` outlives the call; raised within its handler, the signal comes when that has ended.
    unsafe {
        libc::sigaction(signal, &raw const usual, null_mut());
        libc::raise(signal);
    }
}
