//! An object in the caller's memory: the shared part, then a state per tile, then the sun's response plane.

use crate::object::Relighting;
use crate::tile_state::TileState;
use crate::types::{RELUME_MEMORY_ALIGN, RelumeError};
use core::ops::Range;
use relume_firmware::field::Field;

/// An open field that relights, in the caller's memory.
pub struct Relume {
    /// Its own address while it is open: tells an object from anything else, also from its own copy.
    itself: usize,
    relighting: Relighting,
    states: *mut TileState,
    plane: *mut u16,
}

const _: () = assert!(align_of::<Relume>() <= RELUME_MEMORY_ALIGN && align_of::<TileState>() <= RELUME_MEMORY_ALIGN);

/// Byte offsets of the parts.
#[derive(Clone, Copy)]
pub struct Layout {
    states_at: usize,
    plane_at: usize,
    /// Length of all, bytes.
    pub length: usize,
}

impl Layout {
    /// For this field; `None` if no machine of this kind could hold it.
    pub fn new(field: &Field<'_>) -> Option<Self> {
        let response = field.response();
        let aligned = |bytes: usize| bytes.checked_next_multiple_of(RELUME_MEMORY_ALIGN);
        let states_at = aligned(size_of::<Relume>())?;
        let plane_at = aligned(response.tiles().checked_mul(size_of::<TileState>())?.checked_add(states_at)?)?;
        let length = aligned(response.plane_len().checked_mul(2)?.checked_add(plane_at)?)?;
        isize::try_from(length).ok()?;
        Some(Layout { states_at, plane_at, length })
    }
}

/// Makes an object at `memory`.
///
/// # Safety
/// `memory` is aligned to [`RELUME_MEMORY_ALIGN`] and may be written over `layout.length` bytes, and `layout` is the
/// field's.
pub unsafe fn open(memory: *mut u8, layout: Layout, field: Field<'static>) -> *mut Relume {
    let object: *mut Relume = memory.cast();
    let response = field.response();
    // SAFETY: the parts lie in the memory one after the other, each aligned, by `Layout::new`.
    unsafe {
        let states: *mut TileState = memory.add(layout.states_at).cast();
        let plane: *mut u16 = memory.add(layout.plane_at).cast();
        for index in 0..response.tiles() {
            states.add(index).write(TileState::new(&field, index));
        }
        plane.write_bytes(0, response.plane_len());
        object.write(Relume { itself: object as usize, relighting: Relighting::new(field), states, plane });
    }
    object
}

/// Checks a handle as far as that can be done.
fn check(object: *const Relume) -> Result<(), RelumeError> {
    if object.is_null() {
        return Err(RelumeError::NullPointer);
    }
    if !(object as usize).is_multiple_of(RELUME_MEMORY_ALIGN) {
        return Err(RelumeError::Alignment);
    }
    Ok(())
}

impl Relume {
    /// The object behind a handle.
    ///
    /// # Errors
    /// If it is null, misaligned or not open.
    ///
    /// # Safety
    /// Unless null, `object` points to memory of an object, open or closed; nobody changes its shared part for `'a`.
    pub unsafe fn get<'a>(object: *const Relume) -> Result<&'a Relume, RelumeError> {
        check(object)?;
        // SAFETY: aligned as checked, readable by this function's contract; read before anything else is believed.
        let itself = unsafe { (&raw const (*object).itself).read() };
        if itself != object as usize {
            return Err(RelumeError::Handle);
        }
        // SAFETY: `open` has written an object here, and it was not closed since.
        Ok(unsafe { &*object })
    }

    /// The same, to change its shared part.
    ///
    /// # Errors
    /// If it is null, misaligned or not open.
    ///
    /// # Safety
    /// As [`Relume::get`], and nobody else uses the object for `'a`.
    pub unsafe fn get_mut<'a>(object: *mut Relume) -> Result<&'a mut Relume, RelumeError> {
        // SAFETY: this function's contract holds what `get` asks.
        unsafe { Relume::get(object) }?;
        // SAFETY: an open object as checked, used by nobody else by this function's contract.
        Ok(unsafe { &mut *object })
    }

    /// The shared part.
    pub fn relighting(&self) -> &Relighting {
        &self.relighting
    }

    /// The shared part, to change it.
    pub fn relighting_mut(&mut self) -> &mut Relighting {
        &mut self.relighting
    }

    /// Ends the object: its handle is refused from now on.
    pub fn close(&mut self) {
        self.itself = 0;
    }

    /// The bands of a call, if the picture has them.
    ///
    /// # Errors
    /// [`RelumeError::Bands`].
    pub fn bands(&self, first: u32, count: u32) -> Result<Range<usize>, RelumeError> {
        let all = self.relighting.field().response().grid().1;
        let end = (first as usize).checked_add(count as usize).filter(|&end| end <= all).ok_or(RelumeError::Bands)?;
        Ok(first as usize..end)
    }

    /// States of a band's tiles, `band` being one of [`Relume::bands`].
    ///
    /// # Safety
    /// Nobody else uses this band's states for the lifetime of the result.
    #[allow(clippy::mut_from_ref)]
    pub unsafe fn states(&self, band: usize) -> &mut [TileState] {
        let columns = self.relighting.field().response().grid().0;
        // SAFETY: `open` wrote a state for every tile; bands' ranges are apart; used once by this function's contract.
        unsafe { core::slice::from_raw_parts_mut(self.states.add(band * columns), columns) }
    }

    /// A band's part of the sun's response plane, and its place in it.
    ///
    /// # Safety
    /// Nobody else uses this part of the plane for the lifetime of the result.
    #[allow(clippy::mut_from_ref)]
    pub unsafe fn slots(&self, band: usize) -> &mut [u16] {
        let slots = self.relighting.slots_of(band);
        // SAFETY: the slots lie in the plane, which `open` has filled, because the field was checked; bands' slots are
        // apart; used once by this function's contract.
        unsafe { core::slice::from_raw_parts_mut(self.plane.add(slots.start), slots.len()) }
    }

    /// The sun's response plane.
    ///
    /// # Safety
    /// Nobody changes it for the lifetime of the result.
    pub unsafe fn plane(&self) -> &[u16] {
        let length = self.relighting.field().response().plane_len();
        // SAFETY: `open` has filled the plane; still by this function's contract.
        unsafe { core::slice::from_raw_parts(self.plane, length) }
    }
}
