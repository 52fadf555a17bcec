/*
 * Operations on the chain graph: done in random order, whatever they cost, they must keep the graph
 * a surface of the same topology (G1 to G5); and single cases that the tests must refuse or allow.
 */
#include "simplify/patch_merge.h"

#include <stdio.h>

#include "base/memory.h"
#include "test_facts.h"
#include "test_kit.h"
#include "test_patches.h"
#include "test_shapes.h"

struct surface {
    struct context ctx;
    struct mesh mesh;
    struct facts facts;
    struct patch_set patches;
    struct chain_graph graph;
};

static void surface_make(struct surface *s, struct shape shape, uint32_t most_faces,
                         uint32_t blocks, uint64_t seed)
{
    context_init(&s->ctx);
    shape_into_mesh(&s->ctx, &shape, &s->mesh);
    s->facts = facts_of(&s->mesh);
    patch_set_build(&s->mesh, most_faces, blocks, seed, &s->patches);
    patch_set_graph(&s->ctx, &s->patches, &s->graph);
}

static void surface_free(struct surface *s)
{
    chain_graph_clear(&s->graph);
    patch_set_free(&s->patches);
    mesh_clear(&s->ctx, &s->mesh);
    assert_int_equal(s->ctx.memory_now, 0);
    context_clear(&s->ctx);
}

/* Euler characteristic, counted, not taken from the graph's own totals. */
static long euler_of(const struct chain_graph *graph)
{
    long vertices = 0, edges = 0, patches = 0;
    for (uint32_t v = 0; v < graph->vertex_count; v++)
        vertices += vertex_is_live(graph, v);
    for (uint32_t e = 0; e < graph->edge_count; e++)
        edges += edge_is_live(graph, e);
    for (uint32_t p = 0; p < graph->patch_count; p++)
        patches += graph->patches[p].half_edge != NO_INDEX;
    assert_int_equal((uint64_t)edges, graph->live_edges);
    assert_int_equal((uint64_t)patches, graph->live_patches);
    return vertices - edges + patches;
}

/* Walks along all border half-edges. */
static size_t border_loops_of(const struct chain_graph *graph, bool *seen)
{
    size_t loops = 0, edges = 0;
    for (uint32_t h = 0; h < 2 * graph->edge_count; h++)
        seen[h] = false;
    for (uint32_t h = 0; h < 2 * graph->edge_count; h++) {
        if (!edge_is_live(graph, h / 2) || graph->half_edges[h].patch != NO_PATCH)
            continue;
        loops += !seen[h];
        for (uint32_t g = h; !seen[g]; g = graph->half_edges[g].next) {
            seen[g] = true;
            edges++;
        }
    }
    assert_int_equal(edges, graph->live_border_edges);
    return loops;
}

/* Corners that are no junctions, counted for each patch. */
static void open_corners_agree(const struct chain_graph *graph)
{
    for (uint32_t p = 0; p < graph->patch_count; p++) {
        uint32_t first = graph->patches[p].half_edge, h = first, open = 0;
        if (first == NO_INDEX)
            continue;
        do {
            open += !(graph->flags[graph->half_edges[h].origin] & VERTEX_JUNCTION);
            h = graph->half_edges[h].next;
        } while (h != first);
        assert_int_equal(open, graph->patches[p].open);
    }
}

/* Every vertex that was ever on a chain is live, or in the list of exactly one edge. */
static void lists_hold_what_went(const struct chain_graph *graph, const bool *was_live,
                                 uint32_t *found)
{
    for (uint32_t v = 0; v < graph->vertex_count; v++)
        found[v] = vertex_is_live(graph, v);
    for (uint32_t e = 0; e < graph->edge_count; e++)
        for (uint32_t v = graph->edges[e].first; v != NO_INDEX; v = graph->list[v])
            found[v]++;
    for (uint32_t v = 0; v < graph->vertex_count; v++)
        assert_true(found[v] <= 1 && (was_live[v] || found[v] == 0));
}

static bool random_operation(struct chain_graph *graph, uint64_t *random)
{
    uint32_t h = (uint32_t)random_below(random, 2 * graph->edge_count);
    if (!edge_is_live(graph, h / 2))
        return false;
    uint32_t v = graph->half_edges[h].origin;
    switch (random_below(random, 4)) {
    case 0:
        if (!vertex_has_two_edges(graph, v) || !vertex_can_go(graph, v))
            return false;
        vertex_remove(graph, v);
        return true;
    case 1:
        if (!edge_can_collapse(graph, h))
            return false;
        edge_collapse(graph, h, half_edge_turn(graph, h) / 2, half_edge_turn(graph, h) / 2);
        return true;
    case 2:
        if (!patches_can_merge(graph, h))
            return false;
        patches_merge(graph, h, 0);
        return true;
    default:
        if (!vertex_has_two_edges(graph, v) || graph->edges[h / 2].first == NO_INDEX)
            return false;
        vertex_slide(graph, v, h, half_edge_turn(graph, h), graph->edges[h / 2].first);
        return true;
    }
}

static void operations_keep_the_surface(struct surface *s, uint64_t seed, unsigned tries)
{
    struct chain_graph *graph = &s->graph;
    bool *seen = test_calloc(2 * (size_t)graph->edge_count, sizeof *seen);
    bool *was_live = test_calloc(graph->vertex_count, sizeof *was_live);
    uint32_t *found = test_calloc(graph->vertex_count, sizeof *found);
    uint64_t random = seed;
    for (uint32_t v = 0; v < graph->vertex_count; v++)
        was_live[v] = vertex_is_live(graph, v);
    for (unsigned i = 0; i < tries; i++) {
        if (!random_operation(graph, &random))
            continue;
        if (chain_graph_check(graph) != STATUS_OK)
            fail_msg("%s", s->ctx.error);
        assert_int_equal(euler_of(graph), s->facts.euler);
        assert_int_equal(border_loops_of(graph, seen), s->facts.border_loops);
        open_corners_agree(graph);
        lists_hold_what_went(graph, was_live, found);
    }
    test_free(seen);
    test_free(was_live);
    test_free(found);
}

static struct shape shape_number(unsigned kind, uint64_t seed)
{
    switch (kind) {
    case 0:
        return shape_icosphere(1 + (unsigned)seed % 2);
    case 1:
        return shape_torus(4 + (unsigned)seed % 5, 3 + (unsigned)seed % 4);
    case 2:
        return shape_grid(3 + (unsigned)seed % 5, 2 + (unsigned)seed % 5);
    case 3:
        return shape_grid_with_holes(8, 8);
    case 4:
        return shape_tetrahedron();
    case 5:
        return shape_cube_quads();
    case 6:
        return shape_spiral_ramp(2, 6);
    default:
        return shape_single_triangle();
    }
}

static void random_operations(void **state)
{
    (void)state;
    for (uint64_t seed = 0; seed < 6; seed++)
        for (unsigned kind = 0; kind < 8; kind++)
            for (uint32_t most = 1; most <= 25; most *= 5) {
                struct surface s;
                surface_make(&s, shape_number(kind, seed), most, 1 + (uint32_t)seed % 3, seed + 31 * most);
                assert_int_equal(chain_graph_faces(&s.graph), s.patches.loop_faces);
                operations_keep_the_surface(&s, seed + kind, 3000);
                surface_free(&s);
            }
}

/* Every face is a patch: the graph is the mesh. */
static void tetrahedron_is_final(void **state)
{
    (void)state;
    struct surface s;
    surface_make(&s, shape_tetrahedron(), 1, 1, 1);
    assert_int_equal(chain_graph_faces(&s.graph), 4);
    for (uint32_t h = 0; h < 2 * s.graph.edge_count; h++)
        assert_false(edge_can_collapse(&s.graph, h));
    surface_free(&s);
}

/* Section 4.2.7: what is inside may move to the border; the border does not come in; an inner edge
 * between two border vertices is not collapsed at all. */
static void borders_stay(void **state)
{
    (void)state;
    struct surface s;
    unsigned in = 0, out = 0, across = 0, along = 0;
    surface_make(&s, shape_grid(4, 4), 1, 1, 1);
    for (uint32_t h = 0; h < 2 * s.graph.edge_count; h++) {
        bool from = vertex_is_border(&s.graph, s.graph.half_edges[h].origin);
        bool to = vertex_is_border(&s.graph, half_edge_end(&s.graph, h));
        bool border =
            s.graph.half_edges[h].patch == NO_PATCH || s.graph.half_edges[h ^ 1].patch == NO_PATCH;
        bool can = edge_can_collapse(&s.graph, h);
        in += can && from && !to;
        out += can && !from && to;
        across += can && from && to && !border;
        along += can && border;
    }
    assert_int_equal(in, 0);
    assert_true(out > 0);
    assert_int_equal(across, 0);
    assert_true(along > 0);
    surface_free(&s);
}

/* Two patches that meet in a second place must not be merged: the ring would get a pinched border.
 */
static void rings_are_not_closed(void **state)
{
    (void)state;
    struct surface s;
    surface_make(&s, shape_torus(3, 3), 1, 1, 1);
    unsigned merged = 0;
    for (uint32_t h = 0; h < 2 * s.graph.edge_count; h++)
        if (edge_is_live(&s.graph, h / 2) && patches_can_merge(&s.graph, h)) {
            patches_merge(&s.graph, h, 0);
            merged++;
            if (chain_graph_check(&s.graph) != STATUS_OK)
                fail_msg("%s", s.ctx.error);
            assert_int_equal(euler_of(&s.graph), 0);
        }
    assert_true(merged > 0);
    surface_free(&s);
}

/* Blocks that contradict themselves are refused, never believed. */
static void damaged_blocks_are_refused(void **state)
{
    (void)state;
    for (unsigned damage = 0; damage < 6; damage++) {
        struct surface s;
        struct chain_graph graph;
        surface_make(&s, shape_icosphere(1), 4, 2, 5);
        struct chain_block *block = &s.patches.blocks[1];
        assert_true(block->chain_count > 1 && block->seam_chain_count > 1);
        switch (damage) {
        case 0:
            block->chain_count--;
            break;
        case 1:
            block->chains[0].end = block->chains[0].start;
            break;
        case 2:
            block->chains[0].left = block->chains[0].right;
            break;
        case 3:
            s.patches.blocks[0].seam_chain_count--;
            break;
        case 4:
            s.patches.blocks[0].seam_chains[0].right = 100000;
            break;
        default:
            block->slab = 0;
        }
        struct block_source source = patch_set_source(&s.patches);
        if (chain_graph_build(&s.ctx, &source, test_path("records"), &graph) != STATUS_BAD_INPUT)
            fail_msg("damage %u was not noticed", damage);
        assert_true(s.ctx.error[0] != '\0');
        surface_free(&s);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_operations),
        cmocka_unit_test(tetrahedron_is_final),
        cmocka_unit_test(borders_stay),
        cmocka_unit_test(rings_are_not_closed),
        cmocka_unit_test(damaged_blocks_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
