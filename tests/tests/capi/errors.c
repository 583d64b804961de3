/* Whatever is wrong with a call has a code of its own and changes nothing. */
#include "check.h"
#include <math.h>

#define REFUSED(code, call) EXPECT((call) == RELUME_ERROR_##code)

static void fields(bytes field) {
    size_t length;
    REFUSED(NULL_POINTER, relume_memory_size(NULL, field.length, &length));
    REFUSED(NULL_POINTER, relume_memory_size(field.data, field.length, NULL));
    REFUSED(NOT_A_FIELD, relume_memory_size(field.data, 0, &length));
    REFUSED(NOT_A_FIELD, relume_memory_size("not a field, not at all", 23, &length));
    REFUSED(FIELD_TRUNCATED, relume_memory_size(field.data, 100, &length));
    REFUSED(FIELD_TRUNCATED, relume_memory_size(field.data, field.length - 1, &length));
    REFUSED(TOO_SHORT, relume_memory_size(field.data, SIZE_MAX, &length));
    /* Every byte of the header and table, then a few all over the file. */
    for (size_t at = 0; at < field.length; at += at < 700 ? 1 : field.length / 97) {
        field.data[at] ^= 0x10;
        relume_error error = relume_memory_size(field.data, field.length, &length);
        field.data[at] ^= 0x10;
        int between_layers = error == RELUME_ERROR_NONE && field.data[at] == 0;
        EXPECT(between_layers || (error >= RELUME_ERROR_NOT_A_FIELD && error <= RELUME_ERROR_FIELD_UNSUPPORTED));
    }
}

static void opening(bytes field) {
    size_t length;
    relume *object = NULL;
    DONE(relume_memory_size(field.data, field.length, &length));
    unsigned char *memory = malloc(length + 16);
    REFUSED(ABI_VERSION, relume_open(2, field.data, field.length, memory, length, &object));
    REFUSED(NULL_POINTER, relume_open(1, NULL, field.length, memory, length, &object));
    REFUSED(NULL_POINTER, relume_open(1, field.data, field.length, NULL, length, &object));
    REFUSED(NULL_POINTER, relume_open(1, field.data, field.length, memory, length, NULL));
    REFUSED(ALIGNMENT, relume_open(1, field.data, field.length, memory + 8, length, &object));
    REFUSED(TOO_SHORT, relume_open(1, field.data, field.length, memory, length - 1, &object));
    REFUSED(FIELD_TRUNCATED, relume_open(1, field.data, field.length - 1, memory, length, &object));
    EXPECT(object == NULL);
    DONE(relume_open(1, field.data, field.length, memory, length, &object));
    DONE(relume_close(object));
    REFUSED(HANDLE, relume_close(object));
    free(memory);
}

static void handles(opened *it) {
    relume_field_info info;
    REFUSED(NULL_POINTER, relume_info(NULL, &info));
    REFUSED(NULL_POINTER, relume_info(it->object, NULL));
    REFUSED(NULL_POINTER, relume_close(NULL));
    REFUSED(NULL_POINTER, relume_trace_sun(NULL, 0, 1));
    REFUSED(NULL_POINTER, relume_set_light(NULL, &it->light));
    uint32_t blocks;
    REFUSED(NULL_POINTER, relume_use_processor(NULL, 0));
    REFUSED(NULL_POINTER, relume_set_error_budget(NULL, 2.0f));
    REFUSED(NULL_POINTER, relume_restore(NULL, &blocks));
    REFUSED(NULL_POINTER, relume_restore(it->object, NULL));
    const float budgets[] = {0.55f, -1.0f, NAN};
    for (int k = 0; k < 3; k++) {
        REFUSED(BUDGET, relume_set_error_budget(it->object, budgets[k]));
    }
    DONE(relume_restore(it->object, &blocks));
    EXPECT(blocks == 0); /* there is no budget */
    REFUSED(ALIGNMENT, relume_info((relume *)(it->memory + 1), &info));
    unsigned char *copy = malloc(it->memory_length);
    memcpy(copy, it->memory, it->memory_length);
    REFUSED(HANDLE, relume_info((relume *)copy, &info));
    free(copy);
    relume_patch patches[2000];
    REFUSED(NULL_POINTER, relume_patches(it->object, NULL, 2000));
    REFUSED(TOO_SHORT, relume_patches(it->object, patches, it->info.patches - 1));
    size_t pixels = (size_t)it->info.width * it->info.height;
    unsigned char *coverage = malloc(pixels);
    REFUSED(NULL_POINTER, relume_coverage(it->object, NULL, pixels, it->info.width));
    REFUSED(TOO_SHORT, relume_coverage(it->object, coverage, pixels - 1, it->info.width));
    REFUSED(STRIDE, relume_coverage(it->object, coverage, pixels, it->info.width - 1));
    free(coverage);
}

static void lights(opened *it) {
    make_light(it, 1);
    relume_light bad = it->light;
    bad.patches--;
    REFUSED(COUNT, relume_set_light(it->object, &bad));
    bad = it->light;
    bad.radiance_rgb = NULL;
    REFUSED(NULL_POINTER, relume_set_light(it->object, &bad));
    const float values[] = {NAN, INFINITY, -1.0f};
    for (int k = 0; k < 3; k++) {
        float kept = it->radiance[5];
        it->radiance[5] = values[k];
        REFUSED(RADIANCE, relume_set_light(it->object, &it->light));
        it->radiance[5] = kept;
        bad = it->light;
        bad.exposure = values[k];
        REFUSED(EXPOSURE, relume_set_light(it->object, &bad));
        bad = it->light;
        bad.sun_irradiance[1] = values[k];
        REFUSED(SUN, relume_set_light(it->object, &bad));
        bad = it->light;
        bad.sun_dir_world[1] = values[k];
        REFUSED(SUN, relume_set_light(it->object, &bad));
    }
    REFUSED(NULL_POINTER, relume_set_light(it->object, NULL));
}

static void frames(opened *it) {
    canvas on = make_canvas(it, RELUME_FORMAT_XRGB8888);
    uint32_t bands = it->info.bands;
    shine(it, 1);
    REFUSED(SUN_UNTRACED, relume_relight(it->object, &on.frame, 0, bands, NULL));
    REFUSED(BANDS, relume_trace_sun(it->object, 0, bands + 1));
    REFUSED(BANDS, relume_trace_sun(it->object, UINT32_MAX, 2));
    DONE(relume_trace_sun(it->object, 0, bands));
    REFUSED(BANDS, relume_relight(it->object, &on.frame, 1, bands, NULL));
    REFUSED(NULL_POINTER, relume_relight(it->object, NULL, 0, bands, NULL));
#define BAD_FRAME(code, change)                                                        \
    do {                                                                               \
        relume_frame frame = on.frame;                                                 \
        change;                                                                        \
        REFUSED(code, relume_relight(it->object, &frame, 0, bands, NULL));             \
    } while (0)
    uint32_t *view = make_view(it);
    BAD_FRAME(NULL_POINTER, frame.pixels = NULL);
    BAD_FRAME(TOO_SHORT, frame.length--);
    BAD_FRAME(TOO_SHORT, frame.stride = SIZE_MAX / 8 * 4);
    BAD_FRAME(STRIDE, frame.stride = on.row_bytes - 4);
    BAD_FRAME(ALIGNMENT, frame.stride++);
    BAD_FRAME(ALIGNMENT, frame.pixels = on.data + 2);
    BAD_FRAME(FORMAT, frame.format = 99);
    BAD_FRAME(FLAGS, frame.flags = 6);
    show_view(it, &on, view, 1);
    BAD_FRAME(TOO_SHORT, frame.view_length--);
    BAD_FRAME(STRIDE, frame.view_stride -= 4);
    BAD_FRAME(ALIGNMENT, frame.view_stride++);
    BAD_FRAME(VIEW, frame.view = (uint32_t *)frame.pixels);
    BAD_FRAME(VIEW, frame.format = RELUME_FORMAT_ARGB8888);
    for (size_t k = 0; k < on.length; k++) {
        EXPECT(on.data[k] == 0xa5); /* nothing was drawn by what was refused */
    }
    DONE(relume_relight(it->object, &on.frame, 0, bands, NULL));
    free(view);
    free(on.data);
}

void check_errors(bytes field) {
    EXPECT(relume_abi_version() == RELUME_ABI_VERSION);
    for (uint32_t code = 0; code <= RELUME_ERROR_BUDGET; code++) {
        EXPECT(strcmp(relume_error_text(code), relume_error_text(UINT32_MAX)) != 0);
    }
    fields(field);
    opening(field);
    opened it = open_field(field);
    handles(&it);
    lights(&it);
    frames(&it);
    close_field(&it);
}
