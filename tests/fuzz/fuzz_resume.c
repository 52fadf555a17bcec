/*
 * The state of an interrupted run, of any bytes, where the same job and another one find it. The
 * same job goes on only if the state repeats its key to the byte, and else begins anew; another job
 * removes it unless it names inputs that are as they were. Nothing else is removed.
 */
#include "target.h"

#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "api_resume.h"
#include "test_files.h"
#include "test_shapes.h"

const bool target_keeps_length = true;

struct place {
    char dir[1024], input[1024], other[1024], bystander[2048];
};

static void write_file(const char *path, const void *data, size_t size)
{
    FILE *file = fopen(path, "wb");
    require(file && fwrite(data, 1, size, file) == size && fclose(file) == 0,
            "a file can be written");
}

static const struct place *make_place(void)
{
    static struct place place;
    if (!place.dir[0]) {
        snprintf(place.dir, sizeof place.dir, "%s", test_path("runs"));
        snprintf(place.input, sizeof place.input, "%s", test_path("in.ply"));
        snprintf(place.other, sizeof place.other, "%s", test_path("other.ply"));
        snprintf(place.bystander, sizeof place.bystander, "%s/spbm-run-notes", place.dir);
        require(mkdir(place.dir, 0700) == 0, "a folder can be made");
        write_file(place.input, "mesh", 4);
        write_file(place.other, "other mesh", 10);
        write_file(place.bystander, "precious", 8);
    }
    return &place;
}

static void open_run(struct context *ctx, const struct place *place, const char *input,
                     struct run_folder *folder)
{
    spbm_simplify_options options;
    spbm_simplify_defaults(&options);
    options.target.count = 1;
    options.target.values[0] = 100;
    target_context(ctx);
    require(run_folder_open(ctx, place->dir, &input, 1, "out.ply", &options, folder) == STATUS_OK,
            "a folder of ours can be had, whatever lies in it");
}

static void close_run(struct context *ctx, struct run_folder *folder, bool keep)
{
    run_folder_close(folder, keep);
    require(ctx->memory_now == 0, "all memory is given back");
    context_clear(ctx);
}

static bool is_there(const char *path)
{
    return access(path, F_OK) == 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const struct place *place = make_place();
    struct context ctx;
    struct run_folder folder;
    char state[PATH_MAX], store[PATH_MAX], path[PATH_MAX];
    open_run(&ctx, place, place->input, &folder);
    require(!folder.is_resumed, "nothing is left of the last input");
    bool has_state = run_folder_file(&folder, "job.state", state);
    require(has_state && !run_folder_file(&folder, "mesh.store", store), "a new run has a state");
    snprintf(path, sizeof path, "%s", folder.path);
    close_run(&ctx, &folder, true);

    size_t right_size;
    unsigned char *right = file_read(state, &right_size);
    require(right != NULL, "the state can be read");
    bool is_same = right_size == size && memcmp(right, data, size) == 0;
    free(right);
    write_file(state, data, size);
    write_file(store, "store", 5);
    open_run(&ctx, place, place->input, &folder);
    require(folder.is_resumed || !is_same, "a run goes on from its state");
    require(run_folder_file(&folder, "mesh.store", store) == folder.is_resumed,
            "what is no state of this job is not gone on from");
    require(run_folder_verify(&folder) == STATUS_OK, "the state is the job's own now");
    close_run(&ctx, &folder, true);

    write_file(state, data, size);
    open_run(&ctx, place, place->other, &folder);
    require(!folder.is_resumed && strcmp(folder.path, path) != 0, "another job has its own folder");
    require(is_there(path) || !is_same, "what can be resumed is left");
    close_run(&ctx, &folder, false);

    /* Removed by the name that it has, in case it is still there. */
    if (is_there(path)) {
        unlink(state);
        unlink(store);
        require(rmdir(path) == 0, "nothing else is in it");
    }
    require(is_there(place->bystander) && is_there(place->input), "nothing else is removed");
    return 0;
}

void target_seeds(const struct seed_taker *taker)
{
    const struct place *place = make_place();
    struct context ctx;
    struct run_folder folder;
    char state[PATH_MAX];
    for (unsigned which = 0; which < 2; which++) {
        open_run(&ctx, place, which ? place->other : place->input, &folder);
        require(run_folder_file(&folder, "job.state", state), "a new run has a state");
        size_t size;
        unsigned char *bytes = file_read(state, &size);
        require(bytes != NULL, "the state can be read");
        close_run(&ctx, &folder, false);
        taker->take(taker->user, bytes, size);
        free(bytes);
    }
    taker->take(taker->user, "", 0);
}
