//! A checked frame: the caller's buffer and view, for tiles to be written to.

#![allow(unsafe_code)]

use crate::pixel::{Format, premultiplied};
use crate::types::{RELUME_FRAME_REDRAW, RelumeError, RelumeFrame};
use core::marker::PhantomData;
use relume_firmware::composite::{self, Compositor, ViewPixels};
use relume_firmware::field::Field;
use relume_firmware::kernel::{Extent, Kernel};
use relume_firmware::relight::{Coefficients, LinearTile, TileLight};
use relume_firmware::surface::Surface;
use relume_firmware::tile::{TILE_PIXELS, TILE_PX, Tile};
use relume_firmware::tone::ViewLight;

/// Which buffer, format and view a tile was drawn with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Target {
    pixels: usize,
    stride: usize,
    format: Format,
}

/// The view's picture, as far as the caller's number tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewIdentity {
    address: usize,
    stride: usize,
    sequence: u64,
}

/// A buffer that holds a picture of `width` x `height` px, and the view behind it.
pub struct Frame<'a> {
    pixels: *mut u8,
    stride: usize,
    format: Format,
    width: usize,
    height: usize,
    view: ViewPixels<'a>,
    identity: ViewIdentity,
    /// Must every tile be drawn?
    pub redraw: bool,
    buffer: PhantomData<&'a mut [u8]>,
}

/// Bytes from the first to the last pixel of a picture, after checking what the caller says of a buffer.
fn extent(
    (address, length, stride): (usize, usize, usize),
    (width, height): (usize, usize),
    pixel: usize,
) -> Result<usize, RelumeError> {
    if !address.is_multiple_of(pixel) || !stride.is_multiple_of(pixel) {
        return Err(RelumeError::Alignment);
    }
    if stride < width * pixel {
        return Err(RelumeError::Stride);
    }
    let need = (height - 1).checked_mul(stride).and_then(|rows| rows.checked_add(width * pixel));
    let need = need.filter(|&need| need <= length && isize::try_from(need).is_ok()).ok_or(RelumeError::TooShort)?;
    address.checked_add(need).ok_or(RelumeError::TooShort)?;
    Ok(need)
}

impl<'a> Frame<'a> {
    /// Checks a frame for a picture of `size` (width, height; both at least 1).
    ///
    /// # Errors
    /// What is wrong with it.
    ///
    /// # Safety
    /// For `'a`, `pixels` may be written over `length` bytes by nobody else where this picture's pixels are, and `view`,
    /// unless null, may be read over `view_length` bytes and is written by nobody.
    pub unsafe fn new(frame: &RelumeFrame, (width, height): (usize, usize)) -> Result<Self, RelumeError> {
        let format = Format::new(frame.format)?;
        if frame.flags & !RELUME_FRAME_REDRAW != 0 {
            return Err(RelumeError::Flags);
        }
        if frame.pixels.is_null() {
            return Err(RelumeError::NullPointer);
        }
        let address = frame.pixels as usize;
        let need = extent((address, frame.length, frame.stride), (width, height), format.bytes())?;
        let mut view = ViewPixels { pixels_xrgb: &[], stride: 0 };
        if !frame.view.is_null() {
            let behind = frame.view as usize;
            let read = extent((behind, frame.view_length, frame.view_stride), (width, height), 4)?;
            let apart = behind + read <= address || address + need <= behind;
            if !apart || format == Format::Argb8888 {
                return Err(RelumeError::View);
            }
            // SAFETY: aligned and `read` bytes long, as checked; readable and still for 'a by this function's contract.
            let pixels_xrgb = unsafe { core::slice::from_raw_parts(frame.view, read / 4) };
            view = ViewPixels { pixels_xrgb, stride: frame.view_stride / 4 };
        }
        Ok(Frame {
            pixels: frame.pixels.cast(),
            stride: frame.stride,
            format,
            width,
            height,
            view,
            identity: ViewIdentity {
                address: frame.view as usize,
                stride: frame.view_stride,
                sequence: frame.view_sequence,
            },
            redraw: frame.flags & RELUME_FRAME_REDRAW != 0,
            buffer: PhantomData,
        })
    }

    /// Which buffer this is.
    pub fn target(&self) -> Target {
        Target { pixels: self.pixels as usize, stride: self.stride, format: self.format }
    }

    /// Which view this is.
    pub fn view(&self) -> ViewIdentity {
        self.identity
    }

    /// Width and height of the tile whose top left pixel is `x0`, `y0`: less than 16 at ragged edges.
    pub fn tile_size(&self, (x0, y0): (usize, usize)) -> (usize, usize) {
        (TILE_PX.min(self.width.saturating_sub(x0)), TILE_PX.min(self.height.saturating_sub(y0)))
    }

    /// Relights a tile, whose top left pixel is `x0`, `y0`, and writes it over the view, or as premultiplied
    /// colours. Returns the extent of its linear values. `linear` is a place to work in.
    pub fn relight_tile(
        &self,
        (field, tile): (&Field<'_>, &Tile<'_>),
        (x0, y0): (usize, usize),
        (coefficients, light): (&Coefficients, &TileLight<'_>),
        (view_light, kernel): (&ViewLight, Kernel),
        linear: &mut LinearTile,
    ) -> Extent {
        let (width, height) = self.tile_size((x0, y0));
        if self.format == Format::Argb8888 {
            let extent = coefficients.pixels(field, tile, light, kernel, linear);
            self.write_words((x0, y0), &premultiplied(tile, linear, kernel));
            return extent;
        }
        // Composited beside the buffer: display memory is often slow to read, and this has one format.
        let mut words = [0u32; TILE_PIXELS];
        let Ok(mut surface) = Surface::new(&mut words, width, height, TILE_PX) else { return Extent::EMPTY };
        let stride = self.view.stride;
        let behind = self.view.pixels_xrgb.get(y0 * stride + x0..).unwrap_or(&[]);
        let view = ViewPixels { pixels_xrgb: behind, stride };
        let target = composite::Target { surface: &mut surface, surface_y0: 0, at: (0, 0) };
        let compositor = Compositor { view, light: view_light, kernel };
        let extent = compositor.tile((field, tile), (coefficients, light), linear, &mut [], None, target);
        self.write_words((x0, y0), &words);
        extent
    }

    fn write_words(&self, (x0, y0): (usize, usize), words: &[u32; TILE_PIXELS]) {
        let (width, height) = self.tile_size((x0, y0));
        let mut bytes = [0u8; 4 * TILE_PX];
        for (row, words) in words.chunks_exact(TILE_PX).take(height).enumerate() {
            let length = self.format.row(&words[..width], &mut bytes);
            // SAFETY: `x0 + width` and `y0 + row` lie in the picture by `tile_size`, so these bytes lie in the
            // buffer's checked extent, where only this call writes; `bytes` is a local and at least `length` long.
            unsafe {
                let to = self.pixels.add((y0 + row) * self.stride + x0 * self.format.bytes());
                core::ptr::copy_nonoverlapping(bytes.as_ptr(), to, length);
            }
        }
    }
}
