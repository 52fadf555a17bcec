/*
 * What small_mesh.c, small_edges.c, small_chains.c, small_patches.c and small_loss.c share: a
 * block's small mesh while it is built.
 */
#ifndef SPBM_SIMPLIFY_SMALL_INTERNAL_H
#define SPBM_SIMPLIFY_SMALL_INTERNAL_H

#include "base/ranked_bits.h"
#include "simplify/small_bulge.h"
#include "simplify/small_mesh.h"

/* The edges from a vertex to higher ones, and to such hubs among the lower ones that have all bits
 * set already: no list is long. */
struct edge_list {
    uint32_t first; /* 1 + the entry; 0: there is none */
    uint32_t seen;  /* a bit for each of all other ends, several having the same */
};

struct edge_entry {
    uint32_t other; /* vertex */
    uint32_t next;  /* 1 + the next entry of the list; 0: it is the last */
    uint32_t owner;
    uint32_t chain; /* that it is a segment of; NO_INDEX: a diagonal */
};

/* What has become of a chain since it was cut. */
enum chain_state {
    CHAIN_CUT,
    CHAIN_GIVEN_BACK, /* it has all its vertices; the segments entered are those that it had */
    CHAIN_WHOLE,      /* its segments are to be entered, and */
    CHAIN_ENTERED     /* are */
};

/* A use of a chain, as the patch walks along it. */
struct use_line {
    uint32_t start, end;
    uint32_t count;       /* of the vertices between them */
    uint32_t first;       /* of these, if they are a range of numbers */
    const uint32_t *list; /* of them, from the chain's start; NULL: a range */
    bool is_backwards;
};

struct small_builder {
    struct context *ctx;
    struct small_workspace *space;
    const struct chain_block *block;
    double tolerance, given_back;
    bool is_cut;
    double lost;          /* largest error of what was left out within it */
    uint32_t chain_total; /* chains, then seam chains */
    uint32_t use_count;
    uint32_t segment_count;  /* of all chains as they were cut */
    uint32_t *use_first;     /* a patch, and one more */
    uint32_t *face_first;    /* likewise, of the faces that it was cut into */
    uint32_t *uses;          /* chain << 1 | walked from its end */
    unsigned char *keep;     /* a vertex: it is in the mesh */
    unsigned char *states;   /* a chain: enum chain_state */
    float *dropped;          /* a chain: the largest error of what is not kept of it */
    struct edge_list *lists; /* a vertex, in the end its number in the mesh */
    uint32_t list_count;
    struct edge_entry *entries;
    uint32_t entry_count, entry_capacity;
    float *line; /* one chain's positions */
    float *line_errors;
    uint32_t line_capacity;
    struct use_line *lines; /* one patch's uses */
    uint32_t *loop;         /* one patch's kept vertices */
    uint32_t loop_count;
    double *points;
    uint32_t *triangles;
    uint32_t line_room, loop_room; /* of lines, and of the other three */
    uint32_t patch;                /* the one that is being cut */
    uint32_t *copies; /* block vertices of which there is another one, numbered from vertex_count */
    uint32_t copy_count, copy_capacity;
    uint32_t *faces;      /* block vertices */
    float *errors;        /* a block vertex: the largest deviation of the patches at it, and */
    uint32_t *witnesses;  /* the inner vertex of that patch; NO_INDEX: none */
    struct bulge *bulges; /* a block vertex; NULL: nothing is given back */
    uint32_t face_count, face_capacity;
};

/* ---- chains, seam or not, in one numbering ---- */

static inline bool small_is_seam(const struct small_builder *b, uint32_t chain)
{
    return chain >= b->block->chain_count;
}

static inline uint32_t small_chain_length(const struct small_builder *b, uint32_t chain)
{
    return small_is_seam(b, chain)
               ? b->block->seam_chains[chain - b->block->chain_count].vertex_count
               : b->block->chains[chain].interior_count + 2;
}

static inline uint32_t small_chain_vertex(const struct small_builder *b, uint32_t chain, uint32_t i)
{
    if (small_is_seam(b, chain)) {
        const struct seam_chain *seam = &b->block->seam_chains[chain - b->block->chain_count];
        return b->block->seam_lists[seam->vertex_first + i];
    }
    const struct chain *c = &b->block->chains[chain];
    return i == 0 ? c->start : i <= c->interior_count ? c->interior_first + i - 1 : c->end;
}

/* A chain's vertices from its start to its end; those between them are a range of numbers, or the
 * seam's list. */
struct chain_line {
    uint32_t start, end;
    uint32_t interior_first, interior_count;
    const uint32_t *list; /* of them; NULL: a range */
};

static inline struct chain_line small_chain_line(const struct small_builder *b, uint32_t chain)
{
    if (small_is_seam(b, chain)) {
        const struct seam_chain *seam = &b->block->seam_chains[chain - b->block->chain_count];
        const uint32_t *list = b->block->seam_lists + seam->vertex_first;
        return (struct chain_line){list[0], list[seam->vertex_count - 1], 0, seam->vertex_count - 2,
                                   list + 1};
    }
    const struct chain *c = &b->block->chains[chain];
    return (struct chain_line){c->start, c->end, c->interior_first, c->interior_count, NULL};
}

static inline uint32_t small_line_interior(const struct chain_line *line, uint32_t i)
{
    return line->list ? line->list[i] : line->interior_first + i;
}

static inline bool small_on_seam(const struct small_builder *b, uint32_t v)
{
    return v >= b->block->junction_count &&
           v < b->block->junction_count + b->block->seam_vertex_count;
}

/* ---- small_edges.c ---- */

static inline uint32_t small_edge_bit(uint32_t other)
{
    return (uint32_t)1 << (other * 0x9e3779b1u >> 27);
}

static inline bool edge_list_is_full(const struct edge_list *list)
{
    return list->seen == UINT32_MAX;
}

static inline struct edge_entry *edge_list_find(const struct small_builder *b,
                                                const struct edge_list *list, uint32_t other)
{
    if (!(list->seen & small_edge_bit(other)))
        return NULL;
    for (uint32_t i = list->first; i != 0; i = b->entries[i - 1].next)
        if (b->entries[i - 1].other == other)
            return &b->entries[i - 1];
    return NULL;
}

/* The edge between two vertices; NULL: it has not been added. */
static inline struct edge_entry *small_edge_find(const struct small_builder *b, uint32_t u,
                                                 uint32_t v)
{
    const uint32_t low = u < v ? u : v, high = u < v ? v : u;
    const struct edge_list *list = &b->lists[low];
    struct edge_entry *entry = edge_list_find(b, list, high);
    return entry || !edge_list_is_full(list) ? entry : edge_list_find(b, &b->lists[high], low);
}

/* Room for so many edges in all. */
enum status small_edges_reserve(struct small_builder *builder, size_t edges) MUST_CHECK;

/* Enters an edge that is not there yet. */
static inline enum status small_edge_add(struct small_builder *b, uint32_t u, uint32_t v,
                                         uint32_t owner, uint32_t chain)
{
    if (b->entry_count == b->entry_capacity) {
        enum status status = small_edges_reserve(b, (size_t)b->entry_count + 1);
        if (status != STATUS_OK)
            return status;
    }
    const uint32_t low = u < v ? u : v, high = u < v ? v : u;
    const bool is_hub = edge_list_is_full(&b->lists[low]);
    struct edge_list *list = &b->lists[is_hub ? high : low];
    const uint32_t other = is_hub ? low : high;
    b->entries[b->entry_count++] = (struct edge_entry){other, list->first, owner, chain};
    list->first = b->entry_count;
    list->seen |= small_edge_bit(other);
    return STATUS_OK;
}

/* Takes the segments out of the chains that were given back. */
void small_edges_drop(struct small_builder *builder);

/* ---- small_chains.c ---- */

/* Marks all chains' ends, and the vertices that their halving errors put above the tolerance. */
void small_chains_cut(struct small_builder *builder);
/* Marks all vertices of a chain. */
void small_chain_give_back(struct small_builder *builder, uint32_t chain);

/* ---- small_patches.c ---- */

enum { OWNER_TAKEN = UINT32_MAX }; /* else the patch for which an edge is reserved */

/* Adds a patch's faces. Its loop is there to be looked at afterwards. */
enum status small_patch_cut(struct small_builder *builder, uint32_t patch) MUST_CHECK;
/* Room for a loop of so many vertices; what was on it is lost when there is not. */
enum status small_loop_reserve(struct small_builder *builder, uint32_t vertices) MUST_CHECK;
void small_loop_release(struct small_builder *builder);

/* ---- small_loss.c ---- */

/* The farthest inner vertex of a patch that has just been cut, without a vertex of its own: when it
 * matters, it becomes a witness at the nearest of the patch's faces, else it counts as lost.
 * Returns its height above them, 0 when there is nothing to tell. */
double small_note_witness(struct small_builder *builder, uint32_t patch);
/* What chains have lost, when all patches are cut. */
void small_measure_chains(struct small_builder *builder);
/* Of the bulges: vertices of borders and seams stay where they are. */
void small_hold_rims(struct small_builder *builder);

#endif
