/*
 * Maps that memory.c has no use for at present, kept for the blocks to come: their pages are there
 * already. For memory.c and nobody else, but for beginning and end (memory_keep_spares).
 */
#ifndef SPBM_BASE_SPARE_MAPS_H
#define SPBM_BASE_SPARE_MAPS_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SPARE_MAPS_MAX = 48 };

struct spare_map {
    unsigned char *at;
    size_t bytes; /* whole pages */
};

struct spare_maps {
    pthread_mutex_t lock;
    _Atomic uint64_t bytes; /* of all of them */
    bool are_kept;
    unsigned count;
    struct spare_map list[SPARE_MAPS_MAX];
};

void spare_maps_init(struct spare_maps *spares);
void spare_maps_clear(struct spare_maps *spares);

/* A map in another size, both of whole pages, and perhaps at another place, where all of a large
 * one can be large pages. NULL, and nothing done, when the system refuses. */
void *map_resize(void *map, size_t old_bytes, size_t new_bytes);

/* Gives a map of whole pages away, to be kept or returned to the system. */
void spare_maps_put(struct spare_maps *spares, void *map, size_t bytes);
/* A readable and writable map of so many bytes; the first *used of them were used before and hold
 * anything, the others are zero. NULL when the system refuses. */
void *spare_maps_take(struct spare_maps *spares, size_t bytes, size_t *used);
/* Returns what is more than `most` bytes to the system. */
void spare_maps_trim(struct spare_maps *spares, uint64_t most);

#endif
