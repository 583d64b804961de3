/* Relights a field into a framebuffer of its own and writes that as a PPM picture.
 *
 *   relight FIELD W.csv EV OUT.ppm [VIEW.ppm]
 *
 * W.csv: a header, then x,y,z,solid_angle_sr,r,g,b per patch, the sun last (as `relume sky weights` writes it).
 * EV: radiance times 2^EV is display white at 1. VIEW.ppm: the picture behind, P6, of the field's size.
 */
#include <math.h>
#include <relume.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void fail(const char *what, const char *why) {
    fprintf(stderr, "relight: %s: %s\n", what, why);
    exit(2);
}

static void check(const char *what, relume_error error) {
    if (error != RELUME_ERROR_NONE) {
        fail(what, relume_error_text(error));
    }
}

static void *memory(size_t length) {
    void *bytes = malloc(length ? length : 1);
    if (!bytes) {
        fail("memory", "not enough");
    }
    return bytes;
}

/* A program on a board would map the file; any bytes in memory will do. */
static void *read_file(const char *path, size_t *length) {
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END) != 0) {
        fail(path, "cannot be read");
    }
    long end = ftell(file);
    rewind(file);
    *length = end < 0 ? 0 : (size_t)end;
    void *bytes = memory(*length);
    if (fread(bytes, 1, *length, file) != *length) {
        fail(path, "cannot be read");
    }
    fclose(file);
    return bytes;
}

/* Fills in the light but for its exposure. `radiance` has room for `patches` patches. */
static void read_light(const char *path, float *radiance, uint32_t patches, relume_light *light) {
    FILE *file = fopen(path, "r");
    char line[512];
    if (!file || !fgets(line, sizeof line, file)) {
        fail(path, "cannot be read");
    }
    memset(light, 0, sizeof *light); /* no irradiance: no sun */
    light->radiance_rgb = radiance;
    light->patches = patches;
    for (uint32_t row = 0; row <= patches && fgets(line, sizeof line, file); row++) {
        float value[7];
        char *at = line;
        for (int column = 0; column < 7; column++) {
            value[column] = strtof(at, &at);
            at += *at == ',';
        }
        if (row < patches) {
            memcpy(radiance + 3 * row, value + 4, 3 * sizeof(float));
        } else {
            memcpy(light->sun_dir_world, value, sizeof light->sun_dir_world);
            memcpy(light->sun_irradiance, value + 4, sizeof light->sun_irradiance);
        }
    }
    fclose(file);
}

static uint32_t *read_view(const char *path, uint32_t width, uint32_t height) {
    size_t length, pixels = (size_t)width * height;
    unsigned char *bytes = read_file(path, &length);
    char header[64];
    int start = snprintf(header, sizeof header, "P6\n%u %u\n255\n", width, height);
    if (length != (size_t)start + 3 * pixels || memcmp(bytes, header, (size_t)start) != 0) {
        fail(path, "not a P6 picture of the field's size");
    }
    uint32_t *view = memory(4 * pixels);
    for (size_t k = 0; k < pixels; k++) {
        const unsigned char *rgb = bytes + start + 3 * k;
        view[k] = (uint32_t)rgb[0] << 16 | (uint32_t)rgb[1] << 8 | rgb[2];
    }
    free(bytes);
    return view;
}

static void write_picture(const char *path, const uint32_t *pixels, uint32_t width, uint32_t height, size_t stride) {
    FILE *file = fopen(path, "wb");
    if (!file) {
        fail(path, "cannot be written");
    }
    fprintf(file, "P6\n%u %u\n255\n", width, height);
    for (uint32_t y = 0; y < height; y++) {
        for (uint32_t x = 0; x < width; x++) {
            uint32_t word = pixels[y * (stride / 4) + x];
            unsigned char rgb[3] = {(unsigned char)(word >> 16), (unsigned char)(word >> 8), (unsigned char)word};
            fwrite(rgb, 1, 3, file);
        }
    }
    if (fclose(file) != 0) {
        fail(path, "cannot be written");
    }
}

/* A framebuffer with rows a little apart, as display memory often has them. */
static relume_frame make_frame(const relume_field_info *info, const uint32_t *view) {
    relume_frame frame = {0};
    frame.stride = ((size_t)info->width * 4 + 255) / 256 * 256;
    frame.length = frame.stride * info->height;
    frame.pixels = memory(frame.length);
    frame.format = RELUME_FORMAT_XRGB8888;
    frame.view = view;
    frame.view_stride = (size_t)info->width * 4;
    frame.view_length = frame.view_stride * info->height;
    return frame;
}

int main(int argc, char **argv) {
    if (argc != 5 && argc != 6) {
        fail("usage", "relight FIELD W.csv EV OUT.ppm [VIEW.ppm]");
    }
    size_t field_length, memory_length;
    void *field = read_file(argv[1], &field_length);
    check(argv[1], relume_memory_size(field, field_length, &memory_length));
    void *room = memory(memory_length);
    relume *object;
    check(argv[1], relume_open(RELUME_ABI_VERSION, field, field_length, room, memory_length, &object));
    relume_field_info info;
    check(argv[1], relume_info(object, &info));

    float *radiance = memory(3 * sizeof(float) * info.patches);
    relume_light light;
    memset(radiance, 0, 3 * sizeof(float) * info.patches);
    read_light(argv[2], radiance, info.patches, &light);
    light.exposure = (float)exp2(strtod(argv[3], NULL));
    check(argv[2], relume_set_light(object, &light));
    check(argv[2], relume_trace_sun(object, 0, info.bands)); /* nothing to do while the sun stands still */

    uint32_t *view = argc == 6 ? read_view(argv[5], info.width, info.height) : NULL;
    relume_frame frame = make_frame(&info, view);
    relume_report report = {0};
    check(argv[1], relume_relight(object, &frame, 0, info.bands, &report));
    write_picture(argv[4], frame.pixels, info.width, info.height, frame.stride);
    printf("%ux%u px, %u of %u patches dark, %u tiles drawn, %u empty\n", info.width, info.height,
           report.patches_dark, info.patches, report.tiles_drawn, report.tiles_empty);

    check(argv[1], relume_close(object));
    free(view);
    free(frame.pixels);
    free(radiance);
    free(room);
    free(field);
    return 0;
}
