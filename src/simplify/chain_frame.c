/*
 * The info section, field by field: neither the layout of a struct nor the machine's byte order
 * reaches the file.
 */
#include "simplify/chain_frame.h"

#include <math.h>
#include <string.h>

#include "base/bytes.h"
#include "mesh/store.h"

/* One list of the fields serves both ways, so that writer and reader can't differ. */
struct fields {
    unsigned char *at;
    bool decodes;
};

static void field_u32(struct fields *fields, uint32_t *value)
{
    if (fields->decodes)
        *value = load_u32(fields->at);
    else
        store_u32(fields->at, *value);
    fields->at += 4;
}

static void field_u64(struct fields *fields, uint64_t *value)
{
    if (fields->decodes)
        *value = load_u64(fields->at);
    else
        store_u64(fields->at, *value);
    fields->at += 8;
}

static void field_f64(struct fields *fields, double *values, unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        if (fields->decodes)
            values[i] = load_f64(fields->at);
        else
            store_f64(fields->at, values[i]);
        fields->at += 8;
    }
}

static void field_topology(struct fields *fields, struct topology *topology)
{
    uint64_t euler = (uint64_t)topology->euler;
    field_u64(fields, &topology->vertices);
    field_u64(fields, &topology->edges);
    field_u64(fields, &topology->faces);
    field_u64(fields, &topology->border_edges);
    field_u64(fields, &topology->border_loops);
    field_u64(fields, &topology->components);
    field_u64(fields, &euler);
    field_u64(fields, &topology->floor);
    topology->euler = (int64_t)euler;
}

/* CHAIN_INFO_FIXED bytes. */
static void all_fields(struct fields *fields, struct chain_info *info)
{
    uint32_t is_float32 = info->is_float32;
    field_u32(fields, &info->slab_count);
    field_u32(fields, &is_float32);
    field_u32(fields, &info->store_crc);
    field_u32(fields, &info->mode);
    field_u32(fields, &info->effort);
    field_u32(fields, &info->target_kind);
    field_u32(fields, &info->target_count);
    field_u32(fields, &info->options.smoothings);
    field_u32(fields, &info->options.most_faces);
    field_u32(fields, &info->attributes.count);
    field_topology(fields, &info->topology);
    field_f64(fields, info->origin, 3);
    field_f64(fields, info->box_low, 3);
    field_f64(fields, info->box_high, 3);
    field_f64(fields, &info->mean_edge, 1);
    field_f64(fields, &info->noise, 1);
    field_f64(fields, &info->area, 1);
    field_f64(fields, info->options.patch_cosine, 2);
    field_f64(fields, info->options.face_cosine, 2);
    field_f64(fields, &info->options.chain_tolerance, 1);
    field_f64(fields, &info->tolerance, 1);
    field_f64(fields, info->targets, 16);
    field_u64(fields, &info->patches);
    field_u64(fields, &info->chains);
    field_u64(fields, &info->seam_chains);
    field_u64(fields, &info->junctions);
    field_u64(fields, &info->chain_vertices);
    field_u64(fields, &info->most_faces);
    info->is_float32 = is_float32 == 1;
    if (fields->decodes && is_float32 > 1)
        info->slab_count = UINT32_MAX; /* refused below */
}

size_t chain_info_encode(const struct chain_info *info, unsigned char *to)
{
    struct chain_info copy = *info;
    struct fields fields = {.at = to};
    all_fields(&fields, &copy);
    for (uint32_t i = 0; i < info->attributes.count; i++) {
        const struct attribute *attribute = info->attributes.list + i;
        memset(fields.at, 0, ATTRIBUTE_NAME_MAX + 1);
        memcpy(fields.at, attribute->name, strlen(attribute->name));
        store_u32(fields.at + 64, (uint32_t)attribute->type);
        store_u32(fields.at + 68, attribute->offset);
        fields.at += CHAIN_INFO_ATTRIBUTE;
    }
    return (size_t)(fields.at - to);
}

static bool decode_attributes(const unsigned char *from, struct attributes *attributes)
{
    uint64_t offset = 0;
    for (uint32_t i = 0; i < attributes->count; i++) {
        struct attribute *attribute = attributes->list + i;
        memcpy(attribute->name, from, ATTRIBUTE_NAME_MAX + 1);
        size_t length = strnlen(attribute->name, ATTRIBUTE_NAME_MAX + 1);
        for (size_t j = 0; j < ATTRIBUTE_NAME_MAX + 1; j++) {
            unsigned char byte = (unsigned char)attribute->name[j];
            /* The name goes into the header of a PLY: no blanks, no line ends. */
            if (j < length ? byte <= ' ' || byte == 127 : byte != 0)
                return false;
        }
        uint32_t type = load_u32(from + 64);
        attribute->offset = load_u32(from + 68);
        if (length == 0 || length > ATTRIBUTE_NAME_MAX || type > SCALAR_FLOAT64 ||
            attribute->offset != offset)
            return false;
        attribute->type = (enum scalar_type)type;
        offset += scalar_size(attribute->type);
        from += CHAIN_INFO_ATTRIBUTE;
    }
    attributes->stride = (uint32_t)offset;
    return true;
}

static bool all_finite(const double *values, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        if (!isfinite(values[i]))
            return false;
    return true;
}

static bool is_cosine(double value)
{
    return value >= -1 && value <= 1;
}

static bool options_are_sound(const struct patch_options *options)
{
    for (unsigned i = 0; i < 2; i++)
        if (!is_cosine(options->patch_cosine[i]) || !is_cosine(options->face_cosine[i]))
            return false;
    return options->most_faces >= 1 && options->most_faces <= PATCH_FACES_MAX &&
           options->smoothings <= SMOOTHINGS_MAX && isfinite(options->chain_tolerance) &&
           options->chain_tolerance >= 0;
}

const char *chain_info_decode(const unsigned char *from, size_t size, struct chain_info *info)
{
    memset(info, 0, sizeof *info);
    if (size < CHAIN_INFO_FIXED)
        return "it is too short";
    struct fields fields = {.at = (unsigned char *)(uintptr_t)from, .decodes = true};
    all_fields(&fields, info);
    if (info->attributes.count > ATTRIBUTE_MAX ||
        size != CHAIN_INFO_FIXED + (size_t)info->attributes.count * CHAIN_INFO_ATTRIBUTE)
        return "its size does not fit its number of attributes";
    if (!decode_attributes(from + CHAIN_INFO_FIXED, &info->attributes))
        return "an attribute is not sound";
    if (info->slab_count == UINT32_MAX || info->slab_count > info->topology.faces)
        return "the number of slabs is out of range";
    if (info->mode > 1 || info->effort < 1 || info->effort > 3 || info->target_kind > 2 ||
        info->target_count > sizeof info->targets / sizeof *info->targets)
        return "the target is not sound";
    if (!options_are_sound(&info->options) || !isfinite(info->tolerance) || info->tolerance < 0)
        return "the patch options are not sound";
    if (!all_finite(info->origin, 3) || !all_finite(info->box_low, 3) ||
        !all_finite(info->box_high, 3) || !all_finite(info->targets, 16) ||
        !isfinite(info->mean_edge) || !isfinite(info->noise) || !isfinite(info->area))
        return "a number is not finite";
    for (unsigned i = 0; i < 3; i++)
        if (info->box_low[i] > info->box_high[i] || (info->is_float32 && info->origin[i] != 0))
            return "the box or the origin is impossible";
    /* A slab has SLAB_FACES_MAX faces at most: what is claimed of the whole is bounded by what is
     * there. */
    if (info->topology.faces > UINT32_MAX || info->topology.vertices > UINT32_MAX ||
        info->topology.faces > (uint64_t)info->slab_count * SLAB_FACES_MAX ||
        info->patches > info->topology.faces || info->most_faces > info->topology.faces ||
        info->chain_vertices > info->topology.vertices || info->junctions > info->chain_vertices ||
        info->seam_chains > info->chains)
        return "the counts contradict each other";
    return NULL;
}
