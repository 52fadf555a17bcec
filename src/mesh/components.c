/*
 * Union-find with parity, in face order.
 *
 * A flood fill visits faces in an order of its own, all over the slab. Here the faces are taken in
 * their order, each is joined with its neighbours before it, and the root of a set is its lowest
 * face, so that nearly always one look at an array that lies in the cache is all. The parity of a
 * face relative to its root rides in the lowest bit of the parent.
 */
#include "mesh/components.h"

#include <string.h>

#include "base/memory.h"

/* Root << 1 | parity of x relative to it; halves the path. */
static inline uint32_t find_root(uint32_t *parent, uint32_t x)
{
    uint32_t parity = 0;
    for (;;) {
        uint32_t up = parent[x];
        if (up >> 1 == x)
            return x << 1 | parity;
        uint32_t above = parent[up >> 1];
        uint32_t halved = (above & ~1u) | ((up ^ above) & 1);
        parent[x] = halved;
        parity ^= halved & 1;
        x = halved >> 1;
    }
}

/* False when a link contradicts the parities of the links before. */
static bool unite_all(const struct draft *draft, const struct slab_scope *scope, uint32_t *parent)
{
    const uint64_t first = scope->face_first;
    const uint32_t *faces = draft->faces;
    bool fits = true;
    for (uint32_t f = 0; f < scope->face_count; f++) {
        parent[f] = f << 1;
        uint32_t root = f << 1;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t over = draft->neighbours[3 * (first + f) + k];
            if (over < first || over >= first + f)
                continue;
            unsigned mate = mate_of(draft->mates, first + f, k);
            uint32_t turn = run_alike(faces, first + f, k, over, mate);
            uint32_t other = find_root(parent, (uint32_t)(over - first)) ^ turn;
            if (root >> 1 == other >> 1) {
                fits = fits && root == other;
            } else if (other < root) {
                parent[root >> 1] = (other & ~1u) | ((root ^ other) & 1);
                root = other;
            } else {
                parent[other >> 1] = (root & ~1u) | ((root ^ other) & 1);
            }
        }
    }
    return fits;
}

enum status component_begin(struct components *c, uint32_t lowest)
{
    if (c->count == c->capacity) {
        enum status status =
            memory_reserve(c->ctx, &c->list, &c->capacity, (size_t)c->count + 1, sizeof *c->list);
        if (status != STATUS_OK)
            return status;
    }
    c->list[c->count++] = (struct component){.lowest = lowest, .faces = 1, .open_id = NO_INDEX};
    return STATUS_OK;
}

/* Parents become labels. A root stands before its faces, so one sweep flattens. */
static enum status label_all(const struct draft *draft, const struct slab_scope *scope,
                             struct components *c)
{
    const uint64_t first = scope->face_first;
    uint32_t *label = c->label;
    c->count = 0;
    for (uint32_t f = 0; f < scope->face_count; f++) {
        if (label[f] >> 1 == f) {
            label[f] = c->count << 1;
            enum status status = component_begin(c, f);
            if (status != STATUS_OK)
                return status;
        } else {
            uint32_t up = label[label[f] >> 1];
            label[f] = up ^ (label[f] & 1);
            c->list[label[f] >> 1].faces++;
        }
        struct component *component = &c->list[label[f] >> 1];
        component->turned += label[f] & 1;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t over = draft->neighbours[3 * (first + f) + k];
            if (over == NO_INDEX)
                component->borders++;
            else if (over - first >= scope->face_count)
                component->open_id = 0;
        }
    }
    return STATUS_OK;
}

static void mark_twisted(const struct draft *draft, const struct slab_scope *scope,
                         struct components *c)
{
    const uint64_t first = scope->face_first;
    for (uint32_t f = 0; f < scope->face_count; f++) {
        for (unsigned k = 0; k < 3; k++) {
            uint32_t over = draft->neighbours[3 * (first + f) + k];
            if (over < first || over >= first + f)
                continue;
            unsigned mate = mate_of(draft->mates, first + f, k);
            uint32_t turn = run_alike(draft->faces, first + f, k, over, mate);
            if ((c->label[f] ^ c->label[over - first]) != turn)
                c->list[c->label[f] >> 1].is_twisted = true;
        }
    }
}

enum status components_find(const struct draft *draft, const struct slab_scope *scope,
                            struct components *components)
{
    components->ctx = draft->ctx;
    enum status status = memory_reserve(draft->ctx, &components->label, &components->label_capacity,
                                        scope->face_count, sizeof *components->label);
    if (status != STATUS_OK)
        return status;
    bool fits = unite_all(draft, scope, components->label);
    status = label_all(draft, scope, components);
    if (status != STATUS_OK)
        return status;
    if (!fits)
        mark_twisted(draft, scope, components);
    components_number_open(components);
    return STATUS_OK;
}

void components_number_open(struct components *components)
{
    components->open_count = 0;
    for (uint32_t i = 0; i < components->count; i++) {
        if (components->list[i].open_id != NO_INDEX)
            components->list[i].open_id = components->open_count++;
    }
}

void components_clear(struct components *components)
{
    if (!components->ctx)
        return;
    memory_release(components->ctx, &components->label, components->label_capacity,
                   sizeof *components->label);
    memory_release(components->ctx, &components->list, components->capacity,
                   sizeof *components->list);
    memset(components, 0, sizeof *components);
}
