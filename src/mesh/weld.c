/*
 * Finding coincident vertices by sorting.
 *
 * Comparing all pairs is quadratic, and a hash table of all vertices is random access to memory in
 * proportion to the mesh. Sorted by their coordinates, taken as bit patterns, coincident vertices
 * stand side by side, in memory or not. A float32 position and its index are 16 bytes and are the
 * sort key; three doubles are too wide for one key, so they are sorted twice, by z and then,
 * stably, by x and y. The index comes last in the order, so that the first of a group is its lowest
 * vertex. What was found comes in the order of the coordinates; where a table of all vertices does
 * not fit, it is sorted back into theirs.
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

/* After a batch up to vertex v. */
static enum status go_on(struct ingest *ingest, uint64_t v)
{
    if (v / BATCH % POLL_BATCHES != 0)
        return STATUS_OK;
    spool_pass(&ingest->position_spool, v * (ingest->is_float32 ? 12u : 24u));
    return step(ingest->ctx, "import: weld", v, ingest->vertex_count);
}

static enum status add_floats(struct ingest *ingest, struct sorter *sorter, uint64_t first,
                              uint64_t end)
{
    struct float_record batch[BATCH];
    enum status status = STATUS_OK;
    for (uint64_t v = first; v < end && status == STATUS_OK;) {
        size_t count = 0;
        for (; count < BATCH && v < end; count++, v++) {
            const float *p = (const float *)ingest->positions + 3 * v;
            batch[count].x_y = (uint64_t)float_bits(p[0]) << 32 | float_bits(p[1]);
            batch[count].z_index = (uint64_t)float_bits(p[2]) << 32 | v;
        }
        status = sorter_add(sorter, batch, count);
        if (status == STATUS_OK)
            status = go_on(ingest, v);
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
        if (status == STATUS_OK)
            status = go_on(ingest, v);
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
        if (ingest->is_float32)
            status = add_floats(ingest, sorter, input->vertex_first, end);
        else
            status = add_doubles(ingest, sorter, input->vertex_first, end);
    }
    return status;
}

/* From the order by z to the order by x, y and z. */
static enum status sort_again(struct ingest *ingest, struct sorter **sorter)
{
    struct sorter *by_z = *sorter, *by_xy = NULL;
    enum status status = sorter_finish(by_z);
    if (status == STATUS_OK)
        status = sorter_open(ingest->ctx, sizeof(struct double_record), 16,
                             room_left(ingest->room) / 2, ingest->room->beside, &by_xy);
    *sorter = by_xy;
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

/* Where what was found goes: into the table, or, if it is not in memory, into a sort. */
struct merging {
    uint32_t *table;
    struct sorter *by_vertex; /* vertex << 32 | which stands for it */
    uint64_t welded;
};

static inline enum status merge(struct merging *m, uint64_t vertex, uint64_t lowest)
{
    m->welded++;
    if (m->table) {
        m->table[vertex] = (uint32_t)lowest;
        return STATUS_OK;
    }
    uint64_t record = vertex << 32 | lowest;
    return sorter_add(m->by_vertex, &record, 1);
}

static enum status merge_floats(struct sorter *sorter, struct merging *m)
{
    struct float_record group = {0, 0};
    bool has_group = false;
    for (;;) {
        const void *data;
        size_t count;
        enum status status = sorter_next(sorter, &data, &count);
        if (status != STATUS_OK || count == 0)
            return status;
        const struct float_record *records = data;
        for (size_t i = 0; i < count && status == STATUS_OK; i++) {
            if (has_group && records[i].x_y == group.x_y &&
                records[i].z_index >> 32 == group.z_index >> 32) {
                status = merge(m, (uint32_t)records[i].z_index, (uint32_t)group.z_index);
            } else {
                group = records[i];
                has_group = true;
            }
        }
        if (status != STATUS_OK)
            return status;
    }
}

static enum status merge_doubles(struct sorter *sorter, struct merging *m)
{
    struct double_record group = {0};
    bool has_group = false;
    for (;;) {
        const void *data;
        size_t count;
        enum status status = sorter_next(sorter, &data, &count);
        if (status != STATUS_OK || count == 0)
            return status;
        const struct double_record *records = data;
        for (size_t i = 0; i < count && status == STATUS_OK; i++) {
            if (has_group && records[i].x == group.x && records[i].y == group.y &&
                records[i].z == group.z) {
                status = merge(m, records[i].index, group.index);
            } else {
                group = records[i];
                has_group = true;
            }
        }
        if (status != STATUS_OK)
            return status;
    }
}

static enum status find_groups(struct ingest *ingest, bool all, struct merging *m)
{
    const size_t record_size =
        ingest->is_float32 ? sizeof(struct float_record) : sizeof(struct double_record);
    struct sorter *sorter = NULL;
    enum status status = sorter_open(ingest->ctx, record_size, 16, room_left(ingest->room) / 2,
                                     ingest->room->beside, &sorter);
    if (status == STATUS_OK && (all || ingest->input_count == 1))
        status = sorter_expect(sorter, ingest->vertex_count);
    if (status == STATUS_OK)
        status = add_inputs(ingest, all, sorter);
    spool_forget_all(&ingest->position_spool);
    if (status == STATUS_OK && !ingest->is_float32)
        status = sort_again(ingest, &sorter);
    if (status == STATUS_OK)
        status = sorter_finish(sorter);
    if (status == STATUS_OK && !m->table)
        status = sorter_open(ingest->ctx, 8, 8, room_left(ingest->room) / 2, ingest->room->beside,
                             &m->by_vertex);
    if (status == STATUS_OK)
        status = ingest->is_float32 ? merge_floats(sorter, m) : merge_doubles(sorter, m);
    sorter_close(&sorter);
    return status;
}

/* ---- the table ---- */

/* Appends the vertices before `end` that stand for themselves. */
static enum status append_themselves(struct spool *spool, uint64_t *next, uint64_t end)
{
    uint32_t batch[BATCH];
    enum status status = STATUS_OK;
    while (*next < end && status == STATUS_OK) {
        size_t count = 0;
        for (; count < BATCH && *next < end; count++, ++*next)
            batch[count] = (uint32_t)*next;
        status = spool_append(spool, batch, count * sizeof *batch);
    }
    return status;
}

/* The table, front to back. */
static enum status write_table(struct ingest *ingest, struct sorter *by_vertex, struct spool *spool)
{
    uint64_t next = 0;
    spool_init(ingest->ctx, spool, ingest->room->beside, 0);
    enum status status = sorter_finish(by_vertex);
    while (status == STATUS_OK) {
        const void *data;
        size_t count;
        status = sorter_next(by_vertex, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const uint64_t *records = data;
        for (size_t i = 0; i < count && status == STATUS_OK; i++) {
            const uint32_t lowest = (uint32_t)records[i];
            status = append_themselves(spool, &next, records[i] >> 32);
            if (status == STATUS_OK)
                status = spool_append(spool, &lowest, sizeof lowest);
            next++;
        }
    }
    return status == STATUS_OK ? append_themselves(spool, &next, ingest->vertex_count) : status;
}

enum status weld_find(struct ingest *ingest, bool all, struct spool *spool, uint32_t **merged,
                      uint64_t *welded)
{
    *merged = NULL;
    *welded = 0;
    bool any = all;
    for (size_t i = 0; i < ingest->input_count; i++)
        any = any || ingest->inputs[i].is_soup;
    if (!any || ingest->vertex_count == 0)
        return STATUS_OK;
    void *data;
    struct merging m = {NULL, NULL, 0};
    const uint64_t size = ingest->vertex_count * sizeof(uint32_t);
    enum status status = STATUS_OK;
    if (room_fits(ingest->room, size)) {
        status = room_scratch(ingest->room, spool, size, &m.table);
        for (uint64_t v = 0; v < ingest->vertex_count && status == STATUS_OK; v++)
            m.table[v] = (uint32_t)v;
    }
    if (status == STATUS_OK)
        status = find_groups(ingest, all, &m);
    if (status == STATUS_OK && !m.table)
        status = write_table(ingest, m.by_vertex, spool);
    sorter_close(&m.by_vertex);
    if (status == STATUS_OK)
        status = spool_seal(spool, &data);
    if (status != STATUS_OK)
        return status;
    *merged = data;
    *welded = m.welded;
    return STATUS_OK;
}
