//! Ends the program with one sentence and status 1 when an allocation fails.
//!
//! Rust aborts when an ordinary allocation fails. The allocator remembers the failed request, so that the handler can
//! distinguish this abort from any other and give the reason. An allocation that may fail (`try_reserve`) returns its error
//! as usual. It also asks for large pages behind large allocations: the system clears and maps a page when it is first touched. In pages
//! of 4 KB that took a fifth of the processor time in which the equilibria of a tube of 10,080 nodes are found, in large ones 6 %.

use libc::{SIGABRT, c_int};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::Write;

/// The system's allocator, which remembers a thread's last request if the system refused it.
pub struct Allocator;

/// Bytes of an allocation from which on large pages, of 2 MB on most machines, are asked for.
const LARGE: usize = 4 << 20;

thread_local! {
    /// Bytes of the last refused request; 0 if none was refused.
    static REFUSED: Cell<usize> = const { Cell::new(0) };
}

fn watched(memory: *mut u8, bytes: usize) -> *mut u8 {
    if memory.is_null() {
        REFUSED.set(bytes);
    } else if bytes >= LARGE {
        ask_for_large_pages(memory, bytes);
    }
    memory
}

/// Asks for large pages behind all pages that lie in an allocation as a whole; a system without them refuses, and nothing changes.
#[cfg(target_os = "linux")]
fn ask_for_large_pages(memory: *mut u8, bytes: usize) {
    const PAGE: usize = 4096;
    let skipped = memory.align_offset(PAGE);
    let whole = bytes.saturating_sub(skipped) / PAGE * PAGE;
    // SAFETY: the range lies in the allocation, and the advice changes no byte of it.
    unsafe {
        libc::madvise(memory.wrapping_add(skipped).cast(), whole, libc::MADV_HUGEPAGE);
    }
}

#[cfg(not(target_os = "linux"))]
fn ask_for_large_pages(_: *mut u8, _: usize) {}

// SAFETY: every call goes to the system's allocator unchanged, and a thread's cell needs no memory of its own.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise is handed on.
        watched(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise is handed on.
        watched(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller's promise is handed on.
        watched(unsafe { System.realloc(memory, layout, size) }, size)
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is handed on.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// Makes every allocation that fails from now on end the program with a sentence and status 1, if [`Allocator`] is its allocator.
/// If addresses are limited, all threads share one arena, because each further one would reserve 64 MB of them.
pub fn end_in_order() {
    #[cfg(target_env = "gnu")]
    if super::machine::addresses_are_limited() {
        // SAFETY: there is no other thread yet, and the call sets a number of the C library.
        unsafe { libc::mallopt(libc::M_ARENA_MAX, 1) };
    }
    let handler: extern "C" fn(c_int) = on_abort;
    // SAFETY: the handler formats on its own stack and ends the program, or does nothing.
    unsafe { libc::signal(SIGABRT, handler as libc::sighandler_t) };
}

/// Gives freed memory, also that which the C library keeps for later, back to the system: [`super::machine`] then sees the memory
/// in use.
pub fn give_back() {
    #[cfg(target_env = "gnu")]
    // SAFETY: the call takes no memory that is in use.
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Any other abort ends the program as one without this handler, also where another process sent the signal.
extern "C" fn on_abort(signal: c_int) {
    conclude();
    super::fault::send_again(signal);
}

/// Writes the sentence and ends the program, if an allocation of this thread was refused. It calls only functions that are
/// allowed in a signal handler.
fn conclude() {
    let bytes = REFUSED.get();
    if bytes == 0 {
        return;
    }
    let mut text = [0u8; 400];
    let mut rest = &mut text[..];
    let _ = writeln!(
        rest,
        "error: out of memory: {:.1} MB more could not be had. Coarsen the mesh, or write solver = {{ \
         method = \"pcg\" }} in the scene",
        bytes as f64 / 1e6
    );
    let unused = rest.len();
    // SAFETY: both are allowed in a handler, and the text has this length.
    unsafe {
        libc::write(libc::STDERR_FILENO, text.as_ptr().cast(), text.len() - unused);
        libc::_exit(1);
    }
}
