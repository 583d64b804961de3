//! The functions of an error budget; what they ask of their caller is said in `interface`.

use crate::interface::{code, put};
use crate::memory::Relume;
use crate::types::RelumeError;

/// Allows an error of at most `codes` 8-bit codes from the next light on, as bound in reports; 0: whatever it comes to, as in
/// the beginning. Every tile is drawn anew. A budget is kept to by `relume_restore`.
///
/// # Safety
/// `object` is null or came from `relume_open`, its memory is still there, and nobody else uses it meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_set_error_budget(object: *mut Relume, codes: f32) -> RelumeError {
    // SAFETY: this function's own contract.
    code(|| unsafe { Relume::get_mut(object) }?.set_error_budget((codes != 0.0).then_some(codes)))
}

/// Takes more of the field where the frame drawn last is further off than the error budget allows, and writes to `*blocks` how
/// many blocks of 2 x 2 tiles that concerns. Relight all bands and call again until there are none: then the frame is
/// within the budget, or the field has no more (its report says so).
///
/// # Safety
/// As `relume_set_error_budget`; `blocks` is null or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_restore(object: *mut Relume, blocks: *mut u32) -> RelumeError {
    code(|| {
        if blocks.is_null() {
            return Err(RelumeError::NullPointer);
        }
        // SAFETY: this function's own contract.
        let raised = unsafe { Relume::get_mut(object) }?.restore();
        // SAFETY: this function's own contract.
        unsafe { put(blocks, raised) }
    })
}
