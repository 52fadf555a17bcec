/*
 * gen_scan: makes closed, noisy, scan-like surfaces of any size for tests and measurements.
 *
 * The problem: inputs of 10^6 to 10^9 faces that cannot be had, with features at many scales,
 * scanner noise and a known topology, on machines that could not hold them. Displacing a sphere
 * in memory is the simple way and holds everything.
 *
 * The way here: the surface is the boundary of a box of a x b x c cells, bent to a sphere and
 * displaced along the radius. Every vertex is a pure function of its lattice point and the seed,
 * and lattice points, vertex numbers and face numbers are turned into each other by arithmetic;
 * so vertices and faces can be written in any order, one after the other, and nothing is held. The
 * box has 4(ab + bc + ca) triangles, which with a, b, c nearly equal can be any multiple of four.
 * A shuffled order is a Feistel network over the numbers (a bijection with an inverse, walked
 * until it stays in range): no table.
 *
 * The output is closed, manifold, of genus 0, consistently oriented, and depends on the options
 * alone (no libm besides sqrt).
 */
#include <errno.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum format { AS_PLY, AS_PLY_ASCII, AS_STL };
enum order { ORDER_TILES, ORDER_ROWS, ORDER_SHUFFLED };

enum { TILE = 256, OCTAVES_MAX = 16, SIDES = 6 };

struct options {
    uint64_t faces;
    double noise; /* standard deviation along each axis, in mean edge lengths */
    uint64_t seed;
    enum order order;
    enum format format;
    const char *output;
};

/* ---- random numbers as functions of their index ---- */

static uint64_t mix64(uint64_t value)
{
    value ^= value >> 32;
    value *= UINT64_C(0xd6e8feb86659fd93);
    value ^= value >> 32;
    value *= UINT64_C(0xd6e8feb86659fd93);
    return value ^ (value >> 32);
}

static uint32_t mix32(uint32_t value)
{
    value ^= value >> 16;
    value *= UINT32_C(0x7feb352d);
    value ^= value >> 15;
    value *= UINT32_C(0x846ca68b);
    return value ^ (value >> 16);
}

/* Nearly normal, mean 0, standard deviation 1: the sum of four uniform numbers. */
static double bell(uint64_t bits)
{
    double sum = (double)(bits & 0xffff) + (double)(bits >> 16 & 0xffff) +
                 (double)(bits >> 32 & 0xffff) + (double)(bits >> 48);
    return (sum / 65535.0 - 2.0) * 1.7320508075688772;
}

/* ---- permutations: a Feistel network on the next even number of bits, walked into range ---- */

struct permutation {
    uint64_t size;
    unsigned half_bits;
    uint32_t keys[4];
};

static void permutation_make(struct permutation *permutation, uint64_t size, uint64_t seed)
{
    permutation->size = size;
    permutation->half_bits = 1;
    while (permutation->half_bits < 31 && (UINT64_C(1) << 2 * permutation->half_bits) < size)
        permutation->half_bits++;
    for (unsigned i = 0; i < 4; i++)
        permutation->keys[i] = (uint32_t)mix64(seed * 4 + i + 1);
}

static uint64_t feistel(const struct permutation *permutation, uint64_t value, bool backward)
{
    uint32_t mask = (UINT32_C(1) << permutation->half_bits) - 1;
    uint32_t high = (uint32_t)(value >> permutation->half_bits), low = (uint32_t)value & mask;
    for (unsigned i = 0; i < 4; i++) {
        uint32_t key = permutation->keys[backward ? 3 - i : i];
        if (backward) {
            uint32_t before = high;
            high = low ^ (mix32(before ^ key) & mask);
            low = before;
        } else {
            uint32_t before = low;
            low = high ^ (mix32(before ^ key) & mask);
            high = before;
        }
    }
    return (uint64_t)high << permutation->half_bits | low;
}

static uint64_t permute(const struct permutation *permutation, uint64_t value, bool backward)
{
    do
        value = feistel(permutation, value, backward);
    while (value >= permutation->size);
    return value;
}

/* ---- the surface of a box of cells: lattice points, vertex numbers, face numbers ---- */

/* A rectangle of lattice points or cells, numbered tile by tile, row by row in each tile. */
struct rectangle {
    uint64_t first; /* number of its first element */
    uint64_t width, height;
};

struct side {
    unsigned fixed_axis, u_axis, v_axis;
    bool at_end;     /* fixed coordinate is the box's size, not 0 */
    bool turn;       /* u x v points inwards */
    uint64_t u_from; /* lattice point of the vertex rectangle's corner */
    uint64_t v_from;
    struct rectangle vertices;
    struct rectangle cells;
};

struct grid {
    uint64_t size[3];
    uint64_t tile;
    uint64_t vertex_count, cell_count;
    struct side sides[SIDES];
};

static uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

static uint64_t rectangle_number(const struct rectangle *area, uint64_t tile, uint64_t i,
                                 uint64_t j)
{
    uint64_t tile_i = i / tile * tile, tile_j = j / tile * tile;
    uint64_t tile_width = least(tile, area->width - tile_i);
    uint64_t tile_height = least(tile, area->height - tile_j);
    return area->first + tile_j * area->width + tile_i * tile_height + (j - tile_j) * tile_width +
           (i - tile_i);
}

static void rectangle_place(const struct rectangle *area, uint64_t tile, uint64_t number,
                            uint64_t *i, uint64_t *j)
{
    uint64_t rest = number - area->first;
    uint64_t band = tile >= area->height ? rest : rest / (tile * area->width) * tile * area->width;
    uint64_t tile_j = tile >= area->height ? 0 : band / area->width;
    rest = tile >= area->height ? rest : rest - band;
    uint64_t tile_height = least(tile, area->height - tile_j);
    uint64_t tile_i = tile >= area->width ? 0 : rest / (tile * tile_height) * tile;
    rest -= tile_i * tile_height;
    uint64_t tile_width = least(tile, area->width - tile_i);
    *i = tile_i + rest % tile_width;
    *j = tile_j + rest / tile_width;
}

/* The two z sides own all points of their rectangle; the four others own the rest, each edge
 * between two of them belonging to one. */
static void grid_make(struct grid *grid, const uint64_t size[3], uint64_t tile)
{
    uint64_t a = size[0], b = size[1], c = size[2];
    *grid = (struct grid){
        .size = {a, b, c},
        .tile = tile,
        .sides =
            {
                {2, 0, 1, false, true, 0, 0, {0, a + 1, b + 1}, {0, a, b}},
                {1, 0, 2, false, false, 0, 1, {0, a, c - 1}, {0, a, c}},
                {0, 1, 2, true, false, 0, 1, {0, b, c - 1}, {0, b, c}},
                {1, 0, 2, true, true, 1, 1, {0, a, c - 1}, {0, a, c}},
                {0, 1, 2, false, true, 1, 1, {0, b, c - 1}, {0, b, c}},
                {2, 0, 1, true, false, 0, 0, {0, a + 1, b + 1}, {0, a, b}},
            },
    };
    for (unsigned s = 0; s < SIDES; s++) {
        struct side *side = &grid->sides[s];
        side->vertices.first = grid->vertex_count;
        side->cells.first = grid->cell_count;
        grid->vertex_count += side->vertices.width * side->vertices.height;
        grid->cell_count += side->cells.width * side->cells.height;
    }
}

static uint64_t vertex_number(const struct grid *grid, const uint64_t point[3])
{
    unsigned owner;
    if (point[2] == 0)
        owner = 0;
    else if (point[2] == grid->size[2])
        owner = 5;
    else if (point[1] == 0 && point[0] < grid->size[0])
        owner = 1;
    else if (point[0] == grid->size[0] && point[1] < grid->size[1])
        owner = 2;
    else if (point[1] == grid->size[1] && point[0] > 0)
        owner = 3;
    else
        owner = 4;
    const struct side *side = &grid->sides[owner];
    return rectangle_number(&side->vertices, grid->tile, point[side->u_axis] - side->u_from,
                            point[side->v_axis] - side->v_from);
}

static void vertex_point(const struct grid *grid, uint64_t number, uint64_t point[3])
{
    unsigned s = SIDES - 1;
    while (number < grid->sides[s].vertices.first)
        s--;
    const struct side *side = &grid->sides[s];
    uint64_t i, j;
    rectangle_place(&side->vertices, grid->tile, number, &i, &j);
    point[side->fixed_axis] = side->at_end ? grid->size[side->fixed_axis] : 0;
    point[side->u_axis] = i + side->u_from;
    point[side->v_axis] = j + side->v_from;
}

/* The lattice points of a face, counter-clockwise from outside. Two faces a cell; which diagonal
 * cuts it is a matter of chance, as in a mesh that was made from scans. */
static void face_points(const struct grid *grid, uint64_t face, uint64_t seed,
                        uint64_t points[3][3])
{
    uint64_t cell = face / 2;
    unsigned s = SIDES - 1;
    while (cell < grid->sides[s].cells.first)
        s--;
    const struct side *side = &grid->sides[s];
    uint64_t i, j;
    rectangle_place(&side->cells, grid->tile, cell, &i, &j);

    static const uint8_t cuts[2][2][3] = {{{0, 1, 2}, {0, 2, 3}}, {{1, 2, 3}, {1, 3, 0}}};
    static const uint8_t corner_u[4] = {0, 1, 1, 0}, corner_v[4] = {0, 0, 1, 1};
    const uint8_t *cut = cuts[mix64(cell + seed * 31) >> 63][face & 1];
    for (unsigned k = 0; k < 3; k++) {
        unsigned corner = cut[side->turn ? 2 - k : k];
        points[k][side->fixed_axis] = side->at_end ? grid->size[side->fixed_axis] : 0;
        points[k][side->u_axis] = i + corner_u[corner];
        points[k][side->v_axis] = j + corner_v[corner];
    }
}

/* Box sizes with ab + bc + ca = cells as near to a cube as they come; false if there are none with
 * sides within a quarter of the mean. With s = a + b: c = (cells - ab) / s must be whole. */
static bool box_of(uint64_t cells, uint64_t size[3])
{
    double mean = sqrt((double)cells / 3.0);
    uint64_t low = (uint64_t)(mean * 0.75), high = (uint64_t)(mean * 1.25) + 2;
    double best = INFINITY;
    for (uint64_t s = 2 * low; s <= 2 * high; s++) {
        double reach = sqrt(best); /* the sides may not differ by more than in the best so far */
        uint64_t half = s / 2;
        for (uint64_t a = half; a >= 1 && a >= low && (double)(half - a) <= reach; a--) {
            uint64_t b = s - a;
            if (a * b >= cells || (cells - a * b) % s != 0)
                continue;
            uint64_t c = (cells - a * b) / s;
            double off_a = (double)a - mean, off_b = (double)b - mean, off_c = (double)c - mean;
            double off = off_a * off_a + off_b * off_b + off_c * off_c;
            if (c >= 1 && off < best) {
                best = off;
                size[0] = a;
                size[1] = b;
                size[2] = c;
            }
        }
    }
    return best < INFINITY;
}

/* ---- the shape ---- */

/* The lattice cell that a layer of noise was last asked about. Neighbouring vertices mostly lie in
 * one, and hashing its corners is most of the work. */
struct noise_cell {
    int32_t x, y, z;
    bool is_filled;
    double values[8];
};

enum { EXTRA_LAYERS = 3 }; /* besides the octaves */

struct shape {
    const struct grid *grid;
    struct noise_cell cells[OCTAVES_MAX + EXTRA_LAYERS];
    uint32_t seed;
    unsigned octaves;
    double amplitude[OCTAVES_MAX];
    double noise; /* standard deviation, model units */
    uint64_t noise_seed;
};

static void fill_cell(struct noise_cell *cell, int32_t x, int32_t y, int32_t z, uint32_t seed)
{
    static const uint32_t primes[3] = {0x8da6b343, 0xd8163841, 0xcb1ab31f};
    *cell = (struct noise_cell){.x = x, .y = y, .z = z, .is_filled = true};
    for (unsigned corner = 0; corner < 8; corner++) {
        uint32_t hash = seed ^ ((uint32_t)x + (corner & 1)) * primes[0] ^
                        ((uint32_t)y + (corner >> 1 & 1)) * primes[1] ^
                        ((uint32_t)z + (corner >> 2)) * primes[2];
        cell->values[corner] = (double)(int32_t)mix32(hash);
    }
}

/* Smooth value noise in [-1, 1] on the integer lattice, twice differentiable. Each layer has its
 * own seed. */
static double value_noise(struct shape *shape, unsigned layer, double x, double y, double z)
{
    struct noise_cell *cell = &shape->cells[layer];
    double floor_x = floor(x), floor_y = floor(y), floor_z = floor(z);
    double s = x - floor_x, t = y - floor_y, r = z - floor_z;
    int32_t cell_x = (int32_t)floor_x, cell_y = (int32_t)floor_y, cell_z = (int32_t)floor_z;
    if (!cell->is_filled || cell->x != cell_x || cell->y != cell_y || cell->z != cell_z)
        fill_cell(cell, cell_x, cell_y, cell_z, shape->seed + layer);
    const double *values = cell->values;
    s = s * s * s * (s * (s * 6 - 15) + 10);
    t = t * t * t * (t * (t * 6 - 15) + 10);
    r = r * r * r * (r * (r * 6 - 15) + 10);
    double x00 = values[0] + s * (values[1] - values[0]);
    double x10 = values[2] + s * (values[3] - values[2]);
    double x01 = values[4] + s * (values[5] - values[4]);
    double x11 = values[6] + s * (values[7] - values[6]);
    double y0 = x00 + t * (x10 - x00), y1 = x01 + t * (x11 - x01);
    return (y0 + r * (y1 - y0)) * (1.0 / 2147483648.0);
}

static double clamp_unit(double value)
{
    return value < 0 ? 0 : value > 1 ? 1 : value;
}

/*
 * The radius in a direction: lumps at all scales down to a dozen edges, folds with sharp creases,
 * and fine detail in some regions only, so that there is smooth skin beside hair.
 */
static double radius(struct shape *shape, const double way[3])
{
    double sum = 1.0, frequency = 1.7;
    double rough = clamp_unit(
        0.5 + 1.6 * value_noise(shape, OCTAVES_MAX, way[0] * 2.3 + 9, way[1] * 2.3, way[2] * 2.3));
    for (unsigned octave = 0; octave < shape->octaves; octave++) {
        double weight = octave < 3 ? 1.0 : 0.25 + 0.75 * rough;
        /* Each octave is turned against the last, so that no lattice shows. */
        double x = way[0] * frequency, y = way[1] * frequency, z = way[2] * frequency;
        double turned_x = 0.8 * x + 0.6 * y, turned_y = -0.6 * x + 0.8 * y;
        bool odd = octave & 1;
        sum += shape->amplitude[octave] * weight *
               value_noise(shape, octave, (odd ? turned_x : x) + 31.4,
                           odd ? turned_y : 0.6 * y - 0.8 * z, odd ? z : 0.8 * y + 0.6 * z);
        frequency *= 2.0;
    }
    double fold =
        value_noise(shape, OCTAVES_MAX + 1, way[0] * 3.1, way[1] * 3.1 + 50, way[2] * 1.1);
    double crease =
        value_noise(shape, OCTAVES_MAX + 2, way[0] * 7.3, way[1] * 7.3, way[2] * 5.1 + 70);
    sum += 0.16 * fabs(fold) - 0.05 * (1.0 - rough) * fabs(crease);
    return sum < 0.25 ? 0.25 : sum;
}

/* tan(pi u / 4) nearly: cells of the bent box are then of nearly one size. */
static double warp(double u)
{
    double square = u * u;
    return u * (0.7863 + square * (0.1493 + square * 0.0644));
}

/* The place of a lattice point without noise: the sphere, displaced, and stretched to a figure. */
static void smooth_position(struct shape *shape, const uint64_t point[3], double out[3])
{
    double way[3];
    for (unsigned k = 0; k < 3; k++)
        way[k] = warp(2.0 * (double)point[k] / (double)shape->grid->size[k] - 1.0);
    double length = sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]);
    for (unsigned k = 0; k < 3; k++)
        way[k] /= length;
    double distance = 50.0 * radius(shape, way);
    out[0] = way[0] * distance;
    out[1] = way[1] * distance * 0.85;
    out[2] = way[2] * distance * 1.5;
}

static void position(struct shape *shape, uint64_t vertex, const uint64_t point[3], float out[3])
{
    double place[3];
    smooth_position(shape, point, place);
    for (unsigned k = 0; k < 3; k++) {
        if (shape->noise > 0)
            place[k] += shape->noise * bell(mix64(mix64(vertex * 3 + k) + shape->noise_seed));
        out[k] = (float)place[k];
    }
}

/* Mean length of the edges of evenly picked faces. */
static double mean_edge(struct shape *shape, uint64_t seed)
{
    enum { SAMPLES = 20000 };
    uint64_t faces = shape->grid->cell_count * 2;
    double sum = 0;
    for (uint64_t i = 0; i < SAMPLES; i++) {
        uint64_t points[3][3];
        double corners[3][3];
        face_points(shape->grid, mix64(i + seed) % faces, seed, points);
        for (unsigned k = 0; k < 3; k++)
            smooth_position(shape, points[k], corners[k]);
        for (unsigned k = 0; k < 3; k++) {
            const double *from = corners[k], *to = corners[(k + 1) % 3];
            double x = to[0] - from[0], y = to[1] - from[1], z = to[2] - from[2];
            sum += sqrt(x * x + y * y + z * z);
        }
    }
    return sum / (3.0 * SAMPLES);
}

static void shape_make(struct shape *shape, const struct grid *grid, const struct options *options)
{
    *shape = (struct shape){.grid = grid, .seed = (uint32_t)mix64(options->seed + 1)};
    shape->noise_seed = mix64(options->seed + 77);
    /* The finest lumps are about a dozen edges wide, on a mesh of any size. */
    double frequency = 1.7, amplitude = 0.34;
    uint64_t cells = least(grid->size[0], least(grid->size[1], grid->size[2]));
    while (shape->octaves < OCTAVES_MAX && (shape->octaves < 2 || frequency * 8 < (double)cells)) {
        shape->amplitude[shape->octaves++] = amplitude;
        frequency *= 2.0;
        amplitude *= 0.43;
    }
    shape->noise = options->noise * mean_edge(shape, options->seed);
}

/* ---- writing ---- */

struct scan {
    struct options options;
    struct grid grid;
    struct shape shape;
    struct permutation vertex_order, face_order;
    FILE *file;
    /* Soup in a coherent order: a ring of positions that were computed lately, by vertex. */
    struct recent {
        uint64_t vertex;
        float at[3];
    } * recent;
};

enum { RECENT_SLOTS = 1 << 16 };

static void put(struct scan *scan, const void *data, size_t size)
{
    if (fwrite(data, 1, size, scan->file) != size) {
        fprintf(stderr, "gen_scan: %s: %s\n", scan->options.output, strerror(errno));
        exit(1);
    }
}

static void put_uint32(unsigned char *to, uint32_t value)
{
    for (unsigned i = 0; i < 4; i++)
        to[i] = (unsigned char)(value >> 8 * i);
}

static void put_float(unsigned char *to, float value)
{
    uint32_t bits;
    memcpy(&bits, &value, 4);
    put_uint32(to, bits);
}

static bool is_shuffled(const struct scan *scan)
{
    return scan->options.order == ORDER_SHUFFLED;
}

static void write_vertices(struct scan *scan)
{
    for (uint64_t i = 0; i < scan->grid.vertex_count; i++) {
        uint64_t vertex = is_shuffled(scan) ? permute(&scan->vertex_order, i, false) : i;
        uint64_t point[3];
        float at[3];
        vertex_point(&scan->grid, vertex, point);
        position(&scan->shape, vertex, point, at);
        if (scan->options.format == AS_PLY_ASCII) {
            char line[64];
            int length = snprintf(line, sizeof line, "%.9g %.9g %.9g\n", (double)at[0],
                                  (double)at[1], (double)at[2]);
            put(scan, line, (size_t)length);
        } else {
            unsigned char bytes[12];
            for (unsigned k = 0; k < 3; k++)
                put_float(bytes + 4 * k, at[k]);
            put(scan, bytes, sizeof bytes);
        }
    }
}

static void write_faces(struct scan *scan)
{
    for (uint64_t i = 0; i < scan->grid.cell_count * 2; i++) {
        uint64_t face = is_shuffled(scan) ? permute(&scan->face_order, i, false) : i;
        uint64_t points[3][3];
        uint32_t corners[3];
        face_points(&scan->grid, face, scan->options.seed, points);
        for (unsigned k = 0; k < 3; k++) {
            uint64_t vertex = vertex_number(&scan->grid, points[k]);
            corners[k] =
                (uint32_t)(is_shuffled(scan) ? permute(&scan->vertex_order, vertex, true) : vertex);
        }
        if (scan->options.format == AS_PLY_ASCII) {
            char line[64];
            int length =
                snprintf(line, sizeof line, "3 %u %u %u\n", corners[0], corners[1], corners[2]);
            put(scan, line, (size_t)length);
        } else {
            unsigned char bytes[13] = {3};
            for (unsigned k = 0; k < 3; k++)
                put_uint32(bytes + 1 + 4 * k, corners[k]);
            put(scan, bytes, sizeof bytes);
        }
    }
}

static const float *recent_position(struct scan *scan, const uint64_t point[3])
{
    uint64_t vertex = vertex_number(&scan->grid, point);
    struct recent *slot = &scan->recent[vertex % RECENT_SLOTS];
    if (slot->vertex != vertex) {
        slot->vertex = vertex;
        position(&scan->shape, vertex, point, slot->at);
    }
    return slot->at;
}

static void write_soup(struct scan *scan)
{
    for (uint64_t i = 0; i < scan->grid.cell_count * 2; i++) {
        uint64_t face = is_shuffled(scan) ? permute(&scan->face_order, i, false) : i;
        uint64_t points[3][3];
        unsigned char bytes[50] = {0}; /* normal left zero: readers compute it */
        face_points(&scan->grid, face, scan->options.seed, points);
        for (unsigned k = 0; k < 3; k++) {
            const float *at = recent_position(scan, points[k]);
            for (unsigned axis = 0; axis < 3; axis++)
                put_float(bytes + 12 + 12 * k + 4 * axis, at[axis]);
        }
        put(scan, bytes, sizeof bytes);
    }
}

static void write_scan(struct scan *scan)
{
    uint64_t faces = scan->grid.cell_count * 2;
    if (scan->options.format == AS_STL) {
        unsigned char header[84] = "made by gen_scan";
        put_uint32(header + 80, (uint32_t)faces);
        put(scan, header, sizeof header);
        write_soup(scan);
        return;
    }
    char header[512];
    int length =
        snprintf(header, sizeof header,
                 "ply\nformat %s 1.0\ncomment made by gen_scan, seed %llu, noise %g\n"
                 "element vertex %llu\nproperty float x\nproperty float y\nproperty float z\n"
                 "element face %llu\nproperty list uchar %s vertex_indices\nend_header\n",
                 scan->options.format == AS_PLY ? "binary_little_endian" : "ascii",
                 (unsigned long long)scan->options.seed, scan->options.noise,
                 (unsigned long long)scan->grid.vertex_count, (unsigned long long)faces,
                 scan->grid.vertex_count > INT32_MAX ? "uint" : "int");
    put(scan, header, (size_t)length);
    write_vertices(scan);
    write_faces(scan);
}

/* ---- command line ---- */

static const char usage[] =
    "gen_scan: writes a closed, noisy, scan-like surface, streamed\n"
    "\n"
    "  gen_scan --faces N [options] -o FILE\n"
    "\n"
    "  --faces N     triangles; k, M, G allowed; the next multiple of 4 below   1M\n"
    "  --noise X     scanner noise, standard deviation in mean edge lengths     0.04\n"
    "  --seed N      another surface                                            1\n"
    "  --order O     tiles: local in space; rows: long strips; shuffled         tiles\n"
    "  --format F    ply (binary), ply-ascii, stl (binary)                      ply\n"
    "  --soup        the same as --format stl\n"
    "  -o FILE       - is standard output\n"
    "\n"
    "Noise moves every vertex along each axis by a normal deviate, and turns the faces by about "
    "as\n"
    "many radians as it has mean edges. Scanners' noise is small against the distance of the "
    "samples\n"
    "that are kept, and meshing smooths it: 0.04 (faces lean by a few degrees) is a rough real "
    "scan.\n"
    "At 0.15 neighbouring faces lean by 20 degrees and more, which no real scan's do.\n";

static void misuse(const char *what, const char *value)
{
    fprintf(stderr, "gen_scan: %s %s; see gen_scan --help\n", what, value);
    exit(2);
}

static uint64_t parse_count(const char *text)
{
    char *end;
    errno = 0;
    double value = strtod(text, &end);
    double unit = *end == 'k' || *end == 'K'   ? 1e3
                  : *end == 'm' || *end == 'M' ? 1e6
                  : *end == 'g' || *end == 'G' ? 1e9
                                               : 1;
    if (end == text || errno || end[unit > 1] != '\0' || !(value >= 0) || value * unit > 8e9)
        misuse("not a count:", text);
    return (uint64_t)(value * unit + 0.5);
}

static double parse_noise(const char *text)
{
    char *end;
    double value = strtod(text, &end);
    if (end == text || *end || !(value >= 0 && value < 10))
        misuse("--noise must be 0 to 10, not", text);
    return value;
}

static int choice(const char *const *words, const char *value, const char *name)
{
    for (int i = 0; words[i]; i++) {
        if (strcmp(words[i], value) == 0)
            return i;
    }
    misuse(name, value);
    return 0;
}

static void parse(int argc, char **argv, struct options *options)
{
    static const char *const orders[] = {"tiles", "rows", "shuffled", "coherent", NULL};
    static const char *const formats[] = {"ply", "ply-ascii", "stl", NULL};
    *options = (struct options){.faces = 1000000, .noise = 0.04, .seed = 1};
    for (int i = 1; i < argc; i++) {
        const char *name = argv[i];
        if (strcmp(name, "-h") == 0 || strcmp(name, "--help") == 0) {
            fputs(usage, stdout);
            exit(0);
        }
        if (strcmp(name, "--soup") == 0) {
            options->format = AS_STL;
            continue;
        }
        const char *value = ++i < argc ? argv[i] : NULL;
        if (!value)
            misuse("unknown option, or value missing:", name);
        if (strcmp(name, "--faces") == 0)
            options->faces = parse_count(value);
        else if (strcmp(name, "--noise") == 0)
            options->noise = parse_noise(value);
        else if (strcmp(name, "--seed") == 0)
            options->seed = parse_count(value);
        else if (strcmp(name, "--order") == 0)
            options->order = (enum order)(choice(orders, value, "unknown order") % 3);
        else if (strcmp(name, "--format") == 0)
            options->format = (enum format)choice(formats, value, "unknown format");
        else if (strcmp(name, "-o") == 0)
            options->output = value;
        else
            misuse("unknown option", name);
    }
    if (!options->output)
        misuse("-o FILE", "is missing");
    if (options->faces < 12 || options->faces > UINT64_C(8000000000))
        misuse("--faces", "must be 12 to 8G");
    if (options->format == AS_STL && options->faces > UINT32_MAX)
        misuse("--format stl", "has at most 4,294,967,295 faces");
}

int main(int argc, char **argv)
{
    struct scan scan = {0};
    uint64_t size[3] = {0};
    parse(argc, argv, &scan.options);

    uint64_t quads = scan.options.faces / 4;
    while (!box_of(quads, size))
        quads--;
    grid_make(&scan.grid, size, scan.options.order == ORDER_ROWS ? UINT32_MAX : TILE);
    shape_make(&scan.shape, &scan.grid, &scan.options);
    permutation_make(&scan.vertex_order, scan.grid.vertex_count, scan.options.seed + 5);
    permutation_make(&scan.face_order, scan.grid.cell_count * 2, scan.options.seed + 6);
    scan.recent = malloc(RECENT_SLOTS * sizeof *scan.recent);
    bool to_stdout = strcmp(scan.options.output, "-") == 0;
    scan.file = to_stdout ? stdout : fopen(scan.options.output, "wb");
    if (!scan.file || !scan.recent) {
        fprintf(stderr, "gen_scan: %s: %s\n", scan.options.output, strerror(errno));
        free(scan.recent);
        return 1;
    }
    for (size_t i = 0; i < RECENT_SLOTS; i++)
        scan.recent[i].vertex = UINT64_MAX;
    setvbuf(scan.file, NULL, _IOFBF, 1 << 20);

    clock_t begin = clock();
    write_scan(&scan);
    bool is_written = fflush(scan.file) == 0 && (to_stdout || fclose(scan.file) == 0);
    free(scan.recent);
    if (!is_written) {
        fprintf(stderr, "gen_scan: %s: %s\n", scan.options.output, strerror(errno));
        return 1;
    }
    fprintf(stderr, "gen_scan: %llu faces, %llu vertices (box %llu x %llu x %llu), %.1f s\n",
            (unsigned long long)scan.grid.cell_count * 2,
            (unsigned long long)scan.grid.vertex_count, (unsigned long long)size[0],
            (unsigned long long)size[1], (unsigned long long)size[2],
            (double)(clock() - begin) / CLOCKS_PER_SEC);
    return 0;
}
