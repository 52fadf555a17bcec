/*
 * Opening a store and its slabs.
 *
 * Nothing in the file is believed before it is checked. Opening checks what is small: info,
 * attributes, the slab table, each of whose offsets has one possible value. A slab is checked when
 * it is first opened: its CRC, if asked for, and always what slab_judge asks of it, so that a later
 * stage can't be led out of bounds, or round a surface that has no sides, by a file that somebody
 * made with care.
 */
#include "mesh/store_internal.h"

#include <stdatomic.h>
#include <string.h>

#include "base/bytes.h"
#include "base/checksum.h"
#include "base/memory.h"
#include "mesh/draft.h"
#include "mesh/slab_judge.h"
#include "mesh/store_hold.h"
#include "mesh/store_layout.h"

struct store {
    struct context *ctx;
    struct section_reader reader;
    bool verify;
    bool is_own; /* store_open_own */
    struct store_hold *hold;
    struct store_info info;
    const struct section *slabs;
    struct slab_entry *entries;
    _Atomic uint8_t *is_checked; /* a slab */
    _Atomic uint32_t checked_count;
    _Atomic uint64_t seams; /* the sum of what slab_judge gives */
};

enum status store_damaged(const struct store *store, const char *what)
{
    return fail(store->ctx, STATUS_BAD_INPUT, "%s: damaged mesh store: %s", store->reader.file.path,
                what);
}

enum status store_slab_damaged(const struct store *store, uint32_t slab, const char *what)
{
    return fail(store->ctx, STATUS_BAD_INPUT, "%s: damaged mesh store: slab %lu: %s",
                store->reader.file.path, (unsigned long)slab, what);
}

/* ---- opening ---- */

static enum status load_section(struct store *store, uint32_t kind, uint64_t limit,
                                unsigned char **data, const struct section **section)
{
    *section = section_find(&store->reader, kind);
    if (!*section)
        return store_damaged(store, "a section is missing");
    return section_load(&store->reader, *section, limit, data);
}

static enum status load_info(struct store *store)
{
    unsigned char *bytes = NULL;
    const struct section *section;
    enum status status = load_section(store, STORE_KIND_INFO, STORE_INFO_SIZE, &bytes, &section);
    if (status != STATUS_OK)
        return status;
    const char *wrong = "the info is cut off";
    if (section->length == STORE_INFO_SIZE)
        wrong = store_info_decode(bytes, &store->info);
    memory_release(store->ctx, &bytes, (size_t)section->length, 1);
    return wrong ? store_damaged(store, wrong) : STATUS_OK;
}

static enum status load_attributes(struct store *store)
{
    unsigned char *bytes = NULL;
    const struct section *section;
    enum status status = load_section(store, STORE_KIND_ATTRIBUTES, 1 << 16, &bytes, &section);
    if (status != STATUS_OK)
        return status;
    const char *wrong =
        store_attributes_decode(bytes, (size_t)section->length, &store->info.attributes);
    memory_release(store->ctx, &bytes, (size_t)section->length, 1);
    return wrong ? store_damaged(store, wrong) : STATUS_OK;
}

/* The table leaves nothing open: each entry follows from the ones before and its counts. */
static const char *judge_table(const struct store *store)
{
    const struct store_info *info = &store->info;
    const uint64_t full = (uint64_t)1 << info->slab_shift;
    uint64_t offset = 0, vertices = 0, faces = 0;
    for (uint32_t i = 0; i < info->slab_count; i++) {
        const struct slab_entry *entry = &store->entries[i];
        uint64_t left = info->topology.faces - faces;
        if (entry->face_count != (left < full ? left : full))
            return "a slab has a wrong number of faces";
        if (entry->vertex_first != vertices)
            return "a slab's vertices are out of order";
        if ((uint64_t)entry->vertex_count + entry->foreign_count > 3 * (uint64_t)entry->face_count)
            return "a slab has more vertices than its faces have corners";
        if (entry->foreign_count > entry->vertex_first)
            return "a slab has more foreign vertices than there are before it";
        if (entry->offset != offset)
            return "a slab is out of place";
        struct slab_layout layout;
        slab_layout_find(entry, info->attributes.stride, &layout);
        offset += store_hold_has(store->hold, i) ? 0 : layout.size;
        vertices += entry->vertex_count;
        faces += entry->face_count;
    }
    if (vertices != info->topology.vertices)
        return "the slabs' vertices do not add up";
    return offset == store->slabs->length ? NULL : "the slabs do not fill their section";
}

static enum status load_table(struct store *store)
{
    const uint32_t count = store->info.slab_count;
    unsigned char *bytes = NULL;
    const struct section *section;
    enum status status = load_section(store, STORE_KIND_TABLE,
                                      (uint64_t)count * STORE_SLAB_ENTRY_SIZE, &bytes, &section);
    if (status != STATUS_OK)
        return status;
    const char *wrong = "the slab table is cut off";
    if (section->length == (uint64_t)count * STORE_SLAB_ENTRY_SIZE) {
        wrong = NULL;
        status = memory_take(store->ctx, count, sizeof *store->entries, &store->entries);
        for (uint32_t i = 0; i < count && status == STATUS_OK; i++) {
            if (!slab_entry_decode(bytes + (size_t)i * STORE_SLAB_ENTRY_SIZE, &store->entries[i]))
                wrong = "the slab table has bytes that are not zero";
        }
        if (status == STATUS_OK)
            status = memory_take_zeroed(store->ctx, count, 1, &store->is_checked);
    }
    memory_release(store->ctx, &bytes, (size_t)section->length, 1);
    store->slabs = section_find(&store->reader, STORE_KIND_SLABS);
    if (status == STATUS_OK && !wrong)
        wrong = store->slabs ? judge_table(store) : "a section is missing";
    if (status == STATUS_OK && wrong)
        status = store_damaged(store, wrong);
    return status;
}

static enum status open_store(struct context *ctx, const char *path, bool verify, bool is_own,
                              struct store_hold *hold, struct store **out)
{
    struct store *store;
    *out = NULL;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *store, &store);
    if (status != STATUS_OK)
        return status;
    store->ctx = ctx;
    store->verify = verify;
    store->is_own = is_own;
    store->hold = hold;
    status =
        section_file_open(ctx, path, STORE_MAGIC, STORE_VERSION, "a mesh store", &store->reader);
    if (status != STATUS_OK) {
        memory_release(ctx, &store, 1, sizeof *store);
        return status;
    }
    status = load_info(store);
    if (status == STATUS_OK)
        status = load_attributes(store);
    if (status == STATUS_OK)
        status = load_table(store);
    if (status == STATUS_OK && store->reader.count != 4)
        status = store_damaged(store, "there are sections of an unknown kind");
    if (status != STATUS_OK) {
        store_close(&store);
        return status;
    }
    *out = store;
    return STATUS_OK;
}

enum status store_open(struct context *ctx, const char *path, bool verify, struct store **out)
{
    return open_store(ctx, path, verify, false, NULL, out);
}

enum status store_open_own(struct context *ctx, const char *path, struct store_hold *hold,
                           struct store **out)
{
    return open_store(ctx, path, true, true, hold, out);
}

void store_close(struct store **store)
{
    struct store *old = *store;
    *store = NULL;
    if (!old)
        return;
    struct context *ctx = old->ctx;
    memory_release(ctx, &old->entries, old->info.slab_count, sizeof *old->entries);
    memory_release(ctx, &old->is_checked, old->info.slab_count, 1);
    section_file_close(&old->reader);
    memory_release(ctx, &old, 1, sizeof *old);
}

const struct store_info *store_info(const struct store *store)
{
    return &store->info;
}

enum status store_crc(struct store *store, uint32_t *crc)
{
    enum { MARKER_SIZE = 32, CRC_AT = 12 }; /* section_file_format.md; opening has checked it */
    unsigned char marker[MARKER_SIZE];
    struct input_file *file = &store->reader.file;
    enum status status = input_read(file, file->size - MARKER_SIZE, marker, MARKER_SIZE);
    if (status == STATUS_OK)
        *crc = load_u32(marker + CRC_AT);
    return status;
}

struct context *store_context(const struct store *store)
{
    return store->ctx;
}

const char *store_path(const struct store *store)
{
    return store->reader.file.path;
}

struct section_reader *store_reader(struct store *store)
{
    return &store->reader;
}

/* ---- a slab ---- */

/* When the last slab is seen, nothing may be left of what the slabs say of their common edges. */
static enum status settle_seams(struct store *store, uint64_t seams)
{
    atomic_fetch_add_explicit(&store->seams, seams, memory_order_relaxed);
    uint32_t done = 1 + atomic_fetch_add_explicit(&store->checked_count, 1, memory_order_acq_rel);
    if (done == store->info.slab_count &&
        atomic_load_explicit(&store->seams, memory_order_relaxed) != 0)
        return store_damaged(store, "slabs do not agree on the edges between them");
    return STATUS_OK;
}

/* `block` and `size`: the slab's bytes. */
static enum status check_slab(struct store *store, const struct slab *slab, const void *block,
                              uint64_t size)
{
    if (atomic_load_explicit(&store->is_checked[slab->index], memory_order_acquire))
        return STATUS_OK;
    if (store->verify &&
        !checksum_agrees(checksum(0, block, (size_t)size), store->entries[slab->index].crc))
        return store_slab_damaged(store, slab->index, "its checksum is wrong");
    uint64_t seams = 0;
    const char *wrong = store->is_own ? NULL : slab_judge(slab, store->info.topology.faces, &seams);
    if (wrong)
        return store_slab_damaged(store, slab->index, wrong);
    if (atomic_exchange_explicit(&store->is_checked[slab->index], 1, memory_order_acq_rel))
        return STATUS_OK; /* another thread was at it too */
    return settle_seams(store, seams);
}

/* Fills in the slab whose bytes are at `block`, and checks it. */
static enum status point_into(struct store *store, uint32_t index, const struct slab_layout *layout,
                              const unsigned char *block, struct slab *slab)
{
    const struct slab_entry *entry = &store->entries[index];
    slab->index = index;
    slab->face_first = (uint32_t)((uint64_t)index << store->info.slab_shift);
    slab->face_count = entry->face_count;
    slab->vertex_first = entry->vertex_first;
    slab->vertex_end = entry->vertex_first + entry->vertex_count;
    slab->foreign_count = entry->foreign_count;
    slab->faces = (const uint32_t *)(const void *)(block + layout->faces);
    slab->neighbours = (const uint32_t *)(const void *)(block + layout->neighbours);
    slab->mates = block + layout->mates;
    slab->positions = (const float *)(const void *)(block + layout->positions);
    slab->foreign = (const uint32_t *)(const void *)(block + layout->foreign);
    slab->foreign_positions = (const float *)(const void *)(block + layout->foreign_positions);
    slab->records = store->info.attributes.stride ? block + layout->records : NULL;
    enum status status = check_slab(store, slab, block, layout->size);
    if (status != STATUS_OK)
        slab_close(slab);
    return status;
}

/* What the ways to a slab begin with: *is_held when it is given already, or where in the file it is
 * and how it is laid out. */
static enum status find_slab(struct store *store, uint32_t index, struct slab *slab,
                             struct slab_layout *layout, uint64_t *offset, bool *is_held)
{
    memset(slab, 0, sizeof *slab);
    *is_held = false;
    *offset = 0;
    if (index >= store->info.slab_count)
        return fail(store->ctx, STATUS_MISUSE, "there is no slab %lu", (unsigned long)index);
    *is_held = store_hold_has(store->hold, index);
    if (*is_held) {
        store_hold_give(store->hold, index, slab);
        return STATUS_OK;
    }
    slab_layout_find(&store->entries[index], store->info.attributes.stride, layout);
    *offset = store->slabs->offset + store->entries[index].offset;
    return STATUS_OK;
}

enum status slab_open(struct store *store, uint32_t index, struct slab *slab)
{
    struct slab_layout layout;
    uint64_t offset;
    bool is_held;
    enum status status = find_slab(store, index, slab, &layout, &offset, &is_held);
    if (status != STATUS_OK || is_held)
        return status;
    struct window *window = &slab->windows[0];
    status = window_open(&store->reader.file, offset, layout.size, window);
    return status != STATUS_OK ? status : point_into(store, index, &layout, window->data, slab);
}

uint64_t slab_size(const struct store *store, uint32_t index, uint32_t *face_count,
                   uint32_t *vertex_count)
{
    struct slab_layout layout = {0};
    *face_count = *vertex_count = 0;
    if (index < store->info.slab_count) {
        const struct slab_entry *entry = &store->entries[index];
        slab_layout_find(entry, store->info.attributes.stride, &layout);
        *face_count = entry->face_count;
        *vertex_count = entry->vertex_count + entry->foreign_count;
    }
    return layout.size;
}

enum status slab_read(struct store *store, uint32_t index, void *buffer, struct slab *slab)
{
    struct slab_layout layout;
    uint64_t offset;
    bool is_held;
    enum status status = find_slab(store, index, slab, &layout, &offset, &is_held);
    if (status != STATUS_OK || is_held)
        return status;
    status = input_read(&store->reader.file, offset, buffer, (size_t)layout.size);
    return status != STATUS_OK ? status : point_into(store, index, &layout, buffer, slab);
}

void slab_close(struct slab *slab)
{
    window_close(&slab->windows[0]);
    memset(slab, 0, sizeof *slab);
}

bool slab_is_held(const struct store *store, uint32_t index)
{
    return store_hold_has(store->hold, index);
}

void slab_forget(struct store *store, uint32_t index)
{
    if (store_hold_has(store->hold, index))
        store_hold_forget(store->hold, index);
}

const float *slab_position(const struct slab *slab, uint32_t vertex)
{
    if (vertex - slab->vertex_first < slab->vertex_end - slab->vertex_first)
        return slab->positions + 3 * (size_t)(vertex - slab->vertex_first);
    return slab->foreign_positions +
           3 * (size_t)foreign_rank(slab->foreign, slab->foreign_count, vertex);
}

/* ---- beyond a slab ---- */

enum status store_record(struct store *store, uint32_t vertex, unsigned char *record)
{
    const uint32_t stride = store->info.attributes.stride;
    if (vertex >= store->info.topology.vertices)
        return fail(store->ctx, STATUS_MISUSE, "there is no vertex %lu", (unsigned long)vertex);
    uint32_t low = 0, high = store->info.slab_count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (store->entries[middle].vertex_first <= vertex)
            low = middle;
        else
            high = middle;
    }
    if (store_hold_has(store->hold, low)) {
        struct slab slab;
        store_hold_give(store->hold, low, &slab);
        memcpy(record, slab.records + (size_t)(vertex - slab.vertex_first) * stride, stride);
        return STATUS_OK;
    }
    if (store->verify && !atomic_load_explicit(&store->is_checked[low], memory_order_acquire)) {
        struct slab slab;
        enum status status = slab_open(store, low, &slab);
        if (status != STATUS_OK)
            return status;
        slab_close(&slab);
    }
    const struct slab_entry *entry = &store->entries[low];
    struct slab_layout layout;
    slab_layout_find(entry, stride, &layout);
    uint64_t at = store->slabs->offset + entry->offset + layout.records +
                  (uint64_t)(vertex - entry->vertex_first) * stride;
    return input_read(&store->reader.file, at, record, stride);
}

static enum status take_mesh(struct context *ctx, const struct store_info *info, struct mesh *mesh)
{
    memset(mesh, 0, sizeof *mesh);
    const size_t vertices = (size_t)info->topology.vertices, faces = (size_t)info->topology.faces;
    enum status status = memory_take(ctx, vertices, 3 * sizeof(double), &mesh->positions);
    if (status != STATUS_OK)
        return status;
    mesh->vertex_count = vertices;
    mesh->attributes = info->attributes;
    mesh->is_float32 = info->is_float32;
    status = memory_take(ctx, faces, 3 * sizeof(uint32_t), &mesh->faces);
    if (status == STATUS_OK)
        mesh->face_count = faces;
    if (status == STATUS_OK && info->attributes.stride)
        status = memory_take(ctx, vertices, info->attributes.stride, &mesh->records);
    return status;
}

static void copy_slab(const struct store_info *info, const struct slab *slab, struct mesh *mesh)
{
    const size_t own = slab->vertex_end - slab->vertex_first, first = slab->vertex_first;
    const size_t stride = info->attributes.stride;
    memcpy(mesh->faces + 3 * (size_t)slab->face_first, slab->faces,
           3 * sizeof(uint32_t) * slab->face_count);
    for (size_t i = 0; i < 3 * own; i++)
        mesh->positions[3 * first + i] = info->origin[i % 3] + (double)slab->positions[i];
    if (stride && slab->records)
        memcpy(mesh->records + first * stride, slab->records, own * stride);
}

enum status store_load(struct store *store, struct mesh *mesh)
{
    enum status status = take_mesh(store->ctx, &store->info, mesh);
    for (uint32_t i = 0; i < store->info.slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status = slab_open(store, i, &slab);
        if (status != STATUS_OK)
            break;
        copy_slab(&store->info, &slab, mesh);
        slab_close(&slab);
    }
    if (status != STATUS_OK)
        mesh_clear(store->ctx, mesh);
    return status;
}
