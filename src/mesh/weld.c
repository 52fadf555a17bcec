/*
 * Finding coincident vertices by sorting.
 *
 * Comparing all pairs is quadratic, and a hash table of all vertices is random access to memory in
 * proportion to the mesh. Sorted by their coordinates, taken as bit patterns, coincident vertices
 * stand side by side, in memory or not. A float32 position and its index are 16 bytes and are the
 * sort key; three doubles are too wide for one key, so they are sorted twice, by z and then,
 * stably, by x and y. The index comes last in the order, so that the first of a group is its lowest
 * vertex.
 */
#include "mesh/weld.h"

#include <string.h>

#include "base/external_sort.h"
#include "base/memory.h"

struct float_record {
    uint64_t x_y;
    uint64_t z_index;
};

struct double_record {
    uint64_t key[2]; /* first 0, z; then x, y */
    uint64_t x, y, z;
    uint64_t index;
};

enum { BATCH = 1024, POLL_BATCHES = 256 };

static uint32_t float_bits(float value)
{
    float positive = value + 0.0f; /* -0 + 0 is 0 */
    uint32_t bits;
    memcpy(&bits, &positive, sizeof bits);
    return bits;
}

static uint64_t double_bits(double value)
{
    double positive = value + 0.0;
    uint64_t bits;
    memcpy(&bits, &positive, sizeof bits);
    return bits;
}

/* ---- feeding ---- */

static enum status add_floats(struct ingest *ingest, struct sorter *sorter, uint64_t first,
                              uint64_t end)
{
    struct float_record batch[BATCH];
    enum status status = STATUS_OK;
    for (uint64_t v = first; v < end && status == STATUS_OK;) {
        size_t count = 0;
        for (; count < BATCH && v < end; count++, v++) {
            const float *p = ingest->floats + 3 * v;
            batch[count].x_y = (uint64_t)float_bits(p[0]) << 32 | float_bits(p[1]);
            batch[count].z_index = (uint64_t)float_bits(p[2]) << 32 | v;
        }
        status = sorter_add(sorter, batch, count);
        if (status == STATUS_OK && v / BATCH % POLL_BATCHES == 0)
            status = step(ingest->ctx, "import: weld", v, ingest->vertex_count);
    }
    return status;
}

static enum status add_doubles(struct ingest *ingest, struct sorter *sorter, uint64_t first,
                               uint64_t end)
{
    struct double_record batch[BATCH];
    enum status status = STATUS_OK;
    for (uint64_t v = first; v < end && status == STATUS_OK;) {
        size_t count = 0;
        for (; count < BATCH && v < end; count++, v++) {
            double p[3];
            ingest_position(ingest, v, p);
            struct double_record *record = &batch[count];
            record->x = double_bits(p[0]);
            record->y = double_bits(p[1]);
            record->z = double_bits(p[2]);
            record->index = v;
            record->key[0] = 0;
            record->key[1] = record->z;
        }
        status = sorter_add(sorter, batch, count);
        if (status == STATUS_OK && v / BATCH % POLL_BATCHES == 0)
            status = step(ingest->ctx, "import: weld", v, ingest->vertex_count);
    }
    return status;
}

static enum status add_inputs(struct ingest *ingest, bool all, struct sorter *sorter)
{
    enum status status = STATUS_OK;
    for (size_t i = 0; i < ingest->input_count && status == STATUS_OK; i++) {
        const struct ingest_input *input = &ingest->inputs[i];
        if (!all && !input->is_soup)
            continue;
        uint64_t end = input->vertex_first + input->vertex_count;
        if (ingest_is_float32(ingest))
            status = add_floats(ingest, sorter, input->vertex_first, end);
        else
            status = add_doubles(ingest, sorter, input->vertex_first, end);
    }
    return status;
}

/* From the order by z to the order by x, y and z. */
static enum status sort_again(struct ingest *ingest, uint64_t sorter_limit, struct sorter **sorter)
{
    struct sorter *by_z = *sorter, *by_xy = NULL;
    enum status status = sorter_open(ingest->ctx, sizeof(struct double_record), 16, sorter_limit,
                                     ingest->beside, &by_xy);
    *sorter = by_xy;
    if (status == STATUS_OK)
        status = sorter_finish(by_z);
    struct double_record batch[BATCH];
    const void *data = NULL;
    size_t count = 1;
    while (status == STATUS_OK) {
        status = sorter_next(by_z, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const struct double_record *records = data;
        for (size_t done = 0; done < count && status == STATUS_OK;) {
            size_t size = count - done < BATCH ? count - done : BATCH;
            for (size_t i = 0; i < size; i++) {
                batch[i] = records[done + i];
                batch[i].key[0] = batch[i].x;
                batch[i].key[1] = batch[i].y;
            }
            status = sorter_add(by_xy, batch, size);
            done += size;
        }
    }
    sorter_close(&by_z);
    return status;
}

/* ---- the groups ---- */

static enum status merge_floats(struct sorter *sorter, uint32_t *merged, uint64_t *welded)
{
    const void *data;
    size_t count;
    struct float_record group = {0, 0};
    bool has_group = false;
    for (;;) {
        enum status status = sorter_next(sorter, &data, &count);
        if (status != STATUS_OK || count == 0)
            return status;
        const struct float_record *records = data;
        for (size_t i = 0; i < count; i++) {
            if (has_group && records[i].x_y == group.x_y &&
                records[i].z_index >> 32 == group.z_index >> 32) {
                merged[(uint32_t)records[i].z_index] = (uint32_t)group.z_index;
                ++*welded;
            } else {
                group = records[i];
                has_group = true;
            }
        }
    }
}

static enum status merge_doubles(struct sorter *sorter, uint32_t *merged, uint64_t *welded)
{
    const void *data;
    size_t count;
    struct double_record group = {0};
    bool has_group = false;
    for (;;) {
        enum status status = sorter_next(sorter, &data, &count);
        if (status != STATUS_OK || count == 0)
            return status;
        const struct double_record *records = data;
        for (size_t i = 0; i < count; i++) {
            if (has_group && records[i].x == group.x && records[i].y == group.y &&
                records[i].z == group.z) {
                merged[records[i].index] = (uint32_t)group.index;
                ++*welded;
            } else {
                group = records[i];
                has_group = true;
            }
        }
    }
}

static enum status find_groups(struct ingest *ingest, bool all, uint64_t sorter_limit,
                               uint32_t *merged, uint64_t *welded)
{
    const bool is_float32 = ingest_is_float32(ingest);
    size_t record_size = is_float32 ? sizeof(struct float_record) : sizeof(struct double_record);
    struct sorter *sorter = NULL;
    enum status status =
        sorter_open(ingest->ctx, record_size, 16, sorter_limit, ingest->beside, &sorter);
    if (status == STATUS_OK)
        status = add_inputs(ingest, all, sorter);
    if (status == STATUS_OK && !is_float32)
        status = sort_again(ingest, sorter_limit, &sorter);
    if (status == STATUS_OK)
        status = sorter_finish(sorter);
    if (status == STATUS_OK)
        status = is_float32 ? merge_floats(sorter, merged, welded)
                            : merge_doubles(sorter, merged, welded);
    sorter_close(&sorter);
    return status;
}

enum status weld_find(struct ingest *ingest, bool all, uint64_t sorter_limit, struct spool *spool,
                      uint32_t **merged, uint64_t *welded)
{
    *merged = NULL;
    *welded = 0;
    bool any = all;
    for (size_t i = 0; i < ingest->input_count; i++)
        any = any || ingest->inputs[i].is_soup;
    if (!any)
        return STATUS_OK;
    void *data;
    enum status status = spool_scratch(ingest->ctx, spool, ingest->beside, ingest->spool_limit,
                                       ingest->vertex_count * sizeof(uint32_t), &data);
    if (status != STATUS_OK)
        return status;
    uint32_t *map = data;
    for (uint64_t v = 0; v < ingest->vertex_count; v++)
        map[v] = (uint32_t)v;
    status = find_groups(ingest, all, sorter_limit, map, welded);
    if (status == STATUS_OK)
        *merged = map;
    return status;
}
