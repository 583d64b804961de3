//! Where memory is asked for while somebody watches: each stack once per thread, and how often. Nothing is allocated for it.

use std::cell::Cell;
use std::ffi::{c_int, c_void};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Calls of a stack that are kept, from the innermost.
const MOST_CALLS: usize = 64;
/// Stacks that are kept.
const MOST_SITES: usize = 2048;

/// A stack from which memory was asked for.
#[derive(Clone, Copy)]
pub struct Site {
    /// The system's number of the thread.
    pub thread: i32,
    /// How often it asked from here.
    pub times: u64,
    depth: usize,
    returns: [usize; MOST_CALLS],
}

impl Site {
    const NONE: Site = Site { thread: 0, times: 0, depth: 0, returns: [0; MOST_CALLS] };

    /// Addresses to which the calls return, from the innermost.
    pub fn stack(&self) -> &[usize] {
        &self.returns[..self.depth]
    }
}

struct Table {
    sites: [Site; MOST_SITES],
    used: usize,
    /// Asked from stacks for which there was no room.
    lost: u64,
}

static TABLE: Mutex<Table> = Mutex::new(Table { sites: [Site::NONE; MOST_SITES], used: 0, lost: 0 });
static IS_WATCHED: AtomicBool = AtomicBool::new(false);

thread_local! {
    static IS_NOTING: Cell<bool> = const { Cell::new(false) };
}

// The unwinder that the standard library is linked with, and the C library.
unsafe extern "C" {
    fn _Unwind_Backtrace(each: extern "C" fn(*mut c_void, *mut c_void) -> c_int, argument: *mut c_void) -> c_int;
    fn _Unwind_GetIP(context: *mut c_void) -> usize;
    fn gettid() -> c_int;
}

const GO_ON: c_int = 0;
const END_OF_STACK: c_int = 5;

extern "C" fn take_call(context: *mut c_void, argument: *mut c_void) -> c_int {
    // SAFETY: the argument is the site of `note`, which waits for the unwinder and touches it no more until then.
    let site = unsafe { &mut *argument.cast::<Site>() };
    if site.depth == MOST_CALLS {
        return END_OF_STACK;
    }
    // SAFETY: the context is the one that the unwinder just handed over.
    site.returns[site.depth] = unsafe { _Unwind_GetIP(context) };
    site.depth += 1;
    GO_ON
}

/// Notes the stack of the caller while somebody watches.
pub(super) fn note() {
    if !IS_WATCHED.load(Ordering::Relaxed) {
        return;
    }
    // Should noting itself ask for memory, that is not noted; nor is what a thread asks for that is ending.
    if IS_NOTING.try_with(|noting| noting.replace(true)).unwrap_or(true) {
        return;
    }
    // SAFETY: it takes nothing and cannot fail.
    let mut site = Site { thread: unsafe { gettid() }, times: 1, ..Site::NONE };
    // SAFETY: the callback has the unwinder's type and is called before this returns, with the site as its argument.
    unsafe { _Unwind_Backtrace(take_call, (&raw mut site).cast()) };
    TABLE.lock().unwrap_or_else(PoisonError::into_inner).add(&site);
    let _ = IS_NOTING.try_with(|noting| noting.set(false));
}

impl Table {
    fn add(&mut self, site: &Site) {
        let known = self.sites[..self.used].iter_mut();
        let same = known.into_iter().find(|known| known.thread == site.thread && known.stack() == site.stack());
        match same {
            Some(same) => same.times += 1,
            None if self.used == MOST_SITES => self.lost += 1,
            None => {
                self.sites[self.used] = *site;
                self.used += 1;
            }
        }
    }
}

/// Begins to note, or goes on.
pub fn watch() {
    IS_WATCHED.store(true, Ordering::Relaxed);
}

/// Notes no more; the sites until now, and how many asked from stacks for which there was no room.
pub fn watched() -> (Vec<Site>, u64) {
    IS_WATCHED.store(false, Ordering::Relaxed);
    let table = TABLE.lock().unwrap_or_else(PoisonError::into_inner);
    (table.sites[..table.used].to_vec(), table.lost)
}
