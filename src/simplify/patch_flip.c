/*
 * Flipping diagonals.
 *
 * Section 4.2.8 cuts ears in the plane of the patch, by angle. That is blind to how the patch's
 * border rises and falls: on a bent patch, like the quarter of a pipe, diagonals that run round the
 * bend make creases that the surface has not. Choosing diagonals in space from the start would lose
 * what makes ear cutting sure, so it is done first and its diagonals are improved one by one; the
 * triangles stay a tiling of the loop's inside at every step. The number of flips is bounded, as
 * two criteria with a tolerance between them need not have an end.
 */
#include "simplify/patch_flip.h"

#include "base/memory.h"
#include "geom/plane.h"
#include "mesh/corner.h"

enum { PASSES_MAX = 12 };
#define AREA_TOLERANCE 1e-3  /* areas that differ by less are equal: bends of 2 or 3 degrees */
#define ANGLE_TOLERANCE 1e-7 /* sine of the opposite angles' sum */

struct flipping {
    const double *points;
    struct plane_frame frame;
    uint32_t n;
    uint32_t *triangles;
    uint32_t *mates;
};

static uint32_t next_corner(uint32_t c)
{
    return c - c % 3 + (c + 1) % 3;
}

static struct vec3 point_at(const struct flipping *f, uint32_t i)
{
    return vec3_load(f->points + 3 * (size_t)i);
}

/* Lower and higher end of the edge that starts at a corner. */
static void edge_ends(const struct flipping *f, uint32_t c, uint32_t *low, uint32_t *high)
{
    uint32_t a = f->triangles[c], b = f->triangles[next_corner(c)];
    *low = a < b ? a : b;
    *high = a < b ? b : a;
}

/* Finds the mates: corners are put in order by the higher end, then stably by the lower, so that
 * the two of a diagonal follow each other. `first` has n + 1 places. */
static void find_mates(struct flipping *f, uint32_t *order, uint32_t *other, uint32_t *first)
{
    uint32_t corners = 3 * (f->n - 2), low, high;
    for (uint32_t c = 0; c < corners; c++)
        order[c] = c;
    for (int by_low = 0; by_low < 2; by_low++) {
        for (uint32_t i = 0; i <= f->n; i++)
            first[i] = 0;
        for (uint32_t c = 0; c < corners; c++) {
            edge_ends(f, c, &low, &high);
            first[(by_low ? low : high) + 1]++;
        }
        for (uint32_t i = 0; i < f->n; i++)
            first[i + 1] += first[i];
        for (uint32_t i = 0; i < corners; i++) {
            edge_ends(f, order[i], &low, &high);
            other[first[by_low ? low : high]++] = order[i];
        }
        uint32_t *swap = order;
        order = other;
        other = swap;
    }
    for (uint32_t i = 0; i < corners; i++)
        f->mates[order[i]] = NO_INDEX;
    for (uint32_t i = 0; i + 1 < corners; i++) {
        uint32_t next_low, next_high;
        edge_ends(f, order[i], &low, &high);
        edge_ends(f, order[i + 1], &next_low, &next_high);
        if (low == next_low && high == next_high) {
            f->mates[order[i]] = order[i + 1];
            f->mates[order[i + 1]] = order[i];
        }
    }
}

/* Sine of the sum of the angles at p and q over the edge ab, times a positive factor; negative: the
 * other diagonal is the Delaunay one. Scaled to be comparable with a constant. */
static double opposite_sine(struct vec3 a, struct vec3 b, struct vec3 p, struct vec3 q)
{
    struct vec3 pa = vec3_sub(a, p), pb = vec3_sub(b, p), qa = vec3_sub(a, q), qb = vec3_sub(b, q);
    double sine_p = vec3_length(vec3_cross(pa, pb)), sine_q = vec3_length(vec3_cross(qa, qb));
    double cosine_p = vec3_dot(pa, pb), cosine_q = vec3_dot(qa, qb);
    double scale =
        sqrt((sine_p * sine_p + cosine_p * cosine_p) * (sine_q * sine_q + cosine_q * cosine_q));
    return scale > 0 ? (sine_p * cosine_q + cosine_p * sine_q) / scale : 0;
}

/* Is p, q the better diagonal of the quadrangle a, q, b, p than a, b? */
static bool is_better(const struct flipping *f, uint32_t a, uint32_t b, uint32_t p, uint32_t q)
{
    struct vec3 pa = point_at(f, a), pb = point_at(f, b), pp = point_at(f, p), pq = point_at(f, q);
    struct plane_point origin = plane_project(&f->frame, vec3_sub(pa, pa));
    struct plane_point fb = plane_project(&f->frame, vec3_sub(pb, pa));
    struct plane_point fp = plane_project(&f->frame, vec3_sub(pp, pa));
    struct plane_point fq = plane_project(&f->frame, vec3_sub(pq, pa));
    double whole = fabs(plane_turn(origin, fb, fp)) + fabs(plane_turn(fb, origin, fq));
    double first = plane_turn(fp, origin, fq), second = plane_turn(fq, fb, fp);
    if (!(first > 1e-6 * whole && second > 1e-6 * whole))
        return false;
    double before =
        vec3_length(triangle_normal(pa, pb, pp)) + vec3_length(triangle_normal(pb, pa, pq));
    double after =
        vec3_length(triangle_normal(pp, pa, pq)) + vec3_length(triangle_normal(pq, pb, pp));
    if (after < before * (1 - AREA_TOLERANCE))
        return true;
    if (after > before * (1 + AREA_TOLERANCE))
        return false;
    return opposite_sine(pa, pb, pp, pq) < -ANGLE_TOLERANCE;
}

static void set_mate(struct flipping *f, uint32_t c, uint32_t mate)
{
    f->mates[c] = mate;
    if (mate != NO_INDEX)
        f->mates[mate] = c;
}

/* The triangles a, b, p (edge a to b starts at corner c) and b, a, q become a, q, p and q, b, p. */
static void flip(struct flipping *f, uint32_t c)
{
    uint32_t m = f->mates[c], b_to_p = next_corner(c), a_to_q = next_corner(m);
    uint32_t p = f->triangles[next_corner(b_to_p)], q = f->triangles[next_corner(a_to_q)];
    uint32_t beyond_bp = f->mates[b_to_p], beyond_aq = f->mates[a_to_q];
    f->triangles[b_to_p] = q;
    f->triangles[a_to_q] = p;
    set_mate(f, c, beyond_aq);
    set_mate(f, m, beyond_bp);
    set_mate(f, b_to_p, a_to_q);
}

enum status patch_flip(struct context *ctx, struct flip_room *room, const double *points,
                       uint32_t n, const double normal[3],
                       bool (*diagonal_allowed)(void *user, uint32_t i, uint32_t j), void *user,
                       uint32_t *triangles)
{
    struct flipping f = {.points = points,
                         .frame = plane_frame_make(vec3_load(normal)),
                         .n = n,
                         .triangles = triangles};
    size_t corners = 3 * ((size_t)n - 2);
    enum status status =
        memory_reserve(ctx, &room->mates, &room->mate_capacity, corners, sizeof *room->mates);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &room->order, &room->order_capacity, 2 * corners + n + 1,
                                sizeof *room->order);
    if (status != STATUS_OK)
        return status;
    f.mates = room->mates;
    find_mates(&f, room->order, room->order + corners, room->order + 2 * corners);
    bool changed = true;
    for (int pass = 0; pass < PASSES_MAX && changed; pass++) {
        changed = false;
        for (uint32_t c = 0; c < corners; c++) {
            uint32_t m = f.mates[c];
            if (m == NO_INDEX || m < c)
                continue;
            uint32_t p = triangles[next_corner(next_corner(c))];
            uint32_t q = triangles[next_corner(next_corner(m))];
            if (is_better(&f, triangles[c], triangles[m], p, q) && diagonal_allowed(user, p, q)) {
                flip(&f, c);
                changed = true;
            }
        }
    }
    return STATUS_OK;
}

void flip_room_clear(struct context *ctx, struct flip_room *room)
{
    memory_release(ctx, &room->mates, room->mate_capacity, sizeof *room->mates);
    memory_release(ctx, &room->order, room->order_capacity, sizeof *room->order);
    *room = (struct flip_room){0};
}
