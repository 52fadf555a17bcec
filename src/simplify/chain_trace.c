/*
 * A boundary edge lies between faces of different patches, or at the mesh border. The naive way to
 * chains collects all boundary edges in a hash map from vertex to edges and follows it. Here each
 * patch's loop is walked once over the adjacency, from face to face round each boundary vertex,
 * with nothing but the labels and one byte a vertex that says how many boundary edges meet there.
 *
 * Chains end at junctions: vertices where other than two boundary edges meet. A slab sees this for
 * the vertices inside it. A vertex that another slab touches, too, always lies on an edge between
 * the two (the faces round it form one fan); if any boundary edge inside this slab ends there, at
 * least three meet: a closed fan changes its slab at least twice, and an open one has two border
 * edges and changes once. So chains inside a slab always end at its seam vertices, without asking.
 *
 * A chain never comes back to the junction it began at: both its patches have just these two edges
 * there (their boundaries pass no vertex twice), so that no third edge could end there.
 */
#include "simplify/trace_internal.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "simplify/chain_file.h"
#include "simplify/face_normals.h"

#define OVER_SEAM (UINT32_MAX - 1) /* in loop_others: a face of another slab */

/* The longest boundary that a disk of PATCH_FACES_MAX faces can have; and room to have it twice, so
 * that pieces of it never wrap round. */
enum { LOOP_MAX = PATCH_FACES_MAX + 2, LOOP_SPACE = 2 * (LOOP_MAX + 1) };

enum status trace_fail(const struct trace *trace, const char *what)
{
    return fail(trace->ctx, STATUS_BAD_INPUT, "mesh store: slab %u: %s", trace->slab->index, what);
}

/* ---- scratch ---- */

static enum status reserve(struct context *ctx, struct trace_workspace *scratch, size_t vertices,
                           size_t patches)
{
    enum status status = STATUS_OK;
    if (!scratch->loop_vertices)
        status = memory_take(ctx, LOOP_SPACE, sizeof(uint32_t), &scratch->loop_vertices);
    if (!status && !scratch->loop_others)
        status = memory_take(ctx, LOOP_SPACE, sizeof(uint32_t), &scratch->loop_others);
    if (!status && (vertices > scratch->vertex_capacity || !scratch->kinds)) {
        size_t old = scratch->vertex_capacity;
        memory_release(ctx, &scratch->kinds, old, 1);
        memory_release(ctx, &scratch->numbers, old, sizeof(uint32_t));
        scratch->vertex_capacity = vertices;
        status = memory_take(ctx, vertices, 1, &scratch->kinds);
        if (!status)
            status = memory_take(ctx, vertices, sizeof(uint32_t), &scratch->numbers);
    }
    if (!status)
        status = memory_reserve(ctx, &scratch->sums, &scratch->patch_capacity, patches,
                                sizeof *scratch->sums);
    return status;
}

void trace_workspace_clear(struct context *ctx, struct trace_workspace *scratch)
{
    memory_release(ctx, &scratch->kinds, scratch->vertex_capacity, 1);
    memory_release(ctx, &scratch->numbers, scratch->vertex_capacity, sizeof(uint32_t));
    memory_release(ctx, &scratch->sums, scratch->patch_capacity, sizeof *scratch->sums);
    memory_release(ctx, &scratch->loop_vertices, LOOP_SPACE, sizeof(uint32_t));
    memory_release(ctx, &scratch->loop_others, LOOP_SPACE, sizeof(uint32_t));
    memory_release(ctx, &scratch->chains, scratch->chain_capacity, sizeof *scratch->chains);
    memory_release(ctx, &scratch->interiors, scratch->interior_capacity, sizeof(uint32_t));
    memory_release(ctx, &scratch->seam_edges, scratch->seam_edge_capacity,
                   sizeof *scratch->seam_edges);
    memset(scratch, 0, sizeof *scratch);
}

void slab_seams_clear(struct context *ctx, struct slab_seams *seams)
{
    memory_release(ctx, &seams->edges, seams->edge_count, sizeof *seams->edges);
    memory_release(ctx, &seams->junctions, seams->junction_count, sizeof *seams->junctions);
    memset(seams, 0, sizeof *seams);
}

/* ---- all faces once: degrees, seams, sums ---- */

static inline void count_edge(uint8_t *kind)
{
    *kind = (uint8_t)(*kind + ((*kind & KIND_DEGREE) < 3));
}

static void add_face(struct patch_sum *sum, const struct slab_local *local, size_t face)
{
    const uint32_t *corner = local->corners + 3 * face;
    const float *a = local->positions + 3 * (size_t)corner[0];
    const float *b = local->positions + 3 * (size_t)corner[1];
    const float *c = local->positions + 3 * (size_t)corner[2];
    double ux = (double)b[0] - a[0], uy = (double)b[1] - a[1], uz = (double)b[2] - a[2];
    double vx = (double)c[0] - a[0], vy = (double)c[1] - a[1], vz = (double)c[2] - a[2];
    double x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    sum->normal[0] += x;
    sum->normal[1] += y;
    sum->normal[2] += z;
    sum->area += sqrt(x * x + y * y + z * z);
}

/* An edge between two patches is counted from both sides, each time at the vertex where it starts
 * there; a border edge is seen once and counted at both ends. */
static void scan_faces(struct trace *trace)
{
    const struct slab_local *local = trace->local;
    struct patch_sum *sums = trace->scratch->sums;
    uint8_t *kinds = trace->scratch->kinds;
    memset(sums, 0, trace->patch_count * sizeof *sums);
    for (uint32_t p = 0; p < trace->patch_count; p++)
        sums[p].first_face = sums[p].first_edge = NO_INDEX;
    memset(kinds, 0, local->own_count);
    memset(kinds + local->own_count, KIND_SEAM, local->vertex_count - local->own_count);

    for (uint32_t f = 0; f < local->face_count; f++) {
        uint32_t patch = trace->labels[f];
        struct patch_sum *sum = sums + patch;
        add_face(sum, local, f);
        if (sum->first_face == NO_INDEX)
            sum->first_face = f;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t link = local->links[3 * (size_t)f + k];
            if (link_is_face(link) && trace->labels[link >> 2] == patch)
                continue;
            uint8_t *start = kinds + local->corners[3 * (size_t)f + k];
            uint8_t *end = kinds + local->corners[3 * (size_t)f + next3(k)];
            if (link == LINK_SEAM) {
                *start |= KIND_SEAM;
                *end |= KIND_SEAM;
            } else {
                count_edge(start);
                if (link == LINK_BORDER)
                    count_edge(end);
            }
            if (sum->first_edge == NO_INDEX)
                sum->first_edge = f << 2 | k;
        }
    }
}

/* Numbers the seam vertices in the order of their store numbers: foreign ones below the slab's
 * range, its own, foreign ones above it. */
static void number_seam_vertices(struct trace *trace)
{
    const struct slab_local *local = trace->local;
    uint32_t *numbers = trace->scratch->numbers;
    uint32_t foreign = local->own_count, next = 0;
    while (foreign < local->vertex_count &&
           local_vertex_number(local, foreign) < local->vertex_first)
        numbers[foreign++] = next++;
    for (uint32_t v = 0; v < local->own_count; v++)
        if (trace->scratch->kinds[v] & KIND_SEAM)
            numbers[v] = next++;
    while (foreign < local->vertex_count)
        numbers[foreign++] = next++;
    trace->seam_vertex_count = next;
}

/* ---- one patch's loop ---- */

/* Walks the boundary of a patch with the patch on the left: loop_vertices, loop_others, each twice
 * over. */
static enum status walk_loop(struct trace *trace, uint32_t patch, uint32_t *count)
{
    const struct slab_local *local = trace->local;
    uint32_t first = trace->scratch->sums[patch].first_edge;
    uint32_t length = 0, steps = 0;
    *count = 0;
    if (first == NO_INDEX)
        return trace_fail(trace, "a patch without a boundary");
    uint32_t face = first >> 2;
    unsigned k = first & 3;
    do {
        uint32_t link = local->links[3 * (size_t)face + k];
        if (length > LOOP_MAX)
            return trace_fail(trace, "the boundary of a patch does not close");
        trace->scratch->loop_vertices[length] = local->corners[3 * (size_t)face + k];
        trace->scratch->loop_others[length++] = link == LINK_BORDER ? NO_PATCH
                                                : link == LINK_SEAM ? OVER_SEAM
                                                                    : trace->labels[link >> 2];
        /* Round the edge's end, through the patch's faces, to the next boundary edge. Each step is
         * another corner of the patch. */
        k = next3(k);
        for (;;) {
            link = local->links[3 * (size_t)face + k];
            if (!link_is_face(link) || trace->labels[link >> 2] != patch)
                break;
            if (++steps > 3 * PATCH_FACES_MAX)
                return trace_fail(trace, "the faces of a patch form no fan round a vertex");
            face = link >> 2;
            k = next3(link & 3);
        }
    } while ((face << 2 | k) != first);
    if (length < 3)
        return trace_fail(trace, "the boundary of a patch has fewer than three edges");
    memcpy(trace->scratch->loop_vertices + length, trace->scratch->loop_vertices,
           length * sizeof(uint32_t));
    memcpy(trace->scratch->loop_others + length, trace->scratch->loop_others,
           length * sizeof(uint32_t));
    *count = length;
    return STATUS_OK;
}

static bool is_break(const struct trace *trace, uint32_t vertex)
{
    unsigned kind = trace->scratch->kinds[vertex];
    return (kind & KIND_SEAM) || (kind & KIND_DEGREE) != 2;
}

/* The vertex gets a number among the junctions when it has none yet; seam vertices have theirs. */
static void mark_junction(struct trace *trace, uint32_t vertex)
{
    uint8_t *kind = trace->scratch->kinds + vertex;
    if (*kind & KIND_SEAM) {
        trace->touched_count += !(*kind & KIND_TOUCHED);
        *kind |= KIND_TOUCHED;
    } else if (!(*kind & KIND_JUNCTION)) {
        *kind |= KIND_JUNCTION;
        trace->scratch->numbers[vertex] = trace->junction_count++;
    }
}

/* Makes room for whatever a loop of `count` edges can add. */
static enum status reserve_loop(struct trace *trace, uint32_t count)
{
    struct context *ctx = trace->ctx;
    struct trace_workspace *scratch = trace->scratch;
    enum status status = memory_reserve(ctx, &scratch->chains, &scratch->chain_capacity,
                                        trace->chain_count + count, sizeof *scratch->chains);
    if (!status)
        status = memory_reserve(ctx, &scratch->interiors, &scratch->interior_capacity,
                                trace->interior_count + count, sizeof *scratch->interiors);
    if (!status)
        status = memory_reserve(ctx, &scratch->seam_edges, &scratch->seam_edge_capacity,
                                trace->seam_edge_count + count, sizeof *scratch->seam_edges);
    return status;
}

/* Adds the chain over the loop's edges [from, from + edges). */
static void add_chain(struct trace *trace, uint32_t patch, uint32_t from, uint32_t edges)
{
    struct trace_workspace *scratch = trace->scratch;
    const uint32_t *vertices = scratch->loop_vertices + from;
    mark_junction(trace, vertices[0]);
    mark_junction(trace, vertices[edges]);
    scratch->chains[trace->chain_count++] =
        (struct chain){.start = vertices[0],
                       .end = vertices[edges],
                       .left = patch,
                       .right = scratch->loop_others[from],
                       .interior_first = (uint32_t)trace->interior_count,
                       .interior_count = edges - 1};
    for (uint32_t i = 1; i < edges; i++)
        scratch->interiors[trace->interior_count++] = vertices[i];
}

static void add_seam_edge(struct trace *trace, uint32_t patch, uint32_t start, uint32_t end)
{
    uint64_t a = local_vertex_number(trace->local, start);
    uint64_t b = local_vertex_number(trace->local, end);
    trace->scratch->seam_edges[trace->seam_edge_count++] =
        (struct seam_edge){.key = a < b ? a << 32 | b : b << 32 | a,
                           .slab = trace->slab->index,
                           .side = patch << 1 | (a > b)};
}

/* A loop without a junction: the whole boundary of two patches of this slab, or of a patch and the
 * mesh. It gets three. */
static enum status cut_closed_loop(struct trace *trace, uint32_t patch, uint32_t count)
{
    const uint32_t *vertices = trace->scratch->loop_vertices;
    uint32_t other = trace->scratch->loop_others[0];
    if (other < patch)
        return STATUS_OK;
    float *positions;
    enum status status = memory_take(trace->ctx, count, 3 * sizeof *positions, &positions);
    if (status)
        return status;
    for (size_t i = 0; i < count; i++)
        memcpy(positions + 3 * i, trace->local->positions + 3 * (size_t)vertices[i],
               3 * sizeof *positions);
    size_t chosen[3];
    loop_choose_three(count, positions, vertices, chosen);
    memory_release(trace->ctx, &positions, count, 3 * sizeof *positions);
    for (unsigned i = 0; i < 3; i++) {
        size_t to = i == 2 ? chosen[0] + count : chosen[i + 1];
        add_chain(trace, patch, (uint32_t)chosen[i], (uint32_t)(to - chosen[i]));
    }
    return STATUS_OK;
}

/* Cuts the walked loop at its junctions; a chain is added by the lower of its two patches. */
static enum status cut_loop(struct trace *trace, uint32_t patch, uint32_t count)
{
    const uint32_t *vertices = trace->scratch->loop_vertices;
    const uint32_t *others = trace->scratch->loop_others;
    enum status status = reserve_loop(trace, count);
    if (status)
        return status;
    uint32_t first = 0;
    while (first < count && !is_break(trace, vertices[first]))
        first++;
    if (first == count)
        return cut_closed_loop(trace, patch, count);

    uint32_t edges;
    for (uint32_t from = first; from < first + count; from += edges) {
        edges = 1;
        while (!is_break(trace, vertices[from + edges])) {
            if (others[from + edges] != others[from])
                return trace_fail(trace, "a chain changes its patches between junctions");
            edges++;
        }
        if (edges == count)
            return trace_fail(trace, "a chain ends at the junction that it began at");
        if (others[from] == OVER_SEAM)
            add_seam_edge(trace, patch, vertices[from], vertices[from + 1]);
        else if (others[from] > patch)
            add_chain(trace, patch, from, edges);
    }
    return STATUS_OK;
}

/* Unit normal and the boundary's mean: the plane from which interior vertices are measured. */
static void finish_plane(struct trace *trace, uint32_t patch, uint32_t count)
{
    struct patch_sum *sum = trace->scratch->sums + patch;
    double *normal = sum->normal;
    double length2 = normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2];
    if (length2 > 0) {
        double inverse = 1 / sqrt(length2);
        for (unsigned c = 0; c < 3; c++)
            normal[c] *= inverse;
    } else { /* no area, or a patch as good as closed: what its first face was grown by */
        const float *grown = trace->normals + NORMAL_STRIDE * (size_t)sum->first_face;
        for (unsigned c = 0; c < 3; c++)
            normal[c] = grown[c];
    }
    for (uint32_t i = 0; i < count; i++) {
        const float *x = trace->local->positions + 3 * (size_t)trace->scratch->loop_vertices[i];
        for (unsigned c = 0; c < 3; c++)
            sum->centre[c] += x[c];
    }
    for (unsigned c = 0; c < 3; c++)
        sum->centre[c] /= count;
    sum->loop_count = count;
    trace->most_faces += count - 2;
}

static enum status trace_loops(struct trace *trace)
{
    for (uint32_t patch = 0; patch < trace->patch_count; patch++) {
        uint32_t count;
        enum status status = walk_loop(trace, patch, &count);
        if (!status)
            status = cut_loop(trace, patch, count);
        if (status)
            return status;
        finish_plane(trace, patch, count);
    }
    return STATUS_OK;
}

enum status chain_trace(struct context *ctx, struct store *store, uint32_t stride,
                        const struct slab *slab, const struct patch_workspace *space,
                        const uint32_t *labels, uint32_t patch_count,
                        struct trace_workspace *scratch, struct chain_block *block,
                        struct slab_seams *seams, struct trace_counts *counts)
{
    struct trace trace = {.ctx = ctx,
                          .slab = slab,
                          .local = &space->local,
                          .normals = space->normals,
                          .labels = labels,
                          .patch_count = patch_count,
                          .scratch = scratch};
    memset(block, 0, sizeof *block);
    memset(seams, 0, sizeof *seams);
    enum status status = reserve(ctx, scratch, space->local.vertex_count, patch_count);
    if (status)
        return status;
    scan_faces(&trace);
    number_seam_vertices(&trace);
    status = trace_loops(&trace);
    if (!status) {
        trace_choose_interiors(&trace);
        status = trace_make_block(&trace, store, stride, block);
    }
    if (!status)
        status = trace_take_seams(&trace, seams);
    if (status) {
        chain_block_clear(ctx, stride, block);
        slab_seams_clear(ctx, seams);
        return status;
    }
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
