/*
 * Machine parts built in code, with holes, bumps and pockets whose sizes are known: the parts of
 * the dissertation's table 2 and random plates. What must be left after topology simplification is
 * computed from the construction, by building the part anew without what is too small.
 */
#ifndef SPBM_TEST_PARTS_H
#define SPBM_TEST_PARTS_H

#include "test_shapes.h"

enum part_kind { PART_NOTHING = 0, PART_POCKET, PART_BUMP, PART_HOLE };

enum { PART_CORNERS_MAX = 96, PART_NESTED_MAX = 2 };

/*
 * A feature: an outline round the middle of its cell, given by its distances from the middle at
 * evenly spaced angles, and where it leads. A pocket or bump ends in a face that may carry another
 * feature; a hole ends in the opposite face of the part, or in that of a pocket there.
 */
struct part_feature {
    enum part_kind kind;
    unsigned corners;
    double radii[PART_CORNERS_MAX];
    double depth; /* of a pocket, height of a bump */
    double taper; /* the far outline is this times as large */
};

/* What a cell of a plate carries on one side: outermost first; a hole comes last and on top only.
 */
struct part_cell {
    bool is_solid; /* else there is no plate here */
    unsigned top_count, bottom_count;
    struct part_feature top[PART_NESTED_MAX], bottom[PART_NESTED_MAX];
};

/* Cells of side 1, columns by rows, between the planes z = 0 and z = thickness. */
struct part_plate {
    unsigned columns, rows;
    double thickness;
    unsigned edge_vertices; /* more vertices on every cell edge of the outline */
    struct part_cell *cells;
};

struct part_plate plate_make(unsigned columns, unsigned rows, double thickness); /* all solid */
void plate_free(struct part_plate *plate);
struct part_plate plate_copy(const struct part_plate *plate);
struct part_cell *plate_cell(struct part_plate *plate, unsigned column, unsigned row);
struct shape plate_shape(const struct part_plate *plate);
/* False if some outline is hidden from the one round it, so that triangles would be turned over. */
bool plate_is_sound(const struct part_plate *plate);

/* Largest distance of two corners of its two outlines, each by itself. */
double feature_diameter(const struct part_feature *feature);
/* Largest distance of any two of its corners, those of the part's `thickness` counted for a hole.
 */
double feature_extent(const struct part_feature *feature, double thickness);

/* What is left when all features below `size` go (see plate_reduce), and how many went. A feature
 * that carries one that stays, stays; a hole with one small end only stays. */
struct part_counts {
    unsigned holes, cavities, bumps;
};
struct part_counts plate_reduce(struct part_plate *plate, double size, bool by_extent);

/* Handles of the plate's surface, and the fewest triangles that its planes can be made of; right
 * where no two features overlap and no outline has three corners in line. */
unsigned plate_genus(const struct part_plate *plate);
unsigned plate_outline_corners(const struct part_plate *plate);
unsigned plate_fewest_faces(const struct part_plate *plate);

/* Outlines. */
void feature_round(struct part_feature *feature, unsigned corners, double diameter);
void feature_slot(struct part_feature *feature, unsigned corners, double length, double width);
void feature_star(struct part_feature *feature, unsigned points, double outer, double inner);
void feature_square(struct part_feature *feature, double side);
/* The union of two rounds whose middles are `apart` from each other. */
void feature_peanut(struct part_feature *feature, unsigned corners, double diameter, double apart);

/* Table 2. Each with a `plate` from which the expectations come. */
struct part_plate part_box(void);              /* 4 holes, 1,612 triangles */
struct part_plate part_fixture(unsigned side); /* side * side holes: 10, 20 */
struct part_plate part_battery(void);          /* 9 bumps of three sizes */
struct part_plate part_block(unsigned number); /* 1 to 3: 16, 32, 80 holes */
struct shape part_disk(void);                  /* 10 small holes, one large: 752 triangles */
struct shape part_gear(void);                  /* 10 holes, 30 cavities */
struct shape part_cylinder(void);              /* 50 radial holes into one bore */

/* ---- changes ---- */
void shape_rotate(struct shape *shape, double x, double y, double z); /* radians, in this order */
void shape_scale(struct shape *shape, double x, double y, double z);
void shape_noise(struct shape *shape, double amount, uint64_t seed); /* up to it, each coordinate */

#endif
