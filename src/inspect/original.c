/*
 * An original may be larger than the memory. A store can be read by slab as it is. A mesh file is
 * caught in spools by mesh/ingest, as an import does it, but not cleaned: what is measured is the
 * surface as the user has it. Faces are then taken in file order: scanners, marching cubes and
 * viewers write neighbours close together, so a piece is a small part of the surface; where a file
 * is shuffled everything stays right and gets slower.
 *
 * Pages of the spools' files that have been looked at are dropped again and again, so that they do
 * not add up to the whole mesh.
 */
#include "inspect/original.h"

#include <string.h>

#include "base/memory.h"
#include "geom/vec.h"
#include "mesh/ingest.h"
#include "mesh/weld.h"

enum {
    SPOOL_MEMORY = 4 << 20, /* bytes of a spool that stay in memory */
    WELD_MEMORY = 32 << 20,
    MAPPED_MEMORY = 80 << 20 /* bytes of the spools' files that may stay mapped */
};

struct original {
    struct context *ctx;
    struct store *store;  /* or NULL, and then what follows slab_pieces: */
    uint32_t slab_pieces; /* to a slab */
    struct room room;
    struct ingest ingest;
    struct spool merged_spool;
    struct spool referenced_spool;
    unsigned char *referenced; /* a bit a vertex */
    uint64_t piece_count;
};

/* ---- opening ---- */

static void rest(void *user)
{
    struct original *original = user;
    const struct ingest *ingest = &original->ingest;
    if (ingest->position_spool.size + ingest->face_spool.size <= MAPPED_MEMORY)
        return;
    spool_forget_all(&ingest->position_spool);
    spool_forget_all(&ingest->face_spool);
}

static enum status read_file(struct original *original, const char *path)
{
    struct instream *stream = NULL;
    struct import_sink sink;
    enum status status = instream_open(original->ctx, path, &stream);
    if (status == STATUS_OK)
        status = ingest_begin(&original->ingest, path, &sink);
    if (status == STATUS_OK)
        status = import_read(original->ctx, stream, &sink);
    instream_close(&stream);
    if (status == STATUS_OK)
        status = ingest_end(&original->ingest);
    return status == STATUS_OK ? ingest_finish(&original->ingest) : status;
}

/* Gives the faces of an STL common vertices. */
static enum status weld_soup(struct original *original, uint64_t *welded)
{
    struct ingest *ingest = &original->ingest;
    uint32_t *merged = NULL;
    enum status status = weld_find(ingest, false, &original->merged_spool, &merged, welded);
    if (status != STATUS_OK || !merged)
        return status;
    for (uint64_t i = 0; i < 3 * ingest->face_count; i++)
        ingest->faces[i] = merged[ingest->faces[i]];
    return STATUS_OK;
}

static enum status look_at_file(struct original *original, const char *path, const char *beside,
                                struct quality *quality)
{
    struct ingest *ingest = &original->ingest;
    uint64_t welded = 0;
    void *data;
    enum status status = read_file(original, path);
    if (status == STATUS_OK)
        status = weld_soup(original, &welded);
    if (status == STATUS_OK)
        status = spool_scratch(original->ctx, &original->referenced_spool, beside, SPOOL_MEMORY,
                               (ingest->vertex_count + 7) / 8, &data);
    if (status != STATUS_OK)
        return status;
    original->referenced = data;
    struct quality_input input = {.vertex_count = ingest->vertex_count,
                                  .face_count = ingest->face_count,
                                  .double_first = ingest->is_float32 ? UINT64_MAX : 0,
                                  .floats = ingest->positions,
                                  .doubles = ingest->positions,
                                  .faces = ingest->faces,
                                  .beside = beside,
                                  .referenced = original->referenced,
                                  .rest = rest,
                                  .user = original};
    status = quality_of_arrays(original->ctx, &input, quality);
    rest(original);
    /* Vertices that were welded are not there any more. */
    quality->unreferenced_vertices -=
        quality->unreferenced_vertices < welded ? quality->unreferenced_vertices : welded;
    quality->coincident_vertices -=
        quality->coincident_vertices < welded ? quality->coincident_vertices : welded;
    uint64_t most =
        ingest->face_count > ingest->vertex_count ? ingest->face_count : ingest->vertex_count;
    original->piece_count = (most + PIECE_FACES - 1) >> PIECE_SHIFT;
    return status;
}

/* A store's own topology is taken as it is written there: `check` is there to doubt it. */
static enum status look_at_store(struct original *original, const char *path,
                                 struct quality *quality)
{
    enum status status = store_open(original->ctx, path, true, &original->store);
    if (status != STATUS_OK)
        return status;
    const struct store_info *info = store_info(original->store);
    memset(quality, 0, sizeof *quality);
    quality->topology = info->topology;
    quality->zero_area_faces = info->cleaning.zero_area_faces;
    quality->is_manifold = true;
    memcpy(quality->box_low, info->box_low, sizeof quality->box_low);
    memcpy(quality->box_high, info->box_high, sizeof quality->box_high);
    quality->area = info->area;
    quality->genus = (int64_t)info->topology.components -
                     (info->topology.euler + (int64_t)info->topology.border_loops) / 2;
    original->slab_pieces =
        info->slab_shift > PIECE_SHIFT ? (uint32_t)1 << (info->slab_shift - PIECE_SHIFT) : 1;
    original->piece_count = (uint64_t)info->slab_count * original->slab_pieces;

    /* The volume is not in the store: signed tetrahedra towards a corner of the box. */
    struct original_piece piece = {0};
    struct vec3 base = vec3_load(info->box_low);
    for (uint64_t i = 0; i < original->piece_count && status == STATUS_OK; i++) {
        double volume = 0;
        status = original_load(original, i, false, &piece);
        for (uint32_t f = 0; f < piece.face_count && status == STATUS_OK; f++) {
            struct vec3 a = vec3_sub(vec3_load(piece.corners + 9 * (size_t)f), base);
            struct vec3 b = vec3_sub(vec3_load(piece.corners + 9 * (size_t)f + 3), base);
            struct vec3 c = vec3_sub(vec3_load(piece.corners + 9 * (size_t)f + 6), base);
            volume += vec3_dot(a, vec3_cross(b, c)) / 6;
        }
        quality->volume += volume;
        if (status == STATUS_OK)
            status = step(original->ctx, "volume", i + 1, original->piece_count);
    }
    original_piece_clear(&piece);
    return status;
}

static enum status probe(struct context *ctx, const char *path, enum mesh_format *format)
{
    struct instream *stream = NULL;
    *format = FORMAT_UNKNOWN;
    if (strcmp(path, "-") == 0) /* can be read once only; a store cannot come from there */
        return STATUS_OK;
    enum status status = instream_open(ctx, path, &stream);
    if (status == STATUS_OK)
        status = import_probe(ctx, stream, format);
    instream_close(&stream);
    return status;
}

enum status original_open(struct context *ctx, const char *path, const char *beside,
                          struct original **out, struct quality *quality)
{
    struct original *original = NULL;
    enum mesh_format format;
    *out = NULL;
    enum status status = probe(ctx, path, &format);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, 1, sizeof *original, &original);
    if (status != STATUS_OK)
        return status;
    original->ctx = ctx;
    room_set(ctx, &original->room, beside, 6 * SPOOL_MEMORY, WELD_MEMORY);
    ingest_init(ctx, &original->ingest, &original->room);
    spool_init(ctx, &original->merged_spool, beside, SPOOL_MEMORY);
    spool_init(ctx, &original->referenced_spool, beside, SPOOL_MEMORY);

    if (format == FORMAT_STORE)
        status = look_at_store(original, path, quality);
    else
        status = look_at_file(original, path, beside, quality);
    if (status == STATUS_OK && quality->topology.faces == 0)
        status = fail(ctx, STATUS_BAD_INPUT, "%s: there are no faces to measure", path);
    *out = original;
    if (status != STATUS_OK)
        original_close(out);
    return status;
}

void original_close(struct original **original)
{
    struct original *closing = *original;
    if (!closing)
        return;
    store_close(&closing->store);
    ingest_clear(&closing->ingest);
    spool_clear(&closing->merged_spool);
    spool_clear(&closing->referenced_spool);
    memory_release(closing->ctx, original, 1, sizeof **original);
}

uint64_t original_piece_count(const struct original *original)
{
    return original->piece_count;
}

/* ---- pieces ---- */

static enum status reserve(struct original_piece *piece, size_t faces, size_t vertices)
{
    enum status status = memory_reserve(piece->ctx, &piece->corners, &piece->corner_capacity,
                                        9 * faces, sizeof *piece->corners);
    if (status == STATUS_OK)
        status = memory_reserve(piece->ctx, &piece->vertices, &piece->vertex_capacity, 3 * vertices,
                                sizeof *piece->vertices);
    return status;
}

static enum status load_from_file(struct original *original, uint64_t index, bool with_vertices,
                                  struct original_piece *piece)
{
    const struct ingest *ingest = &original->ingest;
    uint64_t first = index << PIECE_SHIFT;
    uint64_t faces = ingest->face_count > first ? ingest->face_count - first : 0;
    uint64_t vertices =
        with_vertices && ingest->vertex_count > first ? ingest->vertex_count - first : 0;
    faces = faces < PIECE_FACES ? faces : PIECE_FACES;
    vertices = vertices < PIECE_FACES ? vertices : PIECE_FACES;
    enum status status = reserve(piece, faces, vertices);
    if (status != STATUS_OK)
        return status;

    piece->first_face = first;
    piece->face_count = (uint32_t)faces;
    for (uint64_t i = 0; i < 3 * faces; i++)
        ingest_position(ingest, ingest->faces[3 * first + i], piece->corners + 3 * i);
    for (uint64_t v = first; v < first + vertices; v++)
        if (original->referenced[v / 8] >> v % 8 & 1)
            ingest_position(ingest, v, piece->vertices + 3 * (size_t)piece->vertex_count++);
    rest(original);
    return STATUS_OK;
}

static void place(const float *from, const double origin[3], double *to)
{
    for (unsigned k = 0; k < 3; k++)
        to[k] = origin[k] + (double)from[k];
}

static enum status load_from_store(struct original *original, uint64_t index, bool with_vertices,
                                   struct original_piece *piece)
{
    const double *origin = store_info(original->store)->origin;
    const uint32_t pieces = original->slab_pieces, part = (uint32_t)(index % pieces);
    struct slab slab = {0};
    enum status status = slab_open(original->store, (uint32_t)(index / pieces), &slab);
    if (status != STATUS_OK)
        return status;
    uint32_t first = part * PIECE_FACES;
    uint32_t faces = slab.face_count > first ? slab.face_count - first : 0;
    faces = faces < PIECE_FACES ? faces : PIECE_FACES;
    uint64_t own = slab.vertex_end - slab.vertex_first;
    uint32_t vertex_from = (uint32_t)(own * part / pieces);
    uint32_t vertex_to = with_vertices ? (uint32_t)(own * (part + 1) / pieces) : vertex_from;

    status = reserve(piece, faces, vertex_to - vertex_from);
    if (status == STATUS_OK) {
        piece->first_face = (uint64_t)slab.face_first + first;
        piece->face_count = faces;
        piece->vertex_count = vertex_to - vertex_from;
        for (size_t i = 0; i < 3 * (size_t)faces; i++)
            place(slab_position(&slab, slab.faces[3 * (size_t)first + i]), origin,
                  piece->corners + 3 * i);
        for (uint32_t i = 0; i < piece->vertex_count; i++)
            place(slab.positions + 3 * (size_t)(vertex_from + i), origin,
                  piece->vertices + 3 * (size_t)i);
    }
    slab_close(&slab);
    return status;
}

enum status original_load(struct original *original, uint64_t index, bool with_vertices,
                          struct original_piece *piece)
{
    piece->ctx = original->ctx;
    piece->face_count = piece->vertex_count = 0;
    return original->store ? load_from_store(original, index, with_vertices, piece)
                           : load_from_file(original, index, with_vertices, piece);
}

void original_piece_clear(struct original_piece *piece)
{
    if (!piece->ctx)
        return;
    memory_release(piece->ctx, &piece->corners, piece->corner_capacity, sizeof *piece->corners);
    memory_release(piece->ctx, &piece->vertices, piece->vertex_capacity, sizeof *piece->vertices);
    memset(piece, 0, sizeof *piece);
}

enum status mesh_load_any(struct context *ctx, const char *path, struct mesh *mesh)
{
    enum mesh_format format;
    memset(mesh, 0, sizeof *mesh);
    enum status status = probe(ctx, path, &format);
    if (status != STATUS_OK)
        return status;
    if (format != FORMAT_STORE)
        return mesh_load(ctx, path, mesh);
    struct store *store = NULL;
    status = store_open(ctx, path, true, &store);
    if (status == STATUS_OK)
        status = store_load(store, mesh);
    store_close(&store);
    return status;
}
