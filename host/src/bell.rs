//! Wakes a thread that waits for the next frame's turn, because there is something newer to show.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::Thread;
use std::time::Duration;

/// Rings for one thread, from any other. A ring that comes before the wait is not lost; several are as one.
#[derive(Clone, Debug)]
pub struct Bell {
    has_rung: Arc<AtomicBool>,
    waiting: Thread,
}

impl Bell {
    /// A bell for the thread that calls this.
    pub fn for_this_thread() -> Self {
        Bell { has_rung: Arc::new(AtomicBool::new(false)), waiting: std::thread::current() }
    }

    /// Wakes the thread. Allocates nothing and does not wait.
    pub fn ring(&self) {
        self.has_rung.store(true, Ordering::Release);
        self.waiting.unpark();
    }

    /// Whether it has rung since this was asked last.
    pub fn take(&self) -> bool {
        self.has_rung.swap(false, Ordering::Acquire)
    }

    /// Waits until it rings, no longer than `limit`; may return early. To be called by the thread that it rings for.
    pub fn wait(&self, limit: Duration) {
        if !self.has_rung.load(Ordering::Acquire) {
            std::thread::park_timeout(limit);
        }
    }
}
