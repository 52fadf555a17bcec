/* What must be the same bytes. */
#ifndef SPBM_TEST_ALIKE_H
#define SPBM_TEST_ALIKE_H

#include <stddef.h>

/* The bytes of the first of several files that must be alike; all zero at first. */
struct first_bytes {
    unsigned char *bytes; /* to be freed in the end */
    size_t size;
};

/* Keeps the first bytes given, and fails the test when later ones differ. Takes the bytes. */
void first_bytes_compare(struct first_bytes *first, unsigned char *bytes, size_t size);

/* Fails the test when one of two files is not there or they differ. */
void files_must_be_alike(const char *one, const char *other);

#endif
