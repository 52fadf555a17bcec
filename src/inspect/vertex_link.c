/*
 * Sorting the ends of the faces by neighbour puts all faces of one edge side by side; a union-find
 * over the vertex's few faces then gives the fans. A vertex of a million faces (the tip of a cone)
 * costs its sort, no more.
 */
#include "inspect/vertex_link.h"

#include <string.h>

#include "base/memory.h"

void vertex_link_init(struct context *ctx, struct vertex_link *link)
{
    memset(link, 0, sizeof *link);
    link->ctx = ctx;
}

void vertex_link_clear(struct vertex_link *link)
{
    memory_release(link->ctx, &link->faces, link->face_capacity, sizeof *link->faces);
    memory_release(link->ctx, &link->ends, link->end_capacity, sizeof *link->ends);
    memory_release(link->ctx, &link->fan, link->fan_capacity, sizeof *link->fan);
    vertex_link_init(link->ctx, link);
}

void vertex_link_begin(struct vertex_link *link, uint32_t vertex)
{
    link->vertex = vertex;
    link->degree = 0;
}

enum status vertex_link_add(struct vertex_link *link, struct link_face face)
{
    if (link->degree == link->face_capacity) {
        enum status status = memory_reserve(link->ctx, &link->faces, &link->face_capacity,
                                            (size_t)link->degree + 1, sizeof *link->faces);
        if (status != STATUS_OK)
            return status;
    }
    link->faces[link->degree++] = face;
    return STATUS_OK;
}

static bool end_before(const struct link_end *a, const struct link_end *b)
{
    if (a->neighbour != b->neighbour)
        return a->neighbour < b->neighbour;
    if (a->other != b->other)
        return a->other < b->other;
    return a->place < b->place;
}

static void sort_few(struct link_end *ends, size_t count)
{
    for (size_t i = 1; i < count; i++) {
        struct link_end end = ends[i];
        size_t at = i;
        for (; at > 0 && end_before(&end, &ends[at - 1]); at--)
            ends[at] = ends[at - 1];
        ends[at] = end;
    }
}

static void sift(struct link_end *ends, size_t root, size_t count)
{
    struct link_end end = ends[root];
    for (size_t child; (child = 2 * root + 1) < count; root = child) {
        if (child + 1 < count && end_before(&ends[child], &ends[child + 1]))
            child++;
        if (!end_before(&end, &ends[child]))
            break;
        ends[root] = ends[child];
    }
    ends[root] = end;
}

static void sort_ends(struct link_end *ends, size_t count)
{
    if (count <= 48) {
        sort_few(ends, count);
        return;
    }
    for (size_t root = count / 2; root-- > 0;)
        sift(ends, root, count);
    for (size_t last = count - 1; last > 0; last--) {
        struct link_end end = ends[0];
        ends[0] = ends[last];
        ends[last] = end;
        sift(ends, 0, last);
    }
}

static uint32_t find_fan(uint32_t *fan, uint32_t place)
{
    while (fan[place] != place) {
        fan[place] = fan[fan[place]];
        place = fan[place];
    }
    return place;
}

enum status vertex_link_finish(struct vertex_link *link, uint32_t *fans)
{
    size_t count = 2 * (size_t)link->degree;
    enum status status =
        memory_reserve(link->ctx, &link->ends, &link->end_capacity, count, sizeof *link->ends);
    if (status == STATUS_OK)
        status = memory_reserve(link->ctx, &link->fan, &link->fan_capacity, link->degree,
                                sizeof *link->fan);
    if (status != STATUS_OK)
        return status;

    for (uint32_t i = 0; i < link->degree; i++) {
        const struct link_face *face = &link->faces[i];
        link->ends[2 * (size_t)i] = (struct link_end){face->next, face->previous, i, true};
        link->ends[2 * (size_t)i + 1] = (struct link_end){face->previous, face->next, i, false};
        link->fan[i] = i;
    }
    sort_ends(link->ends, count);

    *fans = link->degree;
    for (size_t i = 1; i < count; i++) {
        if (link->ends[i].neighbour != link->ends[i - 1].neighbour)
            continue;
        uint32_t a = find_fan(link->fan, link->ends[i - 1].place);
        uint32_t b = find_fan(link->fan, link->ends[i].place);
        if (a == b)
            continue;
        link->fan[a > b ? a : b] = a > b ? b : a;
        --*fans;
    }
    /* A parent never stands behind its child, so one sweep makes every entry a root. */
    for (uint32_t i = 0; i < link->degree; i++)
        link->fan[i] = link->fan[link->fan[i]];
    return STATUS_OK;
}
