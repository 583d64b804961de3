//! An object in the caller's memory: the shared part, its large parts (the light, the sun's light on the bounce points), a
//! state per tile, a state per block, the sun's response plane.

use crate::block_state::{BandBlocks, BlockState};
use crate::level::{Level, Levels, level_count};
use crate::object::Relighting;
use crate::tile_state::TileState;
use crate::types::{RELUME_MEMORY_ALIGN, RelumeError};
use core::ops::Range;
use relume_firmware::bounce::Rgb;
use relume_firmware::field::Field;
use relume_firmware::kernel::Kernel;
use relume_firmware::tile::BLOCK_TILES;
use relume_firmware::weights::SunWeight;

/// An open field that relights, in the caller's memory.
pub struct Relume {
    /// Its own address while it is open: tells an object from anything else, also from its own copy.
    itself: usize,
    relighting: Relighting,
    states: *mut TileState,
    blocks: *mut BlockState,
    plane: *mut u16,
}

const _: () = assert!(align_of::<Relume>() <= RELUME_MEMORY_ALIGN);
const _: () = assert!(align_of::<Level>() <= RELUME_MEMORY_ALIGN);
const _: () =
    assert!(align_of::<TileState>() <= RELUME_MEMORY_ALIGN && align_of::<BlockState>() <= RELUME_MEMORY_ALIGN);

/// Byte offsets of the parts.
#[derive(Clone, Copy)]
pub struct Layout {
    levels_at: usize,
    radiance_at: usize,
    means_at: usize,
    states_at: usize,
    blocks_at: usize,
    plane_at: usize,
    /// Length of all, bytes.
    pub length: usize,
}

impl Layout {
    /// For this field; `None` if no machine of this kind could hold it.
    pub fn new(field: &Field<'_>) -> Option<Self> {
        let response = field.response();
        let aligned = |bytes: usize| bytes.checked_next_multiple_of(RELUME_MEMORY_ALIGN);
        let levels_at = aligned(size_of::<Relume>())?;
        let radiance_at = aligned(levels_at + level_count(field) * size_of::<Level>())?;
        let means_at = aligned(radiance_at + field.patch_set().len() * size_of::<[f32; 3]>())?;
        let states_at = aligned(means_len(field).checked_mul(size_of::<Rgb>())?.checked_add(means_at)?)?;
        let blocks_at = aligned(response.tiles().checked_mul(size_of::<TileState>())?.checked_add(states_at)?)?;
        let plane_at = aligned(response.blocks().checked_mul(size_of::<BlockState>())?.checked_add(blocks_at)?)?;
        let length = aligned(response.plane_len().checked_mul(2)?.checked_add(plane_at)?)?;
        isize::try_from(length).ok()?;
        Some(Layout { levels_at, radiance_at, means_at, states_at, blocks_at, plane_at, length })
    }
}

/// Values of the sun's light on the bounce points and up their tree.
fn means_len(field: &Field<'_>) -> usize {
    2 * field.bounce().points()
}

/// Writes what `make` makes to `to`, on a stack of its own, so that two large values do not lie there at once.
///
/// # Safety
/// `to` is aligned and may be written.
#[inline(never)]
unsafe fn place<T>(to: *mut T, make: impl FnOnce() -> T) {
    // SAFETY: this function's own contract.
    unsafe { to.write(make()) }
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
        let (patches, count) = (field.patch_set().len(), level_count(&field));
        let levels: *mut Level = memory.add(layout.levels_at).cast();
        (0..count).for_each(|level| place(levels.add(level), || Level::dark(patches)));
        let radiance: *mut [f32; 3] = memory.add(layout.radiance_at).cast();
        radiance.write_bytes(0, patches);
        let levels = Levels::new(
            core::slice::from_raw_parts_mut(levels, count),
            core::slice::from_raw_parts_mut(radiance, patches),
        );
        let means: *mut Rgb = memory.add(layout.means_at).cast();
        means.write_bytes(0, means_len(&field));
        let means = core::slice::from_raw_parts_mut(means, means_len(&field));
        let states: *mut TileState = memory.add(layout.states_at).cast();
        let blocks: *mut BlockState = memory.add(layout.blocks_at).cast();
        let plane: *mut u16 = memory.add(layout.plane_at).cast();
        for index in 0..response.tiles() {
            states.add(index).write(TileState::new(&response.tile(index)));
        }
        for index in 0..response.blocks() {
            blocks.add(index).write(BlockState::new());
        }
        plane.write_bytes(0, response.plane_len());
        let relighting = Relighting::new(field, levels, means);
        object.write(Relume { itself: object as usize, relighting, states, blocks, plane });
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

    /// Uses these instructions from now on.
    pub fn set_kernel(&mut self, kernel: Kernel) {
        self.relighting.set_kernel(kernel);
    }

    /// Takes the light of a moment.
    ///
    /// # Errors
    /// What is wrong with it; nothing has changed then.
    pub fn set_light(&mut self, radiance: &[[f32; 3]], sun: SunWeight, exposure: f32) -> Result<(), RelumeError> {
        if self.relighting.set_light(radiance, sun, exposure)? {
            self.all(|relighting, blocks, states| {
                let response = relighting.field().response();
                for (index, block) in blocks.iter_mut().enumerate() {
                    let lower = relighting.may_be_lower(block.level(), response.tiles_of(index).map(|t| &states[t]));
                    block.set_level(block.level() - usize::from(lower));
                    relighting.prepare(block.level());
                }
            });
        }
        Ok(())
    }

    /// Allows so much error in codes; `None`: whatever it comes to. Every tile is drawn anew.
    ///
    /// # Errors
    /// If no frame can keep to it.
    pub fn set_error_budget(&mut self, codes: Option<f32>) -> Result<(), RelumeError> {
        self.relighting.set_error_budget(codes)?;
        self.all(|_, blocks, states| {
            blocks.iter_mut().for_each(|block| block.set_level(0));
            states.iter_mut().filter(|state| !state.empty).for_each(TileState::forget);
        });
        Ok(())
    }

    /// Takes more of the way back in every block that is further off than the budget allows; how many there are.
    pub fn restore(&mut self) -> u32 {
        self.all(|relighting, blocks, states| {
            let (response, mut raised) = (*relighting.field(), 0);
            let response = response.response();
            for (index, block) in blocks.iter_mut().enumerate() {
                if relighting.must_be_higher(block.level(), response.tiles_of(index).map(|t| &states[t])) {
                    block.set_level(block.level() + 1);
                    relighting.prepare(block.level());
                    raised += 1;
                }
            }
            raised
        })
    }

    /// Works with the states of all blocks and tiles.
    fn all<R>(&mut self, work: impl FnOnce(&mut Relighting, &mut [BlockState], &mut [TileState]) -> R) -> R {
        let response = self.relighting.field().response();
        let (blocks, tiles) = (response.blocks(), response.tiles());
        // SAFETY: `open` wrote a state for every block and tile; the object is borrowed exclusively, and they belong to it.
        let (blocks, states) = unsafe {
            (core::slice::from_raw_parts_mut(self.blocks, blocks), core::slice::from_raw_parts_mut(self.states, tiles))
        };
        work(&mut self.relighting, blocks, states)
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

    /// The row of blocks that a band is part of. Its upper band owns it.
    ///
    /// # Safety
    /// Nobody else relights this band, or sets the light, for the lifetime of the result.
    pub unsafe fn blocks(&self, band: usize) -> BandBlocks<'_> {
        let columns = self.relighting.field().response().block_grid().0;
        let first = band / BLOCK_TILES * columns;
        // SAFETY: `open` wrote a state for every block, and they are changed through cells alone until the light is set.
        let blocks = unsafe { core::slice::from_raw_parts(self.blocks.add(first), columns) };
        // SAFETY: each row has one upper band, which is used once by this function's contract.
        unsafe { BandBlocks::new(blocks, band.is_multiple_of(BLOCK_TILES)) }
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
