/*
 * Joining small meshes at their seams.
 *
 * Each part lists its seam vertices by their number in the store; the lists are merged, the first
 * part that has a vertex keeps it, the others' copies become that one. Order is kept: first all of
 * the first part, then what the second adds, and so on, which is along the curve.
 */
#include <string.h>

#include "base/memory.h"
#include "simplify/small_mesh.h"

enum { PARTS_MAX = 8 };

struct joiner {
    struct context *ctx;
    uint32_t stride;
    uint32_t slab_first, slab_end;
    struct small_mesh *parts;
    uint32_t count;
    uint32_t *numbers[PARTS_MAX]; /* of a part's vertices in the whole; NO_INDEX: a later copy */
};

/* Calls of next_group go through the seam vertices by number; a part may have several copies. */
struct group {
    uint32_t begins[PARTS_MAX], ends[PARTS_MAX]; /* tags of the present number */
    uint32_t number;
    uint32_t lowest, highest;
    uint32_t first_part; /* where the first copy is */
    uint32_t first_vertex;
};

static bool next_group(const struct joiner *join, struct group *group)
{
    bool any = false;
    for (uint32_t p = 0; p < join->count; p++) {
        group->begins[p] = group->ends[p];
        if (group->begins[p] == join->parts[p].seam_count)
            continue;
        const uint32_t number = join->parts[p].seams[group->begins[p]].number;
        if (!any || number < group->number)
            group->number = number;
        any = true;
    }
    if (!any)
        return false;
    group->lowest = UINT32_MAX;
    group->highest = 0;
    group->first_part = UINT32_MAX;
    for (uint32_t p = 0; p < join->count; p++) {
        const struct small_mesh *part = &join->parts[p];
        uint32_t *end = &group->ends[p];
        for (; *end < part->seam_count && part->seams[*end].number == group->number; (*end)++) {
            const struct seam_tag *tag = &part->seams[*end];
            if (group->first_part == UINT32_MAX) {
                group->first_part = p;
                group->first_vertex = tag->vertex;
            }
            group->lowest = tag->lowest < group->lowest ? tag->lowest : group->lowest;
            group->highest = tag->highest > group->highest ? tag->highest : group->highest;
        }
    }
    return true;
}

static bool is_inside(const struct joiner *join, const struct group *group)
{
    return group->lowest >= join->slab_first && group->highest < join->slab_end;
}

/* Gives all copies but the first a number. */
static void set_later_copies(struct joiner *join, const struct group *group, uint32_t number)
{
    for (uint32_t p = 0; p < join->count; p++)
        for (uint32_t i = group->begins[p]; i < group->ends[p]; i++) {
            const uint32_t vertex = join->parts[p].seams[i].vertex;
            if (p != group->first_part || vertex != group->first_vertex)
                join->numbers[p][vertex] = number;
        }
}

/* Numbers all vertices; *vertices of the whole, *seams that keep their tag. */
static void number_vertices(struct joiner *join, uint32_t *vertices, uint32_t *seams)
{
    struct group group = {0};
    *vertices = *seams = 0;
    for (uint32_t p = 0; p < join->count; p++)
        memset(join->numbers[p], 0,
               (size_t)join->parts[p].triangles.vertex_count * sizeof *join->numbers[p]);
    while (next_group(join, &group)) {
        *seams += !is_inside(join, &group);
        set_later_copies(join, &group, NO_INDEX);
    }
    for (uint32_t p = 0; p < join->count; p++)
        for (uint64_t v = 0; v < join->parts[p].triangles.vertex_count; v++)
            if (join->numbers[p][v] != NO_INDEX)
                join->numbers[p][v] = (*vertices)++;
}

/* Gives later copies the number of the first one, and the whole its tags. */
static void match_copies(struct joiner *join, struct small_mesh *mesh)
{
    struct group group = {0};
    uint32_t count = 0;
    while (next_group(join, &group)) {
        const uint32_t vertex = join->numbers[group.first_part][group.first_vertex];
        set_later_copies(join, &group, vertex);
        if (!is_inside(join, &group))
            mesh->seams[count++] =
                (struct seam_tag){group.number, vertex, group.lowest, group.highest};
    }
}

static float square_apart(const float p[3], const float q[3])
{
    const float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
    return x * x + y * y + z * z;
}

/* Witnesses of `to` that are still to come are no numbers. */
static void copy_part(const struct joiner *join, uint32_t part, struct collapse_mesh *to,
                      size_t face_first)
{
    const struct collapse_mesh *from = &join->parts[part].triangles;
    const uint32_t *numbers = join->numbers[part];
    const size_t stride = join->stride;
    for (size_t v = 0; v < from->vertex_count; v++) {
        const size_t n = numbers[v];
        /* copies have the same position; of the witnesses the farther counts */
        const float *position = from->positions + 3 * v, *witness = from->witnesses + 3 * v;
        float *known = to->witnesses + 3 * n;
        memcpy(to->positions + 3 * n, position, 3 * sizeof(float));
        if (!(square_apart(known, position) >= square_apart(witness, position)))
            memcpy(known, witness, 3 * sizeof(float));
        if (stride > 0)
            memcpy(to->records + n * stride, from->records + v * stride, stride);
    }
    for (size_t i = 0; i < 3 * (size_t)from->face_count; i++)
        to->faces[3 * face_first + i] = numbers[from->faces[i]];
}

/* ---- fans ---- */

/* The corners at tagged vertices, by tag. */
struct tagged_corners {
    uint32_t *tags;    /* a vertex: its tag, or NO_INDEX */
    uint32_t *firsts;  /* a tag, and one more: into corners */
    uint32_t *corners; /* 3 face + k */
    uint32_t *fans;    /* the fan of each: the place of its first corner */
    size_t count;
};

static uint32_t mesh_corner(const struct collapse_mesh *mesh, uint32_t corner, uint32_t step)
{
    return mesh->faces[corner - corner % 3 + (corner % 3 + step) % 3];
}

static uint32_t fan_of(uint32_t *fans, uint32_t i)
{
    while (fans[i] != i)
        i = fans[i] = fans[fans[i]];
    return i;
}

static void release_corners(struct context *ctx, const struct small_mesh *mesh,
                            struct tagged_corners *t)
{
    memory_release(ctx, &t->fans, t->count, sizeof *t->fans);
    memory_release(ctx, &t->corners, t->count, sizeof *t->corners);
    memory_release(ctx, &t->firsts, (size_t)mesh->seam_count + 1, sizeof *t->firsts);
    memory_release(ctx, &t->tags, (size_t)mesh->triangles.vertex_count, sizeof *t->tags);
}

/* The corners at tagged vertices, ascending, in a vector. */
static enum status find_corners(struct context *ctx, const struct collapse_mesh *m,
                                const uint32_t *tags, uint32_t **found, size_t *capacity,
                                size_t *count)
{
    enum { STRETCH = 3 << 12 };
    const size_t corners = 3 * (size_t)m->face_count;
    size_t end = 0;
    for (size_t first = 0; first < corners; first += STRETCH) {
        const size_t left = corners - first, length = left < STRETCH ? left : STRETCH;
        enum status status = memory_reserve(ctx, found, capacity, end + length, sizeof **found);
        if (status != STATUS_OK)
            return status;
        uint32_t *to = *found;
        for (size_t i = first; i < first + length; i++) {
            to[end] = (uint32_t)i;
            end += tags[m->faces[i]] != NO_INDEX;
        }
    }
    *count = end;
    return STATUS_OK;
}

static enum status list_corners(struct context *ctx, const struct small_mesh *mesh,
                                struct tagged_corners *t)
{
    const struct collapse_mesh *m = &mesh->triangles;
    uint32_t *found = NULL;
    size_t capacity = 0, count = 0;
    enum status status = memory_take(ctx, (size_t)m->vertex_count, sizeof *t->tags, &t->tags);
    if (status == STATUS_OK)
        status =
            memory_take_zeroed(ctx, (size_t)mesh->seam_count + 1, sizeof *t->firsts, &t->firsts);
    if (status != STATUS_OK)
        return status;
    memset(t->tags, 0xff, (size_t)m->vertex_count * sizeof *t->tags);
    for (uint32_t i = 0; i < mesh->seam_count; i++)
        t->tags[mesh->seams[i].vertex] = i;
    status = find_corners(ctx, m, t->tags, &found, &capacity, &count);
    t->count = count;
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *t->corners, &t->corners);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *t->fans, &t->fans);
    if (status == STATUS_OK) {
        for (size_t i = 0; i < count; i++)
            t->firsts[t->tags[m->faces[found[i]]]]++;
        for (uint32_t i = 0, sum = 0; i <= mesh->seam_count; i++) {
            sum += t->firsts[i];
            t->firsts[i] = sum; /* the end of each, brought down to its start below */
        }
        for (size_t i = count; i-- > 0;)
            t->corners[--t->firsts[t->tags[m->faces[found[i]]]]] = found[i];
    }
    memory_release(ctx, &found, capacity, sizeof *found);
    return status;
}

/* Unites the corners of one tag that share an edge. `seen`: by vertex, NO_INDEX everywhere before
 * and after. Returns the number of fans. */
static uint32_t unite_fans(const struct collapse_mesh *m, struct tagged_corners *t, uint32_t tag,
                           uint32_t *seen)
{
    const uint32_t first = t->firsts[tag], end = t->firsts[tag + 1];
    uint32_t count = end - first;
    for (uint32_t i = first; i < end; i++) {
        t->fans[i] = i;
        seen[mesh_corner(m, t->corners[i], 1)] = i;
    }
    for (uint32_t i = first; i < end; i++) {
        const uint32_t other = seen[mesh_corner(m, t->corners[i], 2)];
        if (other == NO_INDEX)
            continue;
        const uint32_t a = fan_of(t->fans, i), b = fan_of(t->fans, other);
        count -= a != b;
        t->fans[a > b ? a : b] = a > b ? b : a;
    }
    for (uint32_t i = first; i < end; i++)
        seen[mesh_corner(m, t->corners[i], 1)] = NO_INDEX;
    return count;
}

/* Makes the fans of one tag but the first vertices of their own, from *next on; `origins` says what
 * each is a copy of. */
static void part_fans(struct small_mesh *mesh, struct tagged_corners *t, uint32_t tag,
                      uint32_t *next, struct seam_tag *tags, uint32_t *tag_count)
{
    const uint32_t first = t->firsts[tag], end = t->firsts[tag + 1];
    uint32_t *faces = mesh->triangles.faces;
    for (uint32_t i = first + 1; i < end; i++) {
        const uint32_t fan = fan_of(t->fans, i);
        if (fan == first)
            continue;
        if (fan == i) {
            tags[*tag_count] = mesh->seams[tag];
            tags[(*tag_count)++].vertex = (*next)++;
        }
        /* the fan's first corner has been renamed before its later ones are met */
        faces[t->corners[i]] = fan == i ? *next - 1 : faces[t->corners[fan]];
    }
}

static enum status grow(struct context *ctx, uint32_t stride, struct collapse_mesh *m,
                        uint32_t extra)
{
    const size_t old = (size_t)m->vertex_count, new = old + extra;
    enum status status = memory_resize(ctx, &m->positions, old, new, 3 * sizeof *m->positions);
    if (status != STATUS_OK)
        return status;
    /* each array must have the size that vertex_count says, whatever fails */
    status = memory_resize(ctx, &m->witnesses, old, new, 3 * sizeof *m->witnesses);
    if (status == STATUS_OK && stride > 0) {
        status = memory_resize(ctx, &m->records, old, new, stride);
        if (status != STATUS_OK)
            memory_release(ctx, &m->witnesses, new, 3 * sizeof *m->witnesses);
    }
    if (status != STATUS_OK)
        memory_release(ctx, &m->positions, new, 3 * sizeof *m->positions);
    else
        m->vertex_count = new;
    return status;
}

enum status small_mesh_split(struct context *ctx, uint32_t stride, struct small_mesh *mesh)
{
    struct collapse_mesh *m = &mesh->triangles;
    struct tagged_corners t = {0};
    struct seam_tag *tags = NULL;
    uint32_t *seen = NULL, extra = 0, count = 0, next = (uint32_t)m->vertex_count;
    const size_t vertices = next, old_count = mesh->seam_count;
    size_t new_count = 0;
    if (old_count == 0)
        return STATUS_OK;
    enum status status = list_corners(ctx, mesh, &t);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *seen, &seen);
    if (status != STATUS_OK)
        goto done;
    memset(seen, 0xff, vertices * sizeof *seen);
    for (uint32_t i = 0; i < old_count; i++)
        if (t.firsts[i + 1] > t.firsts[i])
            extra += unite_fans(m, &t, i, seen) - 1;
    if (extra == 0)
        goto done;
    new_count = old_count + extra;
    status = memory_take(ctx, new_count, sizeof *tags, &tags);
    if (status == STATUS_OK)
        status = grow(ctx, stride, m, extra);
    if (status != STATUS_OK)
        goto done;
    for (uint32_t i = 0; i < old_count; i++) {
        const size_t from = mesh->seams[i].vertex, before = next;
        tags[count++] = mesh->seams[i];
        if (t.firsts[i + 1] > t.firsts[i])
            part_fans(mesh, &t, i, &next, tags, &count);
        for (size_t v = before; v < next; v++) {
            memcpy(m->positions + 3 * v, m->positions + 3 * from, 3 * sizeof *m->positions);
            memcpy(m->witnesses + 3 * v, m->witnesses + 3 * from, 3 * sizeof *m->witnesses);
            if (stride > 0)
                memcpy(m->records + v * stride, m->records + from * stride, stride);
        }
    }
    memory_release(ctx, &mesh->seams, old_count, sizeof *mesh->seams);
    mesh->seams = tags;
    mesh->seam_count = (uint32_t)new_count;
    tags = NULL;
done:
    memory_release(ctx, &tags, new_count, sizeof *tags);
    memory_release(ctx, &seen, vertices, sizeof *seen);
    {
        struct small_mesh as_was = *mesh;
        as_was.seam_count = (uint32_t)old_count;
        as_was.triangles.vertex_count = vertices;
        release_corners(ctx, &as_was, &t);
    }
    return status;
}

void small_mesh_lock(const struct small_mesh *mesh, unsigned char *locked)
{
    enum { SEAM = 1, COPY = 2 };
    const struct collapse_mesh *m = &mesh->triangles;
    bool copies = false;
    for (uint32_t i = 0; i < mesh->seam_count; i++) {
        const struct seam_tag *tag = &mesh->seams[i];
        const bool is_copy = (i > 0 && tag[-1].number == tag->number) ||
                             (i + 1 < mesh->seam_count && tag[1].number == tag->number);
        locked[tag->vertex] = is_copy ? SEAM | COPY : SEAM;
        copies |= is_copy;
    }
    for (size_t f = 0; copies && f < m->face_count; f++) {
        const uint32_t *face = m->faces + 3 * f;
        if ((locked[face[0]] | locked[face[1]] | locked[face[2]]) & COPY)
            for (int k = 0; k < 3; k++)
                locked[face[k]] |= SEAM;
    }
}

/* ---- joining ---- */

static enum status take_arrays(struct joiner *join, uint32_t vertices, uint64_t faces,
                               struct small_mesh *mesh)
{
    struct context *ctx = join->ctx;
    struct collapse_mesh *to = &mesh->triangles;
    to->vertex_count = vertices;
    to->face_count = faces;
    enum status status = memory_take(ctx, vertices, 3 * sizeof *to->positions, &to->positions);
    if (status == STATUS_OK)
        status = memory_take(ctx, (size_t)faces, 3 * sizeof *to->faces, &to->faces);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, 3 * sizeof *to->witnesses, &to->witnesses);
    if (status == STATUS_OK)
        memset(to->witnesses, 0xff, vertices * 3 * sizeof *to->witnesses);
    if (status == STATUS_OK && join->stride > 0)
        status = memory_take(ctx, vertices, join->stride, &to->records);
    if (status == STATUS_OK)
        status = memory_take(ctx, mesh->seam_count, sizeof *mesh->seams, &mesh->seams);
    return status;
}

enum status small_mesh_join(struct context *ctx, uint32_t stride, uint32_t slab_first,
                            uint32_t slab_end, struct small_mesh *parts, uint32_t count,
                            struct small_mesh *mesh)
{
    struct joiner join = {ctx, stride, slab_first, slab_end, parts, count, {NULL}};
    uint32_t vertices;
    uint64_t faces = 0, most = 0;
    size_t sizes[PARTS_MAX] = {0};
    enum status status = STATUS_OK;
    memset(mesh, 0, sizeof *mesh);
    if (count > PARTS_MAX)
        return fail(ctx, STATUS_INTERNAL, "%u meshes can't be joined at once", count);
    for (uint32_t p = 0; p < count && status == STATUS_OK; p++) {
        sizes[p] = (size_t)parts[p].triangles.vertex_count;
        most += sizes[p];
        faces += parts[p].triangles.face_count;
        status = memory_take(ctx, sizes[p], sizeof *join.numbers[p], &join.numbers[p]);
    }
    if (status == STATUS_OK && (most > UINT32_MAX - 2 || faces > UINT32_MAX - 2))
        status = fail(ctx, STATUS_MISUSE,
                      "the level asked for is too fine: the mesh between would have %llu faces",
                      (unsigned long long)faces);
    if (status != STATUS_OK)
        goto done;
    number_vertices(&join, &vertices, &mesh->seam_count);
    status = take_arrays(&join, vertices, faces, mesh);
    if (status != STATUS_OK)
        goto done;
    match_copies(&join, mesh);
    faces = 0;
    for (uint32_t p = 0; p < count; p++) {
        copy_part(&join, p, &mesh->triangles, (size_t)faces);
        faces += parts[p].triangles.face_count;
        small_mesh_clear(ctx, stride, &parts[p]);
    }
    status = small_mesh_split(ctx, stride, mesh);
done:
    for (uint32_t p = 0; p < count; p++)
        memory_release(ctx, &join.numbers[p], sizes[p], sizeof *join.numbers[p]);
    if (status != STATUS_OK)
        small_mesh_clear(ctx, stride, mesh);
    return status;
}
