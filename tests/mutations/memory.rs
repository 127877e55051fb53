//! The system's allocator, with the peak of the bytes that the calling thread has in use.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    /// Bytes in use and their peak. What one thread allocates and another frees counts in neither's favour.
    static IN_USE: Cell<[isize; 2]> = const { Cell::new([0; 2]) };
}

/// Counts; a thread that is ending is not counted any more.
fn count(bytes: isize) {
    let _ = IN_USE.try_with(|cell| {
        let [now, peak] = cell.get();
        cell.set([now + bytes, peak.max(now + bytes)]);
    });
}

// SAFETY: all calls go to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's promise is handed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's promise is handed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: the caller's promise is handed on.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size as isize);
        count(-(layout.size() as isize));
        // SAFETY: the caller's promise is handed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The result of `job`, and the bytes that this thread had in use at its peak, beyond those before.
pub fn peak_of<T>(job: impl FnOnce() -> T) -> (T, usize) {
    let before = in_use();
    IN_USE.set([before; 2]);
    let result = job();
    let [_, peak] = IN_USE.get();
    (result, (peak - before).max(0) as usize)
}

/// Bytes that this thread has in use now, as far as it allocated them itself.
pub fn in_use() -> isize {
    IN_USE.get()[0]
}
