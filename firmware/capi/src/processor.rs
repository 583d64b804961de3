//! Which instructions the library uses; what the functions ask of their caller is said in `interface`.

use crate::interface::code;
use crate::memory::Relume;
use crate::types::RelumeError;
use core::ffi::{CStr, c_char};
use relume_firmware::kernel::Kernel;

/// Tells the library what the processor can do beyond what every processor of its kind can, and makes it use that from the next
/// call on: `hwcap` is what `getauxval(AT_HWCAP)` gives on 64-bit Arm Linux, where a program without an operating system's help
/// cannot ask for it (with `sdot` frames take less time there). Pictures are the same, bit for bit. Other processors are asked
/// by the library itself, and `hwcap` is ignored there.
///
/// # Safety
/// `object` is null or came from `relume_open`, its memory is still there, and nobody else uses it meanwhile; every core that
/// it is used on can do what `hwcap` says.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_use_processor(object: *mut Relume, hwcap: u64) -> RelumeError {
    code(|| {
        // SAFETY: this function's own contract.
        let object = unsafe { Relume::get_mut(object) }?;
        #[cfg(target_arch = "aarch64")]
        // SAFETY: the processor can do what `hwcap` says by this function's contract.
        object.set_kernel(unsafe { Kernel::of_hwcap(hwcap) });
        #[cfg(not(target_arch = "aarch64"))]
        {
            let _ = hwcap;
            object.set_kernel(Kernel::detect());
        }
        Ok(())
    })
}

/// The name of the instructions in use, for reports: `scalar`, `avx2`, `avx512`, `neon` or `neon-dot`, for ever valid; NULL
/// without an open object.
///
/// # Safety
/// As `relume_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_processor_name(object: *const Relume) -> *const c_char {
    // SAFETY: this function's own contract.
    let Ok(object) = (unsafe { Relume::get(object) }) else { return core::ptr::null() };
    let known: [&'static CStr; 5] = [c"scalar", c"avx2", c"avx512", c"neon", c"neon-dot"];
    let name = object.relighting().kernel().name().as_bytes();
    known.into_iter().find(|known| known.to_bytes() == name).map_or(core::ptr::null(), CStr::as_ptr)
}
