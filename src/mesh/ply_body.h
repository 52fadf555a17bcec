/*
 * The parts of the PLY reader: import_ply.c walks the elements, ply_rows.c reads rows value by
 * value in any format and of any types, ply_fast.c reads binary rows of the usual layouts by the
 * thousand, ply_text.c lines of text that are a row each.
 */
#ifndef SPBM_MESH_PLY_BODY_H
#define SPBM_MESH_PLY_BODY_H

#include "mesh/import_batch.h"
#include "mesh/ply_header.h"

/* What becomes of a vertex property: an axis (0 to 2), an attribute, or nothing. */
enum { PLY_DROPPED = -1, PLY_FIRST_ATTRIBUTE = 3 };

struct ply {
    struct context *ctx;
    struct text text;
    struct ply_header header;
    struct import_batch batch;
    struct attributes attributes;
    const struct ply_element *element; /* being read */
    uint64_t row;                      /* rows of it that are done */
    int16_t role[PLY_PROPERTY_MAX];    /* of the properties of the element "vertex" */
    int32_t index_list;                /* which property of the element is vertex_indices, or -1 */
};

/* "ends within element ...: N of M". */
enum status ply_ends_early(struct ply *ply);

/* Each reads the current element's rows before row `end`. */
enum status ply_read_vertices(struct ply *ply, uint64_t end) MUST_CHECK;
enum status ply_read_faces(struct ply *ply, uint64_t end) MUST_CHECK;
/* Each reads all rows of the current element. */
enum status ply_read_strips(struct ply *ply) MUST_CHECK;
enum status ply_skip_rows(struct ply *ply) MUST_CHECK;

/* Whether the fast functions know the current element's layout, and the functions. */
bool ply_vertices_are_plain(const struct ply *ply);
enum status ply_read_plain_vertices(struct ply *ply) MUST_CHECK;
/*
 * As many of the element's further rows of `row_size` bytes as all threads can read at once: none
 * where there are few, or no plain file. `convert`, in any thread,
 * makes of `count` rows what `take`, row by row in their order, is given; false: the rows are not
 * what is expected, and reading stops before them. ply->row counts those that were taken.
 */
struct ply_split {
    struct ply *ply;
    const void *plan;
    size_t row_size;
    size_t made_size; /* bytes that convert makes of IMPORT_BATCH rows, the most */
    bool (*convert)(const void *plan, const unsigned char *rows, size_t count, void *made);
    enum status (*take)(struct ply *ply, const void *plan, size_t count, void *made);
};
enum status ply_read_split(const struct ply_split *split) MUST_CHECK;

bool ply_faces_are_plain(const struct ply *ply);
enum status ply_read_plain_faces(struct ply *ply) MUST_CHECK;

/* Whether the current element, vertices or faces, is text without lists that are dropped, so that
 * its rows may be lines; reads them all, whether they are or not. */
bool ply_rows_are_lines(const struct ply *ply);
enum status ply_read_lines(struct ply *ply) MUST_CHECK;

/* A value from text as the bytes of a record, little-endian; false if the type has no such value.
 */
bool ply_store_scalar(enum scalar_type type, double value, unsigned char bytes[8]);

static inline const struct ply_property *ply_property(const struct ply *ply, uint32_t i)
{
    return &ply->header.properties[ply->element->first_property + i];
}

/* At least `size` bytes in the window, or the element ends early. */
static inline enum status ply_want(struct ply *ply, size_t size)
{
    if (text_available(&ply->text) >= size)
        return STATUS_OK;
    if (!ply->text.is_last) {
        enum status status = text_refill(&ply->text, size);
        if (status != STATUS_OK)
            return status;
        if (text_available(&ply->text) >= size)
            return STATUS_OK;
    }
    return ply_ends_early(ply);
}

/* A scalar of a binary row as a double (exact for all types). */
double ply_load(enum scalar_type type, const unsigned char *from, bool is_big);

#endif
