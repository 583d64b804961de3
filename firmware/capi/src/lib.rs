//! Relume's core as a C library, for displays that bring their own program: `librelume.a`, `librelume.so`, `relume.h`.
//!
//! `no_std`, no allocation, no threads, no global state: memory, field and picture are the caller's. The page for
//! those who link it is `README.md` beside this crate; [`interface`] has the functions, [`types`] what they take.
#![cfg_attr(not(test), no_std)]

mod block_state;
#[allow(unsafe_code)]
pub mod budget;
mod damage;
mod frame;
#[allow(unsafe_code)]
pub mod interface;
mod level;
#[allow(unsafe_code)]
mod memory;
mod object;
mod pixel;
#[allow(unsafe_code)]
pub mod processor;
mod tile_state;
pub mod types;

/// A library that is linked by itself must say what a panic does. None is reachable (a field is checked when it is
/// opened, and so is every pointer's claim); should one be after all, the program ends here and now.
#[cfg(all(feature = "alone", not(test)))]
#[panic_handler]
#[allow(unsafe_code)]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: an undefined instruction ends the program by a signal and touches nothing.
    unsafe {
        core::arch::asm!("ud2", options(noreturn, nomem, nostack))
    }
    #[cfg(target_arch = "aarch64")]
    // SAFETY: as above.
    unsafe {
        core::arch::asm!("udf #0", options(noreturn, nomem, nostack))
    }
    #[allow(unreachable_code)]
    loop {}
}
