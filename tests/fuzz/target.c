/*
 * What the fuzz targets share: bytes as files in memory, and the checks of meshes.
 */
#include "target.h"

#include <dirent.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mesh/import.h"
#include "mesh/store.h"
#include "test_shapes.h"

void require(bool condition, const char *what)
{
    if (condition)
        return;
    fprintf(stderr, "does not hold: %s\n", what);
    abort();
}

struct byte_file byte_file_open(const uint8_t *data, size_t size)
{
    struct byte_file file = {.fd = memfd_create("fuzz", MFD_CLOEXEC)};
    require(file.fd >= 0, "a file in memory can be had");
    for (size_t done = 0; done < size;) {
        ssize_t written = write(file.fd, data + done, size - done);
        require(written > 0, "a file in memory can be written");
        done += (size_t)written;
    }
    snprintf(file.path, sizeof file.path, "/proc/self/fd/%d", file.fd);
    return file;
}

void byte_file_close(struct byte_file *file)
{
    close(file->fd);
    file->fd = -1;
}

/* ---- the folder ---- */

static char folder[64];
static pid_t folder_owner;

static void remove_folder(void)
{
    if (folder[0] && folder_owner == getpid()) {
        target_clear(NULL);
        rmdir(folder);
    }
}

const char *target_path(const char *name)
{
    static char path[128];
    if (!folder[0]) {
        struct stat info;
        bool in_memory = stat("/dev/shm", &info) == 0 && S_ISDIR(info.st_mode);
        snprintf(folder, sizeof folder, "%s/spbm-fuzz-XXXXXX", in_memory ? "/dev/shm" : "/tmp");
        require(mkdtemp(folder) != NULL, "a folder can be made");
        folder_owner = getpid();
        atexit(remove_folder);
    }
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return path;
}

void target_clear(const char *name)
{
    DIR *list = opendir(folder);
    if (!list)
        return;
    bool is_clean = true;
    for (struct dirent *entry; (entry = readdir(list));) {
        if (strcmp(entry->d_name, ".") == 0 || strcmp(entry->d_name, "..") == 0)
            continue;
        if (!name || strcmp(entry->d_name, name) != 0) {
            fprintf(stderr, "left behind: %s\n", entry->d_name);
            is_clean = false;
        }
        unlinkat(dirfd(list), entry->d_name, 0);
    }
    closedir(list);
    require(is_clean, "no file is left behind");
}

/* ---- what must hold ---- */

void target_context(struct context *ctx)
{
    context_init(ctx);
    ctx->memory_budget = 256u << 20;
}

void require_fair_end(const struct context *ctx, enum status status)
{
    if (status == STATUS_OK || status == STATUS_TARGET_MISSED)
        return;
    if (status != STATUS_BAD_INPUT)
        fprintf(stderr, "status %d: %s\n", (int)status, ctx->error);
    require(status == STATUS_BAD_INPUT, "damaged input is refused as that");
    require(ctx->error[0] && !strchr(ctx->error, '\n'), "a failure has one line of words");
}

void target_end(struct context *ctx, enum status status)
{
    require_fair_end(ctx, status);
    require(ctx->memory_now == 0, "all memory is given back");
    context_clear(ctx);
}

/* M1 to M4, finite coordinates, no unused vertices. */
static struct facts require_manifold(const struct mesh *mesh)
{
    for (uint64_t i = 0; i < 3 * mesh->vertex_count; i++)
        require(isfinite(mesh->positions[i]), "coordinates are finite");
    struct facts facts = facts_of(mesh);
    require(facts_manifold(&facts) && facts.unused == 0, "the mesh is manifold");
    return facts;
}

struct facts require_manifold_store(const char *path)
{
    struct context ctx;
    struct store *store = NULL;
    struct mesh mesh = {.vertex_count = 0};
    target_context(&ctx);
    require(store_check(&ctx, path) == STATUS_OK, "the store passes its check");
    require(store_open(&ctx, path, true, &store) == STATUS_OK &&
                store_load(store, &mesh) == STATUS_OK,
            "the store can be read");
    struct facts facts = require_manifold(&mesh);
    mesh_clear(&ctx, &mesh);
    store_close(&store);
    target_end(&ctx, STATUS_OK);
    return facts;
}

struct facts require_manifold_file(const char *path)
{
    struct context ctx;
    struct mesh mesh;
    target_context(&ctx);
    require(mesh_load(&ctx, path, &mesh) == STATUS_OK, "an output can be read");
    struct facts facts = require_manifold(&mesh);
    mesh_clear(&ctx, &mesh);
    target_end(&ctx, STATUS_OK);
    return facts;
}

/* ---- shapes ---- */

/* Two tetrahedra's worth of faces folded flat on themselves, with a face of no area between. */
static struct shape folded(void)
{
    struct shape shape = shape_grid(2, 1);
    uint32_t tip = shape_vertex(&shape, 0.5, 0.5, 0);
    shape_triangle(&shape, 1, 0, tip);
    shape_triangle(&shape, 0, 3, tip);
    return shape;
}

struct shape target_shape(unsigned which)
{
    struct shape shape;
    switch (which) {
    case 0:
        return shape_tetrahedron();
    case 1:
        return shape_cube_quads();
    case 2:
        return shape_noisy_sphere(2, 0.05, 1);
    case 3:
        return shape_torus(6, 4);
    case 4:
        return shape_grid_with_holes(8, 4);
    case 5:
        return shape_mobius(8, 2);
    case 6:
        shape = shape_single_triangle();
        struct shape ramp = shape_spiral_ramp(2, 8);
        shape_append(&shape, &ramp);
        shape_free(&ramp);
        return shape;
    case 7:
        return folded();
    default:
        return shape_spheres_touching_edge(0);
    }
}
