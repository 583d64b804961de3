//! What crosses the border to C: constants, codes and structures.
//!
//! A structure's layout, a code's number or a function's meaning changes only together with [`RELUME_ABI_VERSION`].

use core::ffi::c_void;
use relume_firmware::field::FieldError;
use relume_firmware::weights::WeightError;

/// Version of this interface, the number in `librelume.so.1`. Give it to `relume_open`.
pub const RELUME_ABI_VERSION: u32 = 1;
/// The memory of an object begins at a multiple of this many bytes (`malloc` of a 64-bit system gives that).
pub const RELUME_MEMORY_ALIGN: usize = 16;
/// Rows of pixels in a band: what `relume_trace_sun` and `relume_relight` count in.
pub const RELUME_BAND_PX: u32 = 16;

/// Four bytes, 0x00RRGGBB in the machine's byte order (little-endian: B, G, R, 0): DRM_FORMAT_XRGB8888.
pub const RELUME_FORMAT_XRGB8888: u32 = 0;
/// Four bytes, 0xAARRGGBB, colours premultiplied by alpha = coverage: DRM_FORMAT_ARGB8888, for an overlay plane that
/// the display hardware blends over the view.
pub const RELUME_FORMAT_ARGB8888: u32 = 1;
/// Two bytes, 5 + 6 + 5 bits, each channel rounded to its nearest code: DRM_FORMAT_RGB565.
pub const RELUME_FORMAT_RGB565: u32 = 2;
/// Four bytes, 2 + 10 + 10 + 10 bits, 8-bit codes widened (no finer steps than those): DRM_FORMAT_XRGB2101010.
pub const RELUME_FORMAT_XRGB2101010: u32 = 3;

/// Frame flag: draws every tile, because what was drawn before is no longer in the buffer.
pub const RELUME_FRAME_REDRAW: u32 = 1;

/// What a call came to. Whatever failed changed nothing.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RelumeError {
    /// Done.
    None = 0,
    /// A pointer that must not be null is.
    NullPointer = 1,
    /// The program was compiled against a header of another interface version.
    AbiVersion = 2,
    /// Memory or a buffer is shorter than it must be.
    TooShort = 3,
    /// A pointer or stride is not a multiple of what it must be.
    Alignment = 4,
    /// Not an open object: never opened, closed, or moved.
    Handle = 5,
    /// The bytes are not a Relume field.
    NotAField = 6,
    /// A field of a version that this library does not read.
    FieldVersion = 7,
    /// The field is cut short.
    FieldTruncated = 8,
    /// The field is damaged: a checksum does not fit, or its parts contradict each other.
    FieldDamaged = 9,
    /// The field needs something that this library does not know.
    FieldUnsupported = 10,
    /// Not as many radiances as the field has patches.
    Count = 11,
    /// A radiance is NaN, infinite or negative.
    Radiance = 12,
    /// The sun's irradiance is NaN, infinite or negative, or its direction is not a unit vector.
    Sun = 13,
    /// The exposure is NaN, infinite or not positive.
    Exposure = 14,
    /// The sun is up, but its light has not been traced once: call `relume_trace_sun` first.
    SunUntraced = 15,
    /// The bands are not of this picture.
    Bands = 16,
    /// Rows overlap: the stride is less than a row.
    Stride = 17,
    /// An unknown pixel format.
    Format = 18,
    /// An unknown flag.
    Flags = 19,
    /// A view where none can be used (premultiplied format), or one that overlaps the buffer drawn on.
    View = 20,
    /// An error budget that is not more than 0.55 codes, or is asked of a field without bounds.
    Budget = 21,
}

/// A field's facts.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RelumeInfo {
    /// Picture width, px.
    pub width: u32,
    /// Picture height, px.
    pub height: u32,
    /// Bands of RELUME_BAND_PX rows; the last may have fewer.
    pub bands: u32,
    /// Tiles of 16 x 16 px in each band.
    pub tiles_per_band: u32,
    /// Most rectangles that one band of a frame can report as damaged.
    pub damage_per_band: u32,
    /// Patches of the sky, both hemispheres.
    pub patches: u32,
    /// Patches above the horizon; they come first.
    pub upper_patches: u32,
    /// Pixels with coverage.
    pub covered_px: u32,
    /// Relative RMSE that the bake aimed at, a fraction.
    pub error_target: f32,
    /// Where true north lies, degrees from -Z towards +X.
    pub north_deg: f32,
    /// Vertical field of view, degrees.
    pub fov_y_deg: f32,
    /// Eye, world metres (+Y up).
    pub position_m: [f32; 3],
    /// A point in the middle of the picture, world metres.
    pub target_m: [f32; 3],
    /// World direction that is up in the picture.
    pub up: [f32; 3],
    /// Latitude of the site whose suns the field answers, degrees; NaN: any sun.
    pub site_latitude_deg: f32,
    /// Its longitude, degrees; NaN: any sun.
    pub site_longitude_deg: f32,
}

/// One direction cell of the sky.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RelumePatch {
    /// Unit direction towards its centroid, world.
    pub dir_world: [f32; 3],
    /// Solid angle, sr.
    pub solid_angle_sr: f32,
}

/// The light of one moment. All numbers are linear, Rec.709.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RelumeLight {
    /// Mean radiance of each patch: R, G, B of patch 0, of patch 1, ...; 3 * `patches` numbers.
    pub radiance_rgb: *const f32,
    /// Patches given: as many as the field has.
    pub patches: u32,
    /// Radiance times this is display white at 1.
    pub exposure: f32,
    /// Unit direction towards the sun, world. Not looked at while the irradiance is 0; below the horizon: no sun.
    pub sun_dir_world: [f32; 3],
    /// The sun's irradiance on a plane normal to its direction, R G B; all 0: no sun.
    pub sun_irradiance: [f32; 3],
}

/// Where a frame is drawn, and over what.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RelumeFrame {
    /// Top left pixel of the picture, a multiple of a pixel's bytes. Only written, never read.
    pub pixels: *mut c_void,
    /// Bytes that may be written from `pixels` on.
    pub length: usize,
    /// Bytes from row to row, a multiple of a pixel's bytes.
    pub stride: usize,
    /// RELUME_FORMAT_...
    pub format: u32,
    /// 0 or RELUME_FRAME_REDRAW.
    pub flags: u32,
    /// The real view behind, 0x00RRGGBB, the picture's size, a multiple of 4; null: black, or, with premultiplied
    /// alpha, nothing.
    pub view: *const u32,
    /// Bytes that may be read from `view` on.
    pub view_length: usize,
    /// Bytes from row to row of the view, a multiple of 4.
    pub view_stride: usize,
    /// Another number with each new picture in `view`: tiles that show it are drawn when the number changes.
    pub view_sequence: u64,
}

/// A rectangle of the picture, px.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RelumeRect {
    /// Left edge.
    pub x: u32,
    /// Upper edge.
    pub y: u32,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

/// What a call of `relume_relight` did. `damage` and `damage_capacity` are the caller's, the rest is filled in.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RelumeReport {
    /// Room for rectangles, may be null.
    pub damage: *mut RelumeRect,
    /// Rectangles that `damage` has room for. With fewer than needed the last one grows over all that is left.
    pub damage_capacity: u32,
    /// Rectangles written: together they hold every pixel that was written.
    pub damage_count: u32,
    /// Tiles written that show geometry.
    pub tiles_drawn: u32,
    /// Tiles with geometry left as they were: they would change by less than half a code.
    pub tiles_kept: u32,
    /// Tiles without geometry.
    pub tiles_empty: u32,
    /// Tiles with geometry whose sunlight is still that of an earlier direction of the sun.
    pub tiles_sun_stale: u32,
    /// Patches without light: not read.
    pub patches_dark: u32,
    /// Patches that outshine the sky, shown by rows of their own.
    pub patches_apart: u32,
    /// How right these bands are now: no linear value (1 = display white) of the sky's light is further from that of the
    /// uncompressed response than this, whatever the light. NaN: the field was baked without bounds.
    pub bound_linear: f32,
    /// The same in 8-bit codes, rounding included, before they are brought to a smaller format; where coverage is
    /// partial, premultiplied ones may be half a code further. NaN: the field was baked without bounds.
    pub bound_codes: f32,
}

impl From<FieldError> for RelumeError {
    fn from(error: FieldError) -> Self {
        match error {
            FieldError::Truncated { .. } => RelumeError::FieldTruncated,
            FieldError::NotAField => RelumeError::NotAField,
            FieldError::Version(_) => RelumeError::FieldVersion,
            FieldError::PatchSet { .. } | FieldError::Patches(_) | FieldError::UnknownLayer(_) => {
                RelumeError::FieldUnsupported
            }
            // Anything else that a field can have wrong: it was not written like this.
            _ => RelumeError::FieldDamaged,
        }
    }
}

impl From<WeightError> for RelumeError {
    fn from(error: WeightError) -> Self {
        match error {
            WeightError::Count { .. } => RelumeError::Count,
            WeightError::Radiance { .. } => RelumeError::Radiance,
            WeightError::Sun => RelumeError::Sun,
            WeightError::Exposure(_) => RelumeError::Exposure,
        }
    }
}

impl RelumeError {
    /// One line for people: what is wrong and what to do.
    pub(crate) fn text(code: u32) -> &'static core::ffi::CStr {
        match code {
            0 => c"no error",
            1 => c"a pointer that must not be null is null",
            2 => c"header and library have different interface versions; compile against the library's own header",
            3 => c"memory or a buffer is too short; ask relume_memory_size, or check length, stride and height",
            4 => c"a pointer or stride is not a multiple of what it must be",
            5 => c"not an open object: never opened, closed, or moved",
            6 => c"not a Relume field; make one with relume-bake",
            7 => c"a field of another version; use the matching release or bake again",
            8 => c"the field is cut short; copy it again",
            9 => c"the field is damaged; copy or bake it again",
            10 => c"the field needs something this library does not know; use a newer release",
            11 => c"not as many radiances as the field has patches",
            12 => c"a radiance is NaN, infinite or negative",
            13 => c"the sun needs a unit direction and finite irradiance that is not negative",
            14 => c"the exposure must be finite and positive",
            15 => c"the sun is up but was never traced; call relume_trace_sun",
            16 => c"the bands are not of this picture",
            17 => c"the stride is less than a row",
            18 => c"unknown pixel format",
            19 => c"unknown flag",
            20 => c"a view with a premultiplied format, or one that overlaps the buffer",
            21 => c"an error budget must be more than 0.55 codes, and the field must have bounds; 0 for none",
            _ => c"unknown error code",
        }
    }
}
