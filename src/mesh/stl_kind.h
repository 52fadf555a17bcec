/*
 * Telling text STL from binary: both may begin with "solid".
 */
#ifndef SPBM_MESH_STL_KIND_H
#define SPBM_MESH_STL_KIND_H

#include <stdbool.h>
#include <stddef.h>

enum { STL_LOOK = 4096, STL_HEADER_SIZE = 84, STL_FACET_SIZE = 50 };

/* Both look at the file's first bytes, up to STL_LOOK of them. Text: "solid", then, on a later
 * line, "facet" or "endsolid", and no NUL byte up to there. */
bool stl_is_text(const unsigned char *data, size_t size);
/* Binary: a header, then facets whose numbers can be coordinates. `is_all`: the file ends there. */
bool stl_is_binary(const unsigned char *data, size_t size, bool is_all);

#endif
