//! The buffers of a frame: the linear picture, the view behind, the framebuffer.

use std::sync::atomic::{AtomicU64, Ordering};

/// A linear picture: premultiplied Rec.709 radiance in the weights' unit, and coverage.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height][width]`, row 0 at the top.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage, 0..=1, same order.
    pub alpha: Vec<f32>,
}

/// The real view behind, as 0x00RRGGBB sRGB pixels. Each new view has an identity of its own, so that a still costs
/// nothing after its first frame.
#[derive(Clone, Debug)]
pub struct View {
    pub(super) width: usize,
    height: usize,
    pub(super) pixels: Vec<u32>,
    pub(super) identity: u64,
}

static VIEWS: AtomicU64 = AtomicU64::new(1);

impl View {
    /// A view of `width * height` pixels; missing pixels are black.
    pub fn new(width: usize, height: usize, mut pixels: Vec<u32>) -> Self {
        pixels.resize(width * height, 0);
        View { width, height, pixels, identity: VIEWS.fetch_add(1, Ordering::Relaxed) }
    }

    /// No view at all.
    pub(super) const fn nothing() -> Self {
        View { width: 0, height: 0, pixels: Vec::new(), identity: 0 }
    }

    /// Width and height, px.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// The pixels, `0x00RRGGBB`, row 0 at the top.
    pub fn pixels(&self) -> &[u32] {
        &self.pixels
    }

    /// Exchanges the pixels for those of a live camera's next picture and gives the view a new identity. Pixels of another
    /// size are left where they are.
    pub fn exchange(&mut self, pixels: &mut Vec<u32>) {
        if pixels.len() == self.pixels.len() {
            std::mem::swap(&mut self.pixels, pixels);
            self.identity = VIEWS.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Changes the pixels in place (a live camera's next frame) and gives the view a new identity.
    pub fn pixels_mut(&mut self) -> &mut [u32] {
        self.identity = VIEWS.fetch_add(1, Ordering::Relaxed);
        &mut self.pixels
    }
}

/// What is shown: 0x00RRGGBB pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Framebuffer {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height][width]`.
    pub pixels: Vec<u32>,
}

impl Framebuffer {
    /// A black one.
    pub fn new(width: usize, height: usize) -> Self {
        Framebuffer { width, height, pixels: vec![0; width * height] }
    }
}
