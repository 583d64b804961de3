//! The functions of the library.
//!
//! What every function asks of its caller: pointers are null or point to what they say, of the length they say, and
//! stay so during the call; the field's bytes and the object's memory stay where they are, unchanged by others, from
//! `relume_open` until `relume_close`. Lengths, strides, alignments, codes and numbers are checked.

use crate::damage::Damage;
use crate::frame::Frame;
use crate::memory::{Layout, Relume, open};
use crate::object::Tally;
use crate::types::{
    RELUME_ABI_VERSION, RELUME_BAND_PX, RELUME_MEMORY_ALIGN, RelumeError, RelumeFrame, RelumeInfo, RelumeLight,
    RelumePatch, RelumeRect, RelumeReport,
};
use core::ffi::{c_char, c_void};
use relume_firmware::field::Field;
use relume_firmware::tile::TILE_PX;
use relume_firmware::weights::SunWeight;

const _: () = assert!(RELUME_BAND_PX as usize == TILE_PX);

/// The outcome of a C function's work.
pub(crate) fn code(work: impl FnOnce() -> Result<(), RelumeError>) -> RelumeError {
    work().err().unwrap_or(RelumeError::None)
}

/// `length` values at `pointer`.
///
/// # Safety
/// Unless null, `pointer` may be read over `length` values, which nobody changes for `'a`.
unsafe fn slice<'a, T>(pointer: *const T, length: usize) -> Result<&'a [T], RelumeError> {
    if pointer.is_null() {
        return Err(RelumeError::NullPointer);
    }
    if !pointer.is_aligned() {
        return Err(RelumeError::Alignment);
    }
    if length > isize::MAX as usize / size_of::<T>() {
        return Err(RelumeError::TooShort);
    }
    // SAFETY: not null, aligned, of a possible length; the rest is this function's contract.
    Ok(unsafe { core::slice::from_raw_parts(pointer, length) })
}

/// A value at `pointer`.
///
/// # Safety
/// Unless null, `pointer` may be read as a `T` that nobody changes for `'a`.
unsafe fn value<'a, T>(pointer: *const T) -> Result<&'a T, RelumeError> {
    // SAFETY: a slice of one, with the same contract.
    unsafe { slice(pointer, 1) }.map(|values| &values[0])
}

/// Writes `value` to `pointer`.
///
/// # Safety
/// Unless null, `pointer` may be written as a `T`.
pub(crate) unsafe fn put<T>(pointer: *mut T, value: T) -> Result<(), RelumeError> {
    if pointer.is_null() {
        return Err(RelumeError::NullPointer);
    }
    if !pointer.is_aligned() {
        return Err(RelumeError::Alignment);
    }
    // SAFETY: not null and aligned; writable by this function's contract.
    unsafe { pointer.write(value) };
    Ok(())
}

/// The interface version of the library that is running: RELUME_ABI_VERSION of its own header.
#[unsafe(no_mangle)]
pub extern "C" fn relume_abi_version() -> u32 {
    RELUME_ABI_VERSION
}

/// What an error code means and what to do, one line, for ever valid. Any number may be given.
#[unsafe(no_mangle)]
pub extern "C" fn relume_error_text(error: u32) -> *const c_char {
    RelumeError::text(error).as_ptr()
}

/// Says in `*memory_length` how many bytes `relume_open` needs for this field. Checks the whole field, as that does.
///
/// # Safety
/// `field` is null or holds `field_length` readable bytes; `memory_length` is null or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_memory_size(
    field: *const c_void,
    field_length: usize,
    memory_length: *mut usize,
) -> RelumeError {
    code(|| {
        // SAFETY: this function's own contract.
        let bytes = unsafe { slice(field.cast::<u8>(), field_length) }?;
        let layout = Layout::new(&Field::new(bytes)?).ok_or(RelumeError::FieldUnsupported)?;
        // SAFETY: this function's own contract.
        unsafe { put(memory_length, layout.length) }
    })
}

/// Opens a field in the caller's memory; `*object` is then what all other functions take, in the dark as yet.
///
/// `abi_version` is RELUME_ABI_VERSION. `field` is the whole file, mapped or read; it is checked here (one reading of
/// it) and read until `relume_close`. `memory` is a multiple of RELUME_MEMORY_ALIGN, `memory_length` at least what
/// `relume_memory_size` says.
///
/// # Safety
/// `field` is null or holds `field_length` readable bytes, and nobody changes them until the object is closed; `memory`
/// is null or `memory_length` writable bytes that nobody else touches until then; `object` is null or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_open(
    abi_version: u32,
    field: *const c_void,
    field_length: usize,
    memory: *mut c_void,
    memory_length: usize,
    object: *mut *mut Relume,
) -> RelumeError {
    code(|| {
        if abi_version != RELUME_ABI_VERSION {
            return Err(RelumeError::AbiVersion);
        }
        if memory.is_null() || object.is_null() {
            return Err(RelumeError::NullPointer);
        }
        if !(memory as usize).is_multiple_of(RELUME_MEMORY_ALIGN) || !object.is_aligned() {
            return Err(RelumeError::Alignment);
        }
        // SAFETY: this function's own contract; the bytes live until the object is closed.
        let bytes: &'static [u8] = unsafe { slice(field.cast::<u8>(), field_length) }?;
        let field = Field::new(bytes)?;
        let layout = Layout::new(&field).ok_or(RelumeError::FieldUnsupported)?;
        if memory_length < layout.length {
            return Err(RelumeError::TooShort);
        }
        // SAFETY: aligned and long enough as checked, writable by this function's contract; the layout is the field's.
        let opened = unsafe { open(memory.cast(), layout, field) };
        // SAFETY: this function's own contract.
        unsafe { put(object, opened) }
    })
}

/// Closes an object: nothing is freed, but field and memory are the caller's again and the handle is refused.
///
/// # Safety
/// `object` is null or came from `relume_open`, its memory is still there, and nobody uses it meanwhile.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_close(object: *mut Relume) -> RelumeError {
    // SAFETY: this function's own contract.
    code(|| unsafe { Relume::get_mut(object) }.map(Relume::close))
}

/// Writes the field's facts to `*info`.
///
/// # Safety
/// `object` is null or came from `relume_open`, its memory is still there, and nobody changes its light meanwhile;
/// `info` is null or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_info(object: *const Relume, info: *mut RelumeInfo) -> RelumeError {
    code(|| {
        // SAFETY: this function's own contract.
        let object = unsafe { Relume::get(object) }?;
        // SAFETY: this function's own contract.
        unsafe { put(info, facts(object.relighting().field())) }
    })
}

/// The report's room for rectangles; none without one.
///
/// # Safety
/// As `relume_relight` asks of `report`.
unsafe fn room<'a>(report: *mut RelumeReport) -> Result<&'a mut [RelumeRect], RelumeError> {
    if report.is_null() {
        return Ok(&mut []);
    }
    // SAFETY: not null, and readable by this function's contract.
    let report = unsafe { value(report.cast_const()) }?;
    if report.damage.is_null() {
        return Ok(&mut []);
    }
    let length = report.damage_capacity as usize;
    // SAFETY: not null; readable, and thus of a possible length, by this function's contract.
    unsafe { slice(report.damage.cast_const(), length) }?;
    // SAFETY: aligned and of a possible length, as `slice` has checked; writable by this function's contract.
    Ok(unsafe { core::slice::from_raw_parts_mut(report.damage, length) })
}

fn facts(field: &Field<'_>) -> RelumeInfo {
    let (header, camera, set) = (field.header(), field.camera(), field.patch_set());
    let (columns, bands) = field.response().grid();
    let [site_latitude_deg, site_longitude_deg] = header.site.unwrap_or([f32::NAN; 2]);
    RelumeInfo {
        width: header.width,
        height: header.height,
        bands: bands as u32,
        tiles_per_band: columns as u32,
        damage_per_band: columns.div_ceil(2) as u32,
        patches: set.len() as u32,
        upper_patches: set.upper() as u32,
        covered_px: header.covered,
        error_target: header.error_target,
        north_deg: camera.north_deg,
        fov_y_deg: camera.fov_y_deg,
        position_m: camera.position,
        target_m: camera.target,
        up: camera.up,
        site_latitude_deg,
        site_longitude_deg,
    }
}

/// Writes all patches, in the order of radiances, to `patches`, which has room for `capacity`.
///
/// # Safety
/// As `relume_info`; `patches` is null or `capacity` of them may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_patches(
    object: *const Relume,
    patches: *mut RelumePatch,
    capacity: u32,
) -> RelumeError {
    code(|| {
        // SAFETY: this function's own contract.
        let set = unsafe { Relume::get(object) }?.relighting().field().patch_set();
        if patches.is_null() {
            return Err(RelumeError::NullPointer);
        }
        if (capacity as usize) < set.len() {
            return Err(RelumeError::TooShort);
        }
        for patch in 0..set.len() {
            let cell = RelumePatch { dir_world: set.dir_world(patch), solid_angle_sr: set.solid_angle_sr(patch) };
            // SAFETY: below the capacity, all of which may be written by this function's contract.
            unsafe { put(patches.add(patch), cell) }?;
        }
        Ok(())
    })
}

/// Writes coverage, a byte per pixel, 255 = whole, 0 = no geometry, to rows `stride` bytes apart.
///
/// # Safety
/// As `relume_info`; `coverage` is null or `length` bytes may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_coverage(
    object: *const Relume,
    coverage: *mut u8,
    length: usize,
    stride: usize,
) -> RelumeError {
    code(|| {
        // SAFETY: this function's own contract.
        let field = unsafe { Relume::get(object) }?.relighting().field();
        let (width, height) = (field.width(), field.height());
        if coverage.is_null() {
            return Err(RelumeError::NullPointer);
        }
        if stride < width {
            return Err(RelumeError::Stride);
        }
        let need = (height - 1).checked_mul(stride).and_then(|rows| rows.checked_add(width));
        need.filter(|&need| need <= length).ok_or(RelumeError::TooShort)?;
        let columns = field.response().grid().0;
        for y in 0..height {
            // SAFETY: this row's pixels lie within the length checked above, which may be written.
            unsafe { coverage.add(y * stride).write_bytes(0, width) };
        }
        for index in 0..field.response().tiles() {
            let (x0, y0) = (index % columns * TILE_PX, index / columns * TILE_PX);
            let shares = field.coverage(index);
            for (k, pixel) in field.response().tile(index).covered().enumerate() {
                let (x, y) = (x0 + pixel % TILE_PX, y0 + pixel / TILE_PX);
                // SAFETY: a covered pixel lies in the picture, because the field was checked.
                unsafe { coverage.add(y * stride + x).write(shares.map_or(255, |shares| shares[k])) };
            }
        }
        Ok(())
    })
}

/// Takes the light of a moment for the frames that follow. Costs little, unless the sun is up in another direction than
/// the last one that was up: this call then looks at the sun from every bounce point of the field (at most 65,536
/// rays), and the bands must be traced anew (`relume_trace_sun`).
///
/// # Safety
/// `object` is null or came from `relume_open`, its memory is still there, and nobody else uses it meanwhile; `light` is
/// null or readable, and `radiance_rgb` in it null or 3 * `patches` readable numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_set_light(object: *mut Relume, light: *const RelumeLight) -> RelumeError {
    code(|| {
        // SAFETY: this function's own contract.
        let (object, light) = unsafe { (Relume::get_mut(object)?, value(light)?) };
        // SAFETY: this function's own contract; [f32; 3] is three f32 one after the other.
        let radiance = unsafe { slice(light.radiance_rgb.cast::<[f32; 3]>(), light.patches as usize) }?;
        let sun = SunWeight { dir_world: light.sun_dir_world, irradiance: light.sun_irradiance };
        object.set_light(radiance, sun, light.exposure)
    })
}

/// Traces the light of the sun's newest direction in `bands` bands from `first_band` on, where that was not done yet:
/// the expensive part of a sun that moves. Until then those bands show the sun where it was.
///
/// Several threads may trace bands of their own at once.
///
/// # Safety
/// `object` is null or came from `relume_open`, and its memory is still there; meanwhile nobody sets its light, relights
/// any of it, or traces one of these bands.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_trace_sun(object: *mut Relume, first_band: u32, bands: u32) -> RelumeError {
    code(|| {
        // SAFETY: this function's own contract.
        let object = unsafe { Relume::get(object) }?;
        for band in object.bands(first_band, bands)? {
            // SAFETY: this function's own contract: these bands are this call's.
            let (states, slots) = unsafe { (object.states(band), object.slots(band)) };
            object.relighting().trace_band(band, states, slots);
        }
        Ok(())
    })
}

/// Draws what has changed in `bands` bands from `first_band` on into the caller's buffer, and reports what it did in
/// `*report` unless that is null.
///
/// A tile stays as it is if it was drawn into this buffer before (same address, stride and format), over this view (same
/// address, stride and sequence), and the newest light would change it by less than half a code. The report says how
/// right the bands are, with all that was left as it was.
///
/// Several threads may relight bands of their own at once, each with a report of its own.
///
/// # Safety
/// `object` is null or came from `relume_open`, and its memory is still there; meanwhile nobody sets its light, traces
/// any of it, or relights one of these bands. `frame` is null or readable, and its buffers are what it says; the view
/// stays still, and nobody else writes these bands' pixels. `report` is null or readable and writable, with room at
/// `damage` for `damage_capacity` rectangles unless that is null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn relume_relight(
    object: *mut Relume,
    frame: *const RelumeFrame,
    first_band: u32,
    bands: u32,
    report: *mut RelumeReport,
) -> RelumeError {
    code(|| {
        // SAFETY: this function's own contract.
        let (object, frame) = unsafe { (Relume::get(object)?, value(frame)?) };
        let (relighting, bands) = (object.relighting(), object.bands(first_band, bands)?);
        // SAFETY: this function's own contract.
        let frame = unsafe { Frame::new(frame, (relighting.field().width(), relighting.field().height())) }?;
        // SAFETY: this function's own contract: these bands are this call's. The slices do not outlive the expression.
        if bands.clone().any(|band| relighting.lacks_sun(unsafe { object.states(band) })) {
            return Err(RelumeError::SunUntraced);
        }
        // SAFETY: this function's own contract.
        let mut damage = Damage::new(unsafe { room(report) }?);
        let mut tally = Tally::default();
        for band in bands {
            // SAFETY: this function's own contract: these bands are this call's, and nobody traces.
            let (states, blocks, plane) = unsafe { (object.states(band), object.blocks(band), object.plane()) };
            tally = tally.plus(relighting.relight_band(band, (states, blocks, plane), &frame, &mut damage));
        }
        let count = damage.count() as u32;
        // SAFETY: `room` has checked the pointer; readable and writable by this function's contract.
        if let Some(report) = unsafe { report.as_mut() } {
            report.damage_count = count;
            report.tiles_drawn = tally.drawn;
            report.tiles_kept = tally.kept;
            report.tiles_empty = tally.empty;
            report.tiles_sun_stale = tally.sun_stale;
            report.patches_dark = relighting.patches_dark() as u32;
            report.patches_apart = relighting.patches_apart() as u32;
            (report.bound_linear, report.bound_codes) = relighting.known_bound(tally);
        }
        Ok(())
    })
}
