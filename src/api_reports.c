/*
 * The stages' reports as the public structs. These repeat the internal ones field by field, so that
 * a stage can change its own without breaking the programs that use the library.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "api_internal.h"

_Static_assert((int)SPBM_JOINS_MAX == (int)JOIN_STAGES_MAX, "stages of joining");

static double diagonal_of(const double low[3], const double high[3])
{
    double x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
    return sqrt(x * x + y * y + z * z);
}

static void copy_cleaning(spbm_cleaning *to, const struct cleaning *from)
{
    *to = (spbm_cleaning){
        .input_vertices = from->input_vertices,
        .input_faces = from->input_faces,
        .triangulated_faces = from->triangulated_faces,
        .welded_vertices = from->welded_vertices,
        .unreferenced_vertices = from->unreferenced_vertices,
        .degenerate_faces = from->degenerate_faces,
        .duplicate_faces = from->duplicate_faces,
        .nonmanifold_edges = from->nonmanifold_edges,
        .nonmanifold_vertices = from->nonmanifold_vertices,
        .vertices_added = from->vertices_added,
        .flipped_faces = from->flipped_faces,
        .cut_edges = from->cut_edges,
        .nonorientable_components = from->nonorientable_components,
        .zero_area_faces = from->zero_area_faces,
        .hilbert_ordered = from->hilbert_ordered,
    };
}

static void copy_topology(spbm_topology *to, const struct topology *from)
{
    *to = (spbm_topology){
        .vertices = from->vertices,
        .edges = from->edges,
        .faces = from->faces,
        .border_edges = from->border_edges,
        .border_loops = from->border_loops,
        .components = from->components,
        .euler = from->euler,
        .floor = from->floor,
    };
}

static const char *scalar_word(enum scalar_type type)
{
    static const char *const words[] = {"char", "uchar", "short", "ushort",
                                        "int",  "uint",  "float", "double"};
    return words[type];
}

struct clock clock_now(void)
{
    struct timespec wall, cpu;
    clock_gettime(CLOCK_MONOTONIC, &wall);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
    return (struct clock){(double)wall.tv_sec + 1e-9 * (double)wall.tv_nsec,
                          (double)cpu.tv_sec + 1e-9 * (double)cpu.tv_nsec};
}

spbm_stage stage_since(struct context *ctx, const char *name, struct clock *began)
{
    const struct clock then = *began, now = *began = clock_now();
    return (spbm_stage){.name = name,
                        .wall_seconds = now.wall - then.wall,
                        .cpu_seconds = now.cpu - then.cpu,
                        .memory_peak = atomic_load(&ctx->memory_peak),
                        .threads = ctx->threads};
}

void copy_store(spbm_store_figures *to, const struct store_info *from)
{
    memset(to, 0, sizeof *to);
    copy_cleaning(&to->cleaning, &from->cleaning);
    copy_topology(&to->topology, &from->topology);
    memcpy(to->box_low, from->box_low, sizeof to->box_low);
    memcpy(to->box_high, from->box_high, sizeof to->box_high);
    memcpy(to->origin, from->origin, sizeof to->origin);
    to->diagonal = diagonal_of(from->box_low, from->box_high);
    to->is_float32 = from->is_float32;
    to->welded = from->welded;
    to->mean_edge = from->mean_edge;
    to->noise = from->noise;
    to->area = from->area;
    to->slabs = from->slab_count;
    to->attribute_count = from->attributes.count;
    for (uint32_t i = 0; i < from->attributes.count; i++) {
        const struct attribute *attribute = &from->attributes.list[i];
        snprintf(to->attributes[i].name, sizeof to->attributes[i].name, "%s", attribute->name);
        snprintf(to->attributes[i].type, sizeof to->attributes[i].type, "%s",
                 scalar_word(attribute->type));
    }
    snprintf(to->input_name, sizeof to->input_name, "%s", from->input_name);
    to->input_size = from->input_size;
    to->input_digest = from->input_digest;
}

static double degrees(double cosine)
{
    double angle = acos(cosine > 1 ? 1 : cosine < -1 ? -1 : cosine) * (180.0 / 3.14159265358979324);
    return round(angle * 1e6) / 1e6; /* as it was given, not as the way to the cosine left it */
}

void copy_chains(spbm_chain_figures *to, const struct chain_info *from)
{
    memset(to, 0, sizeof *to);
    copy_topology(&to->topology, &from->topology);
    memcpy(to->box_low, from->box_low, sizeof to->box_low);
    memcpy(to->box_high, from->box_high, sizeof to->box_high);
    to->diagonal = diagonal_of(from->box_low, from->box_high);
    to->mean_edge = from->mean_edge;
    to->noise = from->noise;
    to->area = from->area;
    to->slabs = from->slab_count;
    to->attribute_count = from->attributes.count;
    to->patches = from->patches;
    to->chains = from->chains;
    to->seam_chains = from->seam_chains;
    to->junctions = from->junctions;
    to->chain_vertices = from->chain_vertices;
    to->most_faces = from->most_faces;
    to->tolerance = from->tolerance;
    for (unsigned i = 0; i < 2; i++) {
        to->patch_angle[i] = degrees(from->options.patch_cosine[i]);
        to->face_angle[i] = degrees(from->options.face_cosine[i]);
    }
    to->smoothings = from->options.smoothings;
    to->mode = (spbm_mode)from->mode;
    to->effort = from->effort;
    to->target_kind = (spbm_target_kind)from->target_kind;
    to->target_count = from->target_count;
    memcpy(to->targets, from->targets, sizeof to->targets);
}

void copy_levels(spbm_levels *to, const struct lod_report *from, const struct chain_info *chains)
{
    memset(to, 0, sizeof *to);
    to->count = from->level_count;
    for (uint32_t i = 0; i < from->level_count; i++) {
        const struct level *level = &from->levels[i];
        to->levels[i] = (spbm_level){
            .wanted_faces = level->wanted_faces,
            .wanted_error = level->wanted_error,
            .vertices = level->vertices,
            .faces = level->faces,
            .error = level->error,
            .stop = (spbm_stop)level->reason,
        };
    }
    to->small_faces = from->small_faces;
    to->join_count = from->join_count;
    for (uint32_t i = 0; i < from->join_count; i++)
        to->joins[i] = (spbm_join){.joins = from->joins[i].joins,
                                   .faces_in = from->joins[i].faces_in,
                                   .largest_in = from->joins[i].largest_in,
                                   .faces_out = from->joins[i].faces_out};
    to->diagonal = diagonal_of(chains->box_low, chains->box_high);
    to->floor = chains->topology.floor;
    to->original_faces = chains->topology.faces;
}

void copy_quality(spbm_quality *to, const struct quality *from, uint32_t attribute_count)
{
    memset(to, 0, sizeof *to);
    copy_topology(&to->topology, &from->topology);
    to->unreferenced_vertices = from->unreferenced_vertices;
    to->nonmanifold_edges = from->nonmanifold_edges;
    to->nonmanifold_vertices = from->nonmanifold_vertices;
    to->misoriented_edges = from->misoriented_edges;
    to->degenerate_faces = from->degenerate_faces;
    to->duplicate_faces = from->duplicate_faces;
    to->zero_area_faces = from->zero_area_faces;
    to->coincident_vertices = from->coincident_vertices;
    to->genus = from->genus;
    to->is_manifold = from->is_manifold;
    memcpy(to->box_low, from->box_low, sizeof to->box_low);
    memcpy(to->box_high, from->box_high, sizeof to->box_high);
    to->diagonal = diagonal_of(from->box_low, from->box_high);
    to->area = from->area;
    to->volume = from->volume;
    to->attribute_count = attribute_count;
}
