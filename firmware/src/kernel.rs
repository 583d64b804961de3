//! The kernels: each path equals [`scalar`] bit for bit.

mod job;
#[allow(unsafe_code)]
mod rows;
pub mod scalar;
#[allow(unsafe_code)]
mod shade;
#[allow(unsafe_code)]
mod view;

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod avx2;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod avx512;
#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod detect;
#[cfg(target_arch = "aarch64")]
#[allow(unsafe_code)]
mod neon;
#[cfg(target_arch = "aarch64")]
#[allow(unsafe_code)]
mod neon_dot;

pub use job::{Extent, Linear, Projection, Reconstruction, Shown, UNIT_LIMIT};
pub use rows::RowsLight;

use crate::tile::TILE_PX;
use crate::tone::ViewLight;

/// A path through the kernels that this machine can run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kernel(Path);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Path {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "aarch64")]
    Neon,
    #[cfg(target_arch = "aarch64")]
    NeonDot,
}

/// Plain loops whose lanes do not depend on each other, for [`Kernel::widely`].
pub trait Loops {
    /// What they give.
    type Out;
    /// Runs them; `#[inline(always)]`, and so is what it calls, or nothing is gained.
    fn run(self) -> Self::Out;
}

impl Kernel {
    /// The normative path.
    pub const SCALAR: Kernel = Kernel(Path::Scalar);

    /// The fastest path of this machine.
    pub fn detect() -> Kernel {
        Kernel::paths().last().unwrap_or(Kernel::SCALAR)
    }

    /// All paths that this machine can run, the slowest first.
    pub fn paths() -> impl Iterator<Item = Kernel> {
        #[cfg(target_arch = "x86_64")]
        let vector = {
            let found = detect::found();
            [found.avx2.then_some(Path::Avx2), found.avx512.then_some(Path::Avx512)]
        };
        #[cfg(target_arch = "aarch64")]
        let vector = [Some(Path::Neon), has_dot().then_some(Path::NeonDot)];
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        let vector = [None];
        [Some(Path::Scalar)].into_iter().chain(vector).flatten().map(Kernel)
    }

    /// The fastest path of an aarch64 processor with these capabilities, for programs without `std`, where
    /// [`Kernel::detect`] cannot ask for them.
    ///
    /// # Safety
    /// `hwcap` must be what the kernel of the running system gives as AT_HWCAP (`getauxval(16)`).
    #[cfg(target_arch = "aarch64")]
    #[allow(unsafe_code)]
    pub const unsafe fn of_hwcap(hwcap: u64) -> Kernel {
        if hwcap & HWCAP_ASIMDDP != 0 { Kernel(Path::NeonDot) } else { Kernel(Path::Neon) }
    }

    /// Name for reports.
    pub fn name(self) -> &'static str {
        match self.0 {
            Path::Scalar => "scalar",
            #[cfg(target_arch = "x86_64")]
            Path::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Path::Avx512 => "avx512",
            #[cfg(target_arch = "aarch64")]
            Path::Neon => "neon",
            #[cfg(target_arch = "aarch64")]
            Path::NeonDot => "neon-dot",
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
            // SAFETY: `Kernel` holds this path only where the processor has AVX-512 BW and VNNI; lengths as above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx512 => unsafe { avx512::project(job, out) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon => unsafe { neon::project(job, out) },
            // SAFETY: `Kernel` holds this path only where the processor has `sdot`; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::NeonDot => unsafe { neon_dot::project(job, out) },
        }
    }

    /// Relights a tile: sums U by the coefficients and scales, adds the sun and what `linear` holds, and shows the
    /// result through the tone curve. Each byte of the job is read once, each pixel written once.
    ///
    /// # Panics
    /// If the slices' lengths contradict each other, or a unit is out of range.
    pub fn relight(self, job: &Reconstruction<'_>, linear: Linear<'_>, shown: Option<Shown<'_>>) -> Extent {
        check(job, &linear, shown.as_ref());
        match self.0 {
            Path::Scalar => scalar::relight(job, linear, shown),
            // SAFETY: `Kernel` holds this path only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 => unsafe { avx2::relight(job, linear, shown) },
            // SAFETY: `Kernel` holds this path only where the processor has AVX-512 BW and VNNI; lengths as above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx512 => unsafe { avx512::relight(job, linear, shown) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon => unsafe { neon::relight(job, linear, shown) },
            // SAFETY: `Kernel` holds this path only where the processor has `sdot`; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::NeonDot => unsafe { neon_dot::relight(job, linear, shown) },
        }
    }

    /// Codes of one patch in one tile, `[3][pixels]` R G B, out of its strips ([`crate::wayback`]); only the lowest 8 bits
    /// of each.
    ///
    /// # Panics
    /// If `codes` has no room for just that many, `pixels` is no multiple of 16, or the strips end early.
    pub fn unpack_rows(self, strips: &[u8], pixels: usize, codes: &mut [u8]) {
        assert!(pixels.is_multiple_of(16) && codes.len() == 3 * pixels);
        match self.0 {
            Path::Scalar => rows::unpack_scalar(strips, pixels, codes),
            // SAFETY: `Kernel` holds these paths only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 | Path::Avx512 => unsafe { rows::unpack_avx2(strips, pixels, codes) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon | Path::NeonDot => unsafe { rows::unpack_neon(strips, pixels, codes) },
        }
    }

    /// `plane[c][x] += (sum of code[c][x]^2 * unit[c] over the lights) * row[c][x]`, each operation rounded by itself, in the
    /// order of the lights. `rows` are the row scales as [`Reconstruction`] has them.
    ///
    /// # Panics
    /// If the slices' lengths contradict each other or are no multiple of 16.
    pub fn add_rows(self, lights: &[RowsLight<'_>], rows: &[u8], planes: [&mut [f32]; 3]) {
        let n = planes[0].len();
        assert!(n.is_multiple_of(16) && planes.iter().all(|plane| plane.len() == n) && rows.len() == 6 * n);
        assert!(lights.iter().all(|light| light.codes.len() == 3 * n));
        match self.0 {
            Path::Scalar => rows::add_scalar(lights, rows, planes),
            // SAFETY: `Kernel` holds these paths only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 | Path::Avx512 => unsafe { rows::add_avx2(lights, rows, planes) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon | Path::NeonDot => unsafe { rows::add_neon(lights, rows, planes) },
        }
    }

    /// Adds the view behind pixels that are covered partly, by 255ths, to their linear values: per channel the light of the
    /// view's code times the share that is free. For a multiple of 16 pixels.
    ///
    /// # Panics
    /// If the slices' lengths differ or are no multiple of 16.
    pub fn add_view(self, view_xrgb: &[u32], coverage: &[u8], light: &ViewLight, planes: [&mut [f32]; 3]) {
        let n = view_xrgb.len();
        assert!(n.is_multiple_of(16) && coverage.len() == n && planes.iter().all(|plane| plane.len() == n));
        match self.0 {
            Path::Scalar => view::scalar(view_xrgb, coverage, light, planes),
            // SAFETY: `Kernel` holds these paths only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 | Path::Avx512 => unsafe { view::avx2(view_xrgb, coverage, light, planes) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon | Path::NeonDot => unsafe { view::neon(view_xrgb, coverage, light, planes) },
        }
    }

    /// Multiplies the view's linear light by factors, given by their logarithms ([`crate::shade`]), in place. For a multiple of
    /// 16 pixels, 0x00RRGGBB.
    ///
    /// # Panics
    /// If the slices' lengths differ or are no multiple of 16.
    pub fn shade(self, pixels_xrgb: &mut [u32], log_factors: [&[u16]; 3]) {
        let n = pixels_xrgb.len();
        assert!(n.is_multiple_of(16) && log_factors.iter().all(|plane| plane.len() == n));
        match self.0 {
            Path::Scalar => shade::scalar(pixels_xrgb, log_factors),
            // SAFETY: `Kernel` holds these paths only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 | Path::Avx512 => unsafe { shade::avx2(pixels_xrgb, log_factors) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon | Path::NeonDot => unsafe { shade::neon(pixels_xrgb, log_factors) },
        }
    }

    /// Runs plain loops that were compiled for this path's registers: the same steps, so the same bits, in less time.
    #[inline]
    pub fn widely<L: Loops>(self, work: L) -> L::Out {
        match self.0 {
            // SAFETY: `Kernel` holds these paths only where the processor has AVX2.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 | Path::Avx512 => unsafe { avx2::widely(work) },
            // Every aarch64 has NEON, and plain loops use it anyway.
            _ => work.run(),
        }
    }

    /// Asks for values that will be read soon; changes nothing but the time it takes.
    pub fn prefetch<T: Copy>(self, values: &[T]) {
        match self.0 {
            Path::Scalar => {}
            #[cfg(target_arch = "x86_64")]
            Path::Avx2 | Path::Avx512 => avx2::prefetch(values),
            #[cfg(target_arch = "aarch64")]
            Path::Neon | Path::NeonDot => neon::prefetch(values),
        }
    }

    /// The same for values that follow each other over a page or more: x86-64 processors see that for themselves, and a
    /// frame takes 4 % longer when told.
    pub fn prefetch_stream<T: Copy>(self, values: &[T]) {
        if cfg!(not(target_arch = "x86_64")) {
            self.prefetch(values);
        }
    }

    /// Linear values (1 = display white) to 0x00RRGGBB by [`crate::tone::code`], for a multiple of 16 pixels.
    ///
    /// # Panics
    /// If the slices' lengths differ or are no multiple of 16.
    pub fn tone(self, linear: [&[f32]; 3], out_xrgb: &mut [u32]) {
        let n = out_xrgb.len();
        assert!(n.is_multiple_of(16) && linear.iter().all(|plane| plane.len() == n));
        match self.0 {
            Path::Scalar => scalar::tone(linear, out_xrgb),
            // SAFETY: `Kernel` holds this path only where the processor has AVX2; the lengths were checked above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx2 => unsafe { avx2::tone(linear, out_xrgb) },
            // SAFETY: `Kernel` holds this path only where the processor has AVX-512 BW and VNNI; lengths as above.
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            Path::Avx512 => unsafe { avx512::tone(linear, out_xrgb) },
            // SAFETY: NEON is part of the aarch64 baseline; the lengths were checked above.
            #[cfg(target_arch = "aarch64")]
            #[allow(unsafe_code)]
            Path::Neon | Path::NeonDot => unsafe { neon::tone(linear, out_xrgb) },
        }
    }
}

/// Linux's bit for `sdot` in AT_HWCAP (arch/arm64/include/uapi/asm/hwcap.h).
#[cfg(target_arch = "aarch64")]
const HWCAP_ASIMDDP: u64 = 1 << 20;

/// Has this processor `sdot`? Without `std` nobody can tell.
#[cfg(target_arch = "aarch64")]
fn has_dot() -> bool {
    #[cfg(any(test, feature = "std"))]
    return std::arch::is_aarch64_feature_detected!("dotprod");
    #[cfg(not(any(test, feature = "std")))]
    false
}

/// What the unsafe paths rely on.
fn check(job: &Reconstruction<'_>, linear: &Linear<'_>, shown: Option<&Shown<'_>>) {
    let (n, pairs) = (job.pixels, job.pairs[0].len());
    assert!(n.is_multiple_of(16) && job.covered <= n && job.u.len() >= pairs * n * 2 && job.rows.len() == 6 * n);
    assert!(job.pairs.iter().all(|p| p.len() == pairs));
    let in_range = |units: &[f32; 3]| units.iter().all(|unit| (0.0..=UNIT_LIMIT).contains(unit));
    assert!(in_range(&job.unit) && job.sun.is_none_or(|(plane, unit)| plane.len() == 3 * n && in_range(&unit)));
    match linear {
        Linear::Skip => {}
        Linear::Write(planes) | Linear::Add(planes) => assert!(planes.iter().all(|plane| plane.len() == n)),
    }
    if let Some(shown) = shown {
        let need = (n / TILE_PX).saturating_sub(1) * shown.stride + n.min(TILE_PX);
        assert!(shown.stride >= TILE_PX && shown.pixels_xrgb.len() >= need);
    }
}

#[cfg(test)]
mod tests;
