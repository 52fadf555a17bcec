/*
 * What hangs together by edges is a component. To spread from face to face asks each face for its
 * neighbours, in an order of its own. But in a plain slab the faces at a vertex that no other slab
 * uses are one fan, and so in one component: whoever has such a vertex needs no neighbours. Faces
 * are taken in their order; a vertex is new, or it says which component it came into. As vertices
 * are numbered by first use, nearly all faces have an old one, and nearly all old ones say the
 * same. Only the faces at shared vertices, few, look at their neighbours.
 */
#include "mesh/survey_plain.h"

#include <string.h>

#include "base/forest.h"
#include "base/memory.h"

/* What is said of an own vertex: its component, or one of these. */
#define UNKNOWN UINT32_C(0)
#define SHARED UINT32_MAX

/*
 * A component is said in CODE_BITS bits and the same turned over. So of two neither has all bits of
 * the other, and what several vertices say together, by `or`, is a component if and only if some
 * say it and the others nothing. Those whose number has no room are said as it is, with IS_PLAIN.
 */
enum { CODE_BITS = 15, CODES = 1 << CODE_BITS };
#define IS_PLAIN (UINT32_C(1) << 31)

enum { RUN = 64 }; /* faces looked at together */

static inline uint32_t saying_of(uint32_t component)
{
    return component < CODES ? component | (~component & (CODES - 1)) << CODE_BITS
                             : component | IS_PLAIN;
}

static inline uint32_t said_component(uint32_t saying)
{
    return saying & IS_PLAIN ? saying & ~IS_PLAIN : saying & (CODES - 1);
}

enum status surveyor_begin_component(struct surveyor *s, uint32_t i)
{
    const uint32_t number = s->components.count;
    enum status status = STATUS_OK;
    if (number == s->joined_capacity)
        status = memory_reserve(s->components.ctx, &s->joined, &s->joined_capacity,
                                (size_t)number + 256, sizeof *s->joined);
    if (status == STATUS_OK)
        status = component_begin(&s->components, i);
    if (status != STATUS_OK)
        return status;
    s->joined[number] = number;
    s->marks[i] = number << CORNER_BITS;
    return STATUS_OK;
}

/* ---- what is said ---- */

/* Face i comes into the first of the components that are said, which are joined, or a new one;
 * *saying is what it says from now on. */
static enum status enter_face(struct surveyor *s, uint32_t i, const uint32_t *sayings,
                              unsigned count, uint32_t *saying)
{
    uint32_t least = UINT32_MAX;
    for (unsigned k = 0; k < count; k++) {
        const uint32_t component = said_component(sayings[k]);
        if (sayings[k] != UNKNOWN && component < least)
            least = component;
    }
    if (least == UINT32_MAX) {
        *saying = saying_of(s->components.count);
        return surveyor_begin_component(s, i);
    }
    *saying = saying_of(least);
    s->marks[i] = least << CORNER_BITS;
    for (unsigned k = 0; k < count; k++)
        if (sayings[k] != UNKNOWN && sayings[k] != *saying)
            forest_join(s->joined, least, said_component(sayings[k]));
    return STATUS_OK;
}

/* A face that has a shared vertex hears its other vertices, and its neighbours before it. */
static enum status enter_rim_face(const struct draft *draft, struct surveyor *s, uint32_t i)
{
    const struct slab_scope *scope = s->scope;
    const size_t at = 3 * ((size_t)scope->face_first + i);
    uint32_t sayings[6] = {UNKNOWN}, saying;
    uint32_t *alone[3];
    unsigned alone_count = 0;
    if (s->rim_face_count == s->rim_face_capacity) {
        enum status status = memory_reserve(draft->ctx, &s->rim_faces, &s->rim_face_capacity,
                                            (size_t)s->rim_face_count + 1024, sizeof *s->rim_faces);
        if (status != STATUS_OK)
            return status;
    }
    s->rim_faces[s->rim_face_count++] = i;
    for (unsigned k = 0; k < 3; k++) {
        const uint32_t own = draft->faces[at + k] - scope->vertex_first;
        const uint32_t there = draft->neighbours[at + k] - scope->face_first;
        if (own < scope->own_count && s->said[own] != SHARED) {
            sayings[k] = s->said[own];
            alone[alone_count++] = &s->said[own];
        }
        if (there < i)
            sayings[3 + k] = saying_of(s->marks[there] >> CORNER_BITS);
    }
    enum status status = enter_face(s, i, sayings, 6, &saying);
    for (unsigned k = 0; k < alone_count; k++)
        *alone[k] = saying;
    return status;
}

/* From face i on, as long as the vertices of each together say `saying`: most do, so that the
 * questions are guessed right. Returns the first that is not so. */
static inline uint32_t enter_agreed(const uint32_t *faces, uint32_t i,
                                    const struct slab_scope *scope, uint32_t *said, uint32_t *marks,
                                    uint32_t saying)
{
    const uint32_t first = scope->vertex_first, own = scope->own_count, count = scope->face_count;
    const uint32_t mark = said_component(saying) << CORNER_BITS;
    if (saying & IS_PLAIN)
        return i;
    for (const uint32_t *face = faces + 3 * (size_t)i; i < count; i++, face += 3) {
        const uint32_t a = face[0] - first, b = face[1] - first, c = face[2] - first;
        if (a >= own || b >= own || c >= own || (said[a] | said[b] | said[c]) != saying)
            break;
        marks[i] = mark;
        said[a] = said[b] = said[c] = saying;
    }
    return i;
}

static bool is_rim_face(const struct slab_scope *scope, const uint32_t *face, const uint32_t *said)
{
    for (unsigned k = 0; k < 3; k++) {
        const uint32_t own = face[k] - scope->vertex_first;
        if (own >= scope->own_count || said[own] == SHARED)
            return true;
    }
    return false;
}

static enum status enter_faces(const struct draft *draft, struct surveyor *s)
{
    const struct slab_scope *scope = s->scope;
    const uint32_t *faces = draft->faces + 3 * (size_t)scope->face_first;
    uint32_t saying = IS_PLAIN; /* of the last face with no shared vertex */
    enum status status = STATUS_OK;
    for (uint32_t i = 0; status == STATUS_OK; i++) {
        i = enter_agreed(faces, i, scope, s->said, s->marks, saying);
        if (i >= scope->face_count)
            break;
        const uint32_t *face = faces + 3 * (size_t)i;
        if (is_rim_face(scope, face, s->said)) {
            status = enter_rim_face(draft, s, i);
            continue;
        }
        uint32_t *said[3], sayings[3];
        for (unsigned k = 0; k < 3; k++) {
            said[k] = &s->said[face[k] - scope->vertex_first];
            sayings[k] = *said[k];
        }
        status = enter_face(s, i, sayings, 3, &saying);
        *said[0] = *said[1] = *said[2] = saying;
    }
    return status;
}

/* ---- the whole ---- */

/* Those that are shared say so, the others nothing. */
static void silence_vertices(const struct draft *draft, struct surveyor *s)
{
    const uint32_t first = s->scope->vertex_first, end = first + s->scope->own_count;
    s->shared_own = 0;
    if (end > first)
        memset(s->said, 0, (end - first) * sizeof *s->said);
    for (uint32_t v = first; v < end;) {
        if (v % 8 == 0 && draft->shared[v / 8] == 0) {
            v += 8;
            continue;
        }
        if (is_shared(draft, v)) {
            s->said[v - first] = SHARED;
            s->shared_own++;
        }
        v++;
    }
}

static struct component *component_at(const struct surveyor *s, uint32_t i)
{
    return &s->components.list[s->marks[i] >> CORNER_BITS];
}

/* Edges over which another slab goes on: their ends are shared. */
static void note_seams(const struct draft *draft, struct surveyor *s)
{
    const uint32_t first = s->scope->face_first, count = s->scope->face_count;
    for (uint32_t at = 0; at < s->rim_face_count; at++) {
        const uint32_t i = s->rim_faces[at];
        const uint32_t *over = draft->neighbours + 3 * ((size_t)first + i);
        for (unsigned k = 0; k < 3; k++)
            if (over[k] - first >= count && over[k] != NO_INDEX)
                component_at(s, i)->open_id = 0;
    }
}

/* Edges over which nothing is: nearly all runs of faces have none, as vectors tell at once. */
static void note_borders(const struct draft *draft, struct surveyor *s)
{
    const uint32_t count = s->scope->face_count;
    const uint32_t *over = draft->neighbours + 3 * (size_t)s->scope->face_first;
    for (uint32_t i = 0; i < count; i += RUN) {
        const uint32_t begin = 3 * i, end = 3 * (count - i < RUN ? count : i + RUN);
        uint32_t any = 0;
        for (uint32_t e = begin; e < end; e++)
            any |= over[e] == NO_INDEX;
        for (uint32_t e = begin; e < end && any; e++)
            if (over[e] == NO_INDEX)
                component_at(s, e / 3)->borders++;
    }
}

static bool is_one_component(struct surveyor *s)
{
    for (uint32_t c = 0; c < s->components.count; c++)
        if (forest_root(s->joined, c) != 0)
            return false;
    return true;
}

/* Faces, and vertices by the face that uses them first. */
static void count_members(const struct draft *draft, struct surveyor *s)
{
    const struct slab_scope *scope = s->scope;
    struct component *list = s->components.list;
    const uint32_t *face = draft->faces + 3 * (size_t)scope->face_first;
    for (uint32_t c = 0; c < s->components.count; c++)
        list[c].faces = list[c].vertices = 0;
    if (is_one_component(s)) {
        list->faces = scope->face_count;
        list->vertices = scope->own_count;
        return;
    }
    for (uint32_t i = 0, next = scope->vertex_first; i < scope->face_count; i++, face += 3) {
        const uint32_t before = next;
        for (unsigned k = 0; k < 3; k++)
            next += face[k] == next;
        struct component *component = &list[s->marks[i] >> CORNER_BITS];
        component->vertices += next - before;
        component->faces++;
    }
}

enum status plain_components(const struct draft *draft, struct surveyor *s)
{
    enum status status = memory_reserve(draft->ctx, &s->said, &s->said_capacity,
                                        s->scope->own_count, sizeof *s->said);
    s->rim_face_count = 0;
    if (status != STATUS_OK)
        return status;
    silence_vertices(draft, s);
    status = enter_faces(draft, s);
    if (status != STATUS_OK)
        return status;
    note_seams(draft, s);
    note_borders(draft, s);
    count_members(draft, s);
    return STATUS_OK;
}
