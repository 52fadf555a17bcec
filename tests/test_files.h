/* A folder of a test's own, and small files in it. */
#ifndef SPBM_TEST_FILES_H
#define SPBM_TEST_FILES_H

#include <stddef.h>

enum { TEST_PATH = 4096 };

/* Makes a new empty folder under $TMPDIR (else /tmp) and keeps its name in `folder`. */
void folder_make(char folder[TEST_PATH]);
/* Removes it with the files in it (no folders); returns how many files were left in it. */
int folder_remove(const char *folder);
/* Number of files in it, dotted ones too. */
int folder_count(const char *folder);
/* Joins into `path` and returns it. */
const char *folder_path(char path[TEST_PATH], const char *folder, const char *name);

void file_write(const char *path, const void *data, size_t size);
/* The whole file or all that comes through a pipe, a NUL behind it, to be freed; *size may be NULL.
 * NULL when there is no such file. */
unsigned char *file_read(const char *path, size_t *size);

#endif
