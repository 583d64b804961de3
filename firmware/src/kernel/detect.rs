//! Does this x86-64 processor (and its system) have AVX2? `core` has no answer of its own without `std`.

use core::arch::x86_64::{__cpuid, __cpuid_count, _xgetbv};

/// Leaf 7 names AVX2; OSXSAVE and XCR0 say whether the system keeps the wide registers.
pub fn has_avx2() -> bool {
    if __cpuid(0).eax < 7 {
        return false;
    }
    let (osxsave, avx) = (1 << 27, 1 << 28);
    if __cpuid(1).ecx & (osxsave | avx) != osxsave | avx {
        return false;
    }
    // SAFETY: OSXSAVE is set, so XGETBV is allowed.
    let kept = unsafe { xcr0() };
    kept & 6 == 6 && __cpuid_count(7, 0).ebx & (1 << 5) != 0
}

/// # Safety
/// The processor must report OSXSAVE.
#[target_feature(enable = "xsave")]
unsafe fn xcr0() -> u64 {
    // SAFETY: the caller has checked OSXSAVE.
    unsafe { _xgetbv(0) }
}
