/*
 * Full verification of a store.
 *
 * The frame, the checksums and the padding leave no bit unread; then the contents are put to the
 * test of having been made by store_build from this very mesh. Checking each invariant with code of
 * its own would repeat the builder piece by piece. Instead the faces are taken as if they came from
 * an input, matched and surveyed by the builder's steps, which must find nothing to mend, and what
 * they make must be what the store holds. tests/property checks those steps against others.
 */
#include "mesh/store_internal.h"

#include <math.h>
#include <string.h>

#include "mesh/adjacency.h"
#include "mesh/slab_geometry.h"
#include "mesh/store_layout.h"
#include "mesh/survey.h"

struct check {
    struct context *ctx;
    struct store *store;
    const struct store_info *info;
    struct draft draft;
    struct slab_measures measures;
    double low[3];
    double high[3];
};

/* ---- the bytes ---- */

static enum status check_bytes(struct check *check)
{
    struct section_reader *reader = store_reader(check->store);
    enum status status = section_check_padding(reader);
    for (unsigned i = 0; i < reader->count && status == STATUS_OK; i++)
        status = section_verify(reader, &reader->table[i]);
    return status;
}

/* The bytes of a block that belong to no piece are zero. */
static bool gaps_are_zero(const struct slab *slab, const struct store_info *info)
{
    const struct slab_entry entry = {.vertex_count = slab->vertex_end - slab->vertex_first,
                                     .foreign_count = slab->foreign_count,
                                     .face_count = slab->face_count};
    struct slab_layout at;
    slab_layout_find(&entry, info->attributes.stride, &at);
    const uint64_t own = entry.vertex_count, foreign = entry.foreign_count;
    const uint64_t gaps[][2] = {
        {at.faces + 12 * (uint64_t)entry.face_count, at.neighbours},
        {at.neighbours + 12 * (uint64_t)entry.face_count, at.mates},
        {at.mates + entry.face_count, at.positions},
        {at.positions + 12 * own, at.foreign},
        {at.foreign + 4 * foreign, at.foreign_positions},
        {at.foreign_positions + 12 * foreign, at.records},
        {at.records + own * info->attributes.stride, at.size},
    };
    for (size_t i = 0; i < sizeof gaps / sizeof *gaps; i++) {
        for (uint64_t j = gaps[i][0]; j < gaps[i][1]; j++) {
            if (slab->windows[0].data[j])
                return false;
        }
    }
    return true;
}

/* ---- the faces, as if they were an input ---- */

static enum status take_faces(struct check *check)
{
    struct spool spool;
    spool_init(check->ctx, &spool, check->draft.room.beside,
               room_spool_limit(&check->draft.room, 1));
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < check->info->slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status = step(check->ctx, "check: read", i, check->info->slab_count);
        if (status == STATUS_OK)
            status = slab_open(check->store, i, &slab);
        if (status != STATUS_OK)
            break;
        if (!gaps_are_zero(&slab, check->info))
            status = store_slab_damaged(check->store, i, "padding is not zero");
        if (status == STATUS_OK)
            status = spool_append(&spool, slab.faces, 12 * (size_t)slab.face_count);
        slab_close(&slab);
    }
    if (status == STATUS_OK)
        status = draft_adopt_faces(&check->draft, &spool);
    spool_clear(&spool);
    uint64_t degenerate;
    if (status == STATUS_OK)
        status =
            draft_number(&check->draft, check->info->topology.vertices, NULL, NULL, 0, &degenerate);
    return status;
}

/* Each face by itself, each edge of one or two faces, each vertex one fan, all one way round. */
static enum status check_surface(struct check *check)
{
    struct adjacency adjacency;
    struct survey survey;
    enum status status = adjacency_build(&check->draft, UINT64_MAX, &adjacency);
    if (status != STATUS_OK)
        return status;
    const bool has_duplicates = adjacency.has_duplicates, has_cuts = adjacency.cut_count;
    adjacency_clear(&adjacency);
    if (has_duplicates)
        return store_damaged(check->store, "two faces have the same vertices");
    if (has_cuts)
        return store_damaged(check->store, "an edge has more than two faces");
    status = survey_draft(&check->draft, &survey);
    if (status != STATUS_OK)
        return status;
    const struct topology *found = &survey.topology;
    if (survey.fan_count)
        status = store_damaged(check->store, "a vertex has more than one fan of faces");
    else if (survey.is_turned)
        status = store_damaged(check->store, "neighbouring faces run in different directions");
    else if (memcmp(found, &check->info->topology, sizeof *found) != 0)
        status = store_damaged(check->store, "the topology is not what the info says");
    survey_clear(&survey);
    return status;
}

/* ---- the slabs against what was made from the faces ---- */

static void widen(struct check *check, const struct slab *slab)
{
    const uint32_t own = slab->vertex_end - slab->vertex_first;
    for (size_t i = 0; i < 3 * (size_t)own; i++) {
        double value = (double)slab->positions[i];
        check->low[i % 3] = value < check->low[i % 3] ? value : check->low[i % 3];
        check->high[i % 3] = value > check->high[i % 3] ? value : check->high[i % 3];
    }
}

/* The copies of foreign positions are those of the slabs that own them. The own slab is found by
 * going along the ascending list. */
static enum status check_foreign(struct check *check, const struct slab *slab)
{
    struct slab owner = {0};
    enum status status = STATUS_OK;
    uint32_t at = 0;
    for (uint32_t i = 0; i < slab->foreign_count && status == STATUS_OK; i++) {
        const uint32_t v = slab->foreign[i];
        if (!owner.faces || v >= owner.vertex_end) {
            slab_close(&owner);
            while (check->draft.vertex_first[at + 1] <= v)
                at++;
            status = slab_open(check->store, at, &owner);
            if (status != STATUS_OK)
                break;
        }
        /* The same bytes are meant.
         * NOLINTNEXTLINE(bugprone-suspicious-memory-comparison,cert-flp37-c) */
        if (memcmp(slab->foreign_positions + 3 * (size_t)i, slab_position(&owner, v), 12) != 0)
            status = store_slab_damaged(check->store, slab->index,
                                        "a foreign vertex is not where its own slab has it");
    }
    slab_close(&owner);
    return status;
}

static enum status check_slab(struct check *check, const struct slab *slab,
                              struct slab_scope *scope)
{
    const struct draft *draft = &check->draft;
    const size_t first = slab->face_first, count = slab->face_count;
    draft_enter_slab(draft, slab->index);
    if (memcmp(slab->neighbours, draft->neighbours + 3 * first, 12 * count) != 0 ||
        memcmp(slab->mates, draft->mates + first, count) != 0)
        return store_slab_damaged(check->store, slab->index,
                                  "neighbours are not what the faces say");
    enum status status = scope_enter(&check->draft, slab->index, scope);
    if (status != STATUS_OK)
        return status;
    if (scope->foreign_count != slab->foreign_count ||
        (scope->foreign_count &&
         memcmp(scope->foreign, slab->foreign, 4 * (size_t)scope->foreign_count) != 0))
        return store_slab_damaged(check->store, slab->index,
                                  "the foreign vertices are not those that the faces use");
    struct slab_measures measures;
    measure_slab(draft, scope, slab->positions, slab->foreign_positions, &measures);
    measures_add(&check->measures, &measures);
    widen(check, slab);
    return check_foreign(check, slab);
}

static enum status check_slabs(struct check *check)
{
    struct slab_scope scope = {0};
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < check->info->slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status = step(check->ctx, "check: slabs", i, check->info->slab_count);
        if (status == STATUS_OK)
            status = slab_open(check->store, i, &slab);
        if (status != STATUS_OK)
            break;
        status = check_slab(check, &slab, &scope);
        slab_close(&slab);
        draft_forget_slab(&check->draft, i);
    }
    scope_clear(&scope);
    return status;
}

static enum status check_measures(struct check *check)
{
    const struct store_info *info = check->info;
    if (measures_mean_edge(&check->measures) != info->mean_edge ||
        measures_noise(&check->measures) != info->noise || check->measures.area != info->area ||
        check->measures.zero_area_faces != info->cleaning.zero_area_faces)
        return store_damaged(check->store, "the measures are not those of the mesh");
    for (int i = 0; i < 3; i++) {
        /* Off by the rounding to float32 where coordinates were doubles; its steps end at 2^-149.
         */
        double slack = 0;
        if (!info->is_float32)
            slack = (info->box_high[i] - info->box_low[i]) / (1 << 23) + 0x1p-149;
        double low = info->box_low[i] - info->origin[i];
        double high = info->box_high[i] - info->origin[i];
        double off_low = check->low[i] - low, off_high = check->high[i] - high;
        if (!(off_low >= -slack && off_low <= slack && off_high >= -slack && off_high <= slack))
            return store_damaged(check->store, "the bounding box is not that of the mesh");
    }
    return STATUS_OK;
}

enum status store_check(struct context *ctx, const char *path)
{
    struct check check = {.ctx = ctx};
    enum status status = store_open(ctx, path, true, &check.store);
    if (status != STATUS_OK)
        return status;
    check.info = store_info(check.store);
    draft_init(ctx, &check.draft, path, check.info->slab_shift, 0);
    for (int i = 0; i < 3; i++) {
        check.low[i] = INFINITY;
        check.high[i] = -INFINITY;
    }
    status = check_bytes(&check);
    if (status == STATUS_OK)
        status = take_faces(&check);
    if (status == STATUS_OK)
        status = check_surface(&check);
    if (status == STATUS_OK)
        status = check_slabs(&check);
    if (status == STATUS_OK)
        status = check_measures(&check);
    draft_clear(&check.draft);
    store_close(&check.store);
    return status;
}
