/*
 * The connected components of one slab, with the side that each face shows: faces joined by an edge
 * are in one component, and have the same parity if they run along it in opposite directions.
 */
#ifndef SPBM_MESH_COMPONENTS_H
#define SPBM_MESH_COMPONENTS_H

#include "mesh/draft.h"

struct component {
    uint32_t lowest; /* face of the slab; its parity is 0 */
    uint32_t faces;
    uint32_t turned;   /* faces of parity 1 */
    uint32_t vertices; /* of the slab's own, filled in by survey.c */
    uint32_t borders;  /* border edges */
    uint32_t loops;    /* border loops that lie in the slab, filled in by survey.c */
    uint32_t open_id;  /* place among the slab's open components, NO_INDEX: not open */
    bool is_twisted;   /* no parities fit: the surface is not orientable */
};

struct components { /* kept from slab to slab; all zero before the first use */
    struct context *ctx;
    uint32_t *label; /* component << 1 | parity, a face */
    size_t label_capacity;
    struct component *list; /* by lowest face */
    uint32_t count;
    size_t capacity;
    uint32_t open_count; /* components that go on in another slab */
};

enum status components_find(const struct draft *draft, const struct slab_scope *scope,
                            struct components *components) MUST_CHECK;

/* By pieces, where another walk over the slab finds them: all zero but for ctx before the first
 * use, count set to 0 for a slab. The new one has a face, `lowest`. */
enum status component_begin(struct components *components, uint32_t lowest) MUST_CHECK;
/* Numbers those whose open_id is not NO_INDEX. */
void components_number_open(struct components *components);
void components_clear(struct components *components);

/* Whether the faces over edge k of f, edge m of g, run along it in the same direction. */
static inline bool run_alike(const uint32_t *faces, uint64_t f, unsigned k, uint64_t g, unsigned m)
{
    return faces[3 * f + k] == faces[3 * g + m];
}

#endif
