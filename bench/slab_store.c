/*
 * slab_store: imports a mesh with slabs of another size than the format's, for bench/slabs.py,
 * which asks what slabs cost.
 */
#include <stdio.h>
#include <stdlib.h>

#include "base/report.h"
#include "mesh/store.h"

int main(int argc, char **argv)
{
    if (argc != 4) {
        fprintf(stderr, "usage: slab_store IN STORE SHIFT (slabs of 2^SHIFT faces)\n");
        return 2;
    }
    struct context ctx;
    context_init(&ctx);
    struct import_options options = {.slab_shift = (unsigned)strtoul(argv[3], NULL, 10)};
    const char *input = argv[1];
    const enum status status = store_build(&ctx, &input, 1, argv[2], &options, NULL);
    if (status != STATUS_OK)
        fprintf(stderr, "slab_store: %s\n", "the import failed");
    context_clear(&ctx);
    return status == STATUS_OK ? 0 : 1;
}
