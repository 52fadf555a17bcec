// Distances between two meshes by CGAL's AABB_tree, at the very points that `spbm measure` takes
// (src/inspect/sample.h says where they are, so that header is shared): prints largest, mean, RMS
// and the number of points, a line for each way. A file's faces are sampled in pieces of 2^16.
#include "ply_mesh.hpp"

#include <algorithm>
#include <cmath>

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>

extern "C" {
#include "inspect/sample.h"
}

using Kernel = CGAL::Simple_cartesian<double>;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

static struct vec3 vertex_of(const PlyMesh &mesh, size_t vertex)
{
    const float *p = &mesh.positions[3 * vertex];
    return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}

static struct triangle face_of(const PlyMesh &mesh, size_t face)
{
    const uint32_t *corner = &mesh.faces[3 * face];
    return {vertex_of(mesh, corner[0]), vertex_of(mesh, corner[1]), vertex_of(mesh, corner[2])};
}

static double area_of(const struct triangle &t)
{
    return vec3_length(triangle_normal(t.a, t.b, t.c)) * 0.5;
}

static Triangles triangles_of(const PlyMesh &mesh)
{
    Triangles triangles;
    auto point = [](struct vec3 p) { return Kernel::Point_3(p.x, p.y, p.z); };
    for (size_t f = 0; f < mesh.faces.size() / 3; ++f) {
        struct triangle t = face_of(mesh, f);
        triangles.emplace_back(point(t.a), point(t.b), point(t.c));
    }
    return triangles;
}

struct Deviation {
    const Tree &tree;
    double largest = 0, weights = 0, squares = 0, sum = 0;
    size_t points = 0;

    void add(struct vec3 p, double weight) // 0: counts for the largest only
    {
        double square = tree.squared_distance(Kernel::Point_3(p.x, p.y, p.z));
        largest = std::max(largest, std::sqrt(square));
        weights += weight;
        sum += weight * std::sqrt(square);
        squares += weight * square;
        ++points;
    }
    void add_vertices(const PlyMesh &mesh)
    {
        std::vector<bool> used(mesh.positions.size() / 3);
        for (uint32_t vertex : mesh.faces)
            used[vertex] = true;
        for (size_t v = 0; v < used.size(); ++v)
            if (used[v])
                add(vertex_of(mesh, v), 0);
    }
    void print(const char *way) const
    {
        printf("%s %.17g %.17g %.17g %zu\n", way, largest, sum / weights,
               std::sqrt(squares / weights), points);
    }
};

static double total_area(const PlyMesh &mesh)
{
    double area = 0;
    for (size_t f = 0; f < mesh.faces.size() / 3; ++f)
        area += area_of(face_of(mesh, f));
    return area;
}

int main(int argc, char **argv)
{
    enum { PIECE_FACES = 1 << 16, LEAST_SAMPLES = 10, LEAST_TOTAL = 100000 };
    if (argc != 3)
        die(std::string("usage: ") + argv[0] + " ORIGINAL.ply SIMPLIFIED.ply");
    PlyMesh original = read_ply(argv[1]), simplified = read_ply(argv[2]);
    size_t faces = original.faces.size() / 3, fewer = simplified.faces.size() / 3;
    size_t wanted = std::max<size_t>(LEAST_SAMPLES * fewer, LEAST_TOTAL);

    Triangles triangles = triangles_of(simplified);
    Tree tree(triangles.begin(), triangles.end());
    Deviation forward{tree};
    forward.add_vertices(original);
    double spacing = total_area(original) / static_cast<double>(std::max(wanted, faces));
    struct sample_walk walk = {};
    for (size_t f = 0; f < faces; ++f) {
        if (f % PIECE_FACES == 0)
            walk = sample_walk_begin(spacing, f / PIECE_FACES);
        struct triangle t = face_of(original, f);
        uint32_t count = sample_walk_face(&walk, area_of(t));
        for (uint32_t k = 0; k < count; ++k)
            forward.add(sample_point(&t, f, k), 1);
    }
    forward.print("forward");

    triangles = triangles_of(original);
    tree.rebuild(triangles.begin(), triangles.end());
    Deviation backward{tree};
    backward.add_vertices(simplified);
    double area = total_area(simplified);
    for (size_t f = 0; f < fewer; ++f) {
        struct triangle t = face_of(simplified, f);
        uint32_t count = sample_share(area_of(t), area, wanted, LEAST_SAMPLES);
        for (uint32_t k = 0; k < count; ++k)
            backward.add(sample_point(&t, f, k), area_of(t) / count);
    }
    backward.print("backward");
}
