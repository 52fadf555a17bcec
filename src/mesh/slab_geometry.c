/*
 * Lengths, areas, noise.
 *
 * Everything is summed slab by slab in face order, in doubles and with no operation that a compiler
 * may reorder, so that the sums are the same for any number of threads and on any machine.
 */
#include "mesh/slab_geometry.h"

#include <math.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "base/cpu.h"
#include "base/lanes.h"
#include "geom/vec.h"
#include "mesh/survey.h"

/* ---- frame ---- */

static void widen(struct frame *frame, const double p[3])
{
    for (int i = 0; i < 3; i++) {
        frame->low[i] = p[i] < frame->low[i] ? p[i] : frame->low[i];
        frame->high[i] = p[i] > frame->high[i] ? p[i] : frame->high[i];
    }
}

/* Where vertices never were gathered: those that are used. */
static void look_at_all(const struct draft *draft, struct frame *frame)
{
    const uint64_t count = draft->id_count ? draft->id_count : draft->vertex_count;
    for (uint64_t v = 0; v < count; v++) {
        double p[3];
        draft_position(draft, v, p);
        if (!draft->id_count || is_shared(draft, (uint32_t)v))
            widen(frame, p);
        if (v % FORGET_EVERY == 0)
            spool_pass(&draft->position_spool, v * draft_position_size(draft));
    }
    spool_forget_all(&draft->position_spool);
}

enum status frame_find(const struct draft *draft, struct frame *frame)
{
    for (int i = 0; i < 3; i++) {
        frame->low[i] = draft->has_box ? draft->box_low[i] : INFINITY;
        frame->high[i] = draft->has_box ? draft->box_high[i] : -INFINITY;
        frame->origin[i] = 0;
    }
    if (!draft->has_box)
        look_at_all(draft, frame);
    double extent = 0;
    for (int i = 0; i < 3; i++) {
        frame->low[i] += 0.0; /* -0 or 0 would be whichever came first */
        frame->high[i] += 0.0;
        double side = frame->high[i] - frame->low[i];
        if (!(side >= 0 && side < INFINITY))
            return fail(draft->ctx, STATUS_BAD_INPUT, "coordinates are not finite or too large");
        extent = side > extent ? side : extent;
    }
    if (draft->is_float32)
        return STATUS_OK;
    /* Half the extent is the largest stored value: its float32 is off by 2^-25 of it at most, as
     * long as that is no subnormal number. */
    if (extent > 1e38 || (extent > 0 && extent < 1e-30))
        return fail(draft->ctx, STATUS_BAD_INPUT,
                    "the model is %g across; a store holds models from 1e-30 to 1e38", extent);
    for (int i = 0; i < 3; i++)
        frame->origin[i] = frame->low[i] / 2 + frame->high[i] / 2;
    return STATUS_OK;
}

/* ---- noise ---- */

static inline const float *position_place(const struct slab_scope *scope, const float *own,
                                          const float *foreign, uint32_t vertex)
{
    uint32_t local = vertex - scope->vertex_first;
    if (local < scope->own_count)
        return own + 3 * (size_t)local;
    return foreign + 3 * (size_t)foreign_rank(scope->foreign, scope->foreign_count, vertex);
}

static inline struct vec3 position_of(const struct slab_scope *scope, const float *own,
                                      const float *foreign, uint32_t vertex)
{
    return vec3_load_float(position_place(scope, own, foreign, vertex));
}

/* Adds the square of how far vertex v, at corner 0 of face f, lies off its neighbours. */
static void add_noise(const struct draft *draft, const struct slab_scope *scope, const float *own,
                      const float *foreign, uint32_t f, struct slab_measures *measures)
{
    const uint32_t v = draft->faces[3 * (size_t)f];
    const struct vec3 p = position_of(scope, own, foreign, v);
    struct vec3 sum = {0, 0, 0}, normal = {0, 0, 0};
    uint32_t at = f, count = 0;
    unsigned corner = 0, leave = 0;
    do {
        const uint32_t *face = draft->faces + 3 * (size_t)at;
        struct vec3 a = vec3_sub(position_of(scope, own, foreign, face[next3(corner)]), p);
        struct vec3 b = vec3_sub(position_of(scope, own, foreign, face[previous3(corner)]), p);
        normal = vec3_add(normal, vec3_cross(a, b));
        sum = vec3_add(sum, a); /* each neighbour begins one face of a closed fan */
        count++;
        if (!fan_step(draft, scope->face_first, scope->face_count, v, &at, &corner, &leave))
            return;
    } while (at != f && count <= NOISE_FAN_MAX);
    if (at != f)
        return;
    double square = vec3_dot(normal, normal);
    if (!(square > 0))
        return;
    double distance = vec3_dot(normal, sum) / count;
    measures->noise_squares += distance * distance / square;
    measures->noise_count++;
}

/* ---- areas and edges ---- */

/*
 * Roots are taken of four squares at a time, and each addition to a sum waits for the one before
 * it. So squares of some faces are put down; and while those of the next are found, the roots of
 * these are taken and added, an equal share with each group of faces, which then costs hardly any
 * time.
 */
enum { GROUP = 4, SHARES = 8, ROOTS = GROUP * SHARES };

struct squares {
    double areas[ROOTS];               /* of the cross products, a face */
    double edges[3 * ROOTS + GROUP];   /* a group is written beyond */
    uint32_t face_count, edge_count;   /* behind both are zeros, up to a whole group */
    uint32_t faces_added, edges_added; /* to the sums */
    uint32_t edge_share;
};

struct measuring { /* of one slab */
    const struct draft *draft;
    const struct slab_scope *scope;
    const float *own, *foreign;
    uint32_t last_own;         /* the number of own vertices less 1, or 0 */
    struct squares squares[2]; /* being found, and being added */
    struct squares *found, *added;
    struct slab_measures sums;
};

/* The sum and the roots of some squares, one after the other, scaled by a power of two. */
LANES_INLINE double add_roots(double sum, const double *squares, double scale)
{
    double4 roots;
    memcpy(&roots, squares, sizeof roots);
    for (unsigned i = 0; i < GROUP; i++)
        roots[i] = sqrt(roots[i]);
    roots *= scale;
    for (unsigned i = 0; i < GROUP; i++)
        sum += roots[i];
    return sum;
}

LANES_INLINE void add_share(struct measuring *m)
{
    struct squares *s = m->added;
    if (s->faces_added < s->face_count) {
        m->sums.area = add_roots(m->sums.area, s->areas + s->faces_added, 0.5);
        s->faces_added += GROUP;
    }
    double length = m->sums.edge_length;
    const uint32_t left = s->edge_count - s->edges_added;
    const uint32_t end = s->edges_added + (left < s->edge_share ? left : s->edge_share);
    for (; s->edges_added < end; s->edges_added += GROUP)
        length = add_roots(length, s->edges + s->edges_added, 1);
    m->sums.edge_length = length;
}

/* What has been found is what is to be added. */
LANES_INLINE void turn_over(struct measuring *m)
{
    struct squares *s = m->found;
    const double none[GROUP] = {0};
    m->sums.edge_count += s->edge_count;
    for (; s->face_count % GROUP; s->face_count++)
        s->areas[s->face_count] = 0;
    memcpy(s->edges + s->edge_count, none, sizeof none);
    s->edge_count = (s->edge_count + GROUP - 1) / GROUP * GROUP;
    s->edge_share = (s->edge_count / GROUP + SHARES - 1) / SHARES * GROUP;
    s->faces_added = s->edges_added = 0;
    m->found = m->added;
    m->added = s;
    m->found->face_count = m->found->edge_count = 0;
}

/* Four floats from where a position lies, but for the last one of the slab's own, which may have
 * nothing behind it, and the foreign ones. */
LANES_INLINE float4 load_position(const struct measuring *m, uint32_t vertex)
{
    const uint32_t local = vertex - m->scope->vertex_first;
    float4 row;
    if (local < m->last_own) {
        memcpy(&row, m->own + 3 * (size_t)local, sizeof row);
    } else {
        const float *at = position_place(m->scope, m->own, m->foreign, vertex);
        row = (float4){at[0], at[1], at[2], 0};
    }
    return row;
}

/* Corner k of faces first to first + 3 of the draft. */
LANES_INLINE void load_corners(const struct measuring *m, size_t first, unsigned k, double4 to[3])
{
    float4 rows[GROUP];
    for (unsigned i = 0; i < GROUP; i++)
        rows[i] = load_position(m, m->draft->faces[3 * (first + i) + k]);
    float4_transpose(rows);
    for (unsigned c = 0; c < 3; c++)
        to[c] = __builtin_convertvector(rows[c], double4);
}

LANES_INLINE double4 square_of(const double4 a[3])
{
    return a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
}

LANES_INLINE bool any_zero(double4 a)
{
    uint64_t words[GROUP];
    const long4 is_zero = a == 0;
    memcpy(words, &is_zero, sizeof words);
    return (words[0] | words[1] | words[2] | words[3]) != 0;
}

/* The next edge takes the place of one that is not to be counted: half of them are the
 * neighbours'. */
LANES_INLINE void put_edge(struct squares *squares, double square, uint32_t over, size_t f)
{
    squares->edges[squares->edge_count] = square;
    squares->edge_count += over >= f;
}

#if defined(__x86_64__)

/* The words of the doubles that a mask of four has, closed up. */
static const uint32_t closed_up[16][8] = {
    {0},
    {0, 1},
    {2, 3},
    {0, 1, 2, 3},
    {4, 5},
    {0, 1, 4, 5},
    {2, 3, 4, 5},
    {0, 1, 2, 3, 4, 5},
    {6, 7},
    {0, 1, 6, 7},
    {2, 3, 6, 7},
    {0, 1, 2, 3, 6, 7},
    {4, 5, 6, 7},
    {0, 1, 4, 5, 6, 7},
    {2, 3, 4, 5, 6, 7},
    {0, 1, 2, 3, 4, 5, 6, 7},
};

/* The same for the edges of four faces from `first` on, squares[k] those of edge k, in order of
 * faces, by vectors. */
LANES_AVX2 static inline void put_edges(struct squares *squares, const double4 *edges,
                                        const uint32_t *over, uint32_t first)
{
    const double4 a = __builtin_shufflevector(edges[0], edges[1], 0, 4, 2, 6);
    const double4 b = __builtin_shufflevector(edges[1], edges[2], 1, 5, 3, 7);
    const double4 c = __builtin_shufflevector(edges[2], edges[0], 0, 5, 2, 7);
    const double4 rows[3] = {__builtin_shufflevector(a, c, 0, 1, 4, 5),
                             __builtin_shufflevector(b, a, 0, 1, 6, 7),
                             __builtin_shufflevector(c, b, 2, 3, 6, 7)};
    const uint4 faces[3] = {{0, 0, 0, 1}, {1, 1, 2, 2}, {2, 3, 3, 3}};
    for (unsigned r = 0; r < 3; r++) {
        uint4 there;
        memcpy(&there, over + 4 * r, sizeof there);
        const unsigned counted = float4_bits((float4)(there >= faces[r] + first));
        const __m256i words = _mm256_loadu_si256((const __m256i *)(const void *)closed_up[counted]);
        const __m256i row = _mm256_permutevar8x32_epi32((__m256i)rows[r], words);
        memcpy(squares->edges + squares->edge_count, &row, sizeof row);
        squares->edge_count += (uint32_t)__builtin_popcount(counted);
    }
}

#else

static inline void put_edges(struct squares *squares, const double4 *edges, const uint32_t *over,
                             uint32_t first)
{
    (void)squares, (void)edges, (void)over, (void)first; /* never called */
}

#endif

/* Faces first to first + 3 of the draft. */
LANES_INLINE void measure_four(struct measuring *m, size_t first, bool is_wide)
{
    struct squares *squares = m->found;
    double4 p[3][3], along[3][3], cross[3];
    double4 edges[3];
    for (unsigned k = 0; k < 3; k++)
        load_corners(m, first, k, p[k]);
    for (unsigned k = 0; k < 3; k++) {
        for (unsigned c = 0; c < 3; c++)
            along[k][c] = p[next3(k)][c] - p[k][c];
        edges[k] = square_of(along[k]);
    }
    for (unsigned c = 0; c < 3; c++)
        cross[c] = along[0][next3(c)] * along[1][previous3(c)] -
                   along[0][previous3(c)] * along[1][next3(c)];
    const double4 square = square_of(cross);
    memcpy(squares->areas + squares->face_count, &square, sizeof square);
    squares->face_count += GROUP;
    if (any_zero(square)) /* as those of tiny ones may be, too */
        for (unsigned i = 0; i < GROUP; i++)
            m->sums.zero_area_faces += cross[0][i] == 0 && cross[1][i] == 0 && cross[2][i] == 0;
    const uint32_t *over = m->draft->neighbours + 3 * first;
    if (is_wide) {
        put_edges(squares, edges, over, (uint32_t)first);
        return;
    }
    for (unsigned i = 0; i < GROUP; i++)
        for (unsigned k = 0; k < 3; k++)
            put_edge(squares, edges[k][i], over[3 * i + k], first + i);
}

/* The same for one face. */
static void measure_face(struct measuring *m, size_t f)
{
    struct squares *squares = m->found;
    const uint32_t *face = m->draft->faces + 3 * f, *over = m->draft->neighbours + 3 * f;
    struct vec3 p[3], along[3];
    for (int k = 0; k < 3; k++)
        p[k] = position_of(m->scope, m->own, m->foreign, face[k]);
    for (unsigned k = 0; k < 3; k++)
        along[k] = vec3_sub(p[next3(k)], p[k]);
    struct vec3 cross = vec3_cross(along[0], along[1]);
    const double square = vec3_dot(cross, cross);
    squares->areas[squares->face_count++] = square;
    if (square == 0)
        m->sums.zero_area_faces += cross.x == 0 && cross.y == 0 && cross.z == 0;
    for (unsigned k = 0; k < 3; k++)
        put_edge(squares, vec3_dot(along[k], along[k]), over[k], f);
}

LANES_INLINE void measure_all(struct measuring *m, bool is_wide)
{
    const size_t first = m->scope->face_first;
    const uint32_t most = m->draft->slab_count > 1 ? NOISE_SAMPLES_OF_MANY : NOISE_SAMPLES;
    const uint32_t count = m->scope->face_count, spacing = count / most + 1;
    uint32_t i = 0, sample = 0; /* the next for the noise, looked at with its neighbours at hand */
    for (; i + GROUP <= count; i += GROUP) {
        measure_four(m, first + i, is_wide);
        add_share(m);
        if (m->found->face_count == ROOTS)
            turn_over(m);
        for (; sample < i + GROUP; sample += spacing)
            add_noise(m->draft, m->scope, m->own, m->foreign, (uint32_t)first + sample, &m->sums);
    }
    for (unsigned share = 0; share < SHARES; share++)
        add_share(m);
    for (; i < count; i++) {
        measure_face(m, first + i);
        if (i == sample) {
            add_noise(m->draft, m->scope, m->own, m->foreign, (uint32_t)first + i, &m->sums);
            sample += spacing;
        }
    }
    turn_over(m);
    for (unsigned share = 0; share < SHARES; share++)
        add_share(m);
}

static void measure_all_scalar(struct measuring *m)
{
    measure_all(m, false);
}

LANES_AVX2 static void measure_all_avx2(struct measuring *m)
{
    measure_all(m, true);
}

void measure_slab(const struct draft *draft, const struct slab_scope *scope, const float *own,
                  const float *foreign, struct slab_measures *measures)
{
    struct measuring m = {.draft = draft,
                          .scope = scope,
                          .own = own,
                          .foreign = foreign,
                          .last_own = scope->own_count ? scope->own_count - 1 : 0};
    m.found = &m.squares[0];
    m.added = &m.squares[1];
    if (cpu_level(draft->ctx) >= CPU_AVX2)
        measure_all_avx2(&m);
    else
        measure_all_scalar(&m);
    *measures = m.sums;
}

void measures_add(struct slab_measures *sum, const struct slab_measures *slab)
{
    sum->area += slab->area;
    sum->edge_length += slab->edge_length;
    sum->edge_count += slab->edge_count;
    sum->noise_squares += slab->noise_squares;
    sum->noise_count += slab->noise_count;
    sum->zero_area_faces += slab->zero_area_faces;
}

double measures_mean_edge(const struct slab_measures *sum)
{
    return sum->edge_count ? sum->edge_length / (double)sum->edge_count : 0;
}

double measures_noise(const struct slab_measures *sum)
{
    double mean = measures_mean_edge(sum);
    if (sum->noise_count == 0 || !(mean > 0))
        return 0;
    return sqrt(sum->noise_squares / (double)sum->noise_count) / mean;
}
