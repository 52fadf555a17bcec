/*
 * The bytes of the small sections: written and read by one list of fields each, so that writer and
 * reader can't drift apart.
 */
#include "mesh/store_layout.h"

#include <math.h>
#include <stddef.h>

#include "base/bytes.h"

static uint64_t align_piece(uint64_t offset)
{
    return (offset + STORE_PIECE_ALIGN - 1) & ~(uint64_t)(STORE_PIECE_ALIGN - 1);
}

void slab_layout_find(const struct slab_entry *entry, uint32_t stride, struct slab_layout *layout)
{
    const uint64_t faces = entry->face_count, own = entry->vertex_count;
    const uint64_t foreign = entry->foreign_count;
    layout->faces = 0;
    layout->neighbours = align_piece(layout->faces + 12 * faces);
    layout->mates = align_piece(layout->neighbours + 12 * faces);
    layout->positions = align_piece(layout->mates + faces);
    layout->foreign = align_piece(layout->positions + 12 * own);
    layout->foreign_positions = align_piece(layout->foreign + 4 * foreign);
    layout->records = align_piece(layout->foreign_positions + 12 * foreign);
    layout->size = align_piece(layout->records + own * stride);
}

void slab_entry_encode(const struct slab_entry *entry, unsigned char bytes[STORE_SLAB_ENTRY_SIZE])
{
    store_u64(bytes, entry->offset);
    store_u32(bytes + 8, entry->vertex_first);
    store_u32(bytes + 12, entry->vertex_count);
    store_u32(bytes + 16, entry->foreign_count);
    store_u32(bytes + 20, entry->face_count);
    store_u32(bytes + 24, entry->crc);
    store_u32(bytes + 28, 0);
}

bool slab_entry_decode(const unsigned char bytes[STORE_SLAB_ENTRY_SIZE], struct slab_entry *entry)
{
    entry->offset = load_u64(bytes);
    entry->vertex_first = load_u32(bytes + 8);
    entry->vertex_count = load_u32(bytes + 12);
    entry->foreign_count = load_u32(bytes + 16);
    entry->face_count = load_u32(bytes + 20);
    entry->crc = load_u32(bytes + 24);
    return load_u32(bytes + 28) == 0;
}

/* ---- info ---- */

enum field_type { FIELD_U32, FIELD_U64, FIELD_F64 };

struct field {
    uint16_t at;     /* in the section */
    uint16_t count;  /* values in a row */
    uint16_t offset; /* in struct store_info */
    uint16_t type;
};

#define FIELD(at, count, member, type) \
    { \
        at, count, (uint16_t)offsetof(struct store_info, member), type \
    }

static const struct field fields[] = {
    FIELD(0, 1, slab_shift, FIELD_U32),    FIELD(4, 1, slab_count, FIELD_U32),
    FIELD(12, 1, input_digest, FIELD_U32), FIELD(16, 1, input_size, FIELD_U64),
    FIELD(24, 8, topology, FIELD_U64),     FIELD(88, 15, cleaning, FIELD_U64),
    FIELD(208, 3, origin, FIELD_F64),      FIELD(232, 3, box_low, FIELD_F64),
    FIELD(256, 3, box_high, FIELD_F64),    FIELD(280, 1, mean_edge, FIELD_F64),
    FIELD(288, 1, noise, FIELD_F64),       FIELD(296, 1, area, FIELD_F64),
};

enum { AT_FLAGS = 8, AT_NAME = 304, FLAG_FLOAT32 = 1, FLAG_WELDED = 2 };

/* The two structs of counts are arrays of 64 bits in the order of the format. */
_Static_assert(sizeof(struct topology) == 64, "topology has 8 counts");
_Static_assert(sizeof(struct cleaning) == 120, "cleaning has 15 counts");
_Static_assert(AT_NAME + sizeof(((struct store_info *)0)->input_name) == STORE_INFO_SIZE,
               "the name ends the section");

static size_t field_size(const struct field *field)
{
    return field->type == FIELD_U32 ? 4 : 8;
}

void store_info_encode(const struct store_info *info, unsigned char bytes[STORE_INFO_SIZE])
{
    memset(bytes, 0, STORE_INFO_SIZE);
    for (size_t i = 0; i < sizeof fields / sizeof *fields; i++) {
        const struct field *field = &fields[i];
        const size_t size = field_size(field);
        for (unsigned j = 0; j < field->count; j++) {
            const unsigned char *from = (const unsigned char *)info + field->offset + j * size;
            unsigned char *to = bytes + field->at + j * size;
            if (size == 4) {
                uint32_t value;
                memcpy(&value, from, sizeof value);
                store_u32(to, value);
            } else {
                uint64_t value; /* the bits of a double too */
                memcpy(&value, from, sizeof value);
                store_u64(to, value);
            }
        }
    }
    store_u32(bytes + AT_FLAGS,
              (info->is_float32 ? FLAG_FLOAT32 : 0u) | (info->welded ? FLAG_WELDED : 0u));
    memcpy(bytes + AT_NAME, info->input_name, sizeof info->input_name);
}

static const char *judge_info(const struct store_info *info)
{
    const struct topology *t = &info->topology;
    if (info->slab_shift < STORE_SHIFT_MIN || info->slab_shift > SLAB_SHIFT_MAX)
        return "the slab size is out of range";
    if (t->vertices < 3 || t->faces < 1 || t->vertices > UINT32_MAX - 1 ||
        t->faces > UINT32_MAX - 1 || t->vertices > 3 * t->faces)
        return "the counts of vertices and faces are impossible";
    if (info->slab_count != slabs_of(t->faces, info->slab_shift))
        return "the number of slabs does not fit the number of faces";
    if (t->border_edges > 3 * t->faces || t->edges > 3 * t->faces ||
        2 * t->edges != 3 * t->faces + t->border_edges ||
        t->euler != (int64_t)t->vertices - (int64_t)t->edges + (int64_t)t->faces ||
        t->components < 1 || t->components > t->faces || t->border_loops > t->border_edges)
        return "the topology contradicts itself";
    for (int i = 0; i < 3; i++) {
        if (!isfinite(info->origin[i]) || !isfinite(info->box_low[i]) ||
            !isfinite(info->box_high[i]) || info->box_low[i] > info->box_high[i])
            return "the bounding box is impossible";
        if (info->is_float32 && info->origin[i] != 0)
            return "the origin of float32 coordinates is not zero";
    }
    if (!(isfinite(info->mean_edge) && isfinite(info->noise) && isfinite(info->area)) ||
        info->mean_edge < 0 || info->noise < 0 || info->area < 0)
        return "a measure is impossible";
    return NULL;
}

const char *store_info_decode(const unsigned char bytes[STORE_INFO_SIZE], struct store_info *info)
{
    for (size_t i = 0; i < sizeof fields / sizeof *fields; i++) {
        const struct field *field = &fields[i];
        const size_t size = field_size(field);
        for (unsigned j = 0; j < field->count; j++) {
            unsigned char *to = (unsigned char *)info + field->offset + j * size;
            const unsigned char *from = bytes + field->at + j * size;
            if (size == 4) {
                uint32_t value = load_u32(from);
                memcpy(to, &value, sizeof value);
            } else {
                uint64_t value = load_u64(from);
                memcpy(to, &value, sizeof value);
            }
        }
    }
    uint32_t flags = load_u32(bytes + AT_FLAGS);
    info->is_float32 = flags & FLAG_FLOAT32;
    info->welded = flags & FLAG_WELDED;
    if (flags & ~(uint32_t)(FLAG_FLOAT32 | FLAG_WELDED))
        return "unknown flags are set";
    memcpy(info->input_name, bytes + AT_NAME, sizeof info->input_name);
    size_t length = strnlen(info->input_name, sizeof info->input_name);
    if (length == sizeof info->input_name)
        return "the input's name has no end";
    for (size_t i = length; i < sizeof info->input_name; i++) {
        if (info->input_name[i])
            return "there are bytes behind the input's name";
    }
    return judge_info(info);
}

/* ---- attributes ---- */

size_t store_attributes_size(const struct attributes *attributes)
{
    return 8 + (size_t)attributes->count * STORE_ATTRIBUTE_SIZE;
}

void store_attributes_encode(const struct attributes *attributes, unsigned char *bytes)
{
    memset(bytes, 0, store_attributes_size(attributes));
    store_u32(bytes, attributes->count);
    store_u32(bytes + 4, attributes->stride);
    for (uint32_t i = 0; i < attributes->count; i++) {
        unsigned char *to = bytes + 8 + (size_t)i * STORE_ATTRIBUTE_SIZE;
        const struct attribute *attribute = &attributes->list[i];
        memcpy(to, attribute->name, strnlen(attribute->name, ATTRIBUTE_NAME_MAX));
        store_u32(to + 64, attribute->type);
        store_u32(to + 68, attribute->offset);
    }
}

static const char *decode_attribute(const unsigned char *from, uint32_t offset,
                                    struct attribute *attribute)
{
    memcpy(attribute->name, from, sizeof attribute->name);
    size_t length = strnlen(attribute->name, sizeof attribute->name);
    if (length == 0 || length == sizeof attribute->name)
        return "an attribute has no name or one without end";
    for (size_t i = 0; i < sizeof attribute->name; i++) {
        unsigned char byte = (unsigned char)attribute->name[i];
        if (i < length ? byte <= ' ' || byte == 127 : byte != 0)
            return "an attribute's name has bytes that it can't have";
    }
    uint32_t type = load_u32(from + 64);
    if (type > SCALAR_FLOAT64)
        return "an attribute has an unknown type";
    attribute->type = (enum scalar_type)type;
    attribute->offset = load_u32(from + 68);
    return attribute->offset == offset ? NULL : "an attribute is out of place";
}

const char *store_attributes_decode(const unsigned char *bytes, size_t size,
                                    struct attributes *attributes)
{
    memset(attributes, 0, sizeof *attributes);
    if (size < 8)
        return "the attributes are cut off";
    uint32_t count = load_u32(bytes);
    if (count > ATTRIBUTE_MAX)
        return "there are too many attributes";
    if (size != 8 + (size_t)count * STORE_ATTRIBUTE_SIZE)
        return "the attributes' size does not fit their number";
    for (uint32_t i = 0; i < count; i++) {
        struct attribute *attribute = &attributes->list[i];
        const char *wrong = decode_attribute(bytes + 8 + (size_t)i * STORE_ATTRIBUTE_SIZE,
                                             attributes->stride, attribute);
        if (wrong)
            return wrong;
        attributes->stride += scalar_size(attribute->type);
    }
    attributes->count = count;
    return load_u32(bytes + 4) == attributes->stride ? NULL : "the attributes' stride is wrong";
}
