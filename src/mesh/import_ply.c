/*
 * PLY: a header that describes elements and their properties, then their rows, as text or binary.
 *
 * Readers that know one layout fail on the next file; readers that build a general in-memory model
 * need several times the mesh. Here the header decides once what becomes of every property (axis,
 * attribute, dropped), and each element's rows are streamed by the function that fits best.
 *
 * Understood: element "vertex" with x, y, z of any types in any places, element "face" and element
 * "tristrips" with a list "vertex_indices" or "vertex_index"; all else is skipped, and said once.
 */
#include "mesh/import.h"

#include <string.h>

#include "base/memory.h"
#include "mesh/ply_body.h"

/* ---- what becomes of the properties ---- */

/* "a, b, c", cut to fit; for notes. */
static void list_name(char *names, size_t size, const char *name)
{
    const char *const parts[] = {names[0] ? ", " : "", name};
    for (unsigned i = 0; i < 2; i++) {
        size_t used = strlen(names), length = strlen(parts[i]);
        length = length < size - 1 - used ? length : size - 1 - used;
        memcpy(names + used, parts[i], length);
        names[used + length] = 0;
    }
}

static bool add_attribute(struct attributes *attributes, const struct ply_property *property)
{
    if (property->is_list || attributes->count == ATTRIBUTE_MAX ||
        strlen(property->name) > ATTRIBUTE_NAME_MAX)
        return false;
    struct attribute *attribute = &attributes->list[attributes->count++];
    *attribute = (struct attribute){.type = property->type, .offset = attributes->stride};
    memcpy(attribute->name, property->name, strlen(property->name) + 1);
    attributes->stride += scalar_size(property->type);
    return true;
}

/* Fills role and attributes from the element "vertex". */
static enum status plan_vertices(struct ply *ply, const char *name)
{
    static const char *const axes[] = {"x", "y", "z"};
    const struct ply_element *vertex = ply_find_element(&ply->header, "vertex");
    if (!vertex)
        return fail(ply->ctx, STATUS_BAD_INPUT, "%s: the header has no element \"vertex\"", name);
    if (vertex->count > UINT32_MAX - 1)
        return fail(ply->ctx, STATUS_BAD_INPUT,
                    "%s: %llu vertices; the most that a mesh can have is 4294967294", name,
                    (unsigned long long)vertex->count);
    for (unsigned axis = 0; axis < 3; axis++) {
        const struct ply_property *found = ply_find_property(&ply->header, vertex, axes[axis]);
        if (!found || found->is_list)
            return fail(ply->ctx, STATUS_BAD_INPUT,
                        "%s: element \"vertex\" has no scalar property \"%s\"", name, axes[axis]);
    }
    char dropped[256] = "";
    for (uint32_t i = 0; i < vertex->property_count; i++) {
        const struct ply_property *property = &ply->header.properties[vertex->first_property + i];
        bool is_axis = property->name[0] >= 'x' && property->name[0] <= 'z' && !property->name[1];
        if (is_axis) {
            ply->role[i] = (int16_t)(property->name[0] - 'x');
        } else if (add_attribute(&ply->attributes, property)) {
            ply->role[i] = (int16_t)(PLY_FIRST_ATTRIBUTE + ply->attributes.count - 1);
        } else {
            ply->role[i] = PLY_DROPPED;
            list_name(dropped, sizeof dropped, property->name);
        }
    }
    if (dropped[0])
        tell(ply->ctx, MESSAGE_NOTE, "%s: vertex properties dropped: %s", name, dropped);
    return STATUS_OK;
}

static bool is_face_element(const struct ply_element *element)
{
    return strcmp(element->name, "face") == 0 || strcmp(element->name, "tristrips") == 0;
}

/* Which property of the element lists the corners; -1 if none does. */
static int32_t find_index_list(const struct ply *ply, const struct ply_element *element)
{
    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct ply_property *property = &ply->header.properties[element->first_property + i];
        if (property->is_list && property->type < SCALAR_FLOAT32 &&
            (strcmp(property->name, "vertex_indices") == 0 ||
             strcmp(property->name, "vertex_index") == 0))
            return (int32_t)i;
    }
    return -1;
}

/* Says what will not be read, and that faces have their list. */
static enum status plan_others(struct ply *ply, const char *name)
{
    char elements[256] = "", properties[256] = "";
    for (uint32_t e = 0; e < ply->header.element_count; e++) {
        const struct ply_element *element = &ply->header.elements[e];
        if (element->count == 0 || strcmp(element->name, "vertex") == 0)
            continue;
        if (!is_face_element(element)) {
            list_name(elements, sizeof elements, element->name);
            continue;
        }
        int32_t list = find_index_list(ply, element);
        if (list < 0)
            return fail(ply->ctx, STATUS_BAD_INPUT,
                        "%s: element \"%s\" has no list of integers \"vertex_indices\"", name,
                        element->name);
        for (uint32_t i = 0; i < element->property_count; i++)
            if ((int32_t)i != list)
                list_name(properties, sizeof properties,
                          ply->header.properties[element->first_property + i].name);
    }
    if (elements[0])
        tell(ply->ctx, MESSAGE_NOTE, "%s: elements dropped: %s", name, elements);
    if (properties[0])
        tell(ply->ctx, MESSAGE_NOTE, "%s: face properties dropped: %s", name, properties);
    return STATUS_OK;
}

/* ---- reading ---- */

static enum status read_element(struct ply *ply, const struct ply_element *element)
{
    ply->element = element;
    ply->row = 0;
    ply->index_list = is_face_element(element) ? find_index_list(ply, element) : -1;
    if (element->count == 0)
        return STATUS_OK;
    const bool has_vertices = strcmp(element->name, "vertex") == 0;
    if ((has_vertices || strcmp(element->name, "face") == 0) && ply_rows_are_lines(ply))
        return ply_read_lines(ply);
    if (has_vertices)
        return ply_vertices_are_plain(ply) ? ply_read_plain_vertices(ply)
                                           : ply_read_vertices(ply, element->count);
    if (strcmp(element->name, "face") == 0)
        return ply_faces_are_plain(ply) ? ply_read_plain_faces(ply)
                                        : ply_read_faces(ply, element->count);
    if (strcmp(element->name, "tristrips") == 0)
        return ply_read_strips(ply);
    return ply_skip_rows(ply);
}

static enum status look_behind(struct ply *ply)
{
    bool more;
    enum status status = STATUS_OK;
    if (ply->header.format == PLY_ASCII) {
        status = text_skip(&ply->text, &more);
    } else {
        if (text_available(&ply->text) == 0 && !ply->text.is_last)
            status = text_refill(&ply->text, 1);
        more = text_available(&ply->text) > 0;
    }
    if (status == STATUS_OK && more)
        tell(ply->ctx, MESSAGE_WARNING, "%s: what follows the last element is ignored",
             ply->batch.name);
    return status;
}

static uint64_t count_of(const struct ply *ply, const char *name)
{
    const struct ply_element *element = ply_find_element(&ply->header, name);
    return element ? element->count : 0;
}

static enum status read_all(struct ply *ply, struct instream *stream,
                            const struct import_sink *sink)
{
    const char *name = instream_name(stream);
    enum status status = text_open(&ply->text, ply->ctx, stream, 0);
    if (status == STATUS_OK)
        status = ply_header_read(&ply->text, &ply->header);
    if (status == STATUS_OK)
        status = plan_vertices(ply, name);
    if (status == STATUS_OK)
        status = plan_others(ply, name);
    if (status == STATUS_OK)
        status = batch_open(&ply->batch, ply->ctx, sink, name, &ply->attributes, false,
                            count_of(ply, "vertex"), count_of(ply, "face"));
    for (uint32_t e = 0; status == STATUS_OK && e < ply->header.element_count; e++)
        status = read_element(ply, &ply->header.elements[e]);
    if (status == STATUS_OK)
        status = batch_finish(&ply->batch);
    return status == STATUS_OK ? look_behind(ply) : status;
}

enum status import_ply(struct context *ctx, struct instream *stream, const struct import_sink *sink)
{
    struct ply *ply;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *ply, &ply);
    if (status != STATUS_OK)
        return status;
    ply->ctx = ctx;
    status = read_all(ply, stream, sink);
    text_close(&ply->text);
    batch_close(&ply->batch);
    ply_header_clear(ctx, &ply->header);
    memory_release(ctx, &ply, 1, sizeof *ply);
    return status;
}
