//! The stream of buffers: the newest picture, and what becomes of bad ones.
#![allow(unsafe_code)]

use super::ioctl::{self, Plain, ioctl};
use super::node::{Errno, Node, errno};
use crate::camera::CameraError;
use memmap2::{MmapOptions, MmapRaw};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::time::{ClockId, clock_gettime};
use std::ffi::c_int;
use std::fs::File;
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};
use v4l::v4l_sys as sys;

/// Buffers asked for: one being filled, one in hand, two between.
const BUFFERS: u32 = 4;

/// What became of the frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamCounters {
    /// Handed out.
    pub delivered: u64,
    /// Good ones given back unused, as a newer one was there.
    pub skipped: u64,
    /// Flagged as bad by the driver, or too short.
    pub damaged: u64,
    /// Numbers that never came.
    pub missing: u64,
}

/// A good picture in a buffer that is ours until it is given back.
#[derive(Debug)]
pub(super) struct Taken {
    pub index: usize,
    bytes: usize,
    pub sequence: u64,
    /// When it was taken, by the clock that starts with the machine, seconds.
    pub monotonic_s: f64,
}

/// A running stream.
pub(super) struct Stream {
    file: Arc<File>,
    needed_bytes: usize,
    buffers: Vec<MmapRaw>,
    queued: Vec<bool>,
    /// Extended number of the last good frame.
    last: Option<u64>,
    pub counters: StreamCounters,
}

impl Stream {
    /// Maps buffers and starts the stream.
    ///
    /// # Errors
    /// [`CameraError::Busy`] when another program streams, [`CameraError::Device`] when a retry may help.
    pub(super) fn start(node: &Node, needed_bytes: usize) -> Result<Self, CameraError> {
        let mut stream = Stream {
            file: Arc::clone(&node.file),
            needed_bytes,
            buffers: Vec::new(),
            queued: Vec::new(),
            last: None,
            counters: StreamCounters::default(),
        };
        let failed = |what: &'static str| move |error: io::Error| node.setup_fault(what, &error);
        let count = stream.allocate(BUFFERS).map_err(failed("gives no buffers"))?;
        for index in 0..count {
            let map = stream.map(index).map_err(failed("does not share its buffers"))?;
            if map.len() < needed_bytes {
                return Err(node.refused(format!("gives buffers of {} bytes for {needed_bytes}", map.len())));
            }
            stream.buffers.push(map);
            stream.queued.push(false);
            stream.queue(index as usize).map_err(failed("takes no buffers"))?;
        }
        if stream.buffers.is_empty() {
            return Err(node.refused("gives no buffers"));
        }
        let mut kind = ioctl::CAPTURE as c_int;
        ioctl(&stream.file, &ioctl::STREAMON, &mut kind).map_err(failed("does not start its stream"))?;
        Ok(stream)
    }

    fn allocate(&self, count: u32) -> io::Result<u32> {
        let mut request = sys::v4l2_requestbuffers::zeroed();
        (request.count, request.type_, request.memory) = (count, ioctl::CAPTURE, ioctl::MMAP);
        ioctl(&self.file, &ioctl::REQBUFS, &mut request)?;
        Ok(request.count)
    }

    fn map(&self, index: u32) -> io::Result<MmapRaw> {
        let mut buffer = buffer(index);
        ioctl(&self.file, &ioctl::QUERYBUF, &mut buffer)?;
        let mut options = MmapOptions::new();
        options.offset(ioctl::buffer_offset(&buffer)).len(buffer.length as usize);
        options.map_raw_read_only(&*self.file)
    }

    fn queue(&mut self, index: usize) -> io::Result<()> {
        ioctl(&self.file, &ioctl::QBUF, &mut buffer(index as u32))?;
        self.queued[index] = true;
        Ok(())
    }

    /// Queues what is not queued. A refusal is tried again with the next frame, while any buffer is left.
    fn queue_all(&mut self) -> Result<(), CameraError> {
        for index in 0..self.queued.len() {
            if !self.queued[index]
                && let Err(error) = self.queue(index)
                && errno(&error) == Some(Errno::NODEV)
            {
                return Err(CameraError::Lost);
            }
        }
        if self.queued.iter().any(|&queued| queued) { Ok(()) } else { Err(CameraError::Lost) }
    }

    /// One buffer if any is ready. Whatever else the driver answers, only a new stream helps.
    fn dequeue(&mut self) -> Result<Option<sys::v4l2_buffer>, CameraError> {
        let mut ready = buffer(0);
        match ioctl(&self.file, &ioctl::DQBUF, &mut ready) {
            Ok(()) => {
                let queued = self.queued.get_mut(ready.index as usize).ok_or(CameraError::Lost)?;
                *queued = false;
                Ok(Some(ready))
            }
            Err(error) if errno(&error) == Some(Errno::AGAIN) => Ok(None),
            Err(_) => Err(CameraError::Lost),
        }
    }

    /// The picture in a buffer, unless it is bad.
    fn judge(&mut self, ready: &sys::v4l2_buffer) -> Option<Taken> {
        let index = ready.index as usize;
        let bytes = (ready.bytesused as usize).min(self.buffers[index].len());
        if ready.flags & sys::V4L2_BUF_FLAG_ERROR != 0 || bytes < self.needed_bytes.max(1) {
            self.counters.damaged += 1;
            return None;
        }
        let sequence = extended(self.last, ready.sequence);
        self.counters.missing += self.last.map_or(0, |last| sequence - last - 1);
        self.last = Some(sequence);
        Some(Taken { index, bytes, sequence, monotonic_s: stamp_s(ready) })
    }

    /// Takes the oldest or the newest picture ready; with how many buffers were.
    fn collect(&mut self, newest: bool, saw: &mut impl FnMut(u64)) -> Result<(Option<Taken>, usize), CameraError> {
        let (mut kept, mut ready): (Option<Taken>, usize) = (None, 0);
        // A driver that fills buffers as fast as they are queued must not keep us here.
        while ready < 2 * self.buffers.len() && (newest || kept.is_none()) {
            let Some(buffer) = self.dequeue()? else { break };
            ready += 1;
            match self.judge(&buffer) {
                Some(taken) => {
                    saw(taken.sequence);
                    if let Some(older) = kept.replace(taken) {
                        self.skip(&older);
                    }
                }
                None => self.give_back(buffer.index as usize),
            }
        }
        Ok((kept, ready))
    }

    fn skip(&mut self, taken: &Taken) {
        self.counters.skipped += 1;
        self.give_back(taken.index);
    }

    /// Gives a buffer back to the driver; if that fails, the next call tries again.
    pub(super) fn give_back(&mut self, index: usize) {
        let _ = self.queue(index);
    }

    /// Throws away all pictures that are ready.
    pub(super) fn drain(&mut self, saw: &mut impl FnMut(u64)) -> Result<(), CameraError> {
        self.queue_all()?;
        if let (Some(taken), _) = self.collect(true, saw)? {
            self.skip(&taken);
        }
        Ok(())
    }

    /// A picture: the newest, or the oldest not yet seen. `saw` gets the number of every good one.
    ///
    /// # Errors
    /// [`CameraError::Timeout`] when none came in time, and the stream goes on; [`CameraError::Lost`] when none will.
    pub(super) fn take(
        &mut self,
        deadline: Instant,
        newest: bool,
        saw: &mut impl FnMut(u64),
    ) -> Result<Taken, CameraError> {
        let mut refreshed = !newest;
        loop {
            self.queue_all()?;
            match self.collect(newest, saw)? {
                // With all buffers full the driver had none left for what came after: even the newest may be old.
                (Some(taken), ready) if !refreshed && ready >= self.buffers.len() => {
                    refreshed = true;
                    self.skip(&taken);
                }
                (Some(taken), _) => {
                    self.counters.delivered += 1;
                    return Ok(taken);
                }
                (None, ready) => self.wait(deadline, ready > 0)?,
            }
        }
    }

    /// Waits until something is ready. With `found` there was just now, though nothing good.
    fn wait(&self, deadline: Instant, found: bool) -> Result<(), CameraError> {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(CameraError::Timeout);
        }
        let mut polled = [PollFd::new(&*self.file, PollFlags::IN | PollFlags::PRI)];
        match poll(&mut polled, Some(&timespec(left))) {
            Ok(0) => return Err(CameraError::Timeout),
            Ok(_) => {}
            Err(Errno::INTR | Errno::AGAIN) => return Ok(()),
            Err(_) => return Err(CameraError::Lost),
        }
        let happened = polled[0].revents();
        if happened.contains(PollFlags::PRI) && !happened.contains(PollFlags::ERR) {
            while let Some(changed) = ioctl::source_changed(&self.file) {
                if changed {
                    return Err(CameraError::Lost);
                }
            }
        }
        // An error that no buffer explains would wake us for ever.
        if happened.intersects(PollFlags::ERR | PollFlags::HUP) && !happened.contains(PollFlags::IN) && !found {
            return Err(CameraError::Lost);
        }
        Ok(())
    }

    /// The bytes of a picture.
    pub(super) fn bytes(&self, taken: &Taken) -> &[u8] {
        // SAFETY: the map is as long as `judge` made sure, and lives as long as the borrow of `self`. The driver does not
        // write to a buffer that is not queued, and queueing needs `&mut self`.
        unsafe { std::slice::from_raw_parts(self.buffers[taken.index].as_ptr(), taken.bytes) }
    }
}

impl Drop for Stream {
    fn drop(&mut self) {
        // A device that is gone refuses both, which is no loss.
        let mut kind = ioctl::CAPTURE as c_int;
        let _ = ioctl(&self.file, &ioctl::STREAMOFF, &mut kind);
        self.buffers.clear();
        let _ = self.allocate(0);
    }
}

fn buffer(index: u32) -> sys::v4l2_buffer {
    let mut buffer = sys::v4l2_buffer::zeroed();
    (buffer.index, buffer.type_, buffer.memory) = (index, ioctl::CAPTURE, ioctl::MMAP);
    buffer
}

fn timespec(duration: Duration) -> Timespec {
    // Rounded up, so that a wait never ends just before its deadline and is waited for in vain.
    let rounded = duration.saturating_add(Duration::from_micros(1)).min(Duration::from_secs(3600));
    Timespec { tv_sec: rounded.as_secs() as i64, tv_nsec: i64::from(rounded.subsec_nanos()) }
}

/// A 32-bit number that may wrap, continued. Drivers that do not count, or start again, count on from the last.
fn extended(last: Option<u64>, number: u32) -> u64 {
    let Some(last) = last else { return u64::from(number) };
    let ahead = number.wrapping_sub(last as u32);
    if ahead == 0 || ahead > u32::MAX / 2 { last + 1 } else { last + u64::from(ahead) }
}

/// Seconds since the machine started.
pub(super) fn monotonic_s() -> f64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// What to add to a monotonic time for unix seconds, now.
pub(super) fn unix_offset_s() -> f64 {
    let now = clock_gettime(ClockId::Realtime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9 - monotonic_s()
}

/// The driver's time of a picture; ours where it has none, or one that cannot be.
fn stamp_s(ready: &sys::v4l2_buffer) -> f64 {
    let now = monotonic_s();
    let stamp = ready.timestamp.tv_sec as f64 + ready.timestamp.tv_usec as f64 * 1e-6;
    let is_monotonic = ready.flags & sys::V4L2_BUF_FLAG_TIMESTAMP_MASK == sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    if is_monotonic && (now - 60.0..=now).contains(&stamp) { stamp } else { now }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_go_on_where_the_driver_wraps_or_starts_again() {
        assert_eq!(extended(None, 7), 7);
        assert_eq!(extended(Some(7), 9), 9);
        assert_eq!(extended(Some(u64::from(u32::MAX)), 1), u64::from(u32::MAX) + 2);
        assert_eq!(extended(Some((5 << 32) + 3), 4), (5 << 32) + 4);
        assert_eq!(extended(Some(100), 0), 101);
        assert_eq!(extended(Some(0), 0), 1);
    }

    #[test]
    fn times_of_the_driver_are_taken_when_they_can_be() {
        let mut ready = buffer(0);
        let now = monotonic_s();
        ready.flags = sys::V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
        ready.timestamp.tv_sec = now as i64 - 1;
        assert!((stamp_s(&ready) - (now.floor() - 1.0)).abs() < 1e-6);
        ready.timestamp.tv_sec = now as i64 + 100;
        assert!((stamp_s(&ready) - now).abs() < 1.0);
        ready.timestamp.tv_sec = now as i64 - 1;
        ready.flags = 0;
        assert!((stamp_s(&ready) - now).abs() < 0.5);
    }

    #[test]
    fn what_is_no_camera_starts_no_stream_and_drops_in_peace() {
        let node = Node::open("/dev/null").unwrap();
        assert!(matches!(Stream::start(&node, 100), Err(CameraError::Device { .. })));
    }
}
