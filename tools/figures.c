/*
 * One place for what a count is called, in words and in JSON, so that `info`, the report of a run
 * and the JSON of both agree.
 */
#include "figures.h"

#include <math.h>
#include <string.h>

#include "values.h"

/* ---- JSON ---- */

void set_json(json_t *object, const char *key, json_t *value)
{
    (void)json_object_set_new(object, key, value ? value : json_null());
}

void set_count(json_t *object, const char *key, uint64_t count)
{
    set_json(object, key, json_integer((json_int_t)count));
}

void set_real(json_t *object, const char *key, double number)
{
    set_json(object, key, isfinite(number) ? json_real(number) : json_null());
}

void set_text(json_t *object, const char *key, const char *text)
{
    /* A file name need not be UTF-8, which is all that JSON can hold. */
    json_t *value = text ? json_string(text) : json_null();
    set_json(object, key, value ? value : json_string("(not UTF-8)"));
}

void set_truth(json_t *object, const char *key, int truth)
{
    set_json(object, key, json_boolean(truth));
}

static void set_reals(json_t *object, const char *key, const double *numbers, size_t count)
{
    json_t *list = json_array();
    for (size_t i = 0; i < count; i++)
        (void)json_array_append_new(list,
                                    isfinite(numbers[i]) ? json_real(numbers[i]) : json_null());
    set_json(object, key, list);
}

/* The names of spbm_cleaning's fields, for JSON and for people. */
struct cleaning_row {
    size_t offset;
    const char *key;
    const char *one, *many; /* NULL: not said to people as something that was cleaned */
};

#define CLEANING(field, one, many) \
    { \
        offsetof(spbm_cleaning, field), #field, one, many \
    }

static const struct cleaning_row cleaning_rows[] = {
    CLEANING(input_vertices, NULL, NULL),
    CLEANING(input_faces, NULL, NULL),
    CLEANING(triangulated_faces, "triangle made of a polygon", "triangles made of polygons"),
    CLEANING(welded_vertices, "coincident vertex merged", "coincident vertices merged"),
    CLEANING(unreferenced_vertices, "vertex without a face dropped",
             "vertices without a face dropped"),
    CLEANING(degenerate_faces, "degenerate face dropped", "degenerate faces dropped"),
    CLEANING(duplicate_faces, "duplicate face dropped", "duplicate faces dropped"),
    CLEANING(nonmanifold_edges, "edge of more than two faces separated",
             "edges of more than two faces separated"),
    CLEANING(nonmanifold_vertices, "vertex where surfaces touch separated",
             "vertices where surfaces touch separated"),
    CLEANING(vertices_added, "vertex added by separating", "vertices added by separating"),
    CLEANING(flipped_faces, "face turned round to agree with its neighbours",
             "faces turned round to agree with their neighbours"),
    CLEANING(nonorientable_components, "component is not orientable and was cut",
             "components are not orientable and were cut"),
    CLEANING(cut_edges, "edge cut because the surface is not orientable",
             "edges cut because the surface is not orientable"),
    CLEANING(zero_area_faces, "face has no area (kept)", "faces have no area (kept)"),
    CLEANING(hilbert_ordered, NULL, NULL),
};

enum { CLEANING_COUNT = sizeof cleaning_rows / sizeof cleaning_rows[0] };

static uint64_t cleaning_count(const spbm_cleaning *cleaning, const struct cleaning_row *row)
{
    uint64_t count;
    memcpy(&count, (const char *)cleaning + row->offset, sizeof count);
    return count;
}

static json_t *json_of_topology(const spbm_topology *topology)
{
    json_t *object = json_object();
    set_count(object, "vertices", topology->vertices);
    set_count(object, "edges", topology->edges);
    set_count(object, "faces", topology->faces);
    set_count(object, "border_edges", topology->border_edges);
    set_count(object, "border_loops", topology->border_loops);
    set_count(object, "components", topology->components);
    set_json(object, "euler", json_integer(topology->euler));
    set_count(object, "floor", topology->floor);
    return object;
}

json_t *json_of_store(const spbm_store_figures *store)
{
    json_t *object = json_object(), *cleaning = json_object(), *attributes = json_array();
    set_json(object, "topology", json_of_topology(&store->topology));
    for (size_t i = 0; i < CLEANING_COUNT; i++)
        set_count(cleaning, cleaning_rows[i].key,
                  cleaning_count(&store->cleaning, &cleaning_rows[i]));
    set_json(object, "cleaning", cleaning);
    set_reals(object, "box_low", store->box_low, 3);
    set_reals(object, "box_high", store->box_high, 3);
    set_real(object, "diagonal", store->diagonal);
    set_reals(object, "origin", store->origin, 3);
    set_truth(object, "is_float32", store->is_float32);
    set_truth(object, "welded", store->welded);
    set_real(object, "mean_edge", store->mean_edge);
    set_real(object, "noise", store->noise);
    set_real(object, "area", store->area);
    set_count(object, "slabs", store->slabs);
    for (uint32_t i = 0; i < store->attribute_count && i < SPBM_ATTRIBUTES_MAX; i++) {
        json_t *attribute = json_object();
        set_text(attribute, "name", store->attributes[i].name);
        set_text(attribute, "type", store->attributes[i].type);
        (void)json_array_append_new(attributes, attribute);
    }
    set_json(object, "attributes", attributes);
    set_text(object, "input_name", store->input_name);
    set_count(object, "input_size", store->input_size);
    set_count(object, "input_crc32", store->input_digest);
    return object;
}

json_t *json_of_chains(const spbm_chain_figures *chains)
{
    static const char *const kinds[] = {"faces", "ratio", "error"};
    json_t *object = json_object(), *made_for = json_object();
    set_json(object, "topology", json_of_topology(&chains->topology));
    set_count(object, "patches", chains->patches);
    set_count(object, "chains", chains->chains);
    set_count(object, "seam_chains", chains->seam_chains);
    set_count(object, "junctions", chains->junctions);
    set_count(object, "chain_vertices", chains->chain_vertices);
    set_count(object, "most_faces", chains->most_faces);
    set_reals(object, "patch_angle", chains->patch_angle, 2);
    set_reals(object, "face_angle", chains->face_angle, 2);
    set_count(object, "smoothings", chains->smoothings);
    set_real(object, "chain_tolerance", chains->tolerance);
    set_real(object, "diagonal", chains->diagonal);
    set_real(object, "mean_edge", chains->mean_edge);
    set_real(object, "noise", chains->noise);
    set_real(object, "area", chains->area);
    set_count(object, "slabs", chains->slabs);
    set_text(made_for, "mode", chains->mode == SPBM_CLASSIC ? "classic" : "collapse");
    set_count(made_for, "effort", chains->effort);
    set_text(made_for, "kind",
             kinds[chains->target_kind <= SPBM_BY_ERROR ? chains->target_kind : 0]);
    set_reals(made_for, "values", chains->targets,
              chains->target_count <= SPBM_TARGETS_MAX ? chains->target_count : 0);
    set_json(object, "made_for", made_for);
    return object;
}

json_t *json_of_quality(const spbm_quality *quality)
{
    json_t *object = json_object();
    set_json(object, "topology", json_of_topology(&quality->topology));
    set_truth(object, "is_manifold", quality->is_manifold);
    set_json(object, "genus", json_integer(quality->genus));
    set_count(object, "nonmanifold_edges", quality->nonmanifold_edges);
    set_count(object, "nonmanifold_vertices", quality->nonmanifold_vertices);
    set_count(object, "misoriented_edges", quality->misoriented_edges);
    set_count(object, "degenerate_faces", quality->degenerate_faces);
    set_count(object, "duplicate_faces", quality->duplicate_faces);
    set_count(object, "zero_area_faces", quality->zero_area_faces);
    set_count(object, "unreferenced_vertices", quality->unreferenced_vertices);
    set_count(object, "coincident_vertices", quality->coincident_vertices);
    set_reals(object, "box_low", quality->box_low, 3);
    set_reals(object, "box_high", quality->box_high, 3);
    set_real(object, "diagonal", quality->diagonal);
    set_real(object, "area", quality->area);
    set_real(object, "volume", quality->volume);
    return object;
}

json_t *json_of_deviation(const spbm_deviation *deviation)
{
    json_t *object = json_object();
    set_real(object, "largest", deviation->largest);
    set_real(object, "mean", deviation->mean);
    set_real(object, "rms", deviation->rms);
    set_count(object, "samples", deviation->samples);
    return object;
}

/* ---- words ---- */

static void write_count(FILE *file, const char *key, uint64_t count)
{
    fprintf(file, "%-22s %s\n", key, count_text(count).s);
}

static void write_count_unless_zero(FILE *file, const char *key, uint64_t count)
{
    if (count > 0)
        write_count(file, key, count);
}

static void write_length(FILE *file, const char *key, double length)
{
    fprintf(file, "%-22s %s\n", key, length_text(length).s);
}

static void write_box(FILE *file, const double low[3], const double high[3], double diagonal)
{
    fprintf(file, "%-22s %.7g %.7g %.7g to %.7g %.7g %.7g\n", "box", low[0], low[1], low[2],
            high[0], high[1], high[2]);
    write_length(file, "diagonal", diagonal);
}

void write_summary(FILE *file, const spbm_topology *topology)
{
    fprintf(file, "%s, %s, %s, ", counted_text(topology->faces, "face", "faces").s,
            counted_text(topology->vertices, "vertex", "vertices").s,
            counted_text(topology->components, "component", "components").s);
    if (topology->border_edges == 0)
        fputs("closed", file);
    else
        fprintf(file, "%s", counted_text(topology->border_loops, "border loop", "border loops").s);
}

static void write_topology(FILE *file, const spbm_topology *topology)
{
    write_count(file, "faces", topology->faces);
    write_count(file, "vertices", topology->vertices);
    write_count(file, "edges", topology->edges);
    write_count(file, "components", topology->components);
    if (topology->border_edges == 0) {
        fprintf(file, "%-22s none (closed)\n", "border");
    } else {
        fprintf(file, "%-22s %s in %s\n", "border",
                counted_text(topology->border_edges, "edge", "edges").s,
                counted_text(topology->border_loops, "loop", "loops").s);
    }
    fprintf(file, "%-22s %lld\n", "Euler characteristic", (long long)topology->euler);
}

static void write_floor(FILE *file, const spbm_topology *topology)
{
    if (topology->floor > 0)
        fprintf(file, "%-22s %s (fewest that this topology allows)\n", "floor",
                counted_text(topology->floor, "face", "faces").s);
}

void write_cleaning(FILE *file, const char *indent, const spbm_cleaning *cleaning)
{
    for (size_t i = 0; i < CLEANING_COUNT; i++) {
        const struct cleaning_row *row = &cleaning_rows[i];
        uint64_t count = cleaning_count(cleaning, row);
        if (row->one && count > 0)
            fprintf(file, "%s%s %s\n", indent, count_text(count).s,
                    count == 1 ? row->one : row->many);
    }
}

void write_store(FILE *file, const spbm_store_figures *store)
{
    write_topology(file, &store->topology);
    write_floor(file, &store->topology);
    write_box(file, store->box_low, store->box_high, store->diagonal);
    write_length(file, "area", store->area);
    fprintf(file, "%-22s %s\n", "mean edge", length_text(store->mean_edge).s);
    fprintf(file, "%-22s %s of the mean edge (estimated)\n", "noise", percent_text(store->noise).s);
    fprintf(file, "%-22s %s\n", "coordinates",
            store->is_float32 ? "float32, as read" : "rounded to the store's grid");
    fprintf(file, "%-22s", "attributes");
    for (uint32_t i = 0; i < store->attribute_count && i < SPBM_ATTRIBUTES_MAX; i++)
        fprintf(file, "%s %s (%s)", i ? "," : "", store->attributes[i].name,
                store->attributes[i].type);
    fputs(store->attribute_count ? "\n" : " none\n", file);
    write_count(file, "slabs", store->slabs);
    fprintf(file, "%-22s %s, %s, CRC-32 %08x%s\n", "made from", store->input_name,
            size_text(store->input_size).s, store->input_digest, store->welded ? ", welded" : "");
    fprintf(file, "%-22s %s, %s\n", "as read",
            counted_text(store->cleaning.input_faces, "face", "faces").s,
            counted_text(store->cleaning.input_vertices, "vertex", "vertices").s);
    write_cleaning(file, "                       ", &store->cleaning);
    if (store->cleaning.hilbert_ordered)
        fputs("                       faces put in an order local in space\n", file);
}

void write_chains(FILE *file, const spbm_chain_figures *chains)
{
    static const char *const kinds[] = {"faces", "ratio", "error"};
    write_count(file, "patches", chains->patches);
    fprintf(file, "%-22s %s, %s of them between slabs\n", "chains", count_text(chains->chains).s,
            count_text(chains->seam_chains).s);
    write_count(file, "junctions", chains->junctions);
    write_count(file, "chain vertices", chains->chain_vertices);
    write_count(file, "most faces of a level", chains->most_faces);
    write_floor(file, &chains->topology);
    fprintf(file, "%-22s %g,%g degrees\n", "patch angle", chains->patch_angle[0],
            chains->patch_angle[1]);
    fprintf(file, "%-22s %g,%g degrees\n", "face angle", chains->face_angle[0],
            chains->face_angle[1]);
    write_count(file, "normals smoothed", chains->smoothings);
    if (chains->tolerance > 0)
        fprintf(file, "%-22s %s (%s of the diagonal)\n", "chain tolerance",
                length_text(chains->tolerance).s,
                percent_text(chains->diagonal > 0 ? chains->tolerance / chains->diagonal : 0).s);
    else
        fprintf(file, "%-22s 0 (all chain vertices are kept)\n", "chain tolerance");
    fprintf(file, "%-22s mode %s, effort %u, %s", "made for",
            chains->mode == SPBM_CLASSIC ? "classic" : "collapse", chains->effort,
            kinds[chains->target_kind <= SPBM_BY_ERROR ? chains->target_kind : 0]);
    for (uint32_t i = 0; i < chains->target_count && i < SPBM_TARGETS_MAX; i++)
        fprintf(file, "%s%.10g", i ? ", " : " ", chains->targets[i]);
    fputc('\n', file);
    fputs("\nof the store:\n", file);
    write_topology(file, &chains->topology);
    write_box(file, chains->box_low, chains->box_high, chains->diagonal);
    write_length(file, "area", chains->area);
    write_length(file, "mean edge", chains->mean_edge);
    fprintf(file, "%-22s %s of the mean edge (estimated)\n", "noise",
            percent_text(chains->noise).s);
    write_count(file, "slabs", chains->slabs);
    write_count(file, "attributes", chains->attribute_count);
}

void write_quality(FILE *file, const spbm_quality *quality)
{
    write_topology(file, &quality->topology);
    fprintf(file, "%-22s %lld\n", "genus", (long long)quality->genus);
    fprintf(file, "%-22s %s\n", "manifold", quality->is_manifold ? "yes" : "no");
    write_count_unless_zero(file, "edges of 3+ faces", quality->nonmanifold_edges);
    write_count_unless_zero(file, "touching vertices", quality->nonmanifold_vertices);
    write_count_unless_zero(file, "misoriented edges", quality->misoriented_edges);
    write_count_unless_zero(file, "degenerate faces", quality->degenerate_faces);
    write_count_unless_zero(file, "duplicate faces", quality->duplicate_faces);
    write_count_unless_zero(file, "zero-area faces", quality->zero_area_faces);
    write_count_unless_zero(file, "unreferenced vertices", quality->unreferenced_vertices);
    write_count_unless_zero(file, "coincident vertices", quality->coincident_vertices);
    write_floor(file, &quality->topology);
    write_box(file, quality->box_low, quality->box_high, quality->diagonal);
    write_length(file, "area", quality->area);
    if (quality->topology.border_edges == 0)
        write_length(file, "volume", quality->volume);
}
