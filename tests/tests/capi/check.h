/* What the checks of the C library share. */
#ifndef CHECK_H
#define CHECK_H
#include <relume.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One line that says where, and the end. */
#define EXPECT(truth)                                                                  \
    do {                                                                               \
        if (!(truth)) {                                                                \
            fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #truth);        \
            exit(1);                                                                   \
        }                                                                              \
    } while (0)
#define DONE(call) EXPECT((call) == RELUME_ERROR_NONE)

/* A field in memory. */
typedef struct bytes {
    unsigned char *data;
    size_t length;
} bytes;

/* An open field with the light it was given. */
typedef struct opened {
    relume *object;
    unsigned char *memory;
    size_t memory_length;
    relume_field_info info;
    float *radiance;
    relume_light light;
} opened;

/* A picture with room on all sides. */
typedef struct canvas {
    unsigned char *data;
    size_t length;
    relume_frame frame;
    size_t row_bytes;
} canvas;

bytes read_bytes(const char *path);
void write_bytes(const char *folder, const char *name, const void *data, size_t length);
opened open_field(bytes field);
void close_field(opened *it);
void make_light(opened *it, unsigned seed);
void shine(opened *it, unsigned seed);
canvas make_canvas(const opened *it, uint32_t format);
void check_margins(const opened *it, const canvas *on);
void write_canvas(const opened *it, const canvas *on, const char *folder, const char *name);
uint32_t *make_view(const opened *it);
void show_view(const opened *it, canvas *on, const uint32_t *view, uint64_t sequence);

void check_errors(bytes field);
void check_frames(bytes field, const char *folder);
void check_skipping(bytes field);
void check_threads(bytes field);
#endif
