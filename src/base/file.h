/*
 * Files: outputs that appear whole or not at all, temporary files that nobody else can see, and
 * read-only windows onto large files.
 *
 * Output: a regular file is written under a temporary name beside its final one (exclusive
 * creation, the umask's mode), then fsync, rename, fsync of the directory. Temporary names that a
 * killed process left are removed by the next one that writes the same output. Whatever is not a
 * regular file (a pipe, /dev/null, `-` for standard output) is written directly. All writing goes
 * through write(2), never through a map: a full disk is an error, not a SIGBUS.
 *
 * Windows: a map of a part of a file. What is released is not resident any more, which is how the
 * memory budget is kept.
 */
#ifndef SPBM_BASE_FILE_H
#define SPBM_BASE_FILE_H

#include "report.h"

/* ---- outputs ---- */

struct output {
    struct context *ctx;
    int fd;
    int lock_fd;     /* while the temporary name stands and fd is closed: keeps its lock; else -1 */
    bool is_open;    /* all zero is an output that was never opened */
    bool is_regular; /* appears under its name only at output_commit */
    bool keeps_crc;  /* crc runs over all bytes appended */
    uint32_t crc;
    uint64_t position; /* bytes appended so far */
    char *path;        /* final name, owned */
    char *temp_path;   /* owned; NULL when written directly, or as long as it has no name */
    unsigned char *buffer;
    size_t used;
};

/*
 * Opens an output; "-" is standard output. A symbolic link to a file is followed: the file it leads
 * to is replaced. A directory, and a file that its mode protects from writing, are refused. On
 * failure nothing is left behind and *out needs no closing.
 */
enum status output_open(struct context *ctx, const char *path, struct output *out) MUST_CHECK;
/* After a failure of this or output_patch only output_discard makes sense. */
enum status output_append(struct output *out, const void *data, size_t size) MUST_CHECK;
/* Overwrites bytes already appended (regular files only: section tables are filled in late). */
enum status output_patch(struct output *out, uint64_t position, const void *data,
                         size_t size) MUST_CHECK;
/* Drops all that was appended. Only where output_can_restart: a file that had nothing in it. */
bool output_can_restart(const struct output *out);
enum status output_restart(struct output *out) MUST_CHECK;
/* Makes the file appear under its name; on failure it is removed. The output is closed either way.
 * `sync`: fsync before the rename, and of the directory after it (outputs that are kept), or not
 * (intermediate files). If only the last of these fails, the whole file stands under its name. */
enum status output_commit(struct output *out, bool sync) MUST_CHECK;
/* Closes and removes what was written. Safe on an output that was never opened or is closed. */
void output_discard(struct output *out);

/* STATUS_MISUSE if both names ("-" is standard input and output) lead to the same existing regular
 * file. */
enum status paths_must_differ(struct context *ctx, const char *input,
                              const char *output) MUST_CHECK;

/* ---- temporary files ---- */

/* Opens a file without a name (O_TMPFILE, or created exclusively with mode 0600 and unlinked at
 * once) in ctx->tmp_dir (where the tools also put $TMPDIR), else the directory of `beside`; where
 * `beside` is NULL, "-" or no regular file (/dev/null is not beside a disk), in /var/tmp. */
enum status temp_open(struct context *ctx, const char *beside, int *fd) MUST_CHECK;

/*
 * A spool: a growing array in memory that moves to a temporary file when it passes `memory_limit`
 * bytes. Appended front to back, then sealed, then read through one pointer. The one way to hold
 * data in proportion to the mesh.
 */
struct spool {
    struct context *ctx;
    const char *beside;    /* borrowed, for temp_open */
    uint64_t memory_limit; /* bytes held in memory before it goes to disk */
    uint64_t size;         /* bytes appended */
    unsigned char *memory; /* all of it, or, with a file, what is not yet written */
    size_t used;           /* bytes in memory */
    size_t capacity;
    int fd;    /* -1 while in memory */
    void *map; /* of the sealed file */
    bool is_sealed;
};

void spool_init(struct context *ctx, struct spool *spool, const char *beside,
                uint64_t memory_limit);
enum status spool_append(struct spool *spool, const void *data, size_t size) MUST_CHECK;
/* Room for `size` bytes at once, if they may be in memory: spares the growing, and most of the page
 * faults. `size` is what will come, or a guess: too little does no harm, too much is given back at
 * the sealing. */
enum status spool_reserve(struct spool *spool, uint64_t size) MUST_CHECK;
/* Appends `size` bytes at once, for the caller to fill in before he does anything else with the
 * spool, if they may be in memory; else nothing, and *room is NULL. */
enum status spool_extend(struct spool *spool, uint64_t size, void **room) MUST_CHECK;
/* Where the next `size` bytes will lie, if they have room in memory already, else NULL; spool_fill
 * appends as many of them as have been written there. */
void *spool_room(const struct spool *spool, uint64_t size);
void spool_fill(struct spool *spool, uint64_t size);
/* Ends the appending. *data is valid until spool_clear, and may be written to (a private change
 * of an in-memory spool, a shared one of a file). `*data` is never NULL, even for size 0. */
enum status spool_seal(struct spool *spool, void **data) MUST_CHECK;
/* What is written to the map of a sealed spool from here on stays out of the file (`true`), and is
 * gone when its pages leave the process, or goes there again (`false`). Not while anybody looks at
 * it; without effect on a spool in memory. */
enum status spool_set_private(struct spool *spool, bool is_private) MUST_CHECK;
/* Gives everything back. Safe on a spool that is all zero, and twice. */
void spool_clear(struct spool *spool);

/* Scratch of a known size, in memory or on a temporary file by the same rule; zeroed. */
enum status spool_scratch(struct context *ctx, struct spool *spool, const char *beside,
                          uint64_t memory_limit, uint64_t size, void **data) MUST_CHECK;

/* ---- reading ---- */

struct input_file {
    struct context *ctx;
    int fd;
    uint64_t size; /* at opening */
    char *path;    /* owned */
};

/* Opens a regular file for mapping. Directories and pipes are refused with words. */
enum status input_open(struct context *ctx, const char *path, struct input_file *file) MUST_CHECK;
void input_close(struct input_file *file);

/* Reads exactly `size` bytes at `offset`, or fails with STATUS_BAD_INPUT ("file ends at ..."). */
enum status input_read(struct input_file *file, uint64_t offset, void *to, size_t size) MUST_CHECK;

struct window {
    struct context *ctx;
    const unsigned char *data; /* the byte at `offset` asked for */
    size_t size;
    void *map; /* page-aligned base */
    size_t map_size;
};

/* Maps [offset, offset + size), which must lie within the file. `size` 0 is allowed. The whole
 * window counts as memory in use (memory_hold), as if all of it were resident. A file that
 * someone shortens while it is mapped raises SIGBUS on the next touch: windows are for our own
 * stores, which nobody rewrites in place; foreign inputs are read through instream.h. */
enum status window_open(struct input_file *file, uint64_t offset, uint64_t size,
                        struct window *window) MUST_CHECK;
void window_close(struct window *window); /* safe when never opened (all zero) */

#endif
