/*
 * Sorting what does not fit.
 *
 * A sort in a mapped file pages at random once the file is larger than the memory. So records are
 * collected while they fit into half of the limit (the other half is the radix sort's scratch),
 * sorted, and written as a run; then the runs are merged, reading each in large pieces. All runs
 * lie one behind the other in one temporary file. Where there are more runs than the limit has room
 * for pieces of a useful size, groups of neighbouring runs are merged into longer ones first.
 *
 * The merge is a tree of losers (Knuth, The Art of Computer Programming 3, section 5.4.1): one
 * comparison a level of the tree, log2(runs) for a record. Equal keys come from the lower run
 * first: runs are in the order of insertion and are kept so, which makes the whole sort stable.
 */
#include "base/external_sort.h"

#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "base/bytes.h"
#include "base/descriptor.h"
#include "base/file.h"
#include "base/memory.h"
#include "base/radix_sort.h"

enum {
    LARGEST_RECORD = 64,
    LEAST_RECORDS = 16,      /* in a run, however small the limit */
    USEFUL_PIECE = 64 << 10, /* bytes of a run worth a read */
    LARGEST_PIECE = 4 << 20,
    LEAST_FAN_IN = 4,
    LARGEST_FAN_IN = 1024
};

static const char sort_name[] = "a temporary file of sorting";
static const uint32_t nobody = UINT32_MAX;

/* Records [offset, offset + count * record_size) of the temporary file, in order. */
struct run {
    uint64_t offset; /* bytes */
    uint64_t count;  /* records */
};

/* A run being read: `left` records still in the file, [begin, end) of `piece` not yet taken. */
struct source {
    uint64_t offset;
    uint64_t left;
    unsigned char *piece;
    size_t begin, end;  /* records */
    uint64_t high, low; /* key of the record at `begin` */
    bool is_empty;
};

struct merge {
    struct source *sources;
    uint32_t
        *losers; /* [0]: the winner; [node]: who lost there; leaf i hangs under (count + i) / 2 */
    uint32_t count;
    unsigned char *pieces; /* count + 1 pieces; the last one is for the output */
    size_t piece_records;
};

enum sorter_state { ADDING, IN_MEMORY, MERGING };

struct sorter {
    struct context *ctx;
    const char *beside;
    size_t record_size;
    unsigned key_words;
    unsigned ordered_bits;
    uint64_t memory_limit;
    uint64_t added;
    enum sorter_state state;

    unsigned char *records; /* being collected, or all of them, sorted */
    size_t count, capacity;
    size_t run_records; /* collected before they become a run */

    int fd;
    uint64_t file_size;
    struct run *runs;
    size_t run_count, run_capacity;
    struct merge merge;
};

enum status sorter_open(struct context *ctx, size_t record_size, size_t key_size,
                        uint64_t memory_limit, const char *beside, struct sorter **out)
{
    *out = NULL;
    if (record_size > LARGEST_RECORD || key_size > record_size || (key_size != 8 && key_size != 16))
        return fail(ctx, STATUS_INTERNAL, "records of %zu bytes with keys of %zu can't be sorted",
                    record_size, key_size);
    struct sorter *sorter;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *sorter, &sorter);
    if (status != STATUS_OK)
        return status;
    sorter->ctx = ctx;
    sorter->beside = beside;
    sorter->record_size = record_size;
    sorter->key_words = (unsigned)(key_size / 8);
    sorter->memory_limit = memory_limit;
    sorter->fd = -1;
    uint64_t records = memory_limit / (2 * record_size);
    if (records > PTRDIFF_MAX / (2 * LARGEST_RECORD))
        records = PTRDIFF_MAX / (2 * LARGEST_RECORD);
    sorter->run_records = records < LEAST_RECORDS ? LEAST_RECORDS : (size_t)records;
    *out = sorter;
    return STATUS_OK;
}

static void release_records(struct sorter *sorter)
{
    memory_release(sorter->ctx, &sorter->records, sorter->capacity, sorter->record_size);
    sorter->capacity = 0;
}

static void merge_close(struct sorter *sorter)
{
    struct merge *merge = &sorter->merge;
    memory_release(sorter->ctx, &merge->sources, merge->count, sizeof *merge->sources);
    memory_release(sorter->ctx, &merge->losers, merge->count, sizeof *merge->losers);
    memory_release(sorter->ctx, &merge->pieces, ((size_t)merge->count + 1) * merge->piece_records,
                   sorter->record_size);
    memset(merge, 0, sizeof *merge);
}

void sorter_close(struct sorter **sorter)
{
    struct sorter *closing = *sorter;
    if (!closing)
        return;
    *sorter = NULL;
    merge_close(closing);
    release_records(closing);
    memory_release(closing->ctx, &closing->runs, closing->run_capacity, sizeof *closing->runs);
    if (closing->fd >= 0)
        close(closing->fd);
    memory_release(closing->ctx, &closing, 1, sizeof *closing);
}

uint64_t sorter_count(const struct sorter *sorter)
{
    return sorter->added;
}

void sorter_comes_ordered(struct sorter *sorter, unsigned bits)
{
    sorter->ordered_bits = bits;
}

/* ---- collecting and spilling ---- */

/* Sorts the collected records; they are in sorter->records again. */
static enum status sort_collected(struct sorter *sorter)
{
    unsigned char *scratch, *sorted;
    enum status status = memory_take(sorter->ctx, sorter->capacity, sorter->record_size, &scratch);
    if (status != STATUS_OK)
        return status;
    if (sorter->count == sorter->capacity)
        memory_use_whole(scratch, sorter->capacity, sorter->record_size);
    status =
        radix_sort_above(sorter->ctx, sorter->records, scratch, sorter->count, sorter->record_size,
                         sorter->key_words, sorter->ordered_bits, &sorted);
    if (status == STATUS_OK && sorted == scratch) {
        scratch = sorter->records;
        sorter->records = sorted;
    }
    memory_release(sorter->ctx, &scratch, sorter->capacity, sorter->record_size);
    return status;
}

static enum status add_run(struct sorter *sorter, uint64_t offset, uint64_t count)
{
    enum status status = memory_reserve(sorter->ctx, &sorter->runs, &sorter->run_capacity,
                                        sorter->run_count + 1, sizeof *sorter->runs);
    if (status == STATUS_OK)
        sorter->runs[sorter->run_count++] = (struct run){.offset = offset, .count = count};
    return status;
}

/* Sorts and writes what is collected as a run. */
static enum status spill(struct sorter *sorter)
{
    enum status status = sort_collected(sorter);
    if (status == STATUS_OK && sorter->fd < 0)
        status = temp_open(sorter->ctx, sorter->beside, &sorter->fd);
    size_t bytes = sorter->count * sorter->record_size;
    if (status == STATUS_OK)
        status = descriptor_write(sorter->ctx, sorter->fd, sort_name, sorter->records, bytes);
    if (status == STATUS_OK)
        status = add_run(sorter, sorter->file_size, sorter->count);
    if (status != STATUS_OK)
        return status;
    sorter->file_size += bytes;
    sorter->count = 0;
    return STATUS_OK;
}

/* Makes room for at least one more record; doubles, but never beyond a run. */
static enum status grow(struct sorter *sorter)
{
    size_t wanted = sorter->capacity < 512 ? 1024 : 2 * sorter->capacity;
    if (wanted > sorter->run_records)
        wanted = sorter->run_records;
    enum status status =
        memory_resize(sorter->ctx, &sorter->records, sorter->capacity, wanted, sorter->record_size);
    if (status == STATUS_OK)
        sorter->capacity = wanted;
    return status;
}

enum status sorter_expect(struct sorter *sorter, uint64_t count)
{
    const size_t wanted = count < sorter->run_records ? (size_t)count : sorter->run_records;
    if (sorter->state != ADDING || wanted <= sorter->capacity)
        return STATUS_OK;
    enum status status =
        memory_resize(sorter->ctx, &sorter->records, sorter->capacity, wanted, sorter->record_size);
    if (status != STATUS_OK)
        return status;
    sorter->capacity = wanted;
    memory_use_whole(sorter->records, wanted, sorter->record_size);
    return STATUS_OK;
}

enum status sorter_add(struct sorter *sorter, const void *records, size_t count)
{
    if (sorter->state != ADDING)
        return fail(sorter->ctx, STATUS_INTERNAL, "records for a sorter that is finished");
    const unsigned char *from = records;
    while (count > 0) {
        enum status status = STATUS_OK;
        if (sorter->count == sorter->run_records)
            status = spill(sorter);
        if (status == STATUS_OK && sorter->count == sorter->capacity)
            status = grow(sorter);
        if (status != STATUS_OK)
            return status;
        size_t room = sorter->capacity - sorter->count;
        size_t now = count < room ? count : room;
        memcpy(sorter->records + sorter->count * sorter->record_size, from,
               now * sorter->record_size);
        sorter->count += now;
        sorter->added += now;
        from += now * sorter->record_size;
        count -= now;
    }
    return STATUS_OK;
}

/* ---- merging ---- */

/* Sees to it that source `index` shows its next record, or is empty. */
static enum status source_refill(struct sorter *sorter, struct source *source)
{
    if (source->begin == source->end) {
        if (source->left == 0) {
            source->is_empty = true;
            return STATUS_OK;
        }
        size_t most = sorter->merge.piece_records;
        size_t records = source->left < most ? (size_t)source->left : most;
        size_t bytes = records * sorter->record_size;
        enum status status = descriptor_read_at(sorter->ctx, sorter->fd, sort_name, source->offset,
                                                source->piece, bytes);
        if (status != STATUS_OK)
            return status;
        source->offset += bytes;
        source->left -= records;
        source->begin = 0;
        source->end = records;
    }
    const unsigned char *record = source->piece + source->begin * sorter->record_size;
    source->high = load_u64(record);
    source->low = sorter->key_words > 1 ? load_u64(record + 8) : 0;
    return STATUS_OK;
}

/* Whether the record of source a comes before that of b. */
static bool wins(const struct merge *merge, uint32_t a, uint32_t b)
{
    const struct source *one = &merge->sources[a], *other = &merge->sources[b];
    if (one->is_empty != other->is_empty)
        return other->is_empty;
    if (one->high != other->high)
        return one->high < other->high;
    if (one->low != other->low)
        return one->low < other->low;
    return a < b;
}

/* Plays source `player` up from its leaf: the loser of each game stays there, the winner goes on.
 * At a node that nobody has reached yet (while the tree is built) it waits. */
static void play(struct merge *merge, uint32_t player)
{
    uint32_t winner = player;
    for (uint32_t node = (merge->count + player) / 2; node > 0; node /= 2) {
        uint32_t waiting = merge->losers[node];
        if (waiting == nobody) {
            merge->losers[node] = winner;
            return;
        }
        if (wins(merge, waiting, winner)) {
            merge->losers[node] = winner;
            winner = waiting;
        }
    }
    merge->losers[0] = winner;
}

/* Bytes of each of `pieces` equal pieces that the limit has room for, in records. */
static size_t piece_records(const struct sorter *sorter, size_t pieces)
{
    uint64_t bytes = sorter->memory_limit / pieces;
    if (bytes > LARGEST_PIECE)
        bytes = LARGEST_PIECE;
    size_t records = (size_t)bytes / sorter->record_size;
    return records > 0 ? records : 1;
}

static enum status merge_open(struct sorter *sorter, const struct run *runs, size_t count)
{
    struct context *ctx = sorter->ctx;
    struct merge *merge = &sorter->merge;
    merge->count = (uint32_t)count;
    merge->piece_records = piece_records(sorter, count + 1);
    enum status status = memory_take_zeroed(ctx, count, sizeof *merge->sources, &merge->sources);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *merge->losers, &merge->losers);
    if (status == STATUS_OK)
        status = memory_take(ctx, (count + 1) * merge->piece_records, sorter->record_size,
                             &merge->pieces);
    for (size_t i = 0; i < count && status == STATUS_OK; i++) {
        struct source *source = &merge->sources[i];
        source->offset = runs[i].offset;
        source->left = runs[i].count;
        source->piece = merge->pieces + i * merge->piece_records * sorter->record_size;
        status = source_refill(sorter, source);
    }
    if (status != STATUS_OK) {
        merge_close(sorter);
        return status;
    }
    for (uint32_t i = 0; i < merge->count; i++)
        merge->losers[i] = nobody;
    for (uint32_t i = 0; i < merge->count; i++)
        play(merge, i);
    return STATUS_OK;
}

/* Fills the output piece with the next records; *count 0 at the end. */
static enum status merge_next(struct sorter *sorter, const unsigned char **records, size_t *count)
{
    struct merge *merge = &sorter->merge;
    size_t size = sorter->record_size, made = 0;
    unsigned char *output = merge->pieces + (size_t)merge->count * merge->piece_records * size;
    while (made < merge->piece_records) {
        uint32_t winner = merge->losers[0];
        struct source *source = &merge->sources[winner];
        if (source->is_empty)
            break;
        memcpy(output + made * size, source->piece + source->begin * size, size);
        made++;
        source->begin++;
        enum status status = source_refill(sorter, source);
        if (status != STATUS_OK)
            return status;
        play(merge, winner);
    }
    *records = output;
    *count = made;
    return STATUS_OK;
}

/* Merges `count` runs into one that is written to `fd`; *written is how many records that were. */
static enum status merge_group(struct sorter *sorter, const struct run *runs, size_t count, int fd,
                               uint64_t *written)
{
    *written = 0;
    enum status status = merge_open(sorter, runs, count);
    while (status == STATUS_OK) {
        const unsigned char *records;
        size_t made;
        status = merge_next(sorter, &records, &made);
        if (status != STATUS_OK || made == 0)
            break;
        status = descriptor_write(sorter->ctx, fd, sort_name, records, made * sorter->record_size);
        *written += made;
    }
    merge_close(sorter);
    return status;
}

static size_t fan_in(const struct sorter *sorter)
{
    uint64_t fan = sorter->memory_limit / USEFUL_PIECE;
    return fan < LEAST_FAN_IN ? LEAST_FAN_IN : fan > LARGEST_FAN_IN ? LARGEST_FAN_IN : (size_t)fan;
}

/* Merges neighbouring runs in groups into a new file, so that there are `fan` times fewer. */
static enum status merge_pass(struct sorter *sorter, size_t fan)
{
    int fd;
    enum status status = temp_open(sorter->ctx, sorter->beside, &fd);
    size_t made = 0;
    uint64_t offset = 0;
    for (size_t first = 0; first < sorter->run_count && status == STATUS_OK; first += fan) {
        size_t left = sorter->run_count - first;
        uint64_t written;
        status = merge_group(sorter, sorter->runs + first, left < fan ? left : fan, fd, &written);
        /* made <= first: the group's own runs have been read. */
        sorter->runs[made++] = (struct run){.offset = offset, .count = written};
        offset += written * sorter->record_size;
    }
    if (status != STATUS_OK) {
        if (fd >= 0)
            close(fd);
        return status;
    }
    sorter->run_count = made;
    close(sorter->fd);
    sorter->fd = fd;
    return STATUS_OK;
}

enum status sorter_finish(struct sorter *sorter)
{
    if (sorter->state != ADDING)
        return fail(sorter->ctx, STATUS_INTERNAL, "a sorter was finished twice");
    enum status status = STATUS_OK;
    if (sorter->run_count == 0) {
        if (sorter->count > 0)
            status = sort_collected(sorter);
        if (status == STATUS_OK)
            sorter->state = IN_MEMORY;
        return status;
    }
    if (sorter->count > 0)
        status = spill(sorter);
    release_records(sorter);
    size_t fan = fan_in(sorter);
    while (status == STATUS_OK && sorter->run_count > fan)
        status = merge_pass(sorter, fan);
    if (status == STATUS_OK)
        status = merge_open(sorter, sorter->runs, sorter->run_count);
    if (status == STATUS_OK)
        sorter->state = MERGING;
    return status;
}

enum status sorter_next(struct sorter *sorter, const void **records, size_t *count)
{
    *records = NULL;
    *count = 0;
    if (sorter->state == ADDING)
        return fail(sorter->ctx, STATUS_INTERNAL, "records from a sorter that is not finished");
    if (sorter->state == IN_MEMORY) {
        *records = sorter->records;
        *count = sorter->count;
        sorter->count = 0;
        return STATUS_OK;
    }
    const unsigned char *merged = NULL;
    enum status status = merge_next(sorter, &merged, count);
    *records = merged;
    return status;
}
