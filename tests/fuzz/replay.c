/*
 * A fuzz target without libFuzzer: its seeds as they are, then so many random changes of them,
 * always the same; or the files named on the command line; or, with --seeds DIR, the seeds as files
 * for libFuzzer to begin with. Not guided by coverage: it keeps targets and seeds alive everywhere.
 */
#include "target.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test_files.h"
#include "test_shapes.h"

struct replay {
    const char *folder; /* where seeds go, or NULL: they are run */
    const char *last;   /* $SPBM_FUZZ_LAST: a file that each input is written to before it is run */
    unsigned rounds;    /* changes of each seed */
    unsigned seeds;
    uint64_t random;
};

static void change(uint8_t *data, size_t *size, uint64_t *random)
{
    size_t at = (size_t)random_below(random, *size);
    size_t room = *size - at;
    size_t some = 1 + (size_t)random_below(random, room < 16 ? room : 16);
    uint64_t kind = random_below(random, target_keeps_length ? 4 : 7);
    if (kind == 0) {
        data[at] ^= (uint8_t)(1u << random_below(random, 8));
    } else if (kind == 1) {
        data[at] = (uint8_t)random_next(random);
    } else if (kind == 2) {
        memset(data + at, random_below(random, 2) ? 0xff : 0, some < 4 ? some : 4);
    } else if (kind == 3) {
        size_t from = (size_t)random_below(random, *size - some + 1);
        memmove(data + at, data + from, some < room ? some : room);
    } else if (kind == 4) {
        memmove(data + at, data + at + some, room - some);
        *size -= some;
    } else if (kind == 5 && *size > 1 && random_below(random, 4) == 0) {
        *size = at + 1;
    } else { /* a block twice: the caller has left room */
        memmove(data + at + some, data + at, room);
        *size += some;
    }
}

static void write_input(const char *path, const void *data, size_t size)
{
    FILE *file = fopen(path, "wb");
    require(file && fwrite(data, 1, size, file) == size && fclose(file) == 0,
            "the input can be kept");
}

static void write_seed(const struct replay *replay, const void *data, size_t size)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/seed-%u", replay->folder, replay->seeds);
    write_input(path, data, size);
}

static void take(void *user, const void *data, size_t size)
{
    enum { CHANGES = 4, LONGER = 16 * CHANGES };
    struct replay *replay = user;
    if (replay->folder) {
        write_seed(replay, data, size);
        replay->seeds++;
        return;
    }
    replay->seeds++;
    for (unsigned round = 0; round <= replay->rounds; round++) {
        /* A block of just that size, so that a sanitizer sees reads behind its end. */
        uint8_t *changed = malloc(size + LONGER);
        require(changed != NULL, "memory");
        memcpy(changed, data, size);
        size_t length = size;
        for (uint64_t i = round ? 1 + random_below(&replay->random, CHANGES) : 0; i > 0; i--)
            if (length > 0)
                change(changed, &length, &replay->random);
        uint8_t *exact = malloc(length ? length : 1);
        require(exact != NULL, "memory");
        memcpy(exact, changed, length);
        free(changed);
        if (replay->last)
            write_input(replay->last, exact, length);
        LLVMFuzzerTestOneInput(exact, length);
        free(exact);
    }
}

int main(int argc, char **argv)
{
    const char *rounds = getenv("SPBM_FUZZ_ROUNDS");
    struct replay replay = {.rounds = rounds ? (unsigned)atoi(rounds) : 100,
                            .random = 7,
                            .last = getenv("SPBM_FUZZ_LAST")};
    if (argc == 3 && strcmp(argv[1], "--seeds") == 0) {
        replay.folder = argv[2];
    } else if (argc > 1) {
        for (int i = 1; i < argc; i++) {
            size_t size;
            unsigned char *data = file_read(argv[i], &size);
            require(data != NULL, "the file can be read");
            LLVMFuzzerTestOneInput(data, size);
            free(data);
        }
        return 0;
    }
    struct seed_taker taker = {take, &replay};
    target_seeds(&taker);
    printf("%u seeds, %u changes of each\n", replay.seeds, replay.folder ? 0 : replay.rounds);
    return 0;
}
