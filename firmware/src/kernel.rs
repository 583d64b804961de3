//! The kernels: each path equals [`scalar`] bit for bit.

pub mod scalar;

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod avx2;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod detect;
#[cfg(target_arch = "aarch64")]
#[allow(unsafe_code)]
mod neon;

/// A path through the kernels that this machine can run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kernel(Path);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Path {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "aarch64")]
    Neon,
}

/// What [`Kernel::project`] multiplies: one channel of a tile's V by the weights.
#[derive(Clone, Copy, Debug)]
pub struct Projection<'a> {
    /// V of one channel, `[rank][weights.len()]`, i8 as bytes.
    pub v: &'a [u8],
    /// Weights, a multiple of 16; `sum |w| <= 2^24`.
    pub weights: &'a [i16],
    /// Blocks of 16 weights that are not all zero.
    pub lit_blocks: &'a [u8],
}

/// What [`Kernel::reconstruct`] sums: U by the coefficients, scaled per row, one plane per channel.
#[derive(Clone, Copy, Debug)]
pub struct Reconstruction<'a> {
    /// `rank/2` planes of `pixels` pairs, i8 as bytes.
    pub u: &'a [u8],
    /// Padded pixels, a multiple of 16.
    pub pixels: usize,
    /// Coefficient pairs per channel, `rank/2` used: low half even rank, high half odd rank; |q| <= 32767.
    pub pairs: [&'a [i32]; 3],
    /// Row scales `[3][pixels]`, u16 little-endian.
    pub rows: &'a [u8],
    /// Right shift of `sum * row`, 16..=32, per channel.
    pub right: [u32; 3],
    /// Saturating left shift after it, 0..=30, per channel.
    pub left: [u32; 3],
    /// The sun's response `[3][pixels]` in 1/32768, u16, and its weight in 1/65536; `None`: no sun.
    pub sun: Option<(&'a [u16], [u32; 3])>,
}

/// What [`Kernel::add_residual`] adds: one patch's residual times its weight.
#[derive(Clone, Copy, Debug)]
pub struct ResidualTerm<'a> {
    /// Codes `[3][pixels]`, i8 as bytes.
    pub codes: &'a [u8],
    /// Padded pixels, a multiple of 16.
    pub pixels: usize,
    /// Weight times scale per channel, in 1/2^28 of display white; |value| <= [`RESIDUAL_LIMIT`].
    pub factor: [i32; 3],
}

/// Values are held within +-(2^29 - 1) before the sun (below 2^30) and residuals (2^22 each) are added, so that the sum
/// cannot leave an i32.
pub const LINEAR_LIMIT: i32 = (1 << 29) - 1;
/// Largest factor of a residual: with |code| <= 127 the product stays below 2^30.
pub const RESIDUAL_LIMIT: i32 = (1 << 23) - 1;
/// Right shift of code times factor (1/2^28) to 1/2^20.
pub const RESIDUAL_SHIFT: u32 = 8;
/// Right shift of response (1/32768) by the sun's weight (1/65536) to 1/2^20.
pub const SUN_SHIFT: u32 = 11;

impl Kernel {
    /// The normative path.
    pub const SCALAR: Kernel = Kernel(Path::Scalar);

    /// The fastest path of this machine.
    pub fn detect() -> Kernel {
        #[cfg(target_arch = "x86_64")]
        if detect::has_avx2() {
            return Kernel(Path::Avx2);
        }
        #[cfg(target_arch = "aarch64")]
        return Kernel(Path::Neon);
        #[allow(unreachable_code)]
        Kernel::SCALAR
    }

    /// Name for reports.
    pub fn name(self) -> &'static str {
        match self.0 {
            Path::Scalar => "scalar",
            #[cfg(target_arch = "x86_64")]
            Path::Avx2 => "avx2",
            #[cfg(target_arch = "aarch64")]
            Path::Neon => "neon",
        }
    }

    /// `out[k] = sum_i V[k][i] * w[i]` for every `k < out.len()`.
    ///
    /// # Panics
    /// If the slices' lengths contradict each other.
    pub fn project(self, job: &Projection<'_>, out: &mut [i32]) {
        let stride = job.weights.len();
        assert!(stride.is_multiple_of(16) && job.v.len() >= out.len() * stride);
        assert!(job.lit_blocks.iter().all(|&block| usize::from(block) * 16 < stride));
        match self.0 {
            Path::Scalar => scalar::project(job, out),
            // SAFETY: `Kernel` holds this path only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 => unsafe { avx2::project(job, out) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon => unsafe { neon::project(job, out) },
        }
    }

    /// Linear values in 1/2^20 of display white, `out[c][x]` for every padded pixel.
    ///
    /// # Panics
    /// If the slices' lengths contradict each other.
    pub fn reconstruct(self, job: &Reconstruction<'_>, out: [&mut [i32]; 3]) {
        let n = job.pixels;
        let pairs = job.pairs[0].len();
        assert!(n.is_multiple_of(16) && job.u.len() >= pairs * n * 2 && job.rows.len() == 6 * n);
        assert!(job.pairs.iter().all(|p| p.len() == pairs) && out.iter().all(|o| o.len() == n));
        assert!(job.right.iter().all(|r| (16..=32).contains(r)) && job.left.iter().all(|&l| l <= 30));
        assert!(job.sun.is_none_or(|(plane, _)| plane.len() == 3 * n));
        match self.0 {
            Path::Scalar => scalar::reconstruct(job, out),
            // SAFETY: `Kernel` holds this path only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 => unsafe { avx2::reconstruct(job, out) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon => unsafe { neon::reconstruct(job, out) },
        }
    }

    /// Adds `code * factor`, rounded, to linear values of [`Kernel::reconstruct`].
    ///
    /// # Panics
    /// If the slices' lengths contradict each other.
    pub fn add_residual(self, term: &ResidualTerm<'_>, out: [&mut [i32]; 3]) {
        let n = term.pixels;
        assert!(n.is_multiple_of(16) && term.codes.len() == 3 * n && out.iter().all(|o| o.len() == n));
        assert!(term.factor.iter().all(|f| (-RESIDUAL_LIMIT..=RESIDUAL_LIMIT).contains(f)));
        match self.0 {
            Path::Scalar => scalar::add_residual(term, out),
            // SAFETY: `Kernel` holds this path only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 => unsafe { avx2::add_residual(term, out) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon => unsafe { neon::add_residual(term, out) },
        }
    }

    /// Asks for bytes that will be read soon; changes nothing but the time it takes.
    pub fn prefetch(self, bytes: &[u8]) {
        match self.0 {
            Path::Scalar => {}
            #[cfg(target_arch = "x86_64")]
            Path::Avx2 => avx2::prefetch(bytes),
            #[cfg(target_arch = "aarch64")]
            Path::Neon => neon::prefetch(bytes),
        }
    }

    /// Linear values (1/2^20 of display white) to 0x00RRGGBB by [`crate::tone::code`], for a multiple of 8 pixels.
    ///
    /// # Panics
    /// If the slices' lengths differ or are no multiple of 8.
    pub fn tone(self, linear: [&[i32]; 3], out_xrgb: &mut [u32]) {
        let n = out_xrgb.len();
        assert!(n.is_multiple_of(8) && linear.iter().all(|plane| plane.len() == n));
        match self.0 {
            Path::Scalar => scalar::tone(linear, out_xrgb),
            // SAFETY: `Kernel` holds this path only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 => unsafe { avx2::tone(linear, out_xrgb) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon => unsafe { neon::tone(linear, out_xrgb) },
        }
    }
}

#[cfg(test)]
mod tests;
