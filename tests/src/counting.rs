//! The system's allocator, which counts what each thread asks of it and the bytes that all hold; a test makes it its global one.
#![allow(unsafe_code)]

pub mod sites;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicI64, Ordering};

/// See the module's text.
pub struct Counting;

static HELD_BYTES: AtomicI64 = AtomicI64::new(0);

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

fn note(bytes: i64) {
    HELD_BYTES.fetch_add(bytes, Ordering::Relaxed);
    // A thread that is ending has no count any more.
    let _ = COUNT.try_with(|count| count.set(count.get() + 1));
    sites::note();
}

/// Allocations of this thread until now.
pub fn allocations() -> u64 {
    COUNT.with(Cell::get)
}

/// Bytes that all threads hold.
pub fn held_bytes() -> i64 {
    HELD_BYTES.load(Ordering::Relaxed)
}

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size() as i64);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        HELD_BYTES.fetch_sub(layout.size() as i64, Ordering::Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(size as i64 - layout.size() as i64);
        // SAFETY: as the caller promises.
        unsafe { System.realloc(memory, layout, size) }
    }
}
