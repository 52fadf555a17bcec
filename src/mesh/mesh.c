/*
 * The in-memory mesh. Its arrays come from memory_take with exactly the sizes that the counts give,
 * so that they can be released without being told how they were made.
 */
#include "mesh/mesh.h"

#include <string.h>

#include "base/memory.h"

void mesh_clear(struct context *ctx, struct mesh *mesh)
{
    memory_release(ctx, &mesh->positions, mesh->vertex_count, 3 * sizeof(double));
    memory_release(ctx, &mesh->faces, mesh->face_count, 3 * sizeof(uint32_t));
    memory_release(ctx, &mesh->records, mesh->vertex_count, mesh->attributes.stride);
    memset(mesh, 0, sizeof *mesh);
}
