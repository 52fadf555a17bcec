/*
 * The mesh store: one file, mapped read-only, that holds a clean manifold mesh in an order local in
 * space, cut into slabs. store_format.md describes the bytes; mesh.h the
 * invariants. A reader asks for one slab at a time and gets everything it needs in one view.
 */
#ifndef SPBM_MESH_STORE_H
#define SPBM_MESH_STORE_H

#include "base/section_file.h"
#include "mesh/mesh.h"

/*
 * Slabs have 2^SLAB_SHIFT faces; a mesh of up to 2^SLAB_SHIFT_MAX is one. Smaller slabs take less
 * memory and stay in the processor's caches (with slabs of 2^18 faces, on a scan of a million,
 * patchify takes an eighth longer, and the run a quarter more memory), but the seams of a small
 * mesh are a large part of it. Constants of the format. Only bench/slabs.py builds with others, to
 * see what slabs cost.
 */
#ifndef SPBM_SLAB_SHIFT
#define SPBM_SLAB_SHIFT 16
#define SPBM_SLAB_SHIFT_MAX 18
#else
#define SPBM_SLAB_SHIFT_MAX SPBM_SLAB_SHIFT
#endif
enum {
    SLAB_SHIFT = SPBM_SLAB_SHIFT,
    SLAB_SHIFT_MAX = SPBM_SLAB_SHIFT_MAX,
    SLAB_FACES_MAX = 1 << SLAB_SHIFT_MAX
};

/* Of a mesh whose inputs have so many triangles. */
static inline unsigned slab_shift_of(uint64_t triangles)
{
    return triangles > SLAB_FACES_MAX ? SLAB_SHIFT : SLAB_SHIFT_MAX;
}

/* What import dropped and mended; kept in the store. All are counts. */
struct cleaning {
    uint64_t input_vertices;
    uint64_t input_faces;           /* as the file has them, before triangulation */
    uint64_t triangulated_faces;    /* triangles that polygons gave (0 when all were triangles) */
    uint64_t welded_vertices;       /* vertices that coincided with another and were merged */
    uint64_t unreferenced_vertices; /* dropped */
    uint64_t degenerate_faces;      /* a repeated index; dropped */
    uint64_t duplicate_faces;       /* the same three vertices as an earlier face; dropped */
    uint64_t nonmanifold_edges;     /* edges of more than two faces, separated */
    uint64_t nonmanifold_vertices;  /* vertices whose faces form several fans, separated */
    uint64_t vertices_added;        /* copies that the separating made */
    uint64_t flipped_faces;         /* turned round to agree with their component */
    uint64_t cut_edges;             /* edges cut because the surface is not orientable */
    uint64_t nonorientable_components;
    uint64_t zero_area_faces; /* kept */
    uint64_t hilbert_ordered; /* 1 when the faces were put in Hilbert order */
};

/* Topology of the store's mesh: what every level must have too. */
struct topology {
    uint64_t vertices;
    uint64_t edges;
    uint64_t faces;
    uint64_t border_edges;
    uint64_t border_loops;
    uint64_t components;
    int64_t euler;  /* V - E + F */
    uint64_t floor; /* fewest faces the topology allows, DESIGN.md */
};

struct store_info {
    struct cleaning cleaning;
    struct topology topology;
    struct attributes attributes;
    double origin[3];  /* positions are origin + float32 */
    double box_low[3]; /* bounding box, absolute */
    double box_high[3];
    bool is_float32;  /* all coordinates are float32 and the origin is 0 */
    double mean_edge; /* mean length of all edges */
    double noise; /* estimate: RMS distance of a vertex from its neighbours' mean plane, divided by
                     mean_edge; made in a fixed order */
    double area;  /* of all faces, summed slab by slab */
    uint32_t slab_count;
    uint32_t slab_shift;   /* slab_shift_of(triangles read) in all stores but those of tests */
    uint32_t input_digest; /* CRC-32 of the inputs' raw bytes */
    uint64_t input_size;   /* bytes of all inputs */
    char input_name[256];  /* base name of the first input, cut to fit; never shapes an output */
    bool welded;           /* the option */
};

/*
 * One slab. Faces refer to vertices by their global number; vertices in [vertex_first, vertex_end)
 * are the slab's own (first used here), all others that it uses are in `foreign`, ascending, each
 * with a copy of its position, so that no other slab's pages are needed.
 * Neighbours: neighbours[3f+k] is the face over edge k of the slab's face f (global), NO_INDEX at
 * the border; mates[f] holds in bits 2k, 2k+1 which edge of that neighbour it is.
 */
struct slab {
    uint32_t index;
    uint32_t face_first; /* global number of the slab's first face */
    uint32_t face_count;
    uint32_t vertex_first;
    uint32_t vertex_end;
    uint32_t foreign_count;
    const uint32_t *faces;          /* 3 a face, global vertex numbers */
    const uint32_t *neighbours;     /* 3 a face */
    const uint8_t *mates;           /* 1 a face */
    const float *positions;         /* 3 a vertex of its own, relative to the origin */
    const uint32_t *foreign;        /* vertex numbers, ascending */
    const float *foreign_positions; /* 3 each */
    const unsigned char *records;   /* attributes.stride bytes a vertex of its own, or NULL */
    struct window windows[6];       /* private: what is mapped */
};

struct store; /* opened for reading; may be shared by threads */

/* Opens and checks header, table and slab table; contents are checked by slab (CRC before use when
 * `verify`), by store_check whole. */
enum status store_open(struct context *ctx, const char *path, bool verify,
                       struct store **out) MUST_CHECK;
/* The same for a store that this very process wrote where nobody else can reach it: what has the
 * right checksum is then as it was written, and slabs are not judged again. Slabs that `hold` (may
 * be NULL) got from store_build are taken from there; it outlives the store. */
struct store_hold;
enum status store_open_own(struct context *ctx, const char *path, struct store_hold *hold,
                           struct store **out) MUST_CHECK;
void store_close(struct store **store);
const struct store_info *store_info(const struct store *store);
/* The CRC in the file's end marker (header and section table, and so all sections' CRCs): says
 * which store a chain file came from. */
enum status store_crc(struct store *store, uint32_t *crc) MUST_CHECK;

enum status slab_open(struct store *store, uint32_t index, struct slab *slab) MUST_CHECK;
void slab_close(struct slab *slab); /* unmaps it; safe when all zero */
/* Whether slab_open and slab_read of the slab point to memory that there is anyway. */
bool slab_is_held(const struct store *store, uint32_t index);
/* Nobody will open the slab again, or look at it but for its vertices' records: what holds it in
 * memory may give that back. From any worker, once a slab. */
void slab_forget(struct store *store, uint32_t index);

/* The same, but read into `buffer`, slab_size(...) bytes on a multiple of 16, which the slab
 * then points into: for those who go over it once and have room that they will use again. */
uint64_t slab_size(const struct store *store, uint32_t index, uint32_t *face_count,
                   uint32_t *vertex_count); /* foreign ones, too */
enum status slab_read(struct store *store, uint32_t index, void *buffer,
                      struct slab *slab) MUST_CHECK;

/* Position of any vertex that the slab uses. `foreign_records` are not kept in a slab: use
 * store_record for a foreign vertex's attributes. */
const float *slab_position(const struct slab *slab, uint32_t vertex);
/* Reads the attribute record of any vertex into `record` (stride bytes). */
enum status store_record(struct store *store, uint32_t vertex, unsigned char *record) MUST_CHECK;

/* Full verification: every CRC, padding, M1 to M5, adjacency, slab tables, counts, topology.
 * STATUS_BAD_INPUT with the first thing that is wrong. */
enum status store_check(struct context *ctx, const char *path) MUST_CHECK;

/* The whole store in memory (for small meshes, tests and the picture). */
enum status store_load(struct store *store, struct mesh *mesh) MUST_CHECK;

/* Writes the store's mesh as a mesh file, streamed (spbm export). */
struct export_options;
enum status store_export(struct store *store, const char *path,
                         const struct export_options *options) MUST_CHECK;

/* ---- STAGE 1 ---- */

struct import_options {
    bool weld;               /* merge coincident vertices of indexed inputs too */
    bool sync;               /* fsync the store */
    unsigned slab_shift;     /* for tests: slabs of 2^slab_shift faces, 2 to SLAB_SHIFT_MAX; 0: as
                                slab_shift_of says */
    uint64_t working_memory; /* for tests: bytes for tables, sorts and spools together, in place of
                                what the budget leaves for them; 0: not */
    uint64_t index_limit;    /* for tests: the most vertices and faces; 0: mesh_limit */
    struct store_hold *hold; /* takes what slabs its limits allow, which the store then lacks: it is
                                for store_open_own alone; NULL: all are written */
};

/*
 * The least context.memory_budget with which store_build succeeds, whatever the order of its input,
 * for up to `faces` faces (0: not known) whose vertices have attribute records of `stride` bytes:
 * what room.h says. `threads` do not matter: as many slabs are worked on at a time as fit.
 */
uint64_t store_build_least_memory(unsigned threads, uint64_t faces, uint32_t stride);

/* Builds the store from the inputs, which together are one mesh. *info (may be NULL) tells what was
 * done. Nothing is left behind on failure. */
enum status store_build(struct context *ctx, const char *const *inputs, size_t input_count,
                        const char *store_path, const struct import_options *options,
                        struct store_info *info) MUST_CHECK;

/* A mesh that is made of another store's, as a reader would give it. */
struct import_sink;
struct store_feed {
    enum status (*give)(void *user, const struct import_sink *sink);
    void *user;
    const struct store_info *source; /* whose provenance the new store takes over */
};

/* The same from a mesh that no file holds. */
enum status store_build_from(struct context *ctx, const struct store_feed *feed,
                             const char *store_path, const struct import_options *options,
                             struct store_info *info) MUST_CHECK;

#endif
