//! Memory that the rivals' numbers lie in: as large as one frame needs, or larger than the caches.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use memmap2::MmapMut;

/// Windows start at multiples of this: a cache line.
const ALIGN: usize = 64;

/// Anonymous memory, and where the next window starts.
pub struct Arena {
    memory: MmapMut,
    next: AtomicUsize,
}

impl Arena {
    /// An arena of `bytes` zeros.
    ///
    /// # Errors
    /// When the memory cannot be had.
    pub fn zeros(bytes: usize) -> std::io::Result<Self> {
        let memory = MmapMut::map_anon(bytes.max(ALIGN))?;
        // Large pages spare the rivals page walks; a system without them is slower, not wrong.
        #[cfg(target_os = "linux")]
        let _ = memory.advise(memmap2::Advice::HugePage);
        Ok(Arena { memory, next: AtomicUsize::new(0) })
    }

    /// Fills it with f32 values that no arithmetic unit finds easier than a response.
    pub fn fill_made_up(&mut self) {
        for (k, value) in self.values_mut().iter_mut().enumerate() {
            *value = (k % 97) as f32 * 0.01;
        }
    }

    /// All of it.
    pub fn bytes(&self) -> &[u8] {
        &self.memory
    }

    /// Its whole f32 values, to be written.
    pub fn values_mut(&mut self) -> &mut [f32] {
        let whole = self.memory.len() / size_of::<f32>() * size_of::<f32>();
        bytemuck::cast_slice_mut(&mut self.memory[..whole])
    }

    /// Place of the next window of `bytes`: behind the last one, or at the start again where the arena ends.
    fn take(&self, bytes: usize) -> usize {
        let at = self.next.load(Ordering::Relaxed);
        let at = if at + bytes > self.memory.len() { 0 } else { at };
        self.next.store((at + bytes).next_multiple_of(ALIGN), Ordering::Relaxed);
        at
    }
}

/// The part of an arena that one frame reads.
#[derive(Clone)]
pub struct Window {
    arena: Arc<Arena>,
    at: usize,
    bytes: usize,
}

impl Window {
    /// A window over zeros of its own.
    ///
    /// # Errors
    /// When the memory cannot be had.
    pub fn own(bytes: usize) -> std::io::Result<Self> {
        Ok(Window { arena: Arc::new(Arena::zeros(bytes)?), at: 0, bytes })
    }

    /// Lets the window wander through `arena` from now on.
    ///
    /// # Errors
    /// When the arena is smaller than the window.
    pub fn wander(&mut self, arena: &Arc<Arena>) -> anyhow::Result<()> {
        anyhow::ensure!(arena.bytes().len() >= self.bytes, "a frame needs {} bytes of memory", self.bytes);
        self.arena = Arc::clone(arena);
        self.move_on();
        Ok(())
    }

    /// Moves to the place that was read least recently; a window over memory of its own stays.
    pub fn move_on(&mut self) {
        self.at = self.arena.take(self.bytes);
    }

    /// Its bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.arena.bytes()[self.at..self.at + self.bytes]
    }

    /// Its f32 values.
    pub fn values(&self) -> &[f32] {
        bytemuck::cast_slice(&self.bytes()[..self.bytes / size_of::<f32>() * size_of::<f32>()])
    }

    /// The memory behind it, to be written; `None` once it is shared.
    pub fn arena_mut(&mut self) -> Option<&mut Arena> {
        Arc::get_mut(&mut self.arena)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_follow_each_other_and_start_again() {
        let arena = Arc::new(Arena::zeros(1000).unwrap());
        let mut window = Window::own(300).unwrap();
        window.wander(&arena).unwrap();
        let mut other = Window::own(100).unwrap();
        other.wander(&arena).unwrap();
        assert_eq!((window.at, other.at), (0, 320));
        window.move_on();
        other.move_on();
        assert_eq!((window.at, other.at), (448, 768));
        window.move_on();
        assert_eq!(window.at, 0);
        assert!(Window::own(2000).unwrap().wander(&arena).is_err());
    }

    #[test]
    fn memory_of_its_own_stays_where_it_is() {
        let mut window = Window::own(64).unwrap();
        window.arena_mut().unwrap().values_mut()[3] = 2.5;
        window.move_on();
        window.move_on();
        assert_eq!(window.values()[3], 2.5);
        let shared = window.clone();
        assert!(window.arena_mut().is_none() && shared.bytes().len() == 64);
    }
}
