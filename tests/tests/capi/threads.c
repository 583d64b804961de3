/* Two objects in two threads, and two threads on the bands of one, show what one thread shows. */
#include "check.h"
#include <limits.h>
#include <pthread.h>

/* Opening holds a list of directions for a moment; all else needs little. */
enum { FRAMES = 12, STACK = 64 * 1024, STACK_TO_OPEN = 256 * 1024 };

typedef struct job {
    bytes field;
    opened *it;
    canvas *on;
    unsigned seed;
    uint32_t first_band, bands;
} job;

/* A row of skies on an object of its own; the last picture stays. */
static void *skies(void *given) {
    job *own = given;
    opened it = open_field(own->field);
    *own->on = make_canvas(&it, RELUME_FORMAT_XRGB8888);
    for (unsigned frame = 0; frame < FRAMES; frame++) {
        shine(&it, own->seed + frame);
        DONE(relume_trace_sun(it.object, 0, it.info.bands));
        DONE(relume_relight(it.object, &own->on->frame, 0, it.info.bands, NULL));
    }
    close_field(&it);
    return NULL;
}

static void *trace(void *given) {
    job *own = given;
    DONE(relume_trace_sun(own->it->object, own->first_band, own->bands));
    return NULL;
}

static void *draw(void *given) {
    job *own = given;
    relume_rect rects[64];
    relume_report report = {0};
    report.damage = rects;
    report.damage_capacity = 64;
    DONE(relume_relight(own->it->object, &own->on->frame, own->first_band, own->bands, &report));
    return NULL;
}

static void both(void *(*work)(void *), job *jobs, size_t stack) {
    pthread_t threads[2];
    pthread_attr_t attributes;
    EXPECT(pthread_attr_init(&attributes) == 0);
    size_t least = PTHREAD_STACK_MIN;
    EXPECT(pthread_attr_setstacksize(&attributes, stack > least ? stack : least) == 0);
    for (int k = 0; k < 2; k++) {
        EXPECT(pthread_create(&threads[k], &attributes, work, &jobs[k]) == 0);
    }
    for (int k = 0; k < 2; k++) {
        EXPECT(pthread_join(threads[k], NULL) == 0);
    }
}

void check_threads(bytes field) {
    canvas alone[2], together[2];
    job one[2] = {{field, NULL, &alone[0], 1, 0, 0}, {field, NULL, &alone[1], 2, 0, 0}};
    job two[2] = {{field, NULL, &together[0], 1, 0, 0}, {field, NULL, &together[1], 2, 0, 0}};
    skies(&one[0]);
    skies(&one[1]);
    both(skies, two, STACK_TO_OPEN);
    EXPECT(memcmp(alone[0].data, alone[1].data, alone[0].length) != 0);
    for (int k = 0; k < 2; k++) {
        EXPECT(memcmp(alone[k].data, together[k].data, alone[k].length) == 0);
    }

    opened it = open_field(field);
    canvas shared = make_canvas(&it, RELUME_FORMAT_XRGB8888);
    EXPECT(it.info.bands >= 2);
    job halves[2] = {{field, &it, &shared, 0, 0, 1}, {field, &it, &shared, 0, 1, it.info.bands - 1}};
    for (unsigned frame = 0; frame < FRAMES; frame++) {
        shine(&it, 1 + frame);
        both(trace, halves, STACK);
        both(draw, halves, STACK);
    }
    EXPECT(memcmp(shared.data, alone[0].data, shared.length) == 0);
    close_field(&it);
    free(shared.data);
    for (int k = 0; k < 2; k++) {
        free(alone[k].data);
        free(together[k].data);
    }
}
