#include "test_topology_kit.h"

#include <stdio.h>
#include <string.h>

#include "mesh/import.h"
#include "mesh/store.h"
#include "test_kit.h"

static void check(struct context *ctx, enum status status)
{
    if (status != STATUS_OK)
        fail_msg("status %d: %s", (int)status, ctx->error);
}

void operate(const struct shape *shape, const struct topology_options *options, unsigned slab_shift,
             struct operated *out)
{
    char input[4096], store[4096], chains[4096], output[4096];
    struct import_options import = {.slab_shift = slab_shift};
    snprintf(input, sizeof input, "%s", test_path("part.ply"));
    snprintf(store, sizeof store, "%s", test_path("part.store"));
    snprintf(chains, sizeof chains, "%s", test_path("part.chains"));
    snprintf(output, sizeof output, "%s", test_path("part-out.ply"));
    const char *inputs[] = {input};
    memset(out, 0, sizeof *out);
    context_init(&out->ctx);
    shape_write(shape, SHAPE_PLY_LITTLE, input);
    check(&out->ctx, store_build(&out->ctx, inputs, 1, store, &import, NULL));
    check(&out->ctx, topology_run(&out->ctx, store, chains, output, options, &out->report));
    check(&out->ctx, mesh_load(&out->ctx, output, &out->mesh));
    out->facts = facts_of(&out->mesh);
}

void operated_clear(struct operated *out)
{
    topology_report_clear(&out->ctx, &out->report);
    mesh_clear(&out->ctx, &out->mesh);
    assert_int_equal(atomic_load(&out->ctx.memory_now), 0);
    context_clear(&out->ctx);
}
