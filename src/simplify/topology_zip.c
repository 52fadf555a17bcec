/*
 * Zipping.
 *
 * A crack mostly comes from vertices that were not shared (its sides have the same vertices twice)
 * or from an edge on one side against several on the other (T-junctions). Filling it covers it with
 * faces without area; joining all vertices that are near each other (welding) makes other surfaces
 * touch. A zip is safe because it is local: where two neighbouring edges of the border loop fold
 * onto each other, they are made one edge, the loop gets shorter, and the next two are looked at.
 * One step joins the two far ends, or puts the nearer one into the longer edge. A crack whose ends
 * gape has no such fold: there two edges that lie on each other are joined first, wherever they
 * are, which leaves a fold on both of their sides.
 *
 * All that a step looks at are the faces round the loop's vertices; they are gathered in one sweep
 * over the slabs. A step is not done when it would repeat an edge (the link condition) or turn a
 * face over.
 */
#include "simplify/topology_zip.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/forest.h"
#include "base/memory.h"
#include "simplify/topology_near.h"

/* Two edges fold onto each other when the far end of one is no farther from the other than this
 * part of its length. */
static const double fold_share = 0.25;

/* A corner of a loop. */
struct link {
    uint32_t vertex; /* place in zipper.near.vertices */
    uint32_t previous, next;
    uint32_t feature;
    bool is_gone, is_listed;
};

/* A link by its place along one axis. */
struct axis_place {
    double along;
    uint32_t link;
};

struct zipper {
    struct surgery *surgery;
    double tolerance;
    struct near_faces near;
    struct link *links; /* of all cracks */
    size_t link_count;
    struct axis_place *axis;
    uint32_t *agenda; /* links at which the loop may fold */
    size_t agenda_count, agenda_capacity;
    uint64_t zipped;
};

/* ---- tolerance ---- */

static int compare_lengths(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

enum status zip_tolerance_choose(struct surgery *surgery, double *tolerance)
{
    size_t count = surgery->border_count;
    double *lengths;
    *tolerance = 0;
    if (count == 0)
        return STATUS_OK;
    enum status status = memory_take(surgery->ctx, count, sizeof *lengths, &lengths);
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < count; i++) {
        const struct border_edge *edge = &surgery->borders[i];
        const struct border_edge *end =
            &surgery->borders[find_number(surgery->borders, sizeof *edge, count, edge->to)];
        lengths[i] = vec3_distance(vec3_load_float(edge->position), vec3_load_float(end->position));
    }
    qsort(lengths, count, sizeof *lengths, compare_lengths);
    *tolerance = lengths[count / 2] / 10;
    memory_release(surgery->ctx, &lengths, count, sizeof *lengths);
    return STATUS_OK;
}

/* ---- steps ---- */

static void remove_link(struct zipper *zipper, uint32_t i)
{
    struct link *link = &zipper->links[i];
    zipper->links[link->previous].next = link->next;
    zipper->links[link->next].previous = link->previous;
    link->is_gone = true;
}

/* A loop of two edges is closed: they are one. */
static void close_pair(struct zipper *zipper, uint32_t i)
{
    struct link *links = zipper->links;
    if (links[i].next == links[i].previous)
        links[i].is_gone = links[links[i].next].is_gone = true;
}

/* Is the loop of link i just so long? */
static bool loop_has(const struct zipper *zipper, uint32_t i, unsigned length)
{
    uint32_t at = i;
    for (unsigned k = 1; k < length; k++) {
        at = zipper->links[at].next;
        if (at == i)
            return false;
    }
    return zipper->links[at].next == i;
}

static enum status look_again(struct zipper *zipper, uint32_t i)
{
    enum status status =
        memory_reserve(zipper->surgery->ctx, &zipper->agenda, &zipper->agenda_capacity,
                       zipper->agenda_count + 1, sizeof *zipper->agenda);
    if (status == STATUS_OK)
        zipper->agenda[zipper->agenda_count++] = i;
    return status;
}

/* Which of two vertices goes where the other is: the one with the higher number unless that turns a
 * face over. False if both do. */
static bool choose_gone(const struct zipper *zipper, uint32_t a, uint32_t b, uint32_t *stays,
                        uint32_t *gone)
{
    *stays = a < b ? a : b;
    *gone = a < b ? b : a;
    if (!near_turns_face(&zipper->near, *gone, near_position(&zipper->near, *stays)))
        return true;
    *stays = a < b ? b : a;
    *gone = a < b ? a : b;
    return !near_turns_face(&zipper->near, *gone, near_position(&zipper->near, *stays));
}

/* Can two vertices with no edge between them be one, as far as the edges go? Two neighbours may be
 * common. */
static bool can_join(const struct zipper *zipper, uint32_t a, uint32_t b, uint32_t allowed,
                     uint32_t also_allowed)
{
    return a != b && !near_has_many_faces(&zipper->near, a) &&
           !near_has_many_faces(&zipper->near, b) &&
           !near_are_joined(&zipper->near, a, zipper->near.vertices[b]) &&
           !near_share_others(&zipper->near, a, b, allowed, also_allowed);
}

/* Makes the two neighbours of link `tip` one vertex, if that leaves a manifold. */
static enum status join_ends(struct zipper *zipper, uint32_t tip)
{
    struct link *links = zipper->links;
    uint32_t before = links[tip].previous, after = links[tip].next;
    uint32_t stays, gone, tip_vertex = zipper->near.vertices[links[tip].vertex];
    /* In a loop of four both pairs of edges become one. */
    uint32_t far = loop_has(zipper, tip, 4) ? zipper->near.vertices[links[links[after].next].vertex]
                                            : tip_vertex;
    /* Two triangles that share an edge and are all there is would become the same. */
    if ((near_has_face(&zipper->near, links[before].vertex, tip_vertex, far) &&
         near_has_face(&zipper->near, links[after].vertex, tip_vertex, far)) ||
        !can_join(zipper, links[before].vertex, links[after].vertex, tip_vertex, far) ||
        !choose_gone(zipper, links[before].vertex, links[after].vertex, &stays, &gone))
        return STATUS_OK;
    near_move_vertex(&zipper->near, gone, stays);
    zipper->zipped++;
    links[before].vertex = stays;
    remove_link(zipper, tip);
    remove_link(zipper, after);
    close_pair(zipper, before);
    return look_again(zipper, before);
}

/* Puts the vertex of link `inner` into the edge between its neighbour `tip` and that one's other
 * neighbour `outer`. */
static enum status put_into_edge(struct zipper *zipper, uint32_t tip, uint32_t inner,
                                 uint32_t outer)
{
    struct link *links = zipper->links;
    uint32_t place = links[inner].vertex, vertex = zipper->near.vertices[place];
    uint32_t outer_vertex = zipper->near.vertices[links[outer].vertex];
    bool outer_is_next = links[tip].next == outer;
    /* The face has the edge the other way round than the loop. */
    uint32_t from = outer_is_next ? outer : tip, to = outer_is_next ? tip : outer, corner;
    for (corner = zipper->near.first_corner[links[from].vertex]; corner != NO_INDEX;
         corner = zipper->near.next_corner[corner])
        if (near_vertex(&zipper->near, near_next(corner)) ==
            zipper->near.vertices[links[to].vertex])
            break;
    if (corner == NO_INDEX)
        return STATUS_OK;
    uint32_t end = near_next(corner), apex = near_next(end),
             apex_vertex = near_vertex(&zipper->near, apex);
    struct near_face first = zipper->near.faces[corner / 3], second = first;
    struct vec3 at = near_position(&zipper->near, place);
    struct vec3 whole = near_face_normal(&first, apex % 3, vec3_load_float(first.points[apex % 3]));
    if (apex_vertex == vertex || near_are_joined(&zipper->near, place, apex_vertex) ||
        (!loop_has(zipper, tip, 3) && near_are_joined(&zipper->near, place, outer_vertex)) ||
        vec3_dot(whole, near_face_normal(&first, end % 3, at)) < 0 ||
        vec3_dot(whole, near_face_normal(&first, corner % 3, at)) < 0)
        return STATUS_OK;
    first.corners[end % 3] = second.corners[corner % 3] = vertex;
    memcpy(first.points[end % 3], zipper->near.positions + 3 * (size_t)place,
           sizeof first.points[0]);
    memcpy(second.points[corner % 3], first.points[end % 3], sizeof first.points[0]);
    first.is_changed = second.is_changed = true;
    second.source = NO_INDEX;
    uint32_t split = corner / 3;
    enum status status = near_add_face(&zipper->near, &second);
    if (status != STATUS_OK)
        return status;
    zipper->near.faces[split] = first;
    uint32_t added = 3 * (uint32_t)(zipper->near.face_count - 1);
    near_unlist_corner(&zipper->near, links[to].vertex, end);
    near_list_corner(&zipper->near, links[to].vertex, added + end % 3);
    near_list_corner(&zipper->near, place, end);
    near_list_corner(&zipper->near, place, added + corner % 3);
    near_list_corner(&zipper->near, near_place(&zipper->near, apex_vertex), added + apex % 3);
    zipper->zipped++;
    remove_link(zipper, tip);
    close_pair(zipper, inner);
    status = look_again(zipper, inner);
    return status == STATUS_OK ? look_again(zipper, outer) : status;
}

static double segment_distance(struct vec3 p, struct vec3 a, struct vec3 b)
{
    struct vec3 along = vec3_sub(b, a);
    double length = vec3_length_squared(along);
    double t = length > 0 ? vec3_dot(vec3_sub(p, a), along) / length : 0;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return vec3_distance(p, vec3_add_scaled(a, t, along));
}

/* How near two things along an edge of that length must be. */
static double reach_along(const struct zipper *zipper, double length)
{
    double reach = fold_share * length;
    return reach < zipper->tolerance ? reach : zipper->tolerance;
}

/* One step at a link, if the loop folds there. */
static enum status zip_at(struct zipper *zipper, uint32_t tip)
{
    const struct link *links = zipper->links;
    uint32_t before = links[tip].previous, after = links[tip].next;
    struct vec3 v = near_position(&zipper->near, links[tip].vertex);
    struct vec3 p = near_position(&zipper->near, links[before].vertex);
    struct vec3 q = near_position(&zipper->near, links[after].vertex);
    double to_p = vec3_distance(v, p), to_q = vec3_distance(v, q);
    double reach = reach_along(zipper, to_p < to_q ? to_p : to_q);
    if (!(reach > 0))
        return STATUS_OK;
    if (!loop_has(zipper, tip, 3) && vec3_distance(p, q) <= reach)
        return join_ends(zipper, tip);
    if (to_q < to_p && segment_distance(q, v, p) <= reach)
        return put_into_edge(zipper, tip, after, before);
    if (to_p < to_q && segment_distance(p, v, q) <= reach)
        return put_into_edge(zipper, tip, before, after);
    return STATUS_OK;
}

static enum status zip_folds(struct zipper *zipper)
{
    enum status status = STATUS_OK;
    while (zipper->agenda_count > 0 && status == STATUS_OK) {
        uint32_t at = zipper->agenda[--zipper->agenda_count];
        if (!zipper->links[at].is_gone)
            status = zip_at(zipper, at);
    }
    return status;
}

/* ---- edges that lie on each other ---- */

/* More of a loop is not walked. */
enum { WALK_MAX = 10000 };

static bool share_loop(const struct zipper *zipper, uint32_t a, uint32_t b)
{
    uint32_t forward = a, backward = a;
    for (unsigned steps = 0; steps < WALK_MAX; steps++) {
        forward = zipper->links[forward].next;
        backward = zipper->links[backward].previous;
        if (forward == b || backward == b)
            return true;
        if (forward == a || forward == backward)
            return false;
    }
    return false;
}

/*
 * Joins the edge from link a on and the edge to link d, which run against each other. Their loop
 * falls in two; or two loops become one, which must not be of one component, or it would get a
 * handle.
 */
static enum status join_edges(struct zipper *zipper, uint32_t a, uint32_t d, bool *done)
{
    struct link *links = zipper->links;
    uint32_t b = links[a].next, c = links[d].previous;
    uint32_t at_a = links[a].vertex, at_b = links[b].vertex, at_c = links[c].vertex,
             at_d = links[d].vertex;
    uint32_t stays, gone, stays_too, gone_too;
    *done = false;
    bool are_apart =
        forest_root(zipper->near.parents, at_a) != forest_root(zipper->near.parents, at_d);
    if (b == d || c == a || !(are_apart || share_loop(zipper, a, d)) || at_a == at_c ||
        at_b == at_d || near_are_joined(&zipper->near, at_a, zipper->near.vertices[at_c]) ||
        near_are_joined(&zipper->near, at_b, zipper->near.vertices[at_d]) ||
        !can_join(zipper, at_a, at_d, NO_INDEX, NO_INDEX) ||
        !can_join(zipper, at_b, at_c, NO_INDEX, NO_INDEX) ||
        !choose_gone(zipper, at_a, at_d, &stays, &gone) ||
        !choose_gone(zipper, at_b, at_c, &stays_too, &gone_too))
        return STATUS_OK;
    near_move_vertex(&zipper->near, gone, stays);
    zipper->zipped++;
    near_move_vertex(&zipper->near, gone_too, stays_too);
    zipper->zipped++;
    links[a].vertex = stays;
    links[c].vertex = stays_too;
    links[a].next = links[d].next;
    links[links[d].next].previous = a;
    links[c].next = links[b].next;
    links[links[b].next].previous = c;
    links[b].is_gone = links[d].is_gone = true;
    forest_join(zipper->near.parents, at_a, at_d);
    *done = true;
    enum status status = look_again(zipper, a);
    return status == STATUS_OK ? look_again(zipper, c) : status;
}

static int compare_places(const void *a, const void *b)
{
    const struct axis_place *x = a, *y = b;
    if (x->along != y->along)
        return x->along < y->along ? -1 : 1;
    return x->link < y->link ? -1 : x->link > y->link;
}

/* The axis along which the cracks are longest. */
static unsigned longest_axis(const struct zipper *zipper)
{
    double longest = -1;
    unsigned axis = 0;
    for (unsigned c = 0; c < 3; c++) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < zipper->near.vertex_count; i++) {
            double x = (double)zipper->near.positions[3 * i + c];
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
        if (high - low > longest) {
            longest = high - low;
            axis = c;
        }
    }
    return axis;
}

/* Do the edges from link a and to link d lie on each other? */
static bool edges_match(const struct zipper *zipper, uint32_t a, uint32_t d)
{
    const struct link *links = zipper->links;
    struct vec3 from = near_position(&zipper->near, links[a].vertex);
    struct vec3 to = near_position(&zipper->near, links[links[a].next].vertex);
    double reach = reach_along(zipper, vec3_distance(from, to));
    return vec3_distance(from, near_position(&zipper->near, links[d].vertex)) <= reach &&
           vec3_distance(to, near_position(&zipper->near, links[links[d].previous].vertex)) <=
               reach;
}

/* Of so many links near each other along the axis no more are looked at. */
enum { NEAR_MAX = 64 };

static enum status zip_edges(struct zipper *zipper)
{
    const unsigned axis = longest_axis(zipper);
    size_t count = 0;
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < zipper->link_count; i++)
        if (!zipper->links[i].is_gone)
            zipper->axis[count++] = (struct axis_place){
                (double)zipper->near.positions[3 * (size_t)zipper->links[i].vertex + axis], i};
    if (count > 0)
        qsort(zipper->axis, count, sizeof *zipper->axis, compare_places);
    for (size_t i = 0; i < count && status == STATUS_OK; i++)
        for (size_t j = i + 1; j < count && j <= i + NEAR_MAX && status == STATUS_OK &&
                               zipper->axis[j].along - zipper->axis[i].along <= zipper->tolerance;
             j++) {
            uint32_t a = zipper->axis[i].link, d = zipper->axis[j].link;
            bool done = false;
            if (zipper->links[a].is_gone)
                break;
            if (zipper->links[d].is_gone)
                continue;
            if (edges_match(zipper, a, d))
                status = join_edges(zipper, a, d, &done);
            else if (edges_match(zipper, d, a))
                status = join_edges(zipper, d, a, &done);
            if (done && status == STATUS_OK)
                status = zip_folds(zipper);
        }
    return status;
}

/* ---- loops ---- */

static enum status list_links(struct zipper *zipper)
{
    const struct surgery *surgery = zipper->surgery;
    struct context *ctx = surgery->ctx;
    size_t count = 0;
    for (size_t i = 0; i < surgery->loop_count; i++)
        count += surgery->loops[i].is_crack ? surgery->loops[i].count : 0;
    zipper->link_count = count;
    enum status status = memory_take(ctx, count, sizeof *zipper->links, &zipper->links);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *zipper->axis, &zipper->axis);
    uint32_t first = 0;
    for (size_t i = 0; i < surgery->loop_count && status == STATUS_OK; i++) {
        const struct fill_loop *loop = &surgery->loops[i];
        const uint32_t n = loop->is_crack ? loop->count : 0;
        for (uint32_t k = 0; k < n; k++)
            zipper->links[first + k] = (struct link){
                .vertex = near_place(&zipper->near, surgery->corners[loop->first + k]),
                .previous = first + (k == 0 ? n : k) - 1,
                .next = first + (k + 1 == n ? 0 : k + 1),
                .feature = loop->feature};
        first += n;
    }
    for (uint32_t i = first; i-- > 0 && status == STATUS_OK;)
        status = look_again(zipper, i);
    return status;
}

/* What is left of the cracks replaces them in the surgery's list. */
static enum status replace_cracks(struct zipper *zipper)
{
    struct surgery *surgery = zipper->surgery;
    struct context *ctx = surgery->ctx;
    uint32_t *corners = NULL;
    size_t capacity = 0, kept = 0;
    enum status status = STATUS_OK;
    for (size_t i = 0; i < surgery->loop_count; i++)
        if (!surgery->loops[i].is_crack)
            surgery->loops[kept++] = surgery->loops[i];
    surgery->loop_count = kept;
    for (uint32_t i = 0; i < zipper->link_count && status == STATUS_OK; i++) {
        struct link *links = zipper->links;
        uint32_t count = 0, at = i;
        if (links[i].is_gone || links[i].is_listed)
            continue;
        do {
            status = memory_reserve(ctx, &corners, &capacity, (size_t)count + 1, sizeof *corners);
            if (status == STATUS_OK)
                corners[count++] = zipper->near.vertices[links[at].vertex];
            links[at].is_listed = true;
            at = links[at].next;
        } while (at != i && status == STATUS_OK);
        if (status == STATUS_OK)
            status = surgery_add_loop(surgery, corners, count, links[i].feature, true);
    }
    memory_release(ctx, &corners, capacity, sizeof *corners);
    return status;
}

/* Loops of features that pass through a crack's vertices follow them. */
static void follow_moves(struct zipper *zipper)
{
    struct surgery *surgery = zipper->surgery;
    for (size_t i = 0; i < surgery->corner_count; i++) {
        uint32_t *corner = &surgery->corners[i], place = near_place(&zipper->near, *corner);
        while (place != NO_INDEX && zipper->near.moved_to[place] != NO_INDEX)
            place = zipper->near.moved_to[place];
        if (place != NO_INDEX)
            *corner = zipper->near.vertices[place];
    }
}

static enum status keep_changed(struct zipper *zipper)
{
    struct surgery *surgery = zipper->surgery;
    for (size_t f = 0; f < zipper->near.face_count; f++) {
        const struct near_face *face = &zipper->near.faces[f];
        if (!face->is_changed)
            continue;
        enum status status =
            memory_reserve(surgery->ctx, &surgery->mended, &surgery->mended_capacity,
                           3 * (surgery->mended_count + 1), sizeof *surgery->mended);
        if (status != STATUS_OK)
            return status;
        memcpy(surgery->mended + 3 * surgery->mended_count++, face->corners, sizeof face->corners);
        if (face->source != NO_INDEX) {
            bit_set(surgery->dropped, face->source);
            surgery->dropped_count++;
        }
    }
    return STATUS_OK;
}

enum status cracks_zip(struct surgery *surgery, double tolerance, uint64_t *zipped)
{
    struct context *ctx = surgery->ctx;
    struct zipper zipper = {
        .surgery = surgery, .tolerance = tolerance, .near = {.surgery = surgery}};
    enum status status = near_gather(&zipper.near);
    if (status == STATUS_OK)
        status = list_links(&zipper);
    if (status == STATUS_OK)
        status = zip_folds(&zipper);
    if (status == STATUS_OK)
        status = zip_edges(&zipper);
    if (status == STATUS_OK)
        status = replace_cracks(&zipper);
    if (status == STATUS_OK) {
        follow_moves(&zipper);
        status = keep_changed(&zipper);
    }
    *zipped = zipper.zipped;
    near_clear(&zipper.near);
    memory_release(ctx, &zipper.links, zipper.link_count, sizeof *zipper.links);
    memory_release(ctx, &zipper.axis, zipper.link_count, sizeof *zipper.axis);
    memory_release(ctx, &zipper.agenda, zipper.agenda_capacity, sizeof *zipper.agenda);
    return status;
}
