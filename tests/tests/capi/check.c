/* Checks of the C library: check errors|frames|skipping|threads FIELD [FOLDER]. Silent when all is well. */
#include "check.h"

bytes read_bytes(const char *path) {
    FILE *file = fopen(path, "rb");
    EXPECT(file && fseek(file, 0, SEEK_END) == 0);
    bytes all = {NULL, (size_t)ftell(file)};
    rewind(file);
    EXPECT((all.data = malloc(all.length)) != NULL);
    EXPECT(fread(all.data, 1, all.length, file) == all.length);
    fclose(file);
    return all;
}

void write_bytes(const char *folder, const char *name, const void *data, size_t length) {
    char path[512];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "wb");
    EXPECT(file && fwrite(data, 1, length, file) == length && fclose(file) == 0);
}

opened open_field(bytes field) {
    opened it;
    memset(&it, 0, sizeof it);
    DONE(relume_memory_size(field.data, field.length, &it.memory_length));
    it.memory = malloc(it.memory_length + 64);
    memset(it.memory, 0x5a, it.memory_length + 64);
    DONE(relume_open(RELUME_ABI_VERSION, field.data, field.length, it.memory, it.memory_length, &it.object));
    DONE(relume_info(it.object, &it.info));
    it.radiance = calloc(it.info.patches, 3 * sizeof(float));
    return it;
}

void close_field(opened *it) {
    for (size_t k = 0; k < 64; k++) {
        EXPECT(it->memory[it->memory_length + k] == 0x5a);
    }
    DONE(relume_close(it->object));
    free(it->memory);
    free(it->radiance);
}

/* Light that a test in another language can make too: all numbers are exact. */
void make_light(opened *it, unsigned seed) {
    for (unsigned patch = 0; patch < it->info.patches; patch++) {
        for (unsigned c = 0; c < 3; c++) {
            float value = (float)((patch * 7 + c * 13 + seed * 31) % 64) / 64.0f;
            int outshines = seed % 5 == 4 && patch % 9 == 3; /* as the sky around the sun does */
            it->radiance[3 * patch + c] = outshines ? 32.0f + 8.0f * value : value;
        }
    }
    it->light.radiance_rgb = it->radiance;
    it->light.patches = it->info.patches;
    it->light.exposure = 0.5f;
    float dir[3] = {0.48f, 0.64f, seed % 2 ? 0.6f : -0.6f};
    for (unsigned c = 0; c < 3; c++) {
        it->light.sun_dir_world[c] = dir[c];
        it->light.sun_irradiance[c] = seed % 3 ? 2.0f - 0.25f * (float)c : 0.0f;
    }
}

void shine(opened *it, unsigned seed) {
    make_light(it, seed);
    DONE(relume_set_light(it->object, &it->light));
}

enum { MARGIN = 64, FILL = 0xa5 };

canvas make_canvas(const opened *it, uint32_t format) {
    canvas on;
    memset(&on, 0, sizeof on);
    size_t pixel = format == RELUME_FORMAT_RGB565 ? 2 : 4;
    on.row_bytes = pixel * it->info.width;
    on.frame.stride = on.row_bytes + 12;
    on.frame.length = on.frame.stride * (it->info.height - 1) + on.row_bytes;
    on.frame.format = format;
    on.length = on.frame.length + 2 * MARGIN;
    on.data = malloc(on.length);
    memset(on.data, FILL, on.length);
    on.frame.pixels = on.data + MARGIN;
    return on;
}

/* Nothing is written before, after, or between the rows. */
void check_margins(const opened *it, const canvas *on) {
    for (size_t k = 0; k < on->length; k++) {
        int in_row = 0;
        if (k >= MARGIN && k - MARGIN < on->frame.length) {
            in_row = (k - MARGIN) % on->frame.stride < on->row_bytes;
        }
        EXPECT(in_row || on->data[k] == FILL);
    }
    EXPECT(on->frame.length / on->frame.stride + 1 == it->info.height);
}

void write_canvas(const opened *it, const canvas *on, const char *folder, const char *name) {
    unsigned char *tight = malloc(on->row_bytes * it->info.height);
    for (size_t y = 0; y < it->info.height; y++) {
        memcpy(tight + y * on->row_bytes, on->data + MARGIN + y * on->frame.stride, on->row_bytes);
    }
    write_bytes(folder, name, tight, on->row_bytes * it->info.height);
    free(tight);
}

uint32_t *make_view(const opened *it) {
    uint32_t pixels = it->info.width * it->info.height;
    uint32_t *view = malloc(4 * (size_t)pixels);
    for (uint32_t k = 0; k < pixels; k++) {
        view[k] = k * 7919 & 0xffffff;
    }
    return view;
}

void show_view(const opened *it, canvas *on, const uint32_t *view, uint64_t sequence) {
    on->frame.view = view;
    on->frame.view_stride = 4 * (size_t)it->info.width;
    on->frame.view_length = on->frame.view_stride * it->info.height;
    on->frame.view_sequence = sequence;
}

int main(int argc, char **argv) {
    EXPECT(argc == 4);
    bytes field = read_bytes(argv[2]);
    if (strcmp(argv[1], "errors") == 0) {
        check_errors(field);
    } else if (strcmp(argv[1], "frames") == 0) {
        check_frames(field, argv[3]);
    } else if (strcmp(argv[1], "skipping") == 0) {
        check_skipping(field);
    } else {
        EXPECT(strcmp(argv[1], "threads") == 0);
        check_threads(field);
    }
    free(field.data);
    return 0;
}
