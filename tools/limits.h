/*
 * How much of the machine a run may use when the user does not say: memory and threads, from the
 * machine, its control group and the batch system.
 */
#ifndef SPBM_TOOLS_LIMITS_H
#define SPBM_TOOLS_LIMITS_H

#include <stdint.h>

struct limits {
    uint64_t memory;         /* bytes */
    const char *memory_from; /* static words: where the figure comes from */
    unsigned threads;
    const char *threads_from;
};

/* Half of the least of: the machine's memory, that of the control group (version 1 or 2) and of
 * those above it, SLURM_MEM_PER_NODE. Threads: the least of the processors this process may run
 * on, SLURM_CPUS_PER_TASK and OMP_NUM_THREADS. */
void limits_find(struct limits *limits);

/* The strictest memory limit of this process's control groups, as the system under the folder
 * `root` tells it ("" for the real one): bytes, UINT64_MAX where there is none. */
uint64_t limits_of_groups(const char *root);

#endif
