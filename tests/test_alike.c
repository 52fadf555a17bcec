/* memcmp with cmocka's words; the first difference is told by its place. */
#include "test_alike.h"

#include <stdlib.h>

#include "test_files.h"
#include "test_kit.h"

void first_bytes_compare(struct first_bytes *first, unsigned char *bytes, size_t size)
{
    if (!first->bytes) {
        *first = (struct first_bytes){bytes, size};
        return;
    }
    assert_int_equal(size, first->size);
    assert_memory_equal(bytes, first->bytes, size);
    free(bytes);
}

void files_must_be_alike(const char *one, const char *other)
{
    size_t size, other_size;
    unsigned char *bytes = file_read(one, &size), *other_bytes = file_read(other, &other_size);
    assert_non_null(bytes);
    assert_non_null(other_bytes);
    assert_int_equal(size, other_size);
    assert_memory_equal(bytes, other_bytes, size);
    free(bytes);
    free(other_bytes);
}
