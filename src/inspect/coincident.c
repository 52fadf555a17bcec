/*
 * Comparing all pairs is quadratic, and a hash map of positions misses the cache once a vertex.
 * Vertices are sorted by a hash of their coordinates instead, outside of memory where it must be;
 * equal ones then stand side by side, and coordinates are compared only there.
 */
#include "inspect/coincident.h"

#include <string.h>

#include "base/bytes.h"
#include "base/external_sort.h"

struct place_record {
    uint64_t hash; /* of the coordinates */
    uint32_t vertex;
    uint32_t unused;
};

static uint64_t mix(uint64_t hash, double value)
{
    uint64_t bits;
    value += 0.0; /* -0 becomes 0 */
    memcpy(&bits, &value, sizeof bits);
    hash = (hash ^ bits) * 0x9fb21c651e98df25u;
    return hash ^ hash >> 29;
}

static bool same_place(const struct quality_input *input, uint32_t a, uint32_t b)
{
    struct vec3 p = position_of(input, a), q = position_of(input, b);
    return p.x == q.x && p.y == q.y && p.z == q.z;
}

/* Vertices of equal hash follow each other; all but the first at each place are counted. Different
 * places of equal hash, which hardly ever occur, are told apart up to a few. */
static enum status count_groups(const struct quality_input *input, struct sorter *sorter,
                                uint64_t *count_out)
{
    enum { PLACES = 8 };
    uint32_t first[PLACES];
    unsigned places = 0;
    uint64_t hash = 0;
    for (;;) {
        const void *batch;
        size_t count;
        enum status status = sorter_next(sorter, &batch, &count);
        if (status != STATUS_OK || count == 0)
            return status;
        const struct place_record *records = batch;
        for (size_t i = 0; i < count; i++) {
            if (places == 0 || load_u64(&records[i].hash) != hash) {
                hash = load_u64(&records[i].hash);
                places = 0;
            }
            unsigned k = 0;
            while (k < places && !same_place(input, first[k], records[i].vertex))
                k++;
            if (k < places)
                ++*count_out;
            else if (places < PLACES)
                first[places++] = records[i].vertex;
        }
    }
}

enum status coincident_count(struct context *ctx, const struct quality_input *input,
                             uint64_t sort_memory, uint64_t *coincident)
{
    enum { BATCH = 1024 };
    struct place_record records[BATCH];
    *coincident = 0;
    size_t used = 0;
    struct sorter *sorter = NULL;
    enum status status =
        sorter_open(ctx, sizeof *records, sizeof(uint64_t), sort_memory, input->beside, &sorter);
    for (uint64_t v = 0; v < input->vertex_count && status == STATUS_OK; v++) {
        struct vec3 p = position_of(input, v);
        uint64_t hash = mix(mix(mix(0x243f6a8885a308d3u, p.x), p.y), p.z);
        store_u64(&records[used].hash, hash);
        records[used].vertex = (uint32_t)v;
        records[used++].unused = 0;
        if (used == BATCH) {
            status = sorter_add(sorter, records, used);
            used = 0;
        }
    }
    if (status == STATUS_OK)
        status = sorter_add(sorter, records, used);
    if (status == STATUS_OK)
        status = sorter_finish(sorter);
    if (status == STATUS_OK)
        status = count_groups(input, sorter, coincident);
    sorter_close(&sorter);
    return status;
}
