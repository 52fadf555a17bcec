/*
 * What every fuzz target has: the function that libFuzzer calls, and the inputs to begin with, made
 * in code. A target is linked twice: with libFuzzer (build option `fuzz`, scripts/fuzz.sh), and
 * with replay.c into a test that needs no clang.
 *
 * A target ends the process (abort) when something that must hold does not; crashes and bad memory
 * accesses are the sanitizers' part.
 */
#ifndef SPBM_FUZZ_TARGET_H
#define SPBM_FUZZ_TARGET_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mesh/mesh.h"
#include "test_facts.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

struct seed_taker {
    void (*take)(void *user, const void *data, size_t size);
    void *user;
};
void target_seeds(const struct seed_taker *taker);

/* Changes that keep the length are what gets behind the frame of a store or a chain file;
 * libFuzzer's own seldom do. True in targets that want mostly those. */
extern const bool target_keeps_length;

/* ---- what targets share (target.c) ---- */

/* Aborts with these words unless it is true. */
void require(bool condition, const char *what);

/* Bytes as a file without a name; `path` leads to it as long as `fd` is open. */
struct byte_file {
    int fd;
    char path[32];
};
struct byte_file byte_file_open(const uint8_t *data, size_t size);
void byte_file_close(struct byte_file *file);

/* "<a folder of this process in memory>/NAME"; the folder is removed at exit. */
const char *target_path(const char *name);
/* Nothing but the named file (NULL: nothing) may be there; it is removed. */
void target_clear(const char *name);

/* A context for one run. A budget, so that a claim believed shows. */
void target_context(struct context *ctx);
/* What any call may end in on damaged input: done, target missed, or bad input with one line of
 * words. */
void require_fair_end(const struct context *ctx, enum status status);
/* The end of a run on such input: fair, with all memory given back. Frees the context. */
void target_end(struct context *ctx, enum status status);
/* The store passes its check and can be read; the file can be read; and either is a manifold (M1 to
 * M4) of finite coordinates without unused vertices. Their facts. */
struct facts require_manifold_store(const char *path);
struct facts require_manifold_file(const char *path);

/* Small surfaces of every kind: closed, with border, of genus 1, several, not orientable, folded.
 * NULL-less; `count` of them. */
enum { TARGET_SHAPES = 9 };
struct shape target_shape(unsigned which);

#endif
