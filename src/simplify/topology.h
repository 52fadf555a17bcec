/*
 * Topology simplification (dissertation, chapter 5): small holes, bumps and cavities go, specks are
 * dropped, cracks are closed, and nothing else is touched (5.3, option 2).
 *
 * Features are found on the chain graph, where they cost what chains cost; the store is streamed by
 * slab to drop the faces of the walls, to add the fills and to copy all other faces as they are.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_H
#define SPBM_SIMPLIFY_TOPOLOGY_H

#include "mesh/export.h"
#include "mesh/store.h"

/* How large a loop is (5.3.3). */
enum loop_measure {
    LOOP_EXACT = 0, /* the largest distance of two of its vertices */
    LOOP_SAMPLED,   /* from a pair (convex loops) or a triple of vertices evenly spaced in index */
    LOOP_BOX,       /* the diagonal of its bounding box */
    LOOP_EXTENT     /* the largest distance of two vertices of the whole feature: long pins stay */
};

enum feature_kind {
    FEATURE_HOLE = 0,  /* several loops, empty inside: as many handles less as loops less one */
    FEATURE_CAVITY,    /* one loop, the wall goes into the solid */
    FEATURE_BUMP,      /* one loop, the wall rises from the solid */
    FEATURE_PIPE,      /* several loops, solid inside; only without keep_pipes */
    FEATURE_COMPONENT, /* a component of the mesh */
    FEATURE_CRACK,     /* a border loop */
    FEATURE_HANDLE,    /* a smooth handle or tunnel */
    FEATURE_KINDS
};

struct feature {
    enum feature_kind kind;
    uint32_t loops;  /* fills that it took */
    double size;     /* of its largest loop, as measured; of a component its box's diagonal */
    double place[3]; /* the middle of its largest loop, or of its box; model coordinates */
};

/* A size as the user gives it. */
struct length_option {
    double value;     /* 0: not asked for; negative: choose */
    bool is_relative; /* a fraction of the bounding box's diagonal */
};

struct topology_options {
    struct length_option max_feature; /* features all of whose loops are smaller go */
    enum loop_measure measure;
    double sharp_angle[2]; /* degrees: an edge is sharp between the two, by more than a tenth of a
                              degree; default 45, 180 */
    bool remove_pipes;     /* also what is solid between two loops */
    bool smooth_features;  /* also smooth handles and tunnels that are smaller than max_feature */
    struct length_option drop_components; /* whole components whose box has a smaller diagonal go */
    struct length_option close_cracks;    /* border loops that are smaller are filled */
    bool crack_inscribed;                 /* by the largest circle inside instead of the diameter */
    struct length_option zip_tolerance;   /* how far apart the two sides of a crack may lie */
    bool merge_coplanar;   /* planes are triangulated anew, by the fewest triangles */
    double coplanar_angle; /* degrees within which neighbours count as one plane; default 0.5 */
    struct export_options export;
};

void topology_defaults(struct topology_options *options);

/* Owned by the caller; release with topology_report_clear. */
struct topology_report {
    struct feature *features; /* what was removed, in the order of the patches */
    size_t feature_count, feature_capacity;
    uint64_t counts[FEATURE_KINDS];
    uint64_t blocked;         /* small features that stay, for no fill would leave a manifold */
    uint64_t zipped;          /* vertices merged or inserted along cracks */
    uint64_t dropped_faces;   /* of the store */
    uint64_t added_faces;     /* fills, and faces that zipping changed, which are dropped too */
    uint64_t vertices, faces; /* of the output */
};

void topology_report_clear(struct context *ctx, struct topology_report *report);

/*
 * Reads the store `store_path`, makes its chains in the file `chain_path` (scratch: the caller
 * removes it), and writes the mesh `output`. `report` is all zero before. The output is a manifold
 * whatever the input's features are; faces that are not part of a removed feature and, without
 * merge_coplanar, all vertices left are the store's, bit for bit.
 */
enum status topology_run(struct context *ctx, const char *store_path, const char *chain_path,
                         const char *output, const struct topology_options *options,
                         struct topology_report *report) MUST_CHECK;

/* The same, but the result is the mesh store `output`, that of a mesh file with the same content
 * (`import`: how to build it). *info (may be NULL) tells what is in it. */
enum status topology_rebuild(struct context *ctx, const char *store_path, const char *chain_path,
                             const char *output, const struct import_options *import,
                             const struct topology_options *options, struct topology_report *report,
                             struct store_info *info) MUST_CHECK;

#endif
