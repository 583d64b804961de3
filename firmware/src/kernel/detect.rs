//! What this x86-64 processor (and its system) has. `core` has no answer of its own without `std`.

use core::arch::x86_64::{__cpuid, __cpuid_count, _xgetbv};

/// Kinds of instructions.
#[derive(Clone, Copy, Default)]
pub struct Found {
    /// AVX2.
    pub avx2: bool,
    /// AVX2, and AVX-512 F, BW and VNNI.
    pub avx512: bool,
}

/// Leaf 7 names the instructions; OSXSAVE and XCR0 say whether the system keeps the wide registers.
pub fn found() -> Found {
    let (osxsave, avx) = (1 << 27, 1 << 28);
    if __cpuid(0).eax < 7 || __cpuid(1).ecx & (osxsave | avx) != osxsave | avx {
        return Found::default();
    }
    // SAFETY: OSXSAVE is set, so XGETBV is allowed.
    let kept = unsafe { xcr0() };
    let leaf = __cpuid_count(7, 0);
    let avx2 = kept & 0x06 == 0x06 && leaf.ebx & (1 << 5) != 0;
    let (f_bw, vnni) = (1 << 16 | 1 << 30, 1 << 11);
    Found { avx2, avx512: avx2 && kept & 0xe6 == 0xe6 && leaf.ebx & f_bw == f_bw && leaf.ecx & vnni != 0 }
}

/// # Safety
/// The processor must report OSXSAVE.
#[target_feature(enable = "xsave")]
unsafe fn xcr0() -> u64 {
    // SAFETY: the caller has checked OSXSAVE.
    unsafe { _xgetbv(0) }
}
