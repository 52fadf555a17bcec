/*
 * spbm: simplifies triangle scans too large for memory.
 *
 * The method is Simplified Patch Boundary Merging (Ho, Mitchell and Silva, 1999): the surface is
 * cut into nearly flat patches, the chains between the patches are kept, and levels of detail are
 * made from the chains alone. Three stages, each a call here:
 *
 *     spbm_import    a mesh file            ->  mesh store
 *     spbm_patchify  mesh store             ->  chain file
 *     spbm_lod       chain file             ->  one or several simplified meshes
 *
 * and spbm_simplify does all three with temporary files. The output of a call depends on the input
 * and the options alone: not on threads, memory or machine, nor on whether the stages ran apart.
 *
 * Jobs. All state lives in a job (spbm_job_open): limits, callbacks, and the words for the last
 * failure. There are no globals; nothing is printed; no signal handler is set; nothing exits. One
 * job serves one call at a time; different jobs can be used by different threads at once. A call
 * may use several threads of its own, all of which have ended when it returns.
 *
 * Ownership. Paths, arrays and options that are given to a call are borrowed until it returns,
 * settings' `tmp_dir` and `user` until the job is closed. Reports are plain structs, filled by the
 * library and owned by the caller; nothing in them needs releasing. Whether a call succeeds or
 * fails, there is nothing to release except the job.
 *
 * Failure. A call that fails returns a status other than SPBM_OK, and spbm_job_error() gives one
 * line of words for it. What it was to write is then not there: a regular file appears under its
 * name only when it is whole. (The one exception says so: SPBM_TARGET_MISSED.)
 *
 * Units. Lengths are in the model's own units. An error or tolerance can be given as a fraction of
 * the diagonal of the bounding box instead (`..._is_relative`). Angles are in degrees, sizes in
 * bytes. Paths are in the file system's encoding; "-" is standard input or output where it makes
 * sense; formats are recognised by content when read and by ending when written.
 *
 * Compatibility. Fill every options struct by its _defaults function before you set fields: what a
 * later version adds takes the place of `reserved` and has a default. Never set `reserved`.
 *
 * Examples stand between `@code` and `@endcode`; a test compiles them.
 */
#ifndef SPBM_H
#define SPBM_H

#include <stddef.h>
#include <stdint.h>

#define SPBM_VERSION "0.1.0"

#if defined(__GNUC__)
#define SPBM_API __attribute__((visibility("default")))
#else
#define SPBM_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ---- status ---- */

typedef enum spbm_status {
    SPBM_OK = 0,
    SPBM_BAD_INPUT = 1,     /* an input is damaged, unsupported or inconsistent */
    SPBM_MISUSE = 2,        /* options contradict each other or are out of range */
    SPBM_TARGET_MISSED = 3, /* all output is written and whole, but a count or error asked for was
                               not reached; the report says why */
    SPBM_NO_MEMORY = 4,     /* an allocation failed or the budget does not allow it */
    SPBM_NO_SPACE = 5,      /* the disk is full */
    SPBM_IO = 6,            /* another failed operation on a file */
    SPBM_CANCELLED = 7,     /* the `cancelled` callback asked to stop */
    SPBM_INTERNAL = 8       /* a defect of the library */
} spbm_status;

/* A few words for a status, for instance "bad input"; never NULL. Static. */
SPBM_API const char *spbm_status_text(spbm_status status);

/* The library's version, "MAJOR.MINOR.PATCH"; compare with SPBM_VERSION of the header. Static. */
SPBM_API const char *spbm_version(void);

/* ---- jobs ---- */

typedef enum spbm_message_kind {
    SPBM_NOTE = 0,   /* something worth knowing: a choice that was made */
    SPBM_WARNING = 1 /* something was dropped or mended */
} spbm_message_kind;

/*
 * Limits and callbacks. Callbacks may be NULL. They are called from any of the call's threads, but
 * never two of progress and message at a time; they must not call the library with the same job.
 */
typedef struct spbm_settings {
    /* Budget in bytes; 0: no limit. It is what the whole process may have resident: some MiB are
     * set aside for code, libraries and threads, and calls get the rest. Stages that need more than
     * that with one thread fail with SPBM_NO_MEMORY and say what they need; else they use as many
     * of the threads as fit. */
    uint64_t memory;
    uint32_t threads;    /* at least 1 */
    uint32_t cpu_cap;    /* highest vector level to use, for tests; UINT32_MAX: no cap */
    const char *tmp_dir; /* for temporary files; NULL: beside the output */

    /* `done` of `total` steps of a stage; total is 0 when it is not known. `stage` is valid during
     * the call only, like `text`. */
    void (*progress)(void *user, const char *stage, uint64_t done, uint64_t total);
    /* One line, without a full stop or newline. */
    void (*message)(void *user, spbm_message_kind kind, const char *text);
    /* Polled several times a second, from any thread; anything but 0 makes the call end soon with
     * SPBM_CANCELLED. */
    int (*cancelled)(void *user);
    void *user; /* handed to the callbacks */

    uint64_t reserved[8];
} spbm_settings;

typedef struct spbm_job spbm_job;

/* No limit, one thread, no callbacks. */
SPBM_API void spbm_settings_defaults(spbm_settings *settings);

/*
 * Opens a job; `settings` may be NULL for the defaults. On success *job is to be closed by
 * spbm_job_close. On failure (SPBM_NO_MEMORY, SPBM_MISUSE) *job is NULL.
 *
 * @code
 *     spbm_settings settings;
 *     spbm_job *job;
 *     spbm_settings_defaults(&settings);
 *     settings.threads = 4;
 *     if (spbm_job_open(&settings, &job) != SPBM_OK)
 *         return 1;
 *     spbm_job_close(&job);
 * @endcode
 */
SPBM_API spbm_status spbm_job_open(const spbm_settings *settings, spbm_job **job);

/* Closes *job, which may be NULL, and sets it to NULL. No call may be under way. */
SPBM_API void spbm_job_close(spbm_job **job);

/* Why the last call failed: one line that names file, position and reason; "" after success. Valid
 * until the next call with this job. */
SPBM_API const char *spbm_job_error(const spbm_job *job);

/* The most bytes that this job had allocated at any time so far; mapped files are not counted. */
SPBM_API uint64_t spbm_job_memory_peak(const spbm_job *job);

/* ---- what reports are made of ---- */

/* What a stage took. */
typedef struct spbm_stage {
    const char *name; /* "import", "patchify", "lod"; static */
    double wall_seconds;
    double cpu_seconds;   /* of all threads of the process */
    uint64_t memory_peak; /* most bytes that the job had allocated or mapped so far */
    uint32_t threads; /* that it used: fewer than asked for where the memory has room for fewer */
    int resumed;      /* not done: an earlier run had finished it */
} spbm_stage;

/* What import dropped and mended. All are counts. */
typedef struct spbm_cleaning {
    uint64_t input_vertices;
    uint64_t input_faces;           /* as the file has them, before triangulation */
    uint64_t triangulated_faces;    /* triangles that polygons gave; 0 when all were triangles */
    uint64_t welded_vertices;       /* coincided with another and were merged */
    uint64_t unreferenced_vertices; /* dropped */
    uint64_t degenerate_faces;      /* a repeated index; dropped */
    uint64_t duplicate_faces;       /* the same three vertices as an earlier face; dropped */
    uint64_t nonmanifold_edges;     /* of more than two faces; separated */
    uint64_t nonmanifold_vertices;  /* their faces form several fans; separated */
    uint64_t vertices_added;        /* copies that the separating made */
    uint64_t flipped_faces;         /* turned round to agree with their component */
    uint64_t cut_edges;             /* cut because the surface is not orientable */
    uint64_t nonorientable_components;
    uint64_t zero_area_faces; /* kept */
    uint64_t hilbert_ordered; /* 1 when the faces were put in another order */
} spbm_cleaning;

typedef struct spbm_topology {
    uint64_t vertices;
    uint64_t edges;
    uint64_t faces;
    uint64_t border_edges; /* of one face */
    uint64_t border_loops;
    uint64_t components;
    int64_t euler;  /* vertices - edges + faces */
    uint64_t floor; /* the fewest faces that this topology allows */
} spbm_topology;

enum { SPBM_ATTRIBUTES_MAX = 64, SPBM_TARGETS_MAX = 16 };

/* A vertex property that travels along, such as a colour. */
typedef struct spbm_attribute {
    char name[64];
    char type[8]; /* as PLY names it: "char" "uchar" "short" "ushort" "int" "uint" "float" "double"
                   */
} spbm_attribute;

/* A mesh store. */
typedef struct spbm_store_figures {
    spbm_cleaning cleaning;
    spbm_topology topology;
    double box_low[3], box_high[3];
    double diagonal;  /* of the box */
    double origin[3]; /* positions are float32 relative to it */
    int is_float32;   /* every coordinate of the input is a float32 */
    int welded;       /* import was asked to weld */
    double mean_edge; /* mean length of the edges */
    double noise;     /* estimate of the scanner's noise, in mean edge lengths */
    double area;
    uint32_t slabs;
    uint32_t attribute_count;
    spbm_attribute attributes[SPBM_ATTRIBUTES_MAX];
    char input_name[256];  /* base name of the first input */
    uint64_t input_size;   /* bytes of all inputs */
    uint32_t input_digest; /* CRC-32 of those bytes */
    uint64_t reserved[8];
} spbm_store_figures;

typedef enum spbm_mode {
    SPBM_COLLAPSE = 0, /* fine patches, then edge collapse: for scans */
    SPBM_CLASSIC = 1   /* the dissertation's chapter 4: for CAD parts */
} spbm_mode;

typedef enum spbm_target_kind {
    SPBM_BY_FACES = 0, /* values are face counts */
    SPBM_BY_RATIO = 1, /* values are fractions of the store's faces, in (0,1] */
    SPBM_BY_ERROR = 2  /* values are estimated largest distances to the original */
} spbm_target_kind;

typedef enum spbm_place {
    SPBM_PLACE_DEFAULT = 0, /* subset in mode classic, optimal in mode collapse */
    SPBM_PLACE_SUBSET = 1,  /* every output vertex is an input vertex, bit for bit */
    SPBM_PLACE_OPTIMAL = 2  /* vertices go where the error is least, attributes are interpolated */
} spbm_place;

typedef enum spbm_format {
    SPBM_FORMAT_BY_NAME = 0, /* .ply (binary), .obj, .stl, .off */
    SPBM_FORMAT_PLY = 1,
    SPBM_FORMAT_PLY_ASCII = 2,
    SPBM_FORMAT_PLY_BIG = 3, /* big-endian */
    SPBM_FORMAT_OBJ = 4,
    SPBM_FORMAT_STL = 5,
    SPBM_FORMAT_OFF = 6
} spbm_format;

/* A chain file. */
typedef struct spbm_chain_figures {
    spbm_topology topology; /* of the store it was made from */
    double box_low[3], box_high[3];
    double diagonal;
    double mean_edge, noise, area;
    uint32_t slabs;
    uint32_t attribute_count;
    uint64_t patches;
    uint64_t chains;      /* those between slabs counted once */
    uint64_t seam_chains; /* of these, between slabs */
    uint64_t junctions;
    uint64_t chain_vertices;
    uint64_t most_faces;   /* of the finest level that the file can give */
    double tolerance;      /* chain tolerance used, a length */
    double patch_angle[2]; /* degrees: sharing one edge, sharing two */
    double face_angle[2];
    uint32_t smoothings;
    /* What it was made for. */
    spbm_mode mode;
    uint32_t effort;
    spbm_target_kind target_kind;
    uint32_t target_count;
    double targets[SPBM_TARGETS_MAX];
    uint64_t reserved[8];
} spbm_chain_figures;

typedef enum spbm_stop {
    SPBM_STOP_REACHED = 0,  /* N or N - 1 faces, or the error asked for */
    SPBM_STOP_TOPOLOGY = 1, /* nothing more can go without changing the topology */
    SPBM_STOP_TOO_FINE = 2, /* the chain file has no such faces, or no such small error, to give */
    SPBM_STOP_ERROR = 3     /* the error bound came before the count; no miss */
} spbm_stop;

/* A few words for it, for instance "target reached"; never NULL. Static. */
SPBM_API const char *spbm_stop_text(spbm_stop stop);

/* One simplified mesh. */
typedef struct spbm_level {
    uint64_t wanted_faces; /* 0 when an error was asked for */
    double wanted_error;   /* a length; with a count: the error bound, 0 if there is none */
    uint64_t vertices, faces;
    double error;   /* estimated largest distance to the original, a length */
    spbm_stop stop; /* why it has as many faces as it has */
} spbm_level;

/* One stage of joining the blocks' small meshes (mode collapse): 8 at a time, up to one. */
typedef struct spbm_join {
    uint32_t joins;                /* meshes that came out */
    uint64_t faces_in, largest_in; /* that were joined: of all, and of the largest join */
    uint64_t faces_out;            /* left of all when they were thinned (the last one is not) */
} spbm_join;

enum { SPBM_JOINS_MAX = 8 };

typedef struct spbm_levels {
    uint32_t count;
    spbm_level levels[SPBM_TARGETS_MAX]; /* finest first */
    uint64_t small_faces;                /* of the mesh that the chains gave (mode collapse) */
    uint32_t join_count;
    spbm_join joins[SPBM_JOINS_MAX];
    double diagonal;         /* of the original's bounding box */
    uint64_t floor;          /* the fewest faces that the topology allows */
    uint64_t original_faces; /* of the mesh store */
    uint64_t reserved[8];
} spbm_levels;

/* ---- stage 1: import ---- */

typedef struct spbm_import_options {
    int weld; /* merge coincident vertices of indexed inputs too (an STL is always welded) */
    int sync; /* flush the store to the disk before it gets its name; default 1 */
    uint64_t reserved[8];
} spbm_import_options;

SPBM_API void spbm_import_defaults(spbm_import_options *options);

/*
 * Reads `input_count` mesh files (PLY, OBJ, STL, OFF, plain or gzip-compressed; "-" is standard
 * input), which together are one mesh, cleans it, and writes the mesh store `store`. `options`
 * NULL: the defaults; `figures` may be NULL and is filled on success only. Fails with
 * SPBM_BAD_INPUT (words name file, position and reason), SPBM_MISUSE (an input is the output),
 * SPBM_NO_MEMORY, SPBM_NO_SPACE, SPBM_IO, SPBM_CANCELLED.
 */
SPBM_API spbm_status spbm_import(spbm_job *job, const char *const *inputs, size_t input_count,
                                 const char *store, const spbm_import_options *options,
                                 spbm_store_figures *figures);

/* ---- stage 2: patchify ---- */

/* What levels are wanted: the same for patchify, which grows patches fine enough for the finest,
 * and lod. In any order. */
typedef struct spbm_target {
    spbm_target_kind kind;
    uint32_t count; /* of values, at least 1; 0 is misuse */
    double values[SPBM_TARGETS_MAX];
    int error_is_relative; /* values of SPBM_BY_ERROR are fractions of the diagonal */
    spbm_mode mode;
    uint32_t effort;    /* 1 fastest, 2, 3 most accurate */
    double error_bound; /* with a count or ratio: stop before this error is passed, what is reached
                           first stops; 0: none */
    int bound_is_relative;
    uint64_t reserved[8];
} spbm_target;

/* No values yet; mode and effort as the program's defaults. */
SPBM_API void spbm_target_defaults(spbm_target *target);

/* How patches are grown. What is negative is chosen from the store's noise and the target. */
typedef struct spbm_patch_options {
    double patch_angle[2]; /* degrees, face against patch: sharing one edge, sharing two */
    double face_angle[2];  /* degrees, face against neighbouring face, likewise */
    int32_t smoothings;    /* times the face normals are averaged with their neighbours' */
    double chain_tolerance;
    int tolerance_is_relative;
    int sync; /* default 1 */
    uint64_t reserved[8];
} spbm_patch_options;

SPBM_API void spbm_patch_defaults(spbm_patch_options *options);

/*
 * Makes the chain file `chains` of a mesh store. `options` NULL: the defaults; `figures` may be
 * NULL and is filled on success only. Fails as spbm_import does.
 */
SPBM_API spbm_status spbm_patchify(spbm_job *job, const char *store, const char *chains,
                                   const spbm_target *target, const spbm_patch_options *options,
                                   spbm_chain_figures *figures);

/* ---- stage 3: levels of detail ---- */

typedef struct spbm_lod_options {
    spbm_place place;
    spbm_format format; /* of the output; "-" needs one */
    int sync;           /* default 1 */
    int cache;          /* default 0. spbm_lod: replaces the chain file by one that also holds what
                           makes further levels cheap, as spbm_simplify's keep_dir does, where it
                           does not have that yet (elsewhere: does nothing) */
    uint64_t reserved[8];
} spbm_lod_options;

SPBM_API void spbm_lod_defaults(spbm_lod_options *options);

/*
 * Makes all levels of `target` from a chain file. `output` is a name; with several levels it holds
 * %d, which becomes the level's number (0 is the finest), and %% is a percent sign.
 * By faces or ratio and without a bound of the error, a level is the same whatever others are made
 * with it, if none is finer than those that the chain file was made for; these are passed on the
 * way, also where they are not asked for.
 * `levels` may be NULL; it is filled on SPBM_OK and SPBM_TARGET_MISSED. In both cases all levels
 * are written. Fails otherwise as spbm_import does.
 */
SPBM_API spbm_status spbm_lod(spbm_job *job, const char *chains, const char *output,
                              const spbm_target *target, const spbm_lod_options *options,
                              spbm_levels *levels);

/* The name of a level's file: `output` with its %d replaced, written to `name` (`size` bytes,
 * always terminated). SPBM_MISUSE if it does not fit, or holds other than one %d when `level_count`
 * is above 1. With one level, %d is replaced by 0 if it is there. */
SPBM_API spbm_status spbm_level_name(const char *output, uint32_t level, uint32_t level_count,
                                     char *name, size_t size);

/* ---- topology ---- */

/* A length, or a fraction of the diagonal of the bounding box. */
typedef struct spbm_length {
    double value; /* 0: not asked for */
    int is_relative;
} spbm_length;

typedef enum spbm_loop_size {
    SPBM_SIZE_EXACT = 0,   /* largest distance of two vertices of a feature's largest loop */
    SPBM_SIZE_SAMPLED = 1, /* estimated from two or three of its vertices */
    SPBM_SIZE_BOX = 2,     /* diagonal of its bounding box */
    SPBM_SIZE_EXTENT = 3   /* largest distance of two vertices of the whole feature */
} spbm_loop_size;

typedef enum spbm_feature_kind {
    SPBM_HOLE = 0,      /* several loops, empty between them */
    SPBM_CAVITY = 1,    /* one loop, the wall goes into the solid */
    SPBM_BUMP = 2,      /* one loop, the wall rises from the solid */
    SPBM_PIPE = 3,      /* several loops, solid between them */
    SPBM_COMPONENT = 4, /* a component of the mesh */
    SPBM_CRACK = 5,     /* a border loop */
    SPBM_HANDLE = 6,    /* a smooth handle or tunnel */
    SPBM_FEATURE_KINDS = 7
} spbm_feature_kind;

/* One word for a kind, for instance "hole"; never NULL. Static. */
SPBM_API const char *spbm_feature_text(spbm_feature_kind kind);

/* Something that was removed. */
typedef struct spbm_feature {
    spbm_feature_kind kind;
    uint32_t loops;  /* that were filled */
    double size;     /* of its largest loop; of a component the diagonal of its box; a length */
    double place[3]; /* the middle of that loop or box */
} spbm_feature;

typedef struct spbm_topology_options {
    spbm_import_options import;
    spbm_length max_feature; /* holes, bumps and cavities all of whose loops are smaller go */
    spbm_loop_size size;
    double sharp_angle[2]; /* degrees: edges in between are sharp; default 45, 180 */
    int remove_pipes;      /* what is solid between two loops, too */
    int smooth_features;   /* also handles and tunnels without sharp rims whose shortest loop is
                              smaller than max_feature */
    spbm_length drop_components; /* whole components whose box has a smaller diagonal go */
    spbm_length close_cracks;    /* border loops that are smaller are filled */
    spbm_length zip_tolerance;   /* how far apart the two sides of a crack may lie that become one
                                    before it is filled; below 0, the default: a tenth of the
                                    median border edge; 0: none */
    int crack_inscribed; /* their size is that of the largest circle inside, not the diameter */
    int merge_coplanar;  /* planes are triangulated anew, by the fewest triangles */
    spbm_format format;  /* of the output */
    int sync;            /* default 1 */
    /* Called for everything that was removed, at the end, in a fixed order; may be NULL. */
    void (*removed)(void *user, const spbm_feature *feature);
    void *user;
    uint64_t reserved[8];
} spbm_topology_options;

SPBM_API void spbm_topology_defaults(spbm_topology_options *options);

/* What was removed. */
typedef struct spbm_removal {
    uint64_t counts[SPBM_FEATURE_KINDS];
    uint64_t blocked;         /* small enough, but kept, for no fill would leave a manifold */
    uint64_t zipped;          /* vertices of cracks that were joined with others */
    uint64_t dropped_faces;   /* of the original */
    uint64_t added_faces;     /* fills */
    uint64_t vertices, faces; /* that are left */
} spbm_removal;

typedef struct spbm_topology_report {
    uint32_t stage_count;
    spbm_stage stages[2]; /* import (if there was one), topology */
    spbm_store_figures store;
    spbm_removal removal;
    uint64_t reserved[8];
} spbm_topology_report;

/*
 * Removes small features of the topology and nothing else: all other faces are written as they
 * are (with merge_coplanar: planes anew). The inputs are mesh files, as for spbm_import, or one
 * mesh store. `report` may be NULL. Fails as spbm_import does.
 */
SPBM_API spbm_status spbm_simplify_topology(spbm_job *job, const char *const *inputs,
                                            size_t input_count, const char *output,
                                            const spbm_topology_options *options,
                                            spbm_topology_report *report);

/* ---- all three ---- */

typedef struct spbm_simplify_options {
    spbm_import_options import;
    spbm_target target;
    spbm_patch_options patch;
    spbm_lod_options lod;
    const char *keep_dir;   /* NULL: store and chain file are temporary; else they are kept there as
                               mesh.store and mesh.chains, and the directory is made if need be.
                               The latter gets what makes further levels cheap (spbm_lod) where they
                               go by counts with the same effort and placement */
    const char *resume_dir; /* NULL: a run that does not finish leaves nothing. Else finished stages
                               are kept in a folder there, named by inputs and options, while the
                               run lasts; if it ends otherwise than by finishing (even by SIGKILL)
                               or by bad input, the same call goes on from them. Not together with
                               keep_dir, nor with standard input. */
    const spbm_topology_options *topology; /* NULL: topology stays as it is; else small features go
                                              before patches are grown, and mesh.store holds what
                                              is left. Its import, format and sync do not count */
    uint64_t reserved[7];
} spbm_simplify_options;

SPBM_API void spbm_simplify_defaults(spbm_simplify_options *options);

/* Filled as far as the run came, also when it fails: stages that did not end are not counted. */
typedef struct spbm_simplify_report {
    uint32_t stage_count;      /* stages that ended */
    spbm_stage stages[4];      /* import, topology (if it is asked for), patchify, lod */
    int has_topology;          /* topology is asked for and has ended */
    spbm_store_figures store;  /* of the input; valid with stage_count > 0 */
    spbm_removal removal;      /* with has_topology */
    spbm_chain_figures chains; /* stage_count > 1 + has_topology */
    spbm_levels levels;        /* > 2 + has_topology */
    uint64_t reserved[8];
} spbm_simplify_report;

/*
 * Mesh files in, simplified meshes out. Store and chain file are temporary (in the job's tmp_dir,
 * else beside the output) and are gone when the call returns, whatever it returns, unless
 * `keep_dir` is given. The output is the same, byte for byte, as that of the three stages. `report`
 * may be NULL. Fails as spbm_lod does.
 *
 * @code
 *     const char *input = "scan.ply.gz";
 *     spbm_simplify_options options;
 *     spbm_simplify_report report;
 *     spbm_job *job;
 *     spbm_status status = spbm_job_open(NULL, &job);
 *     if (status != SPBM_OK)
 *         return status;
 *     spbm_simplify_defaults(&options);
 *     options.target.kind = SPBM_BY_FACES;
 *     options.target.count = 2;
 *     options.target.values[0] = 10000;
 *     options.target.values[1] = 1000;
 *     status = spbm_simplify(job, &input, 1, "small-%d.ply", &options, &report);
 *     if (status != SPBM_OK)
 *         fprintf(stderr, "%s\n", spbm_job_error(job));
 *     for (uint32_t i = 0; i < report.levels.count; i++) {
 *         const spbm_level *level = &report.levels.levels[i];
 *         printf("level %u: %llu faces, error %g, %s\n", (unsigned)i,
 *                (unsigned long long)level->faces, level->error, spbm_stop_text(level->stop));
 *     }
 *     spbm_job_close(&job);
 *     return status;
 * @endcode
 */
SPBM_API spbm_status spbm_simplify(spbm_job *job, const char *const *inputs, size_t input_count,
                                   const char *output, const spbm_simplify_options *options,
                                   spbm_simplify_report *report);

/*
 * The levels of spbm_lod with small features gone: the finest mesh that the chain file gives is
 * made again, and goes through topology, patches and levels as in spbm_simplify; all in temporary
 * files. Features are as large as the chains show them; ratios are of the faces of the chain file's
 * store. `options` NULL: the defaults. `topology` as in spbm_simplify_options. `report` (may be
 * NULL): the first stage is "unfold", and store is of the mesh that the chains give. Fails as
 * spbm_lod does.
 */
SPBM_API spbm_status spbm_lod_topology(spbm_job *job, const char *chains, const char *output,
                                       const spbm_target *target, const spbm_lod_options *options,
                                       const spbm_topology_options *topology,
                                       spbm_simplify_report *report);

/* What a run is expected to take. */
typedef struct spbm_plan {
    uint64_t faces, vertices; /* of the inputs; a soup's vertices as after welding */
    int is_counted;       /* the inputs tell their faces; else scaled up from their beginnings */
    double seconds;       /* wall, of all stages; right to a factor of about two */
    spbm_stage stages[3]; /* of each: name, wall_seconds and threads; all else is 0 */
    uint64_t temporary_bytes; /* on the disk at most, while the run lasts */
    uint64_t output_bytes;    /* as binary PLY */
    uint64_t free_bytes;      /* now, where temporary files go; 0: not known */
    uint64_t memory_peak;     /* of the process, within the budget */
    uint64_t memory_least;    /* the least budget that would do */
    uint64_t reserved[8];
} spbm_plan;

/*
 * Foretells what spbm_simplify with the same arguments takes. Nothing is read but the inputs'
 * beginnings, and nothing is written. Fails where spbm_simplify would at once: SPBM_MISUSE,
 * SPBM_NO_MEMORY (the budget is below memory_least, which the words tell), and SPBM_BAD_INPUT for
 * what is no mesh.
 */
SPBM_API spbm_status spbm_simplify_plan(spbm_job *job, const char *const *inputs,
                                        size_t input_count, const char *output,
                                        const spbm_simplify_options *options, spbm_plan *plan);

/* Writes a store's mesh as a mesh file, streamed. */
SPBM_API spbm_status spbm_export(spbm_job *job, const char *store, const char *output,
                                 spbm_format format);

/* ---- looking at files ---- */

typedef enum spbm_file_kind {
    SPBM_FILE_MESH = 0, /* PLY, OBJ, STL or OFF */
    SPBM_FILE_STORE = 1,
    SPBM_FILE_CHAINS = 2
} spbm_file_kind;

/* A mesh as it is, clean or not. */
typedef struct spbm_quality {
    spbm_topology topology; /* of referenced vertices; the floor is 0 unless manifold */
    uint64_t unreferenced_vertices;
    uint64_t nonmanifold_edges;    /* of more than two faces */
    uint64_t nonmanifold_vertices; /* faces form more than one fan */
    uint64_t misoriented_edges;    /* two faces run along them the same way */
    uint64_t degenerate_faces;     /* a repeated index */
    uint64_t duplicate_faces;
    uint64_t zero_area_faces;
    uint64_t coincident_vertices; /* at the same position as an earlier one */
    int64_t genus;                /* summed over closed components */
    int is_manifold;              /* and consistently oriented, without degenerates or duplicates */
    double box_low[3], box_high[3];
    double diagonal;
    double area;
    double volume;            /* signed; meaningful when closed */
    uint32_t attribute_count; /* filled by spbm_info */
    uint64_t reserved[8];
} spbm_quality;

/* What a file is and holds; of the last three fields only that of `kind` is filled. */
typedef struct spbm_file_figures {
    spbm_file_kind kind;
    uint64_t file_size; /* bytes; 0 for standard input */
    spbm_quality mesh;
    spbm_store_figures store;
    spbm_chain_figures chains;
    uint64_t reserved[8];
} spbm_file_figures;

/* Describes a mesh file ("-": standard input), mesh store or chain file, recognised by content.
 * *figures is filled on success. A mesh file is held in memory. */
SPBM_API spbm_status spbm_info(spbm_job *job, const char *path, spbm_file_figures *figures);

/* Verifies a file wholly: of a store and a chain file every byte, checksum and invariant; of a mesh
 * file that it is a manifold (with or without border), consistently oriented, without degenerate
 * and duplicate faces. SPBM_BAD_INPUT and words for the first thing that is wrong. *kind (may be
 * NULL) is filled when the file could be recognised. */
SPBM_API spbm_status spbm_check(spbm_job *job, const char *path, spbm_file_kind *kind);

typedef struct spbm_deviation {
    double largest, mean, rms; /* lengths */
    uint64_t samples;
} spbm_deviation;

typedef struct spbm_measurement {
    spbm_deviation forward;             /* from the original to the simplified mesh */
    spbm_deviation backward;            /* from the simplified mesh to the original */
    double hausdorff;                   /* the larger of both maxima */
    double diagonal;                    /* of the original's bounding box */
    double normal_mean, normal_largest; /* degrees between the normals */
    double samples_per_face;            /* of the simplified mesh */
    uint64_t flipped_faces;             /* normal more than 90 degrees from the original's */
    uint64_t self_intersecting_faces;   /* when looked for */
    spbm_quality original, simplified;
    uint64_t reserved[8];
} spbm_measurement;

typedef struct spbm_measure_options {
    uint32_t samples_per_face; /* at least this many; 0: ten */
    int self_intersections;    /* look for them */
    const char *error_ply;     /* writes the simplified mesh to this PLY, each vertex with its
                                  distance to the original as property `quality` and as a colour
                                  (viridis, dark is near); NULL: does not */
    uint64_t reserved[8];
} spbm_measure_options;

SPBM_API void spbm_measure_defaults(spbm_measure_options *options);

/* Distances between two surfaces both ways, and how their normals differ. `original` may be a mesh
 * file or a mesh store. *measurement is filled on success. */
SPBM_API spbm_status spbm_measure(spbm_job *job, const char *original, const char *simplified,
                                  const spbm_measure_options *options,
                                  spbm_measurement *measurement);

typedef struct spbm_render_options {
    uint32_t width, height; /* pixels of one picture; several stand side by side */
    double view[3];         /* direction from the model to the eye; all 0: a good one */
    double up[3];           /* all 0: a good one */
    int wireframe;          /* draw the edges too */
    int flat;               /* shade faces flat, so that they can be told apart; default 1 */
    int captions;           /* write names and face counts below; default 1 */
    uint32_t background;    /* 0xRRGGBB */
    const char *legend;     /* words under the colour map's legend; NULL: the name of what it shows;
                               there is one only with a mesh of property `quality` */
    uint64_t reserved[8];
} spbm_render_options;

SPBM_API void spbm_render_defaults(spbm_render_options *options);

enum { SPBM_RENDER_MAX = 16 };

/*
 * Draws up to SPBM_RENDER_MAX mesh files and stores side by side, all at one scale, into a PNG.
 * Meshes whose vertices have a property `quality`, such as spbm_measure writes, are coloured by it
 * (viridis), all over one range, with a legend; others by their own colours if they have any. A
 * chain file in the list colours the patches of the store before it, which must be the one that it
 * was made from. The meshes are held in memory.
 */
SPBM_API spbm_status spbm_render(spbm_job *job, const char *const *paths, size_t path_count,
                                 const char *picture, const spbm_render_options *options);

#ifdef __cplusplus
}
#endif

#endif
