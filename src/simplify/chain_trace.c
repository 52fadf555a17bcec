/*
 * A boundary edge lies between faces of different patches, or at the mesh border. The naive way to
 * chains collects all boundary edges in a hash map from vertex to edges and follows it, once all
 * patches are there. But a patch's boundary can be cut into chains as soon as the patch is grown,
 * while its faces are still at hand: each chain is added by the later of its two patches.
 *
 * Chains end at junctions: vertices where other than two boundary edges meet. On a patch's boundary
 * these are the vertices where what lies over the edges changes, and the slab's seam vertices; no
 * degrees need counting:
 *   - Let the edges before and after vertex v both lie against patch Q. Q's boundary passes v at
 *     most once, so its faces round v hang together and reach from one of the two edges to the
 *     other: nothing else is at v. The same holds for the mesh border.
 *   - A vertex that another slab touches, too, always lies on an edge between the two (the faces
 *     round it form one fan). If any boundary edge inside this slab ends there, at least three
 *     meet: a closed fan changes its slab at least twice, and an open one has two border edges and
 *     changes once. So chains inside a slab always end at its seam vertices, without asking.
 *   - Edges against free faces may be parts of several chains; the later patches see to them.
 *
 * A chain never comes back to the junction it began at: both its patches have just these two edges
 * there, so that no third edge could end there.
 */
#include "simplify/trace_internal.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "simplify/face_normals.h"
#include "simplify/unit_code.h"

/* The longest boundary that a disk of PATCH_FACES_MAX faces can have. */
enum { LOOP_MAX = PATCH_FACES_MAX + 2 };

/* A patch is flat to rounding when its normal's square is below this part of the fourth power of
 * its boundary's length: it is as good as closed, or of no area. */
static const double no_normal = 1e-28;

enum status trace_fail(const struct trace *trace, const char *what)
{
    return fail(trace->ctx, STATUS_BAD_INPUT, "mesh store: slab %u: %s", trace->slab->index, what);
}

/* Edges of a loop between two places where chains end. */
struct piece {
    uint32_t from, edges;
};

/* ---- scratch ---- */

void trace_workspace_clear(struct context *ctx, struct trace_workspace *scratch)
{
    memory_release(ctx, &scratch->breaks, LOOP_MAX + 1, sizeof *scratch->breaks);
    memory_release(ctx, &scratch->pieces, LOOP_MAX + 1, sizeof *scratch->pieces);
    memory_release(ctx, &scratch->chains, scratch->chain_capacity, sizeof *scratch->chains);
    memory_release(ctx, &scratch->junctions, scratch->junction_capacity, sizeof(uint32_t));
    memory_release(ctx, &scratch->interiors, scratch->interior_capacity, sizeof(uint32_t));
    memory_release(ctx, &scratch->patch_interiors, scratch->patch_interior_capacity,
                   sizeof(uint32_t));
    if (!scratch->has_lent_notes)
        memory_release(ctx, &scratch->notes, scratch->note_capacity, sizeof *scratch->notes);
    memory_release(ctx, &scratch->diagonals, scratch->diagonal_capacity, 2 * sizeof(uint32_t));
    memory_release(ctx, &scratch->seam_edges, scratch->seam_edge_capacity,
                   sizeof *scratch->seam_edges);
    memory_release(ctx, &scratch->seam_vertices, scratch->seam_vertex_capacity, sizeof(uint32_t));
    memory_release(ctx, &scratch->positions, scratch->position_capacity, 3 * sizeof(float));
    memory_release(ctx, &scratch->records, scratch->record_capacity, 1);
    memset(scratch, 0, sizeof *scratch);
}

void slab_seams_clear(struct context *ctx, struct slab_seams *seams)
{
    memory_release(ctx, &seams->vertices, seams->vertex_count, sizeof *seams->vertices);
    memory_release(ctx, &seams->positions, seams->vertex_count, 3 * sizeof *seams->positions);
    memory_release(ctx, &seams->edges, seams->edge_count, sizeof *seams->edges);
    memory_release(ctx, &seams->junctions, seams->vertex_count, sizeof *seams->junctions);
    memset(seams, 0, sizeof *seams);
}

static enum status reserve(struct trace *trace)
{
    struct context *ctx = trace->ctx;
    struct trace_workspace *scratch = trace->scratch;
    enum status status = STATUS_OK;
    if (!scratch->breaks)
        status = memory_take(ctx, LOOP_MAX + 1, sizeof *scratch->breaks, &scratch->breaks);
    if (!status && !scratch->pieces)
        status = memory_take(ctx, LOOP_MAX + 1, sizeof *scratch->pieces, &scratch->pieces);
    return status;
}

/* Room in a vector, a sixteenth more than needed: what all slabs in flight have to spare counts. */
static enum status make_room(struct context *ctx, void *vector, size_t *capacity, size_t needed,
                             size_t size)
{
    if (needed <= *capacity)
        return STATUS_OK;
    const size_t wanted = needed + needed / 16 + 64;
    enum status status = memory_resize(ctx, vector, *capacity, wanted, size);
    *capacity = status ? *capacity : wanted;
    return status;
}

/* Notes begin in what growth has no use for, unless an earlier slab had too many for it. */
static void lend_notes(struct trace_workspace *scratch, const struct patch_workspace *space)
{
    if (scratch->notes && !scratch->has_lent_notes)
        return;
    scratch->has_lent_notes = true;
    scratch->notes = space->rest;
    scratch->note_capacity = space->rest_size / sizeof *scratch->notes;
}

static enum status make_note_room(struct trace *trace, size_t needed)
{
    struct trace_workspace *s = trace->scratch;
    if (needed <= s->note_capacity)
        return STATUS_OK;
    if (s->has_lent_notes) {
        enum status status = trace_own_notes(trace, needed);
        if (status)
            return status;
    }
    return make_room(trace->ctx, &s->notes, &s->note_capacity, needed, sizeof *s->notes);
}

/* Makes room for whatever a patch can add: rarely more than a few comparisons. */
static enum status reserve_patch(struct trace *trace, const struct grown_patch *patch)
{
    struct context *ctx = trace->ctx;
    struct trace_workspace *s = trace->scratch;
    const size_t chains = trace->chain_count + patch->edge_count;
    /* One more: junction_code writes behind the last even when the vertex is a junction already. */
    const size_t junctions = trace->junction_count + patch->edge_count + 1;
    const size_t interiors = trace->interior_count + patch->edge_count;
    const size_t seam_edges = trace->seam_edge_count + patch->edge_count;
    const size_t diagonals = trace->diagonal_count + 3 * (size_t)patch->face_count;
    const size_t notes = trace->patch_count + 1, insides = trace->patch_interior_count + 1;
    if (chains <= s->chain_capacity && junctions <= s->junction_capacity &&
        interiors <= s->interior_capacity && seam_edges <= s->seam_edge_capacity &&
        diagonals <= s->diagonal_capacity && notes <= s->note_capacity &&
        insides <= s->patch_interior_capacity)
        return STATUS_OK;
    enum status status = make_room(ctx, &s->chains, &s->chain_capacity, chains, sizeof *s->chains);
    if (!status)
        status =
            make_room(ctx, &s->junctions, &s->junction_capacity, junctions, sizeof *s->junctions);
    if (!status)
        status =
            make_room(ctx, &s->interiors, &s->interior_capacity, interiors, sizeof *s->interiors);
    if (!status)
        status = make_room(ctx, &s->seam_edges, &s->seam_edge_capacity, seam_edges,
                           sizeof *s->seam_edges);
    if (!status)
        status = make_room(ctx, &s->diagonals, &s->diagonal_capacity, diagonals,
                           2 * sizeof *s->diagonals);
    if (!status)
        status = make_note_room(trace, notes);
    if (!status)
        status = make_room(ctx, &s->patch_interiors, &s->patch_interior_capacity, insides,
                           sizeof *s->patch_interiors);
    return status;
}

/* ---- one patch's boundary ---- */

/* The code of a chain's end: the vertex becomes a junction, if it is none yet. (Whether it is one
 * is hard to guess, so nothing branches on it.) */
static inline uint32_t junction_code(struct trace *trace, uint32_t vertex)
{
    uint32_t *place = trace->scratch->codes + vertex, code = *place;
    const bool is_new = code == CODE_NONE;
    trace->scratch->junctions[trace->junction_count] = vertex;
    code = is_new ? (uint32_t)trace->junction_count : code; /* KIND_JUNCTION is 0 */
    trace->junction_count += is_new;
    code |= code_kind(code) == KIND_SEAM ? CODE_TOUCHED : 0;
    *place = code;
    return code;
}

/* Adds the chain over the loop's edges [from, from + edges). */
static enum status add_chain(struct trace *trace, const struct grown_patch *patch, uint32_t from,
                             uint32_t edges)
{
    struct trace_workspace *scratch = trace->scratch;
    const uint32_t *vertices = patch->vertices + from;
    const uint32_t over = patch->others[from];
    uint32_t *codes = scratch->codes;
    uint32_t start = junction_code(trace, vertices[0]);
    uint32_t end = junction_code(trace, vertices[edges]);
    bool is_sound = code_kind(start) != KIND_CHAIN && code_kind(end) != KIND_CHAIN;
    scratch->chains[trace->chain_count++] =
        (struct chain){.start = start,
                       .end = end,
                       .left = (uint32_t)trace->patch_count,
                       .right = over == OVER_BORDER ? NO_PATCH : over,
                       .interior_first = (uint32_t)trace->interior_count,
                       .interior_count = edges - 1};
    for (uint32_t i = 1; i < edges; i++) {
        uint32_t vertex = vertices[i];
        is_sound &= codes[vertex] == CODE_NONE;
        codes[vertex] = (uint32_t)KIND_CHAIN << CODE_SHIFT | (uint32_t)trace->interior_count;
        scratch->interiors[trace->interior_count++] = vertex;
    }
    return is_sound ? STATUS_OK
                    : trace_fail(trace, "the boundaries of patches cross inside a chain");
}

static void add_seam_edge(struct trace *trace, uint32_t start, uint32_t end)
{
    uint64_t a = local_vertex_number(trace->local, start);
    uint64_t b = local_vertex_number(trace->local, end);
    trace->scratch->seam_edges[trace->seam_edge_count++] =
        (struct seam_edge){.key = a < b ? a << 32 | b : b << 32 | a,
                           .slab = trace->slab->index,
                           .side = (uint32_t)trace->patch_count << 1 | (a > b)};
}

/* A loop without a junction: the whole boundary of two patches of this slab, or of a patch and the
 * mesh. It gets three. */
static enum status cut_closed_loop(struct trace *trace, const struct grown_patch *patch)
{
    if (patch->others[0] == NO_PATCH) /* the last patch will see to it */
        return STATUS_OK;
    float *positions;
    const size_t count = patch->edge_count;
    enum status status = memory_take(trace->ctx, count, 3 * sizeof *positions, &positions);
    if (status)
        return status;
    for (size_t i = 0; i < count; i++)
        memcpy(positions + 3 * i, trace->local->positions + 3 * (size_t)patch->vertices[i],
               3 * sizeof *positions);
    size_t chosen[3];
    loop_choose_three(count, positions, patch->vertices, chosen);
    memory_release(trace->ctx, &positions, count, 3 * sizeof *positions);
    for (unsigned i = 0; i < 3 && !status; i++) {
        size_t to = i == 2 ? chosen[0] + count : chosen[i + 1];
        status = add_chain(trace, patch, (uint32_t)chosen[i], (uint32_t)(to - chosen[i]));
    }
    return status;
}

/* The places where chains end on the boundary, ascending, into `breaks`; returns their number. */
static uint32_t find_breaks(const struct trace *trace, const struct grown_patch *patch,
                            uint32_t *breaks)
{
    const uint32_t *codes = trace->scratch->codes;
    uint32_t count = 0, before = patch->others[patch->edge_count - 1];
    for (uint32_t i = 0; i < patch->edge_count; i++) {
        uint32_t over = patch->others[i];
        breaks[count] = i;
        count += (over != before) | (code_kind(codes[patch->vertices[i]]) == KIND_SEAM);
        before = over;
    }
    return count;
}

/* Cuts a patch's boundary at its junctions and adds the chains against the border and earlier
 * patches. */
static enum status cut_boundary(struct trace *trace, const struct grown_patch *patch)
{
    uint32_t *breaks = trace->scratch->breaks;
    const uint32_t count = find_breaks(trace, patch, breaks);
    if (count == 0)
        return cut_closed_loop(trace, patch);
    breaks[count] = breaks[0] + patch->edge_count;
    uint32_t kept = 0; /* the pieces not against free faces, in place */
    for (uint32_t i = 0; i < count; i++) {
        uint32_t from = breaks[i], edges = breaks[i + 1] - from;
        trace->scratch->pieces[kept] = (struct piece){from, edges};
        kept += patch->others[from] != NO_PATCH;
    }
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < kept && !status; i++) {
        const struct piece piece = trace->scratch->pieces[i];
        if (patch->others[piece.from] == OVER_SEAM)
            add_seam_edge(trace, patch->vertices[piece.from], patch->vertices[piece.from + 1]);
        else if (piece.edges < patch->edge_count)
            status = add_chain(trace, patch, piece.from, piece.edges);
        else
            status = trace_fail(trace, "a chain ends at the junction that it began at");
    }
    return status;
}

/* ---- what a patch keeps ---- */

/* A plane: unit normal, and the mean of the boundary's vertices. */
struct plane_sum {
    double normal[3];
    double centre[3];
};

/* The sum of the faces' area vectors is that of any triangles that the boundary spans: here those
 * of a fan. */
static void find_plane(const struct trace *trace, const struct grown_patch *patch,
                       struct plane_sum *plane)
{
    const float *positions = trace->local->positions;
    const float *first = positions + 3 * (size_t)patch->vertices[0];
    double u[3] = {0, 0, 0}, normal[3] = {0, 0, 0}, sum[3] = {0, 0, 0}, length2 = 0;
    for (uint32_t i = 1; i <= patch->edge_count; i++) { /* the last term is zero */
        const float *x = positions + 3 * (size_t)patch->vertices[i];
        double v[3] = {(double)x[0] - first[0], (double)x[1] - first[1], (double)x[2] - first[2]};
        double d[3] = {v[0] - u[0], v[1] - u[1], v[2] - u[2]};
        normal[0] += u[1] * v[2] - u[2] * v[1];
        normal[1] += u[2] * v[0] - u[0] * v[2];
        normal[2] += u[0] * v[1] - u[1] * v[0];
        length2 += d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        for (unsigned c = 0; c < 3; c++) {
            sum[c] += v[c];
            u[c] = v[c];
        }
    }
    double square = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
    if (square > no_normal * (length2 * length2)) {
        double inverse = 1 / sqrt(square);
        for (unsigned c = 0; c < 3; c++)
            plane->normal[c] = normal[c] * inverse;
    } else { /* what its first face was grown by */
        const float *grown =
            trace->space->normals + NORMAL_STRIDE * (size_t)*patch_growth_faces(trace->space);
        for (unsigned c = 0; c < 3; c++)
            plane->normal[c] = grown[c];
    }
    for (unsigned c = 0; c < 3; c++)
        plane->centre[c] = first[c] + sum[c] / patch->edge_count;
}

/* The one that is farthest from the plane; of equal ones the lowest. NO_INDEX: all vertices are on
 * the boundary. */
static uint32_t farthest_vertex(const struct trace *trace, const struct grown_patch *patch,
                                const struct plane_sum *plane, double *farthest)
{
    uint32_t chosen = NO_INDEX;
    *farthest = 0;
    for (uint32_t i = 0; i < patch->inside_count; i++) {
        const uint32_t vertex = patch->inside[i];
        const float *x = trace->local->positions + 3 * (size_t)vertex;
        double distance = fabs(plane->normal[0] * (x[0] - plane->centre[0]) +
                               plane->normal[1] * (x[1] - plane->centre[1]) +
                               plane->normal[2] * (x[2] - plane->centre[2]));
        if (chosen == NO_INDEX || distance > *farthest ||
            (distance == *farthest && vertex < chosen)) {
            chosen = vertex;
            *farthest = distance;
        }
    }
    return chosen;
}

/* A patch of F faces without interior vertices has F + 2 boundary vertices and F - 1 edges inside:
 * its diagonals, each taken from the lower of its two faces; local vertices as yet. */
static enum status add_diagonals(struct trace *trace, const struct grown_patch *patch)
{
    const struct slab_local *local = trace->local;
    uint32_t *diagonals = trace->scratch->diagonals;
    const uint32_t *faces = patch_growth_faces(trace->space);
    size_t count = trace->diagonal_count;
    for (uint32_t i = 0; i < patch->face_count; i++) {
        const uint32_t face = faces[i];
        for (unsigned k = 0; k < 3; k++) {
            diagonals[2 * count] = edge_start(local, face, k);
            diagonals[2 * count + 1] = edge_end(local, face, k);
            const uint32_t other = link_face(face_link(local, face, k));
            count += (patch_growth_label(trace->space, other) == patch->number) & (other > face);
        }
    }
    if (count - trace->diagonal_count != patch->edge_count - 3)
        return trace_fail(trace, "a patch is no disk");
    trace->diagonal_count = count;
    return STATUS_OK;
}

/* The nearest float that is not below. */
static float round_up(double value)
{
    float rounded = (float)value;
    return rounded < value ? nextafterf(rounded, INFINITY) : rounded;
}

static float clamp_float(double value)
{
    return value > 3.4e38 ? 3.4e38f : (float)value;
}

static enum status add_patch(struct trace *trace, const struct grown_patch *patch)
{
    struct trace_workspace *scratch = trace->scratch;
    struct patch_note *note = scratch->notes + trace->patch_count;
    const size_t diagonals = trace->diagonal_count;
    struct plane_sum plane;
    double distance;
    enum status status = STATUS_OK;
    find_plane(trace, patch, &plane);
    uint32_t interior = farthest_vertex(trace, patch, &plane, &distance);
    note->normal = unit_encode(plane.normal);
    note->area = clamp_float(patch->area);
    note->deviation = round_up(distance);
    if (interior != NO_INDEX)
        scratch->patch_interiors[trace->patch_interior_count++] = interior;
    else
        status = add_diagonals(trace, patch);
    note->diagonals =
        interior != NO_INDEX ? NO_INDEX : (uint32_t)(trace->diagonal_count - diagonals);
    trace->most_faces += patch->edge_count - 2;
    trace->patch_count++;
    return status;
}

/* ---- a slab ---- */

static enum status trace_patches(struct trace *trace, struct patch_workspace *space)
{
    struct grown_patch patch;
    while (patch_growth_next(space, &patch)) {
        enum status status = patch.edge_count ? reserve_patch(trace, &patch)
                                              : trace_fail(trace, "a boundary is no closed loop");
        if (!status)
            status = cut_boundary(trace, &patch);
        if (!status)
            status = add_patch(trace, &patch);
        if (status)
            return status;
    }
    return STATUS_OK;
}

enum status chain_trace(struct context *ctx, struct store *store, uint32_t stride,
                        const struct slab *slab, struct patch_workspace *space,
                        struct trace_workspace *scratch, struct chain_block *block,
                        struct slab_seams *seams, struct trace_counts *counts)
{
    struct trace trace = {
        .ctx = ctx, .slab = slab, .space = space, .local = &space->local, .scratch = scratch};
    memset(block, 0, sizeof *block);
    memset(seams, 0, sizeof *seams);
    scratch->codes = space->vertex_room;
    lend_notes(scratch, space);
    enum status status = reserve(&trace);
    if (!status)
        status = trace_number_seams(&trace);
    if (!status)
        status = trace_patches(&trace, space);
    if (!status)
        status = trace_make_block(&trace, store, stride, block);
    if (!status)
        status = trace_take_seams(&trace, block, seams);
    if (status) {
        slab_seams_clear(ctx, seams);
        return status;
    }
    counts->chain_interiors = trace.interior_count;
    counts->most_faces = trace.most_faces;
    return STATUS_OK;
}

/* ---- three junctions for a loop that has none ---- */

static double squared_distance(const float *a, const float *b)
{
    double x = (double)a[0] - b[0], y = (double)a[1] - b[1], z = (double)a[2] - b[2];
    return x * x + y * y + z * z;
}

/* Squared length of the cross product of b - a and c - a. */
static double squared_span(const float *a, const float *b, const float *c)
{
    double ux = (double)b[0] - a[0], uy = (double)b[1] - a[1], uz = (double)b[2] - a[2];
    double vx = (double)c[0] - a[0], vy = (double)c[1] - a[1], vz = (double)c[2] - a[2];
    double x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    return x * x + y * y + z * z;
}

static void swap_places(size_t *a, size_t *b)
{
    if (*a <= *b)
        return;
    size_t swap = *a;
    *a = *b;
    *b = swap;
}

void loop_choose_three(size_t count, const float *positions, const uint32_t *numbers,
                       size_t chosen[3])
{
    size_t lowest = 0;
    for (size_t i = 1; i < count; i++)
        if (numbers[i] < numbers[lowest])
            lowest = i;
    const float *a = positions + 3 * lowest;

    size_t far = count; /* none yet */
    double best = 0;
    for (size_t i = 0; i < count; i++) {
        double distance = squared_distance(a, positions + 3 * i);
        if (i != lowest &&
            (far == count || distance > best || (distance == best && numbers[i] < numbers[far]))) {
            far = i;
            best = distance;
        }
    }
    const float *b = positions + 3 * far;

    size_t off = count;
    best = 0;
    for (size_t i = 0; i < count; i++) {
        double span = squared_span(a, b, positions + 3 * i);
        if (i != lowest && i != far &&
            (off == count || span > best || (span == best && numbers[i] < numbers[off]))) {
            off = i;
            best = span;
        }
    }
    chosen[0] = lowest;
    chosen[1] = far;
    chosen[2] = off;
    swap_places(&chosen[0], &chosen[1]);
    swap_places(&chosen[1], &chosen[2]);
    swap_places(&chosen[0], &chosen[1]);
}
