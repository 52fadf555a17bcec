/*
 * Status codes: what a library call ended with. The words for a failure travel in the context
 * (report.h); the exit codes of the program are made from these in tools/ only.
 */
#ifndef SPBM_BASE_STATUS_H
#define SPBM_BASE_STATUS_H

/* The values are part of the ABI: spbm.h repeats them and api.c asserts that they agree. */
enum status {
    STATUS_OK = 0,
    STATUS_BAD_INPUT = 1, /* the input is damaged, unsupported or inconsistent */
    STATUS_MISUSE = 2,    /* the caller's options contradict each other or are out of range */
    STATUS_TARGET_MISSED =
        3,                /* output is whole, but the count or error asked for was not reached */
    STATUS_NO_MEMORY = 4, /* an allocation failed or the budget does not allow it */
    STATUS_NO_SPACE = 5,  /* the disk is full */
    STATUS_IO = 6,        /* any other failed system call on a file */
    STATUS_CANCELLED = 7, /* the caller's cancel callback asked to stop */
    STATUS_INTERNAL = 8   /* an invariant did not hold: a defect of ours, never the user's */
};

/* Every function that can fail is marked, so that a dropped status is a warning. */
#define MUST_CHECK __attribute__((warn_unused_result))

#endif
