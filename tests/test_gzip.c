#include "test_gzip.h"

#include <libdeflate.h>
#include <stdio.h>
#include <stdlib.h>

size_t gzip_pack(const void *data, size_t size, int level, void *to, size_t room)
{
    struct libdeflate_compressor *compressor = libdeflate_alloc_compressor(level);
    size_t made = compressor ? libdeflate_gzip_compress(compressor, data, size, to, room) : 0;
    libdeflate_free_compressor(compressor);
    if (made == 0)
        abort();
    return made;
}

void gzip_write(const char *path, const void *data, size_t size)
{
    const size_t room = size + size / 64 + 1024;
    void *packed = malloc(room);
    FILE *file = fopen(path, "wb");
    if (!packed || !file)
        abort();
    size_t made = gzip_pack(data, size, 6, packed, room);
    if (fwrite(packed, 1, made, file) != made || fclose(file) != 0)
        abort();
    free(packed);
}
