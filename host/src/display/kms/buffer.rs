//! Memory that a screen shows: a GBM buffer or a dumb one, written by the processor.
#![allow(unsafe_code)]

use super::BufferKind;
use super::card::Card;
use crate::damage::Damage;
use crate::display::Frame;
use crate::display::pack::{PixelFormat, Placement};
use drm::buffer::{Buffer as _, DrmFourcc};
use drm::control::dumbbuffer::DumbBuffer;
use drm::control::{Device as _, framebuffer};
use memmap2::{MmapMut, MmapOptions};
use std::io;
use std::os::fd::AsFd;
use std::rc::Rc;

/// Bits of a pixel that carry colour, and bits that it takes.
fn depths(format: PixelFormat) -> (u32, u32) {
    match format {
        PixelFormat::Xrgb8888 => (24, 32),
        PixelFormat::Xrgb2101010 => (30, 32),
    }
}

/// The format's name in DRM.
pub(super) fn fourcc(format: PixelFormat) -> DrmFourcc {
    match format {
        PixelFormat::Xrgb8888 => DrmFourcc::Xrgb8888,
        PixelFormat::Xrgb2101010 => DrmFourcc::Xrgb2101010,
    }
}

/// Where a buffer's pixels are.
enum Pixels {
    /// The screen's own memory.
    Dumb { buffer: DumbBuffer, map: MmapMut },
    /// A copy that is handed to GBM as a whole.
    Gbm { object: gbm::BufferObject<()>, copy: Vec<u32> },
}

/// One of the pictures that a screen flips between.
pub(super) struct ScreenBuffer {
    card: Rc<Card>,
    pixels: Pixels,
    framebuffer: framebuffer::Handle,
    stride: usize,
    /// Tiles in which it differs from the newest picture.
    stale: Damage,
}

impl ScreenBuffer {
    /// A black buffer of `size` pixels for pictures of `picture` pixels.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn new(
        card: &Rc<Card>,
        gbm: Option<&gbm::Device<Rc<Card>>>,
        size: (usize, usize),
        format: PixelFormat,
        picture: (usize, usize),
    ) -> io::Result<Self> {
        let (pixels, framebuffer, stride) = match gbm {
            Some(device) => Self::by_gbm(card, device, size, format)?,
            None => Self::dumb(card, size, format)?,
        };
        let stale = Damage::whole(picture.0, picture.1);
        Ok(ScreenBuffer { card: Rc::clone(card), pixels, framebuffer, stride, stale })
    }

    fn dumb(
        card: &Card,
        (width, height): (usize, usize),
        format: PixelFormat,
    ) -> io::Result<(Pixels, framebuffer::Handle, usize)> {
        let (depth, bits) = depths(format);
        let buffer = card.create_dumb_buffer((width as u32, height as u32), fourcc(format), bits)?;
        let stride = buffer.pitch() as usize / 4;
        let made = map(card, &buffer, stride * height * 4)
            .and_then(|map| Ok((map, card.add_framebuffer(&buffer, depth, bits)?)));
        match made {
            Ok((map, framebuffer)) => Ok((Pixels::Dumb { buffer, map }, framebuffer, stride)),
            Err(error) => {
                // The buffer is of no use; that it cannot be given back either changes nothing.
                let _ = card.destroy_dumb_buffer(buffer);
                Err(error)
            }
        }
    }

    fn by_gbm(
        card: &Card,
        device: &gbm::Device<Rc<Card>>,
        (width, height): (usize, usize),
        format: PixelFormat,
    ) -> io::Result<(Pixels, framebuffer::Handle, usize)> {
        let usage = gbm::BufferObjectFlags::SCANOUT | gbm::BufferObjectFlags::WRITE;
        let object = device.create_buffer_object(width as u32, height as u32, fourcc(format), usage)?;
        let (depth, bits) = depths(format);
        let framebuffer = card.add_framebuffer(&object, depth, bits)?;
        let stride = object.stride() as usize / 4;
        Ok((Pixels::Gbm { object, copy: vec![0; stride * height] }, framebuffer, stride))
    }

    pub(super) fn framebuffer(&self) -> framebuffer::Handle {
        self.framebuffer
    }

    /// Words from row to row.
    pub(super) fn stride(&self) -> usize {
        self.stride
    }

    /// Notes what has changed since the last picture.
    pub(super) fn age(&mut self, damage: &Damage) {
        self.stale.add(damage);
    }

    /// Does it differ from the newest picture?
    pub(super) fn is_stale(&self) -> bool {
        !self.stale.is_empty()
    }

    /// Brings it up to the newest picture.
    ///
    /// # Errors
    /// When GBM does not take it.
    pub(super) fn write(&mut self, frame: &Frame<'_>, placement: &Placement) -> io::Result<()> {
        let areas = self.stale.areas();
        match &mut self.pixels {
            Pixels::Dumb { map, .. } => {
                let memory: &mut [u32] = bytemuck::cast_slice_mut(map);
                areas.for_each(|area| placement.write(frame, area, memory));
            }
            Pixels::Gbm { object, copy } => {
                areas.for_each(|area| placement.write(frame, area, copy));
                object.write(bytemuck::cast_slice(copy))?;
            }
        }
        self.stale.clear();
        Ok(())
    }
}

/// The buffer's memory, black.
fn map(card: &Card, buffer: &DumbBuffer, bytes: usize) -> io::Result<MmapMut> {
    let offset = drm_ffi::mode::dumbbuffer::map(card.as_fd(), buffer.handle().into(), 0, 0)?.offset;
    // SAFETY: the kernel gave this offset for this buffer, which is at least `bytes` long; nothing else writes to it.
    let mut map = unsafe { MmapOptions::new().offset(offset).len(bytes).map_mut(card.file())? };
    map.fill(0);
    Ok(map)
}

impl Drop for ScreenBuffer {
    fn drop(&mut self) {
        // A card that is gone has taken them along.
        let _ = self.card.destroy_framebuffer(self.framebuffer);
        if let Pixels::Dumb { buffer, .. } = &self.pixels {
            let _ = self.card.destroy_dumb_buffer(*buffer);
        }
    }
}

/// Opens GBM where the post's file does not rule it out; `None`: dumb buffers.
pub(super) fn open_gbm(card: &Rc<Card>, kind: BufferKind, format: PixelFormat) -> Option<gbm::Device<Rc<Card>>> {
    if kind == BufferKind::Dumb {
        return None;
    }
    let device = gbm::Device::new(Rc::clone(card)).ok()?;
    let usage = gbm::BufferObjectFlags::SCANOUT | gbm::BufferObjectFlags::WRITE;
    device.is_format_supported(fourcc(format), usage).then_some(device)
}
