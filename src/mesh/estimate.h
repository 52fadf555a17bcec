/*
 * How large is the mesh in a file, without reading it: for limits that are checked before a run and
 * for foretelling what it takes.
 */
#ifndef SPBM_MESH_ESTIMATE_H
#define SPBM_MESH_ESTIMATE_H

#include "mesh/import.h"

struct mesh_estimate {
    uint64_t file_size; /* bytes on the disk */
    uint64_t vertices;  /* a soup's corners are counted once for each face */
    uint64_t faces;
    uint32_t stride; /* bytes of a vertex's attributes */
    bool is_text;    /* numbers must be parsed */
    bool is_gzip;
    bool is_soup;    /* must be welded */
    bool is_counted; /* the counts are what the file says; else scaled up from its beginning */
};

/*
 * Looks at a file's beginning. What it claims of itself is not believed beyond what its bytes could
 * hold. Standard input and pipes can't be looked at without being used up: all zero. So is
 * what can't be read as a mesh: the import will say why. Nothing is told and nothing fails but for
 * want of memory.
 */
enum status mesh_estimate(struct context *ctx, const char *path,
                          struct mesh_estimate *estimate) MUST_CHECK;

#endif
