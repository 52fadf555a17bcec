/*
 * Is a slab fit for use? Checksums tell of accidents; a file that was made with care has the right
 * ones. To believe nothing at all, a store would have to be built again from its faces, as
 * store_check does, at the price of a quarter of an import. What is asked here of every slab that
 * is opened is what one sweep over it can tell: that no number leads anywhere it should not, and
 * that all edges are seen alike from both sides. For edges between slabs, where the other side may
 * not be mapped, each side reduces what it knows to a number; the lower slab adds it, the higher
 * subtracts it, and nothing is left when all slabs have been seen.
 */
#include "mesh/slab_judge.h"

#include <string.h>

#include "base/memory.h"
#include "mesh/draft.h"

static bool foreign_has(const struct slab *slab, uint32_t vertex)
{
    if (slab->foreign_count == 0)
        return false;
    return slab->foreign[foreign_rank(slab->foreign, slab->foreign_count, vertex)] == vertex;
}

static const char *judge_vertices(const struct slab *slab)
{
    for (uint32_t i = 0; i < slab->foreign_count; i++) {
        if (slab->foreign[i] >= slab->vertex_first ||
            (i && slab->foreign[i] <= slab->foreign[i - 1]))
            return "the foreign vertices are not in order";
    }
    uint32_t next = slab->vertex_first;
    const size_t corners = 3 * (size_t)slab->face_count;
    for (size_t i = 0; i < corners; i++) {
        const uint32_t vertex = slab->faces[i];
        if (vertex >= slab->vertex_end ||
            (vertex < slab->vertex_first && !foreign_has(slab, vertex)))
            return "a face names a vertex that the slab does not have";
        if (vertex > next)
            return "vertices are not numbered by first use";
        next += vertex == next;
    }
    if (next != slab->vertex_end)
        return "its own vertices are not all used";
    for (size_t i = 0; i < corners; i += 3) {
        const uint32_t *face = slab->faces + i;
        if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0])
            return "a face names a vertex twice";
    }
    return NULL;
}

/* No infinity, no NaN. */
static bool is_finite(const float *values, size_t count)
{
    bool all = true;
    for (size_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        all &= (bits & 0x7f800000) != 0x7f800000;
    }
    return all;
}

/* ---- neighbours ---- */

/* Edge k of face f, which runs from vertex a to b, meets edge `mate` of face g. Each bit of the
 * result hangs on all bits (the finaliser is that of splitmix64: Steele, Lea, Flood 2014). */
static uint64_t seam_number(uint32_t f, unsigned k, uint32_t g, unsigned mate, uint32_t a,
                            uint32_t b)
{
    uint64_t words[] = {(uint64_t)f << 32 | g, (uint64_t)a << 32 | b, (uint64_t)(4 * k + mate)};
    uint64_t sum = 0;
    for (unsigned i = 0; i < 3; i++) {
        sum = (sum ^ words[i]) + 0x9e3779b97f4a7c15;
        sum = (sum ^ sum >> 30) * 0xbf58476d1ce4e5b9;
        sum = (sum ^ sum >> 27) * 0x94d049bb133111eb;
        sum ^= sum >> 31;
    }
    return sum;
}

/* Edge k of the slab's face f, whose neighbour lies in the slab. */
static bool agrees(const struct slab *slab, uint32_t f, unsigned k, uint32_t there, unsigned mate)
{
    const size_t here = 3 * (size_t)f, other = 3 * (size_t)there;
    return slab->neighbours[other + mate] == slab->face_first + f &&
           mate_of(slab->mates, there, mate) == k &&
           (there < f || /* seen from there already */
            (slab->faces[here + k] == slab->faces[other + next3(mate)] &&
             slab->faces[here + next3(k)] == slab->faces[other + mate]));
}

/* The same for all edges of a face whose neighbours all lie in the slab, and whose mates are in
 * range. From both sides and without asking which comes first: to guess that wrong for every other
 * edge takes longer than to compare twice. */
static bool all_agree(const struct slab *slab, uint32_t f)
{
    static const uint8_t after[3] = {1, 2, 0};
    const uint32_t *over = slab->neighbours + 3 * (size_t)f, *corner = slab->faces + 3 * (size_t)f;
    const unsigned mates = slab->mates[f];
    uint32_t differs = 0;
    for (unsigned k = 0; k < 3; k++) {
        const uint32_t there = over[k] - slab->face_first;
        const size_t other = 3 * (size_t)there;
        const unsigned mate = mates >> 2 * k & 3;
        differs |= slab->neighbours[other + mate] ^ (slab->face_first + f);
        differs |= (slab->mates[there] >> 2 * mate & 3) ^ k;
        differs |= corner[k] ^ slab->faces[other + after[mate]];
        differs |= corner[next3(k)] ^ slab->faces[other + mate];
    }
    return differs == 0;
}

static const char *judge_neighbours(const struct slab *slab, uint64_t face_count, uint64_t *seams)
{
    for (uint32_t f = 0; f < slab->face_count; f++) {
        const uint32_t *over = slab->neighbours + 3 * (size_t)f;
        const uint32_t *corner = slab->faces + 3 * (size_t)f, own = slab->face_first + f;
        const unsigned mates = slab->mates[f];
        if (mates >> 6)
            return "a face's mates have bits that are not zero";
        if ((over[0] - slab->face_first < slab->face_count) &
            (over[1] - slab->face_first < slab->face_count) &
            (over[2] - slab->face_first < slab->face_count) & !(mates & mates >> 1 & 0x15)) {
            if (!all_agree(slab, f))
                return "two neighbours do not agree";
            continue;
        }
        for (unsigned k = 0; k < 3; k++) {
            unsigned mate = mate_of(slab->mates, f, k);
            if (over[k] == NO_INDEX && mate == 0)
                continue;
            if (over[k] >= face_count || mate == 3)
                return "a face has an impossible neighbour";
            uint32_t there = over[k] - slab->face_first;
            if (there < slab->face_count) {
                if (!agrees(slab, f, k, there, mate))
                    return "two neighbours do not agree";
            } else if (own < over[k]) {
                *seams += seam_number(own, k, over[k], mate, corner[k], corner[next3(k)]);
            } else {
                *seams -= seam_number(over[k], mate, own, k, corner[next3(k)], corner[k]);
            }
        }
    }
    return NULL;
}

const char *slab_judge(const struct slab *slab, uint64_t face_count, uint64_t *seams)
{
    *seams = 0;
    const char *wrong = judge_vertices(slab);
    if (!wrong &&
        (!is_finite(slab->positions, 3 * (size_t)(slab->vertex_end - slab->vertex_first)) ||
         !is_finite(slab->foreign_positions, 3 * (size_t)slab->foreign_count)))
        wrong = "a coordinate is not finite";
    return wrong ? wrong : judge_neighbours(slab, face_count, seams);
}

/* ---- stars ---- */

/* Of a vertex, in `last`: the vertex whose star it was last met in, plus 1, and in `fans` what is
 * known of its own. Vertices are numbered in the slab: its own, then the foreign ones. */
struct stars {
    const struct slab *slab;
    uint32_t *last;
    uint8_t *fans;  /* FAN_WHOLE, FAN_PART or 0 */
    uint8_t *faces; /* bit k: corner k is done */
};

enum { FAN_PART = 1, FAN_WHOLE = 2 };

static uint32_t local_number(const struct slab *slab, uint32_t vertex)
{
    const uint32_t own = slab->vertex_end - slab->vertex_first;
    if (vertex >= slab->vertex_first)
        return vertex - slab->vertex_first;
    return own + foreign_rank(slab->foreign, slab->foreign_count, vertex);
}

/* Goes from corner k of face f to the corner of the same vertex over edge `edge` of f, k or the one
 * before it; false where that face is not in the slab: *ends tells if there is none. */
static bool turn(const struct slab *slab, uint32_t *f, unsigned *k, unsigned edge, bool *ends)
{
    uint32_t over = slab->neighbours[3 * (size_t)*f + edge];
    *ends = over == NO_INDEX;
    if (*ends || over - slab->face_first >= slab->face_count)
        return false;
    unsigned mate = mate_of(slab->mates, *f, edge);
    *k = edge == *k ? next3(mate) : mate;
    *f = over - slab->face_first;
    return true;
}

/* The fan round corner k of face f: whether it meets each vertex once and is the only one. */
static bool walk_fan(struct stars *stars, uint32_t f, unsigned k)
{
    const struct slab *slab = stars->slab;
    const uint32_t centre = local_number(slab, slab->faces[3 * (size_t)f + k]);
    const uint32_t first = f;
    const unsigned first_corner = k;
    bool begins = false, has_end = false, is_closed = false;
    while (!is_closed && turn(slab, &f, &k, previous3(k), &begins))
        is_closed = f == first && k == first_corner;

    uint32_t rim = local_number(slab, slab->faces[3 * (size_t)f + previous3(k)]), degree = 0;
    stars->last[rim] = centre + 1;
    do {
        stars->faces[f] |= (uint8_t)(1u << k);
        degree++;
        rim = local_number(slab, slab->faces[3 * (size_t)f + next3(k)]);
        bool goes_on = turn(slab, &f, &k, k, &has_end);
        if (is_closed && f == first && k == first_corner)
            break;
        if (stars->last[rim] == centre + 1)
            return false;
        stars->last[rim] = centre + 1;
        if (!goes_on)
            break;
    } while (true);
    if (is_closed && degree < 3)
        return false;

    uint8_t found = is_closed || (begins && has_end) ? FAN_WHOLE : FAN_PART;
    bool is_only = !stars->fans[centre] || (found == FAN_PART && stars->fans[centre] == FAN_PART);
    stars->fans[centre] = found;
    return is_only;
}

enum status slab_judge_stars(struct context *ctx, const struct slab *slab, const char **wrong)
{
    struct stars stars = {.slab = slab};
    const size_t vertices = (size_t)(slab->vertex_end - slab->vertex_first) + slab->foreign_count;
    *wrong = NULL;
    enum status status = memory_take_zeroed(ctx, vertices, sizeof *stars.last, &stars.last);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, vertices, 1, &stars.fans);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, slab->face_count, 1, &stars.faces);
    for (uint32_t f = 0; f < slab->face_count && status == STATUS_OK && !*wrong; f++)
        for (unsigned k = 0; k < 3 && !*wrong; k++)
            if (!(stars.faces[f] >> k & 1) && !walk_fan(&stars, f, k))
                *wrong = "the faces at a vertex do not lie round it in one turn";
    memory_release(ctx, &stars.last, vertices, sizeof *stars.last);
    memory_release(ctx, &stars.fans, vertices, 1);
    memory_release(ctx, &stars.faces, slab->face_count, 1);
    return status;
}
