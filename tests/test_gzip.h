/* gzip files made in tests: by libdeflate, which the reading of gzip has nothing to do with. */
#ifndef SPBM_TEST_GZIP_H
#define SPBM_TEST_GZIP_H

#include <stddef.h>

/* One member of `size` bytes at `to`, whose `room` is enough (else the process ends); its size.
 * Level 0, stored blocks only, to 12. */
size_t gzip_pack(const void *data, size_t size, int level, void *to, size_t room);
/* A file that is one member. */
void gzip_write(const char *path, const void *data, size_t size);

#endif
