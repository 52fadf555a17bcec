/*
 * A sieve for soups: of the corners that come, most that coincide with an earlier one stay in it.
 */
#ifndef SPBM_MESH_SIEVE_H
#define SPBM_MESH_SIEVE_H

#include "base/report.h"

struct sieve_place { /* a vertex that has come by */
    uint32_t bits[3];
    uint32_t id;
};

struct sieve {
    struct context *ctx;  /* NULL: it lets everything through */
    uint64_t most_places; /* that there is room for */
    struct sieve_place *places;
    size_t place_count; /* a power of 2, or 0 */
    uint64_t filled;
    bool is_full;  /* it cannot grow */
    unsigned idle; /* batches in a row of which it held less than half when it was full */
    /* corners, by the number that the input gives them: */
    uint64_t first; /* the first one that faces may still name */
    uint32_t *ids;  /* and their ids from there on */
    size_t id_count, id_capacity;
    float *kept; /* of the last batch */
    size_t kept_capacity;
    const float *out; /* the new vertices of the last batch */
    uint64_t held;    /* corners that stayed, of all inputs */
};

/* `memory`: bytes that the sieve may take. */
void sieve_open(struct context *ctx, struct sieve *sieve, uint64_t memory);
void sieve_close(struct sieve *sieve); /* safe when all zero */
/* Another input begins; its corners are numbered from 0. */
void sieve_restart(struct sieve *sieve);

/* The next `count` corners: positions of those that are new vertices, which get the ids from
 * `next_id` on, in sieve->out, *kept of them. Coordinates are equal as numbers (-0 is 0). */
enum status sieve_take(struct sieve *sieve, const float *floats, size_t count, uint64_t next_id,
                       size_t *kept) MUST_CHECK;
/* The next `count` corners are vertices of their own. */
enum status sieve_pass(struct sieve *sieve, size_t count, uint64_t next_id) MUST_CHECK;

/* The ids of `count` corners, in place; no corner up to the last one named will be named again.
 * STATUS_INTERNAL if one has not come or has been named. */
enum status sieve_name(struct sieve *sieve, uint32_t *corners, size_t count) MUST_CHECK;

#endif
