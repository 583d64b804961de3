/* Frames in each format for the caller to compare; what is skipped, and that damage tells all that was written. */
#include "check.h"
#if defined(__aarch64__)
#include <sys/auxv.h>
#endif

static void formats(bytes field, const char *folder) {
    const char *names[] = {"xrgb8888", "argb8888", "rgb565", "xrgb2101010"};
    for (uint32_t format = 0; format < 4; format++) {
        for (int with_view = 0; with_view < (format == RELUME_FORMAT_ARGB8888 ? 1 : 2); with_view++) {
            opened it = open_field(field);
            shine(&it, 1);
            DONE(relume_trace_sun(it.object, 0, it.info.bands));
            canvas on = make_canvas(&it, format);
            uint32_t *view = make_view(&it);
            if (with_view) {
                show_view(&it, &on, view, 1);
            }
            DONE(relume_relight(it.object, &on.frame, 0, it.info.bands, NULL));
            check_margins(&it, &on);
            char name[64];
            snprintf(name, sizeof name, "%s%s.raw", names[format], with_view ? "-view" : "");
            write_canvas(&it, &on, folder, name);
            free(view);
            free(on.data);
            close_field(&it);
        }
    }
}

/* Ordinary light, and light with patches that outshine the sky; what the report says of them. */
static void lights(bytes field, const char *folder) {
    for (unsigned seed = 1; seed <= 4; seed += 3) {
        opened it = open_field(field);
        shine(&it, seed);
        DONE(relume_trace_sun(it.object, 0, it.info.bands));
        canvas on = make_canvas(&it, RELUME_FORMAT_XRGB8888);
        uint32_t *view = make_view(&it);
        show_view(&it, &on, view, 1);
        relume_report report = {0};
        DONE(relume_relight(it.object, &on.frame, 0, it.info.bands, &report));
        char name[64];
        snprintf(name, sizeof name, "light-%u.raw", seed);
        write_canvas(&it, &on, folder, name);
        struct { uint32_t apart; float linear, codes; } told = {report.patches_apart, report.bound_linear, report.bound_codes};
        snprintf(name, sizeof name, "bound-%u.raw", seed);
        write_bytes(folder, name, &told, sizeof told);
        free(view);
        free(on.data);
        close_field(&it);
    }
}

/* Pictures are the same by whatever instructions. */
static void processors(bytes field) {
    opened it = open_field(field);
    canvas on[2];
    EXPECT(relume_processor_name(NULL) == NULL && relume_processor_name(it.object) != NULL);
    for (int told = 0; told < 2; told++) {
        if (told) {
            uint64_t hwcap = 0;
#if defined(__aarch64__)
            hwcap = getauxval(AT_HWCAP);
            EXPECT(strcmp(relume_processor_name(it.object), "neon") == 0);
#endif
            DONE(relume_use_processor(it.object, hwcap));
#if defined(__aarch64__)
            EXPECT(strcmp(relume_processor_name(it.object), hwcap >> 20 & 1 ? "neon-dot" : "neon") == 0);
#endif
        }
        shine(&it, 4);
        DONE(relume_trace_sun(it.object, 0, it.info.bands));
        on[told] = make_canvas(&it, RELUME_FORMAT_XRGB8888);
        DONE(relume_relight(it.object, &on[told].frame, 0, it.info.bands, NULL));
    }
    EXPECT(memcmp(on[0].data, on[1].data, on[0].length) == 0);
    free(on[0].data);
    free(on[1].data);
    close_field(&it);
}

/* Frames within an error budget: more light apart, less, and more again; the caller makes the same of the same lights. */
static void budgets(bytes field, const char *folder) {
    opened it = open_field(field);
    if (relume_set_error_budget(it.object, 2.0f) == RELUME_ERROR_BUDGET) {
        close_field(&it);
        return; /* a field without bounds */
    }
    canvas on = make_canvas(&it, RELUME_FORMAT_XRGB8888);
    const unsigned seeds[] = {1, 4, 4, 3, 1};
    for (int step = 0; step < 5; step++) {
        shine(&it, seeds[step]);
        DONE(relume_trace_sun(it.object, 0, it.info.bands));
        relume_report report = {0};
        uint32_t blocks = 0, rounds = 0;
        do {
            DONE(relume_relight(it.object, &on.frame, 0, it.info.bands, &report));
            DONE(relume_restore(it.object, &blocks));
            EXPECT(rounds++ < 8);
        } while (blocks > 0);
        char name[64];
        snprintf(name, sizeof name, "budget-%d.raw", step);
        write_canvas(&it, &on, folder, name);
        struct { uint32_t rounds; float linear, codes; } told = {rounds, report.bound_linear, report.bound_codes};
        snprintf(name, sizeof name, "budget-bound-%d.raw", step);
        write_bytes(folder, name, &told, sizeof told);
    }
    check_margins(&it, &on);
    free(on.data);
    close_field(&it);
}

static void facts(bytes field, const char *folder) {
    opened it = open_field(field);
    size_t stride = it.info.width + 3, length = stride * it.info.height;
    unsigned char *coverage = malloc(length);
    memset(coverage, 0x5a, length);
    DONE(relume_coverage(it.object, coverage, length, stride));
    write_bytes(folder, "coverage.raw", coverage, length);
    relume_patch *patches = malloc(it.info.patches * sizeof *patches);
    DONE(relume_patches(it.object, patches, it.info.patches));
    write_bytes(folder, "patches.raw", patches, it.info.patches * sizeof *patches);
    write_bytes(folder, "info.raw", &it.info, sizeof it.info);
    free(patches);
    free(coverage);
    close_field(&it);
}

enum { ROOM = 4096 };
static relume_rect room[ROOM];

static relume_report relight(opened *it, canvas *on, uint32_t capacity) {
    relume_report report = {0};
    report.damage = room;
    report.damage_capacity = capacity;
    DONE(relume_relight(it->object, &on->frame, 0, it->info.bands, &report));
    EXPECT(report.damage_count <= capacity && report.damage_count <= it->info.bands * it->info.damage_per_band);
    uint32_t tiles = it->info.bands * it->info.tiles_per_band;
    EXPECT(report.tiles_drawn + report.tiles_kept + report.tiles_empty == tiles);
    return report;
}

static int in_damage(const relume_report *report, uint32_t x, uint32_t y) {
    for (uint32_t k = 0; k < report->damage_count; k++) {
        const relume_rect *r = &room[k];
        if (x >= r->x && x - r->x < r->width && y >= r->y && y - r->y < r->height) {
            return 1;
        }
    }
    return 0;
}

/* After filling the whole canvas: with `exact`, damage is what was written; else it holds at least that. */
static void check_damage(const opened *it, const canvas *on, const relume_report *report, int exact) {
    for (uint32_t y = 0; y < it->info.height; y++) {
        for (uint32_t x = 0; x < it->info.width; x++) {
            uint32_t word;
            memcpy(&word, (unsigned char *)on->frame.pixels + y * on->frame.stride + 4 * x, 4);
            int written = word != 0xa5a5a5a5, told = in_damage(report, x, y);
            EXPECT(exact ? written == told : told || !written);
        }
    }
}

static void skipping(bytes field) {
    opened it = open_field(field);
    canvas on = make_canvas(&it, RELUME_FORMAT_XRGB8888);
    uint32_t *view = make_view(&it);
    show_view(&it, &on, view, 1);
    shine(&it, 1);
    DONE(relume_trace_sun(it.object, 0, it.info.bands));
    relume_report all = relight(&it, &on, ROOM);
    EXPECT(all.tiles_kept == 0 && all.tiles_drawn > 0 && all.damage_count == it.info.bands);
    relume_report same = relight(&it, &on, ROOM);
    EXPECT(same.damage_count == 0); /* nothing has changed */
    EXPECT(same.bound_linear == all.bound_linear && same.bound_codes == all.bound_codes);

    it.light.exposure *= 1.0002f; /* not visible */
    DONE(relume_set_light(it.object, &it.light));
    relume_report near = relight(&it, &on, ROOM);
    EXPECT(near.damage_count == 0); /* but not as right as it was */
    EXPECT(near.bound_linear > all.bound_linear && near.bound_codes > all.bound_codes);

    memset(on.data, 0xa5, on.length); /* so that what is written shows */
    show_view(&it, &on, view, 2);
    relume_report through = relight(&it, &on, ROOM);
    EXPECT(through.tiles_kept > 0 && through.damage_count > 0);
    check_damage(&it, &on, &through, 1);
    memset(on.data, 0xa5, on.length);
    show_view(&it, &on, view, 3);
    through = relight(&it, &on, 2); /* too little room: wider rectangles */
    EXPECT(through.damage_count == 2);
    check_damage(&it, &on, &through, 0);

    on.frame.flags = RELUME_FRAME_REDRAW;
    EXPECT(relight(&it, &on, ROOM).tiles_kept == 0);
    on.frame.flags = 0;
    canvas other = make_canvas(&it, RELUME_FORMAT_XRGB8888); /* another buffer has nothing in it yet */
    show_view(&it, &other, view, 3);
    EXPECT(relight(&it, &other, ROOM).tiles_kept == 0);
    EXPECT(memcmp(other.data, on.data, on.length) == 0);
    check_margins(&it, &on);
    free(view);
    free(on.data);
    free(other.data);
    close_field(&it);
}

/* A sun that moves is shown where it was until its bands are traced; in the end the picture is a fresh object's. */
static void sun(bytes field) {
    opened it = open_field(field), fresh = open_field(field);
    canvas on = make_canvas(&it, RELUME_FORMAT_XRGB8888), last = make_canvas(&fresh, RELUME_FORMAT_XRGB8888);
    shine(&it, 1);
    DONE(relume_trace_sun(it.object, 0, it.info.bands));
    EXPECT(relight(&it, &on, ROOM).tiles_sun_stale == 0);
    it.light.sun_dir_world[2] = -it.light.sun_dir_world[2];
    DONE(relume_set_light(it.object, &it.light));
    relume_report report = relight(&it, &on, ROOM);
    EXPECT(report.tiles_sun_stale > 0 && report.damage_count == 0);
    DONE(relume_trace_sun(it.object, 1, 1));
    uint32_t stale = report.tiles_sun_stale;
    report = relight(&it, &on, ROOM);
    EXPECT(report.tiles_sun_stale < stale && report.damage_count > 0);
    for (uint32_t k = 0; k < report.damage_count; k++) {
        EXPECT(room[k].y == 16);
    }
    DONE(relume_trace_sun(it.object, 0, it.info.bands));
    EXPECT(relight(&it, &on, ROOM).tiles_sun_stale == 0);
    on.frame.flags = RELUME_FRAME_REDRAW;
    relight(&it, &on, ROOM);

    shine(&fresh, 1);
    fresh.light.sun_dir_world[2] = -fresh.light.sun_dir_world[2];
    DONE(relume_set_light(fresh.object, &fresh.light));
    DONE(relume_trace_sun(fresh.object, 0, fresh.info.bands));
    relight(&fresh, &last, ROOM);
    EXPECT(memcmp(on.data, last.data, on.length) == 0);

    fresh.light.sun_dir_world[1] = -fresh.light.sun_dir_world[1]; /* night */
    DONE(relume_set_light(fresh.object, &fresh.light));
    EXPECT(relight(&fresh, &last, ROOM).tiles_sun_stale == 0);
    EXPECT(memcmp(on.data, last.data, on.length) != 0);
    free(on.data);
    free(last.data);
    close_field(&it);
    close_field(&fresh);
}

/* The largest difference of two pictures, codes. */
static int difference(const opened *it, const canvas *a, const canvas *b) {
    int largest = 0;
    for (uint32_t y = 0; y < it->info.height; y++) {
        for (size_t x = 0; x < a->row_bytes; x++) {
            size_t at = y * a->frame.stride + x;
            int step = abs(((unsigned char *)a->frame.pixels)[at] - ((unsigned char *)b->frame.pixels)[at]);
            largest = step > largest ? step : largest;
        }
    }
    return largest;
}

/* What is left as it was never falls behind by more than rounding shows, however small the steps. */
static void drift(bytes field, unsigned seed) {
    opened it = open_field(field), fresh = open_field(field);
    canvas on = make_canvas(&it, RELUME_FORMAT_XRGB8888), exact = make_canvas(&fresh, RELUME_FORMAT_XRGB8888);
    uint32_t kept = 0, drawn = 0;
    for (int step = 0; step < 200; step++) {
        make_light(&it, seed);
        make_light(&fresh, seed);
        it.light.exposure = fresh.light.exposure = 0.05f + 1e-5f * (float)step;
        DONE(relume_set_light(it.object, &it.light));
        DONE(relume_set_light(fresh.object, &fresh.light));
        DONE(relume_trace_sun(it.object, 0, it.info.bands));
        DONE(relume_trace_sun(fresh.object, 0, it.info.bands));
        relume_report report = relight(&it, &on, ROOM);
        kept += step ? report.tiles_kept : 0;
        drawn += step ? report.tiles_drawn : 0;
        exact.frame.flags = RELUME_FRAME_REDRAW;
        relight(&fresh, &exact, ROOM);
        EXPECT(difference(&it, &on, &exact) <= 1);
    }
    EXPECT(kept > 0 && drawn > 0);
    free(on.data);
    free(exact.data);
    close_field(&it);
    close_field(&fresh);
}

void check_frames(bytes field, const char *folder) {
    formats(field, folder);
    processors(field);
    lights(field, folder);
    budgets(field, folder);
    facts(field, folder);
}

void check_skipping(bytes field) {
    skipping(field);
    sun(field);
    drift(field, 1);
    drift(field, 4); /* with patches that outshine the sky */
}
