/*
 * The header of a PLY file: elements in their order, each with its properties.
 */
#ifndef SPBM_MESH_PLY_HEADER_H
#define SPBM_MESH_PLY_HEADER_H

#include "mesh/mesh.h"
#include "mesh/text_scan.h"

enum ply_format { PLY_ASCII, PLY_LITTLE, PLY_BIG };
enum { PLY_NAME_MAX = 255, PLY_ELEMENT_MAX = 64, PLY_PROPERTY_MAX = 1024 };

struct ply_property {
    char name[PLY_NAME_MAX + 1];
    enum scalar_type type; /* of a list: of its items */
    bool is_list;
    enum scalar_type count_type; /* of a list: an integer type */
};

struct ply_element {
    char name[PLY_NAME_MAX + 1];
    uint64_t count;
    uint32_t first_property; /* in the header's array */
    uint32_t property_count;
    bool has_lists;
    uint64_t row_size; /* bytes of a row in a binary file; without lists' items */
};

struct ply_header {
    enum ply_format format;
    uint32_t element_count;
    uint32_t property_count;
    size_t property_capacity;
    struct ply_element elements[PLY_ELEMENT_MAX];
    struct ply_property *properties;
};

/* Reads the header, from "ply" to the byte behind end_header's line. The header must be cleared in
 * any case. */
enum status ply_header_read(struct text *text, struct ply_header *header) MUST_CHECK;
void ply_header_clear(struct context *ctx, struct ply_header *header); /* safe when all zero */

/* NULL when there is none of this name. */
const struct ply_element *ply_find_element(const struct ply_header *header, const char *name);
const struct ply_property *ply_find_property(const struct ply_header *header,
                                             const struct ply_element *element, const char *name);

#endif
