/*
 * Parts are put together from rings: the area between an outer and an inner loop that both go round
 * a middle, triangulated by going round by angle.
 */
#include "test_parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const double full_turn = 6.283185307179586;

static void *take(size_t count, size_t size)
{
    void *memory = calloc(count ? count : 1, size);
    if (!memory)
        abort();
    return memory;
}

/* ---- loops and rings ---- */

enum { LOOP_MAX = 512 };

/* Vertices counter-clockwise seen from above; x and y as used for angles. */
struct ring {
    unsigned count;
    uint32_t vertices[LOOP_MAX];
    double x[LOOP_MAX], y[LOOP_MAX];
};

static void ring_add(struct ring *ring, uint32_t vertex, double x, double y)
{
    if (ring->count == LOOP_MAX)
        abort();
    ring->vertices[ring->count] = vertex;
    ring->x[ring->count] = x;
    ring->y[ring->count++] = y;
}

static void add_face(struct shape *shape, bool is_up, uint32_t a, uint32_t b, uint32_t c)
{
    if (is_up)
        shape_triangle(shape, a, b, c);
    else
        shape_triangle(shape, a, c, b);
}

/* Angle from `from` to `to` round the middle, in [-pi, pi]. */
static double turn(double from, double to)
{
    return remainder(to - from, full_turn);
}

/* The area between two loops round (x, y), both gone round so that angles differ as little as can
 * be: what is far apart in angle does not see each other past a hole. */
static double triangle_turn(const struct ring *one, unsigned a, unsigned b, const struct ring *two,
                            unsigned c)
{
    return (one->x[b] - one->x[a]) * (two->y[c] - one->y[a]) -
           (one->y[b] - one->y[a]) * (two->x[c] - one->x[a]);
}

/* Returns how many triangles are turned over: the loops do not see each other everywhere. */
static unsigned zip_rings(struct shape *shape, const struct ring *outer, const struct ring *inner,
                          double x, double y, bool is_up)
{
    unsigned folds = 0;
    double start = atan2(outer->y[0] - y, outer->x[0] - x);
    unsigned best = 0;
    double least = INFINITY;
    for (unsigned i = 0; i < inner->count; i++) {
        double distance = fabs(turn(start, atan2(inner->y[i] - y, inner->x[i] - x)));
        if (distance < least) {
            least = distance;
            best = i;
        }
    }
    unsigned o = 0, i = 0;
    double outer_angle = 0,
           inner_angle = turn(start, atan2(inner->y[best] - y, inner->x[best] - x));
    while (o < outer->count || i < inner->count) {
        unsigned oa = o % outer->count, ob = (o + 1) % outer->count;
        unsigned ia = (best + i) % inner->count, ib = (best + i + 1) % inner->count;
        double outer_step = turn(atan2(outer->y[oa] - y, outer->x[oa] - x),
                                 atan2(outer->y[ob] - y, outer->x[ob] - x));
        double inner_step = turn(atan2(inner->y[ia] - y, inner->x[ia] - x),
                                 atan2(inner->y[ib] - y, inner->x[ib] - x));
        bool takes_outer = i == inner->count ||
                           (o < outer->count && fabs(outer_angle + outer_step - inner_angle) <=
                                                    fabs(inner_angle + inner_step - outer_angle));
        if (takes_outer) {
            add_face(shape, is_up, outer->vertices[oa], outer->vertices[ob], inner->vertices[ia]);
            folds += triangle_turn(outer, oa, ob, inner, ia) <= 0;
            outer_angle += outer_step;
            o++;
        } else {
            add_face(shape, is_up, inner->vertices[ia], outer->vertices[oa], inner->vertices[ib]);
            folds += triangle_turn(inner, ib, ia, outer, oa) <= 0;
            inner_angle += inner_step;
            i++;
        }
    }
    return folds;
}

/* A fan round a new middle vertex. */
static void fill_ring(struct shape *shape, const struct ring *ring, double x, double y, double z,
                      bool is_up)
{
    uint32_t middle = shape_vertex(shape, x, y, z);
    for (unsigned i = 0; i < ring->count; i++)
        add_face(shape, is_up, ring->vertices[i], ring->vertices[(i + 1) % ring->count], middle);
}

/* A wall between two loops of as many vertices; seen from outside the loops when `is_outward`, the
 * second above the first. */
static void wall(struct shape *shape, const struct ring *low, const struct ring *high,
                 bool is_outward)
{
    for (unsigned i = 0; i < low->count; i++) {
        unsigned j = (i + 1) % low->count;
        add_face(shape, is_outward, low->vertices[i], low->vertices[j], high->vertices[j]);
        add_face(shape, is_outward, low->vertices[i], high->vertices[j], high->vertices[i]);
    }
}

/* ---- features ---- */

static void corner_at(const struct part_feature *feature, unsigned i, double scale, double *x,
                      double *y)
{
    double angle = full_turn * (i + 0.5) / feature->corners;
    *x = scale * feature->radii[i] * cos(angle);
    *y = scale * feature->radii[i] * sin(angle);
}

static void feature_ring(struct shape *shape, const struct part_feature *feature, double x,
                         double y, double z, double scale, struct ring *ring)
{
    ring->count = 0;
    for (unsigned i = 0; i < feature->corners; i++) {
        double dx, dy;
        corner_at(feature, i, scale, &dx, &dy);
        double px = (float)(x + dx), py = (float)(y + dy);
        ring_add(ring, shape_vertex(shape, px, py, z), px, py);
    }
}

double feature_diameter(const struct part_feature *feature)
{
    double most = 0, scale = feature->taper > 1 ? feature->taper : 1;
    for (unsigned i = 0; i < feature->corners; i++)
        for (unsigned j = 0; j < i; j++) {
            double ax, ay, bx, by;
            corner_at(feature, i, scale, &ax, &ay);
            corner_at(feature, j, scale, &bx, &by);
            most = fmax(most, hypot(ax - bx, ay - by));
        }
    return most;
}

double feature_extent(const struct part_feature *feature, double thickness)
{
    double most = feature_diameter(feature);
    double depth = feature->kind == PART_HOLE ? thickness : feature->depth;
    for (unsigned i = 0; i < feature->corners; i++)
        for (unsigned j = 0; j < feature->corners; j++) {
            double ax, ay, bx, by;
            corner_at(feature, i, 1, &ax, &ay);
            corner_at(feature, j, feature->taper, &bx, &by);
            most = fmax(most, hypot(hypot(ax - bx, ay - by), depth));
        }
    return most;
}

void feature_round(struct part_feature *feature, unsigned corners, double diameter)
{
    feature->corners = corners;
    feature->taper = 1;
    for (unsigned i = 0; i < corners; i++)
        feature->radii[i] = diameter / 2;
}

void feature_slot(struct part_feature *feature, unsigned corners, double length, double width)
{
    feature_round(feature, corners, width);
    double half = (length - width) / 2, r = width / 2;
    for (unsigned i = 0; i < corners; i++) {
        double angle = full_turn * (i + 0.5) / corners, c = fabs(cos(angle)), s = fabs(sin(angle));
        /* on the straight side, or on the round end */
        double side = s > 0 ? r / s : INFINITY;
        double end = half * c + sqrt(fmax(0, r * r - half * half * s * s));
        feature->radii[i] = side * c <= half ? side : end;
    }
}

void feature_star(struct part_feature *feature, unsigned points, double outer, double inner)
{
    feature_round(feature, 2 * points, outer);
    for (unsigned i = 1; i < 2 * points; i += 2)
        feature->radii[i] = inner / 2;
}

void feature_square(struct part_feature *feature, double side)
{
    feature_round(feature, 4, side * sqrt(2));
}

void feature_peanut(struct part_feature *feature, unsigned corners, double diameter, double apart)
{
    feature_round(feature, corners, diameter);
    double half = apart / 2, r = diameter / 2;
    for (unsigned i = 0; i < corners; i++) {
        double angle = full_turn * (i + 0.5) / corners, c = fabs(cos(angle)), s = fabs(sin(angle));
        feature->radii[i] = half * c + sqrt(fmax(0, r * r - half * half * s * s));
    }
}

/* ---- plates ---- */

struct part_plate plate_make(unsigned columns, unsigned rows, double thickness)
{
    struct part_plate plate = {.columns = columns, .rows = rows, .thickness = thickness};
    plate.cells = take((size_t)columns * rows, sizeof *plate.cells);
    for (unsigned i = 0; i < columns * rows; i++)
        plate.cells[i].is_solid = true;
    return plate;
}

void plate_free(struct part_plate *plate)
{
    free(plate->cells);
    memset(plate, 0, sizeof *plate);
}

struct part_plate plate_copy(const struct part_plate *plate)
{
    struct part_plate copy = *plate;
    size_t count = (size_t)plate->columns * plate->rows;
    copy.cells = take(count, sizeof *copy.cells);
    memcpy(copy.cells, plate->cells, count * sizeof *copy.cells);
    return copy;
}

struct part_cell *plate_cell(struct part_plate *plate, unsigned column, unsigned row)
{
    return &plate->cells[(size_t)row * plate->columns + column];
}

static bool cell_is_solid(const struct part_plate *plate, int column, int row)
{
    return column >= 0 && row >= 0 && column < (int)plate->columns && row < (int)plate->rows &&
           plate->cells[(size_t)row * plate->columns + (size_t)column].is_solid;
}

struct builder {
    const struct part_plate *plate;
    struct shape shape;
    uint32_t *corners[2];    /* bottom, top: vertices of the grid */
    uint32_t *edge_first[2]; /* a cell edge: its first additional vertex */
    unsigned folds;          /* triangles that are turned over */
};

/* Vertices are made when first asked for. */
static uint32_t grid_vertex(struct builder *builder, unsigned side, unsigned x, unsigned y)
{
    uint32_t *vertex = &builder->corners[side][(size_t)y * (builder->plate->columns + 1) + x];
    if (*vertex == UINT32_MAX)
        *vertex = shape_vertex(&builder->shape, x, y, side ? builder->plate->thickness : 0);
    return *vertex;
}

/* The edge from (x, y) in direction k (0: +x, 1: +y, 2: -x, 3: -y), its start but not its end. */
static void add_edge(struct builder *builder, unsigned side, unsigned x, unsigned y, unsigned k,
                     bool is_border, struct ring *ring)
{
    static const int step_x[] = {1, 0, -1, 0}, step_y[] = {0, 1, 0, -1};
    unsigned more = builder->plate->edge_vertices;
    ring_add(ring, grid_vertex(builder, side, x, y), x, y);
    if (!is_border || more == 0)
        return;
    unsigned low_x = k == 2 ? x - 1 : x, low_y = k == 3 ? y - 1 : y;
    size_t edge = 2 * ((size_t)low_y * (builder->plate->columns + 1) + low_x) + k % 2;
    uint32_t *first = &builder->edge_first[side][edge];
    if (*first == UINT32_MAX)
        for (unsigned i = 1; i <= more; i++) {
            double t = (float)((double)i / (more + 1));
            uint32_t v =
                shape_vertex(&builder->shape, low_x + (k % 2 ? 0 : t), low_y + (k % 2 ? t : 0),
                             side ? builder->plate->thickness : 0);
            if (i == 1)
                *first = v;
        }
    for (unsigned i = 0; i < more; i++) {
        uint32_t v = *first + (k < 2 ? i : more - 1 - i);
        double t = (double)(i + 1) / (more + 1);
        ring_add(ring, v, x + step_x[k] * t, y + step_y[k] * t);
    }
}

static bool edge_is_border(const struct part_plate *plate, unsigned column, unsigned row,
                           unsigned k)
{
    static const int step_x[] = {0, 1, 0, -1}, step_y[] = {-1, 0, 1, 0};
    return !cell_is_solid(plate, (int)column + step_x[k], (int)row + step_y[k]);
}

static void cell_ring(struct builder *builder, unsigned side, unsigned column, unsigned row,
                      struct ring *ring)
{
    static const unsigned dx[] = {0, 1, 1, 0}, dy[] = {0, 0, 1, 1};
    ring->count = 0;
    for (unsigned k = 0; k < 4; k++)
        add_edge(builder, side, column + dx[k], row + dy[k], k,
                 edge_is_border(builder->plate, column, row, k), ring);
}

/* A face at height z within `ring`, and the features on it from number `from` on. A hole's rim is
 * handed out in `hole`. */
static void build_face(struct builder *builder, const struct ring *ring,
                       const struct part_feature *features, unsigned count, double x, double y,
                       double z, bool is_up, struct ring *hole)
{
    struct shape *shape = &builder->shape;
    if (count == 0) {
        fill_ring(shape, ring, x, y, z, is_up);
        return;
    }
    struct ring *rim = take(1, sizeof *rim), *end = take(1, sizeof *end);
    feature_ring(shape, features, x, y, z, 1, rim);
    builder->folds += zip_rings(shape, ring, rim, x, y, is_up);
    if (features->kind == PART_HOLE) {
        *hole = *rim;
    } else {
        bool rises = features->kind == PART_BUMP;
        double end_z = z + (rises == is_up ? features->depth : -features->depth);
        feature_ring(shape, features, x, y, end_z, features->taper, end);
        /* A bump's wall is seen from outside, a pocket's from inside. */
        if (end_z > z)
            wall(shape, rim, end, rises);
        else
            wall(shape, end, rim, rises);
        build_face(builder, end, features + 1, count - 1, x, y, end_z, is_up, hole);
    }
    free(rim);
    free(end);
}

static void build_cell(struct builder *builder, unsigned column, unsigned row)
{
    const struct part_cell *cell =
        &builder->plate->cells[(size_t)row * builder->plate->columns + column];
    struct ring *bottom = take(1, sizeof *bottom), *top = take(1, sizeof *top);
    struct ring *hole = take(1, sizeof *hole), *end = take(1, sizeof *end);
    double x = column + 0.5, y = row + 0.5;
    cell_ring(builder, 0, column, row, bottom);
    cell_ring(builder, 1, column, row, top);
    build_face(builder, top, cell->top, cell->top_count, x, y, builder->plate->thickness, true,
               hole);
    if (hole->count > 0) {
        feature_ring(&builder->shape, &cell->top[cell->top_count - 1], x, y, 0,
                     cell->top[cell->top_count - 1].taper, end);
        builder->folds += zip_rings(&builder->shape, bottom, end, x, y, false);
        wall(&builder->shape, end, hole, false);
    } else
        build_face(builder, bottom, cell->bottom, cell->bottom_count, x, y, 0, false, hole);
    /* The sides of the part. */
    for (unsigned i = 0; i < bottom->count; i++) {
        unsigned j = (i + 1) % bottom->count;
        double mx = (bottom->x[i] + bottom->x[j]) / 2, my = (bottom->y[i] + bottom->y[j]) / 2;
        unsigned k = my == row ? 0 : mx == column + 1 ? 1 : my == row + 1 ? 2 : 3;
        if (!edge_is_border(builder->plate, column, row, k))
            continue;
        shape_triangle(&builder->shape, bottom->vertices[i], bottom->vertices[j], top->vertices[j]);
        shape_triangle(&builder->shape, bottom->vertices[i], top->vertices[j], top->vertices[i]);
    }
    free(bottom);
    free(top);
    free(hole);
    free(end);
}

static struct shape build_plate(const struct part_plate *plate, unsigned *folds)
{
    struct builder builder = {.plate = plate};
    size_t corners = (size_t)(plate->columns + 1) * (plate->rows + 1);
    for (unsigned side = 0; side < 2; side++) {
        builder.corners[side] = take(corners, sizeof(uint32_t));
        builder.edge_first[side] = take(2 * corners, sizeof(uint32_t));
        memset(builder.corners[side], 0xff, corners * sizeof(uint32_t));
        memset(builder.edge_first[side], 0xff, 2 * corners * sizeof(uint32_t));
    }
    for (unsigned row = 0; row < plate->rows; row++)
        for (unsigned column = 0; column < plate->columns; column++)
            if (cell_is_solid(plate, (int)column, (int)row))
                build_cell(&builder, column, row);
    for (unsigned side = 0; side < 2; side++) {
        free(builder.corners[side]);
        free(builder.edge_first[side]);
    }
    *folds = builder.folds;
    return builder.shape;
}

struct shape plate_shape(const struct part_plate *plate)
{
    unsigned folds;
    return build_plate(plate, &folds);
}

bool plate_is_sound(const struct part_plate *plate)
{
    unsigned folds;
    struct shape shape = build_plate(plate, &folds);
    shape_free(&shape);
    return folds == 0;
}

/* ---- expectations ---- */

static bool goes(const struct part_feature *feature, double size, bool by_extent, double thickness)
{
    return (by_extent ? feature_extent(feature, thickness) : feature_diameter(feature)) < size;
}

static void reduce_side(struct part_feature *features, unsigned *count, double size, bool by_extent,
                        double thickness, struct part_counts *counts)
{
    /* From the innermost outward: what carries something that stays, stays. */
    while (*count > 0 && goes(&features[*count - 1], size, by_extent, thickness)) {
        enum part_kind kind = features[--*count].kind;
        counts->holes += kind == PART_HOLE;
        counts->cavities += kind == PART_POCKET;
        counts->bumps += kind == PART_BUMP;
    }
}

struct part_counts plate_reduce(struct part_plate *plate, double size, bool by_extent)
{
    struct part_counts counts = {0, 0, 0};
    for (unsigned i = 0; i < plate->columns * plate->rows; i++) {
        struct part_cell *cell = &plate->cells[i];
        reduce_side(cell->top, &cell->top_count, size, by_extent, plate->thickness, &counts);
        reduce_side(cell->bottom, &cell->bottom_count, size, by_extent, plate->thickness, &counts);
    }
    return counts;
}

unsigned plate_genus(const struct part_plate *plate)
{
    unsigned holes = 0;
    for (unsigned i = 0; i < plate->columns * plate->rows; i++) {
        const struct part_cell *cell = &plate->cells[i];
        holes += cell->is_solid && cell->top_count > 0 &&
                 cell->top[cell->top_count - 1].kind == PART_HOLE;
    }
    return holes;
}

/* Corners of the outline: grid points round which not two neighbouring or all cells are solid. */
unsigned plate_outline_corners(const struct part_plate *plate)
{
    unsigned corners = 0;
    for (int y = 0; y <= (int)plate->rows; y++)
        for (int x = 0; x <= (int)plate->columns; x++) {
            unsigned solid = 0;
            for (int k = 0; k < 4; k++)
                solid += cell_is_solid(plate, x - (k & 1), y - (k >> 1));
            corners += solid == 1 || solid == 3;
        }
    return corners;
}

unsigned plate_fewest_faces(const struct part_plate *plate)
{
    unsigned vertices = 2 * plate_outline_corners(plate);
    for (unsigned i = 0; i < plate->columns * plate->rows; i++) {
        const struct part_cell *cell = &plate->cells[i];
        for (unsigned k = 0; cell->is_solid && k < cell->top_count; k++)
            vertices += 2 * cell->top[k].corners;
        for (unsigned k = 0; cell->is_solid && k < cell->bottom_count; k++)
            vertices += 2 * cell->bottom[k].corners;
    }
    return 2 * (vertices - 2 + 2 * plate_genus(plate));
}

/* ---- table 2 ---- */

static void set_hole(struct part_cell *cell, unsigned corners, double diameter)
{
    cell->top_count = 1;
    cell->top[0].kind = PART_HOLE;
    feature_round(&cell->top[0], corners, diameter);
}

struct part_plate part_box(void)
{
    struct part_plate plate = plate_make(2, 2, 1);
    for (unsigned i = 0; i < 4; i++)
        set_hole(&plate.cells[i], i < 3 ? 96 : 95, 0.5);
    plate.edge_vertices = 1;
    return plate;
}

struct part_plate part_fixture(unsigned side)
{
    struct part_plate plate = plate_make(side, side, 0.5);
    /* as many corners more as the table's 18,796 and 74,396 triangles need */
    unsigned more = side == 10 ? 79 : 159;
    for (unsigned i = 0; i < side * side; i++)
        set_hole(&plate.cells[i], i < more ? 45 : 44, 0.6);
    return plate;
}

struct part_plate part_battery(void)
{
    struct part_plate plate = plate_make(3, 3, 2);
    static const double sizes[] = {0.2, 0.4, 0.7};
    static const unsigned corners[] = {12, 16, 24};
    for (unsigned i = 0; i < 9; i++) {
        struct part_cell *cell = &plate.cells[i];
        cell->top_count = 1;
        cell->top[0].kind = PART_BUMP;
        cell->top[0].depth = 0.25;
        feature_round(&cell->top[0], corners[i % 3], sizes[i % 3]);
    }
    return plate;
}

struct part_plate part_block(unsigned number)
{
    /* A U, a cross, and a larger cross. */
    unsigned side = number == 3 ? 12 : number == 2 ? 8 : 6;
    struct part_plate plate = plate_make(side, number == 1 ? 4 : side, 1);
    unsigned holes = number == 1 ? 16 : number == 2 ? 32 : 80;
    for (unsigned y = 0; y < plate.rows; y++)
        for (unsigned x = 0; x < side; x++) {
            struct part_cell *cell = plate_cell(&plate, x, y);
            unsigned third = number == 3 ? 4 : 3;
            if (number == 1)
                cell->is_solid = y == 0 || x < 2 || x >= 4;
            else
                cell->is_solid =
                    (x >= third && x < side - third) || (y >= third && y < side - third);
            if (cell->is_solid && holes > 0) {
                set_hole(cell, 44, 0.5);
                holes--;
            }
        }
    return plate;
}

/* Points on a circle. */
static void circle(struct shape *shape, unsigned count, double radius, double z, struct ring *ring)
{
    ring->count = 0;
    for (unsigned i = 0; i < count; i++) {
        double x = (float)(radius * cos(full_turn * i / count));
        double y = (float)(radius * sin(full_turn * i / count));
        ring_add(ring, shape_vertex(shape, x, y, z), x, y);
    }
}

/* Sector s of `sectors` between two rings: counter-clockwise loop, and a point inside. */
static void sector(const struct ring *outer, const struct ring *inner, unsigned s, unsigned sectors,
                   struct ring *ring, double *x, double *y)
{
    unsigned o0 = outer->count * s / sectors, o1 = outer->count * (s + 1) / sectors;
    unsigned i0 = inner->count * s / sectors, i1 = inner->count * (s + 1) / sectors;
    ring->count = 0;
    for (unsigned i = o0; i <= o1; i++)
        ring_add(ring, outer->vertices[i % outer->count], outer->x[i % outer->count],
                 outer->y[i % outer->count]);
    for (unsigned i = i1 + 1; i-- > i0;)
        ring_add(ring, inner->vertices[i % inner->count], inner->x[i % inner->count],
                 inner->y[i % inner->count]);
    *x = *y = 0;
    for (unsigned i = 0; i < ring->count; i++) {
        *x += ring->x[i] / ring->count;
        *y += ring->y[i] / ring->count;
    }
}

/* A flat ring of sectors with a feature each, on both sides: through holes or pockets from above.
 */
static void feature_sectors(struct shape *shape, const struct ring outer[2],
                            const struct ring inner[2], unsigned sectors,
                            const struct part_feature *feature, double low, double high)
{
    struct ring *ring = take(1, sizeof *ring), *rims = take(2, sizeof *rims);
    for (unsigned s = 0; s < sectors; s++) {
        double x, y;
        bool is_hole = feature->kind == PART_HOLE;
        double end = is_hole ? low : high - feature->depth;
        sector(&outer[1], &inner[1], s, sectors, ring, &x, &y);
        feature_ring(shape, feature, x, y, high, 1, &rims[1]);
        feature_ring(shape, feature, x, y, end, 1, &rims[0]);
        zip_rings(shape, ring, &rims[1], x, y, true);
        wall(shape, &rims[0], &rims[1], false);
        sector(&outer[0], &inner[0], s, sectors, ring, &x, &y);
        if (is_hole)
            zip_rings(shape, ring, &rims[0], x, y, false);
        else {
            fill_ring(shape, &rims[0], x, y, end, true);
            fill_ring(shape, ring, x, y, low, false);
        }
    }
    free(ring);
    free(rims);
}

struct shape part_disk(void)
{
    struct shape shape = {0};
    struct ring *outer = take(2, sizeof *outer), *inner = take(2, sizeof *inner);
    struct part_feature hole = {.kind = PART_HOLE};
    feature_round(&hole, 14, 1);
    for (unsigned side = 0; side < 2; side++) {
        circle(&shape, 19, 10, side, &outer[side]);
        circle(&shape, 19, 4, side, &inner[side]);
    }
    feature_sectors(&shape, outer, inner, 10, &hole, 0, 1);
    wall(&shape, &outer[0], &outer[1], true);
    wall(&shape, &inner[0], &inner[1], false);
    free(outer);
    free(inner);
    return shape;
}

struct shape part_gear(void)
{
    struct shape shape = {0};
    struct ring *outer = take(2, sizeof *outer), *middle = take(2, sizeof *middle);
    struct ring *inner = take(2, sizeof *inner);
    struct part_feature pocket = {.kind = PART_POCKET, .depth = 0.5};
    struct part_feature hole = {.kind = PART_HOLE};
    feature_round(&pocket, 8, 0.8);
    feature_round(&hole, 16, 1.6);
    for (unsigned side = 0; side < 2; side++) {
        /* 30 teeth of four points */
        outer[side].count = 0;
        for (unsigned i = 0; i < 120; i++) {
            double radius = i % 4 < 2 ? 10.8 : 10.5, angle = full_turn * (i - 0.5) / 120;
            double x = (float)(radius * cos(angle)), y = (float)(radius * sin(angle));
            ring_add(&outer[side], shape_vertex(&shape, x, y, 2 * side), x, y);
        }
        circle(&shape, 60, 8, 2 * side, &middle[side]);
        circle(&shape, 30, 4, 2 * side, &inner[side]);
    }
    feature_sectors(&shape, outer, middle, 30, &pocket, 0, 2);
    feature_sectors(&shape, middle, inner, 10, &hole, 0, 2);
    wall(&shape, &outer[0], &outer[1], true);
    fill_ring(&shape, &inner[0], 0, 0, 0, false);
    fill_ring(&shape, &inner[1], 0, 0, 2, true);
    free(outer);
    free(middle);
    free(inner);
    return shape;
}

/* A tube: unrolled, a grid of cells with a hole each; rolled up, outside and inside. */
enum { TUBE_AROUND = 10, TUBE_HIGH = 5, TUBE_STEPS = 6 };

static void roll(struct shape *shape, uint32_t vertex, double angle, double radius, double z)
{
    double *at = shape->positions + 3 * (size_t)vertex;
    at[0] = (float)(radius * cos(angle));
    at[1] = (float)(radius * sin(angle));
    at[2] = (float)z;
}

struct shape part_cylinder(void)
{
    struct shape shape = {0};
    const double radii[2] = {6, 10}, cell = full_turn / TUBE_AROUND;
    uint32_t grid[2][TUBE_HIGH + 1][TUBE_AROUND * TUBE_STEPS];
    struct part_feature hole = {.kind = PART_HOLE};
    struct ring *ring = take(1, sizeof *ring), *rims = take(2, sizeof *rims);
    feature_round(&hole, 24, 0.3);
    for (unsigned side = 0; side < 2; side++)
        for (unsigned y = 0; y <= TUBE_HIGH; y++)
            for (unsigned x = 0; x < TUBE_AROUND * TUBE_STEPS; x++) {
                grid[side][y][x] = shape_vertex(&shape, 0, 0, 0);
                roll(&shape, grid[side][y][x], cell * x / TUBE_STEPS, radii[side], 6.0 * y);
            }
    for (unsigned y = 0; y < TUBE_HIGH; y++)
        for (unsigned x = 0; x < TUBE_AROUND; x++) {
            double mx = x + 0.5, my = y + 0.5;
            for (unsigned side = 0; side < 2; side++) {
                ring->count = 0;
                for (unsigned i = 0; i < TUBE_STEPS; i++)
                    ring_add(ring, grid[side][y][(TUBE_STEPS * x + i) % (TUBE_AROUND * TUBE_STEPS)],
                             x + (double)i / TUBE_STEPS, y);
                for (unsigned i = 0; i < TUBE_STEPS; i++)
                    ring_add(
                        ring,
                        grid[side][y + 1][(TUBE_STEPS * (x + 1) - i) % (TUBE_AROUND * TUBE_STEPS)],
                        x + 1 - (double)i / TUBE_STEPS, y + 1);
                uint32_t corner =
                    grid[side][y][(TUBE_STEPS * (x + 1)) % (TUBE_AROUND * TUBE_STEPS)];
                uint32_t last = grid[side][y + 1][TUBE_STEPS * x];
                /* the two corners that the halves leave out */
                struct ring *whole = take(1, sizeof *whole);
                for (unsigned i = 0; i < TUBE_STEPS; i++)
                    ring_add(whole, ring->vertices[i], ring->x[i], ring->y[i]);
                ring_add(whole, corner, x + 1, y);
                for (unsigned i = TUBE_STEPS; i < 2 * TUBE_STEPS; i++)
                    ring_add(whole, ring->vertices[i], ring->x[i], ring->y[i]);
                ring_add(whole, last, x, y + 1);
                feature_ring(&shape, &hole, mx, my, 0, 1, &rims[side]);
                zip_rings(&shape, whole, &rims[side], mx, my, side == 1);
                for (unsigned i = 0; i < rims[side].count; i++)
                    roll(&shape, rims[side].vertices[i], cell * rims[side].x[i], radii[side],
                         6 * rims[side].y[i]);
                free(whole);
            }
            wall(&shape, &rims[0], &rims[1], false);
        }
    for (unsigned end = 0; end < 2; end++)
        for (unsigned x = 0; x < TUBE_AROUND * TUBE_STEPS; x++) {
            unsigned next = (x + 1) % (TUBE_AROUND * TUBE_STEPS), y = end ? TUBE_HIGH : 0;
            add_face(&shape, end, grid[0][y][x], grid[1][y][x], grid[1][y][next]);
            add_face(&shape, end, grid[0][y][x], grid[1][y][next], grid[0][y][next]);
        }
    free(ring);
    free(rims);
    return shape;
}

/* ---- changes ---- */

void shape_rotate(struct shape *shape, double x, double y, double z)
{
    const double angles[3] = {x, y, z};
    for (unsigned axis = 0; axis < 3; axis++) {
        unsigned a = (axis + 1) % 3, b = (axis + 2) % 3;
        double c = cos(angles[axis]), s = sin(angles[axis]);
        for (size_t i = 0; i < shape->vertex_count; i++) {
            double *at = shape->positions + 3 * i, p = at[a], q = at[b];
            at[a] = c * p - s * q;
            at[b] = s * p + c * q;
        }
    }
}

void shape_scale(struct shape *shape, double x, double y, double z)
{
    const double factors[3] = {x, y, z};
    for (size_t i = 0; i < 3 * shape->vertex_count; i++)
        shape->positions[i] *= factors[i % 3];
}

void shape_noise(struct shape *shape, double amount, uint64_t seed)
{
    for (size_t i = 0; i < 3 * shape->vertex_count; i++)
        shape->positions[i] += amount * (2 * random_unit(&seed) - 1);
}
