/*
 * Meshes built in code, for every test. A shape is a polygon mesh in plain malloc'ed arrays, made
 * without any code under test: generators, a shuffler, and encoders for the file formats that are
 * independent of src/mesh/export*.c. Everything aborts the test program when memory or the disk
 * fails. All positions are float32 values unless shape_move is used.
 */
#ifndef SPBM_TEST_SHAPES_H
#define SPBM_TEST_SHAPES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mesh/mesh.h"

struct shape {
    size_t vertex_count;
    size_t face_count;
    size_t index_count;
    double *positions; /* 3 a vertex */
    uint32_t *sizes;   /* corners of each face */
    uint32_t *indices; /* all faces' corners, one after the other */
};

void shape_free(struct shape *shape);
/* Building by hand: an empty shape is all zero. Both return the index of what was added. */
uint32_t shape_vertex(struct shape *shape, double x, double y, double z);
uint32_t shape_face(struct shape *shape, size_t corners, const uint32_t *indices);
uint32_t shape_triangle(struct shape *shape, uint32_t a, uint32_t b, uint32_t c);
uint32_t shape_quad(struct shape *shape, uint32_t a, uint32_t b, uint32_t c, uint32_t d);

/* ---- closed, orientable ---- */
struct shape shape_tetrahedron(void);         /* 4 V, 4 F */
struct shape shape_cube_quads(void);          /* 8 V, 6 quads */
struct shape shape_icosphere(unsigned level); /* 10*4^level + 2 V, 20*4^level F, radius 1 */
struct shape shape_torus(unsigned around, unsigned across); /* around*across V, twice that F */
/* Icosphere (torus: noisy_torus) whose vertices are moved by up to `noise` in each coordinate. */
struct shape shape_noisy_sphere(unsigned level, double noise, uint64_t seed);
struct shape shape_noisy_torus(unsigned around, unsigned across, double noise, uint64_t seed);
/* Height field with bumps and scanner noise over a square, closed below: scan-like, genus 0. */
struct shape shape_noisy_slab(unsigned cells, double noise, uint64_t seed);

/* ---- with border ---- */
struct shape shape_single_triangle(void);
struct shape shape_grid(unsigned columns, unsigned rows); /* cells, in the plane z = 0, 2 F each */
/* A grid with a 1x1 hole in the middle of every 4x4 cells: (columns/4)*(rows/4) holes. */
struct shape shape_grid_with_holes(unsigned columns, unsigned rows);
/* A strip that winds `turns` times round the z axis and climbs: its projection overlaps itself. */
struct shape shape_spiral_ramp(unsigned turns, unsigned cells_a_turn);
struct shape shape_comb(unsigned teeth); /* one polygon of 4*teeth corners, concave, flat */
struct shape shape_star_polygon(unsigned corners,
                                uint64_t seed); /* one star-shaped polygon, flat */

/* ---- not orientable ---- */
struct shape shape_mobius(unsigned around,
                          unsigned across); /* around*(across+1) V, 1 border loop */
struct shape shape_klein_bottle(unsigned around, unsigned across); /* closed, Euler 0 */

/* ---- not manifold ---- */
struct shape
shape_spheres_touching_vertex(unsigned level);            /* two icospheres with a common vertex */
struct shape shape_spheres_touching_edge(unsigned level); /* with a common edge: 4 faces at it */

/* ---- changes ---- */
/* Adds a copy of `other` (nothing is shared). */
void shape_append(struct shape *shape, const struct shape *other);
/* Permutes vertices and faces and turns the corners of each face; orientation is kept. */
void shape_shuffle(struct shape *shape, uint64_t seed);
/* Reverses a face's orientation. */
void shape_flip(struct shape *shape, size_t face);
/* Scales, then moves; positions are doubles afterwards (not rounded to float32). */
void shape_move(struct shape *shape, double scale, double x, double y, double z);
/* Cuts polygons into fans (right for convex ones). */
void shape_fan(struct shape *shape);

/* ---- to the product's types, to bytes, to files ---- */
/* A mesh (polygons are fanned), released by mesh_clear with the same context. */
void shape_to_mesh(struct context *ctx, const struct shape *shape, struct mesh *mesh);
/* The same for shapes that are not needed afterwards: frees the shape. */
void shape_into_mesh(struct context *ctx, struct shape *shape, struct mesh *mesh);

enum shape_format {
    SHAPE_PLY_ASCII, /* 9 digits (float), 17 (double) */
    SHAPE_PLY_LITTLE,
    SHAPE_PLY_BIG,
    SHAPE_OBJ,
    SHAPE_OFF,
    SHAPE_STL_BINARY, /* polygons are fanned */
    SHAPE_STL_ASCII
};

/* The file's bytes, to be freed. PLY: float when every coordinate is a float32, else double. */
unsigned char *shape_encode(const struct shape *shape, enum shape_format format, size_t *size);
void shape_write(const struct shape *shape, enum shape_format format, const char *path);

/* ---- files of tests ---- */
/* A folder of this process's own, made on first use; removed with all in it at exit. */
const char *test_folder(void);
/* "<test folder>/<name>" in one of eight buffers used in turn: valid for the next seven calls. */
const char *test_path(const char *name);
/* "<SPBM_DATA>/<name>", default folder ../shared/data, also looked for further up the tree; NULL
 * when absent: skip() then. Same buffers as test_path. */
const char *test_data(const char *name);

/* ---- reproducible random numbers (splitmix64) ---- */
uint64_t random_next(uint64_t *state);
double random_unit(uint64_t *state);                    /* in [0, 1) */
uint64_t random_below(uint64_t *state, uint64_t limit); /* in [0, limit) */

#endif
