/*
 * Border loops. In a manifold every vertex of the border has one border edge that leaves it, so the
 * loops follow from a table sorted by vertex. How wide a crack is can be asked in two ways: by the
 * largest distance of two of its vertices, or by the largest circle that fits in, which a long thin
 * crack passes and a round window of the same length does not.
 */
#include "simplify/topology_cracks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* The circle is found to this fraction of its diameter, or of the loop's extent: a loop without an
 * inside is no end of squares along a line. */
static const double circle_precision = 0.01;
static const double extent_precision = 1e-3;

struct search {
    struct surgery *surgery;
    const struct crack_options *options;
    struct feature_list *list;
    uint8_t *visited;  /* a border edge */
    uint32_t *corners; /* of the loop in hand, backwards: with the fill on the left */
    double *points;    /* 3 a corner */
    size_t corner_capacity, point_capacity;
    uint32_t count;
    struct loop_points scratch;
    struct cell *cells; /* a heap, the most promising first */
    size_t cell_count, cell_capacity;
};

static int compare_edges(const void *a, const void *b)
{
    uint32_t x = ((const struct border_edge *)a)->from, y = ((const struct border_edge *)b)->from;
    return x < y ? -1 : x > y;
}

/* The border edge that starts at a vertex, or border_count. */
static size_t edge_from(const struct surgery *surgery, uint32_t vertex)
{
    const size_t count = surgery->border_count;
    size_t at = find_number(surgery->borders, sizeof *surgery->borders, count, vertex);
    return at < count && surgery->borders[at].from == vertex ? at : count;
}

/* ---- the largest circle inside ---- */

struct flat_point {
    double x, y;
};

/* A square that may hold the middle of the largest circle. */
struct cell {
    double x, y, half, distance, most; /* most: the radius that a point in it can have at most */
};

static double edge_distance(struct flat_point p, struct flat_point a, struct flat_point b)
{
    double dx = b.x - a.x, dy = b.y - a.y, length = dx * dx + dy * dy;
    double t = length > 0 ? ((p.x - a.x) * dx + (p.y - a.y) * dy) / length : 0;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    double x = a.x + t * dx - p.x, y = a.y + t * dy - p.y;
    return sqrt(x * x + y * y);
}

/* Distance from the outline, negative outside. */
static double inside_distance(const struct flat_point *outline, uint32_t n, struct flat_point p)
{
    double least = INFINITY;
    bool is_inside = false;
    for (uint32_t i = 0, j = n - 1; i < n; j = i++) {
        struct flat_point a = outline[i], b = outline[j];
        if ((a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x)
            is_inside = !is_inside;
        double distance = edge_distance(p, a, b);
        least = distance < least ? distance : least;
    }
    return is_inside ? least : -least;
}

static enum status push_cell(struct search *search, const struct flat_point *outline, double x,
                             double y, double half)
{
    enum status status =
        memory_reserve(search->surgery->ctx, &search->cells, &search->cell_capacity,
                       search->cell_count + 1, sizeof *search->cells);
    if (status != STATUS_OK)
        return status;
    double distance = inside_distance(outline, search->count, (struct flat_point){x, y});
    struct cell cell = {x, y, half, distance, distance + half * 1.4142135623730951};
    size_t at = search->cell_count++;
    for (; at > 0 && search->cells[(at - 1) / 2].most < cell.most; at = (at - 1) / 2)
        search->cells[at] = search->cells[(at - 1) / 2];
    search->cells[at] = cell;
    return STATUS_OK;
}

static struct cell pop_cell(struct search *search)
{
    struct cell top = search->cells[0], last = search->cells[--search->cell_count];
    size_t at = 0, child;
    while ((child = 2 * at + 1) < search->cell_count) {
        if (child + 1 < search->cell_count &&
            search->cells[child + 1].most > search->cells[child].most)
            child++;
        if (search->cells[child].most <= last.most)
            break;
        search->cells[at] = search->cells[child];
        at = child;
    }
    search->cells[at] = last;
    return top;
}

/* Squares are halved, the most promising first, until none can hold a noticeably larger circle. */
static enum status search_circle(struct search *search, const struct flat_point *outline,
                                 double *diameter)
{
    double low_x = INFINITY, low_y = INFINITY, high_x = -INFINITY, high_y = -INFINITY, best = 0;
    for (uint32_t i = 0; i < search->count; i++) {
        low_x = fmin(low_x, outline[i].x);
        high_x = fmax(high_x, outline[i].x);
        low_y = fmin(low_y, outline[i].y);
        high_y = fmax(high_y, outline[i].y);
    }
    double half = fmax(high_x - low_x, high_y - low_y) / 2, least = extent_precision * half;
    search->cell_count = 0;
    enum status status =
        push_cell(search, outline, (low_x + high_x) / 2, (low_y + high_y) / 2, half);
    while (status == STATUS_OK && search->cell_count > 0) {
        struct cell cell = pop_cell(search);
        if (cell.most <= best * (1 + circle_precision) + least)
            break;
        best = cell.distance > best ? cell.distance : best;
        for (unsigned i = 0; i < 4 && status == STATUS_OK; i++)
            status = push_cell(search, outline, cell.x + (i & 1 ? 0.5 : -0.5) * cell.half,
                               cell.y + (i & 2 ? 0.5 : -0.5) * cell.half, cell.half / 2);
    }
    *diameter = 2 * best;
    return status;
}

static enum status inscribed_circle(struct search *search, double *diameter)
{
    struct context *ctx = search->surgery->ctx;
    struct vec3 origin = vec3_load(search->points), normal = {0, 0, 0};
    for (uint32_t i = 1; i + 1 < search->count; i++)
        normal = vec3_add(normal, triangle_normal(origin, vec3_load(search->points + 3 * (size_t)i),
                                                  vec3_load(search->points + 3 * (size_t)i + 3)));
    normal = vec3_normalized(normal);
    struct vec3 helper = fabs(normal.x) < 0.6 ? vec3_make(1, 0, 0) : vec3_make(0, 1, 0);
    struct vec3 u = vec3_normalized(vec3_cross(normal, helper)), v = vec3_cross(normal, u);
    struct flat_point *outline;
    enum status status = memory_take(ctx, search->count, sizeof *outline, &outline);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < search->count; i++) {
        struct vec3 at = vec3_sub(vec3_load(search->points + 3 * (size_t)i), origin);
        outline[i] = (struct flat_point){vec3_dot(at, u), vec3_dot(at, v)};
    }
    status = search_circle(search, outline, diameter);
    memory_release(ctx, &outline, search->count, sizeof *outline);
    return status;
}

/* ---- loops ---- */

static enum status gather_loop(struct search *search, size_t first, bool *closes)
{
    struct surgery *surgery = search->surgery;
    struct context *ctx = surgery->ctx;
    size_t at = first;
    search->count = 0;
    do {
        enum status status = memory_reserve(ctx, &search->corners, &search->corner_capacity,
                                            (size_t)search->count + 1, sizeof *search->corners);
        if (status == STATUS_OK)
            status = memory_reserve(ctx, &search->points, &search->point_capacity,
                                    3 * ((size_t)search->count + 1), sizeof *search->points);
        if (status != STATUS_OK)
            return status;
        for (unsigned c = 0; c < 3; c++)
            search->points[3 * (size_t)search->count + c] =
                (double)surgery->borders[at].position[c];
        search->corners[search->count++] = surgery->borders[at].from;
        search->visited[at] = 1;
        at = edge_from(surgery, surgery->borders[at].to);
    } while (at < surgery->border_count && !search->visited[at]);
    *closes = at == first && search->count >= 3;
    return STATUS_OK;
}

static enum status judge_loop(struct search *search)
{
    struct context *ctx = search->surgery->ctx;
    double size = 0;
    enum status status = search->options->inscribed
                             ? inscribed_circle(search, &size)
                             : points_diameter(ctx, &search->scratch, search->points, search->count,
                                               INFINITY, &size);
    if (status != STATUS_OK || size >= search->options->size)
        return status;
    struct feature feature = {.kind = FEATURE_CRACK, .loops = 1, .size = size};
    struct vec3 sum = {0, 0, 0};
    for (uint32_t i = 0; i < search->count; i++)
        sum = vec3_add(sum, vec3_load(search->points + 3 * (size_t)i));
    vec3_store(feature.place, vec3_scale(sum, 1 / (double)search->count));
    for (uint32_t i = 0, j = search->count - 1; i < j; i++, j--) {
        uint32_t swap = search->corners[i];
        search->corners[i] = search->corners[j];
        search->corners[j] = swap;
    }
    status = surgery_add_loop(search->surgery, search->corners, search->count,
                              (uint32_t)search->list->count, true);
    return status == STATUS_OK ? feature_list_add(ctx, search->list, &feature) : status;
}

enum status cracks_find(struct surgery *surgery, const struct crack_options *options,
                        struct feature_list *list)
{
    struct context *ctx = surgery->ctx;
    struct search search = {.surgery = surgery, .options = options, .list = list};
    size_t count = surgery->border_count;
    if (count == 0)
        return STATUS_OK;
    enum status status = memory_take_zeroed(ctx, count, 1, &search.visited);
    if (status != STATUS_OK)
        return status;
    qsort(surgery->borders, count, sizeof *surgery->borders, compare_edges);
    for (size_t i = 0; i < count && status == STATUS_OK; i++) {
        bool closes = false;
        if (search.visited[i])
            continue;
        status = gather_loop(&search, i, &closes);
        if (status == STATUS_OK && closes)
            status = judge_loop(&search);
    }
    memory_release(ctx, &search.visited, count, 1);
    memory_release(ctx, &search.corners, search.corner_capacity, sizeof *search.corners);
    memory_release(ctx, &search.points, search.point_capacity, sizeof *search.points);
    memory_release(ctx, &search.cells, search.cell_capacity, sizeof *search.cells);
    loop_points_clear(ctx, &search.scratch);
    return status;
}
