#ifndef RELUME_H
#define RELUME_H

/* Relume's core as a C library. Made by cbindgen: change src/types.rs or src/interface.rs, not this.
 *
 * What every function asks of its caller: pointers are null or point to what they say, of the length they say, and stay
 * so during the call; the field's bytes and the object's memory stay where they are, unchanged by others, from
 * relume_open until relume_close. Lengths, strides, alignments, codes and numbers are checked.
 *
 * Different objects may be used by different threads at once; the library has no state of its own. What threads may do
 * with one object is said at each function. */

#include <stddef.h>
#include <stdint.h>

// Version of this interface, the number in `librelume.so.1`. Give it to `relume_open`.
#define RELUME_ABI_VERSION 1

// The memory of an object begins at a multiple of this many bytes (`malloc` of a 64-bit system gives that).
#define RELUME_MEMORY_ALIGN 16

// Rows of pixels in a band: what `relume_trace_sun` and `relume_relight` count in.
#define RELUME_BAND_PX 16

// Four bytes, 0x00RRGGBB in the machine's byte order (little-endian: B, G, R, 0): DRM_FORMAT_XRGB8888.
#define RELUME_FORMAT_XRGB8888 0

// Four bytes, 0xAARRGGBB, colours premultiplied by alpha = coverage: DRM_FORMAT_ARGB8888, for an overlay plane that
// the display hardware blends over the view.
#define RELUME_FORMAT_ARGB8888 1

// Two bytes, 5 + 6 + 5 bits, each channel rounded to its nearest code: DRM_FORMAT_RGB565.
#define RELUME_FORMAT_RGB565 2

// Four bytes, 2 + 10 + 10 + 10 bits, 8-bit codes widened (no finer steps than those): DRM_FORMAT_XRGB2101010.
#define RELUME_FORMAT_XRGB2101010 3

// Frame flag: draws every tile, because what was drawn before is no longer in the buffer.
#define RELUME_FRAME_REDRAW 1

// What a call came to. Whatever failed changed nothing.
typedef enum relume_error {
    // Done.
    RELUME_ERROR_NONE = 0,
    // A pointer that must not be null is.
    RELUME_ERROR_NULL_POINTER = 1,
    // The program was compiled against a header of another interface version.
    RELUME_ERROR_ABI_VERSION = 2,
    // Memory or a buffer is shorter than it must be.
    RELUME_ERROR_TOO_SHORT = 3,
    // A pointer or stride is not a multiple of what it must be.
    RELUME_ERROR_ALIGNMENT = 4,
    // Not an open object: never opened, closed, or moved.
    RELUME_ERROR_HANDLE = 5,
    // The bytes are not a Relume field.
    RELUME_ERROR_NOT_A_FIELD = 6,
    // A field of a version that this library does not read.
    RELUME_ERROR_FIELD_VERSION = 7,
    // The field is cut short.
    RELUME_ERROR_FIELD_TRUNCATED = 8,
    // The field is damaged: a checksum does not fit, or its parts contradict each other.
    RELUME_ERROR_FIELD_DAMAGED = 9,
    // The field needs something that this library does not know.
    RELUME_ERROR_FIELD_UNSUPPORTED = 10,
    // Not as many radiances as the field has patches.
    RELUME_ERROR_COUNT = 11,
    // A radiance is NaN, infinite or negative.
    RELUME_ERROR_RADIANCE = 12,
    // The sun's irradiance is NaN, infinite or negative, or its direction is not a unit vector.
    RELUME_ERROR_SUN = 13,
    // The exposure is NaN, infinite or not positive.
    RELUME_ERROR_EXPOSURE = 14,
    // The sun is up, but its light has not been traced once: call `relume_trace_sun` first.
    RELUME_ERROR_SUN_UNTRACED = 15,
    // The bands are not of this picture.
    RELUME_ERROR_BANDS = 16,
    // Rows overlap: the stride is less than a row.
    RELUME_ERROR_STRIDE = 17,
    // An unknown pixel format.
    RELUME_ERROR_FORMAT = 18,
    // An unknown flag.
    RELUME_ERROR_FLAGS = 19,
    // A view where none can be used (premultiplied format), or one that overlaps the buffer drawn on.
    RELUME_ERROR_VIEW = 20,
    // An error budget that is not more than 0.55 codes, or is asked of a field without bounds.
    RELUME_ERROR_BUDGET = 21,
} relume_error;

// An open field that relights, in the caller's memory.
typedef struct relume relume;

// A field's facts.
typedef struct relume_field_info {
    // Picture width, px.
    uint32_t width;
    // Picture height, px.
    uint32_t height;
    // Bands of RELUME_BAND_PX rows; the last may have fewer.
    uint32_t bands;
    // Tiles of 16 x 16 px in each band.
    uint32_t tiles_per_band;
    // Most rectangles that one band of a frame can report as damaged.
    uint32_t damage_per_band;
    // Patches of the sky, both hemispheres.
    uint32_t patches;
    // Patches above the horizon; they come first.
    uint32_t upper_patches;
    // Pixels with coverage.
    uint32_t covered_px;
    // Relative RMSE that the bake aimed at, a fraction.
    float error_target;
    // Where true north lies, degrees from -Z towards +X.
    float north_deg;
    // Vertical field of view, degrees.
    float fov_y_deg;
    // Eye, world metres (+Y up).
    float position_m[3];
    // A point in the middle of the picture, world metres.
    float target_m[3];
    // World direction that is up in the picture.
    float up[3];
    // Latitude of the site whose suns the field answers, degrees; NaN: any sun.
    float site_latitude_deg;
    // Its longitude, degrees; NaN: any sun.
    float site_longitude_deg;
} relume_field_info;

// One direction cell of the sky.
typedef struct relume_patch {
    // Unit direction towards its centroid, world.
    float dir_world[3];
    // Solid angle, sr.
    float solid_angle_sr;
} relume_patch;

// The light of one moment. All numbers are linear, Rec.709.
typedef struct relume_light {
    // Mean radiance of each patch: R, G, B of patch 0, of patch 1, ...; 3 * `patches` numbers.
    const float *radiance_rgb;
    // Patches given: as many as the field has.
    uint32_t patches;
    // Radiance times this is display white at 1.
    float exposure;
    // Unit direction towards the sun, world. Not looked at while the irradiance is 0; below the horizon: no sun.
    float sun_dir_world[3];
    // The sun's irradiance on a plane normal to its direction, R G B; all 0: no sun.
    float sun_irradiance[3];
} relume_light;

// Where a frame is drawn, and over what.
typedef struct relume_frame {
    // Top left pixel of the picture, a multiple of a pixel's bytes. Only written, never read.
    void *pixels;
    // Bytes that may be written from `pixels` on.
    size_t length;
    // Bytes from row to row, a multiple of a pixel's bytes.
    size_t stride;
    // RELUME_FORMAT_...
    uint32_t format;
    // 0 or RELUME_FRAME_REDRAW.
    uint32_t flags;
    // The real view behind, 0x00RRGGBB, the picture's size, a multiple of 4; null: black, or, with premultiplied
    // alpha, nothing.
    const uint32_t *view;
    // Bytes that may be read from `view` on.
    size_t view_length;
    // Bytes from row to row of the view, a multiple of 4.
    size_t view_stride;
    // Another number with each new picture in `view`: tiles that show it are drawn when the number changes.
    uint64_t view_sequence;
} relume_frame;

// A rectangle of the picture, px.
typedef struct relume_rect {
    // Left edge.
    uint32_t x;
    // Upper edge.
    uint32_t y;
    // Width.
    uint32_t width;
    // Height.
    uint32_t height;
} relume_rect;

// What a call of `relume_relight` did. `damage` and `damage_capacity` are the caller's, the rest is filled in.
typedef struct relume_report {
    // Room for rectangles, may be null.
    struct relume_rect *damage;
    // Rectangles that `damage` has room for. With fewer than needed the last one grows over all that is left.
    uint32_t damage_capacity;
    // Rectangles written: together they hold every pixel that was written.
    uint32_t damage_count;
    // Tiles written that show geometry.
    uint32_t tiles_drawn;
    // Tiles with geometry left as they were: they would change by less than half a code.
    uint32_t tiles_kept;
    // Tiles without geometry.
    uint32_t tiles_empty;
    // Tiles with geometry whose sunlight is still that of an earlier direction of the sun.
    uint32_t tiles_sun_stale;
    // Patches without light: not read.
    uint32_t patches_dark;
    // Patches that outshine the sky, shown by rows of their own.
    uint32_t patches_apart;
    // How right these bands are now: no linear value (1 = display white) of the sky's light is further from that of the
    // uncompressed response than this, whatever the light. NaN: the field was baked without bounds.
    float bound_linear;
    // The same in 8-bit codes, rounding included, before they are brought to a smaller format; where coverage is
    // partial, premultiplied ones may be half a code further. NaN: the field was baked without bounds.
    float bound_codes;
} relume_report;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The interface version of the library that is running: RELUME_ABI_VERSION of its own header.
uint32_t relume_abi_version(void);

// What an error code means and what to do, one line, for ever valid. Any number may be given.
const char *relume_error_text(uint32_t error);

// Says in `*memory_length` how many bytes `relume_open` needs for this field. Checks the whole field, as that does.
//
// # Safety
// `field` is null or holds `field_length` readable bytes; `memory_length` is null or writable.
enum relume_error relume_memory_size(const void *field, size_t field_length, size_t *memory_length);

// Opens a field in the caller's memory; `*object` is then what all other functions take, in the dark as yet.
//
// `abi_version` is RELUME_ABI_VERSION. `field` is the whole file, mapped or read; it is checked here (one reading of
// it) and read until `relume_close`. `memory` is a multiple of RELUME_MEMORY_ALIGN, `memory_length` at least what
// `relume_memory_size` says.
//
// # Safety
// `field` is null or holds `field_length` readable bytes, and nobody changes them until the object is closed; `memory`
// is null or `memory_length` writable bytes that nobody else touches until then; `object` is null or writable.
enum relume_error relume_open(uint32_t abi_version,
                              const void *field,
                              size_t field_length,
                              void *memory,
                              size_t memory_length,
                              struct relume **object);

// Closes an object: nothing is freed, but field and memory are the caller's again and the handle is refused.
//
// # Safety
// `object` is null or came from `relume_open`, its memory is still there, and nobody uses it meanwhile.
enum relume_error relume_close(struct relume *object);

// Writes the field's facts to `*info`.
//
// # Safety
// `object` is null or came from `relume_open`, its memory is still there, and nobody changes its light meanwhile;
// `info` is null or writable.
enum relume_error relume_info(const struct relume *object, struct relume_field_info *info);

// Writes all patches, in the order of radiances, to `patches`, which has room for `capacity`.
//
// # Safety
// As `relume_info`; `patches` is null or `capacity` of them may be written.
enum relume_error relume_patches(const struct relume *object, struct relume_patch *patches, uint32_t capacity);

// Writes coverage, a byte per pixel, 255 = whole, 0 = no geometry, to rows `stride` bytes apart.
//
// # Safety
// As `relume_info`; `coverage` is null or `length` bytes may be written.
enum relume_error relume_coverage(const struct relume *object, uint8_t *coverage, size_t length, size_t stride);

// Takes the light of a moment for the frames that follow. Costs little, unless the sun is up in another direction than
// the last one that was up: this call then looks at the sun from every bounce point of the field (at most 65,536
// rays), and the bands must be traced anew (`relume_trace_sun`).
//
// # Safety
// `object` is null or came from `relume_open`, its memory is still there, and nobody else uses it meanwhile; `light` is
// null or readable, and `radiance_rgb` in it null or 3 * `patches` readable numbers.
enum relume_error relume_set_light(struct relume *object, const struct relume_light *light);

// Traces the light of the sun's newest direction in `bands` bands from `first_band` on, where that was not done yet:
// the expensive part of a sun that moves. Until then those bands show the sun where it was.
//
// Several threads may trace bands of their own at once.
//
// # Safety
// `object` is null or came from `relume_open`, and its memory is still there; meanwhile nobody sets its light, relights
// any of it, or traces one of these bands.
enum relume_error relume_trace_sun(struct relume *object, uint32_t first_band, uint32_t bands);

// Draws what has changed in `bands` bands from `first_band` on into the caller's buffer, and reports what it did in
// `*report` unless that is null.
//
// A tile stays as it is if it was drawn into this buffer before (same address, stride and format), over this view (same
// address, stride and sequence), and the newest light would change it by less than half a code. The report says how
// right the bands are, with all that was left as it was.
//
// Several threads may relight bands of their own at once, each with a report of its own.
//
// # Safety
// `object` is null or came from `relume_open`, and its memory is still there; meanwhile nobody sets its light, traces
// any of it, or relights one of these bands. `frame` is null or readable, and its buffers are what it says; the view
// stays still, and nobody else writes these bands' pixels. `report` is null or readable and writable, with room at
// `damage` for `damage_capacity` rectangles unless that is null.
enum relume_error relume_relight(struct relume *object,
                                 const struct relume_frame *frame,
                                 uint32_t first_band,
                                 uint32_t bands,
                                 struct relume_report *report);

// Allows an error of at most `codes` 8-bit codes from the next light on, as bound in reports; 0: whatever it comes to, as in
// the beginning. Every tile is drawn anew. A budget is kept to by `relume_restore`.
//
// # Safety
// `object` is null or came from `relume_open`, its memory is still there, and nobody else uses it meanwhile.
enum relume_error relume_set_error_budget(struct relume *object,
                                          float codes);

// Takes more of the field where the frame drawn last is further off than the error budget allows, and writes to `*blocks` how
// many blocks of 2 x 2 tiles that concerns. Relight all bands and call again until there are none: then the frame is
// within the budget, or the field has no more (its report says so).
//
// # Safety
// As `relume_set_error_budget`; `blocks` is null or writable.
enum relume_error relume_restore(struct relume *object,
                                 uint32_t *blocks);

// Tells the library what the processor can do beyond what every processor of its kind can, and makes it use that from the next
// call on: `hwcap` is what `getauxval(AT_HWCAP)` gives on 64-bit Arm Linux, where a program without an operating system's help
// cannot ask for it (with `sdot` frames take less time there). Pictures are the same, bit for bit. Other processors are asked
// by the library itself, and `hwcap` is ignored there.
//
// # Safety
// `object` is null or came from `relume_open`, its memory is still there, and nobody else uses it meanwhile; every core that
// it is used on can do what `hwcap` says.
enum relume_error relume_use_processor(struct relume *object,
                                       uint64_t hwcap);

// The name of the instructions in use, for reports: `scalar`, `avx2`, `avx512`, `neon` or `neon-dot`, for ever valid; NULL
// without an open object.
//
// # Safety
// As `relume_info`.
const char *relume_processor_name(const struct relume *object);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* RELUME_H */
