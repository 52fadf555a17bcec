// Is each mesh named on standard input (a line each) a manifold, in the eyes of CGAL (Debian's libcgal-dev)? Files are
// read by CGAL's own reader. A line each: "manifold VERTICES FACES COMPONENTS BORDERS EULER", or what is wrong.
#include <CGAL/IO/polygon_soup_io.h>
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <set>
#include <string>
#include <vector>

namespace PMP = CGAL::Polygon_mesh_processing;
using Point = CGAL::Simple_cartesian<double>::Point_3;
using Mesh = CGAL::Surface_mesh<Point>;

static std::string judge(const std::string &path)
{
    std::vector<Point> points;
    std::vector<std::vector<std::size_t>> faces;
    if (!CGAL::IO::read_polygon_soup(path, points, faces, CGAL::parameters::verbose(false)))
        return "cannot be read";
    std::vector<bool> used(points.size());
    std::set<std::array<std::size_t, 3>> seen;
    for (const auto &face : faces) {
        if (face.size() != 3 || face[0] == face[1] || face[1] == face[2] || face[2] == face[0])
            return "a face is no triangle";
        std::array<std::size_t, 3> key = {face[0], face[1], face[2]};
        std::sort(key.begin(), key.end());
        if (!seen.insert(key).second)
            return "a face is there twice";
        for (std::size_t v : face)
            used[v] = true;
    }
    for (std::size_t v = 0; v < points.size(); v++)
        if (!used[v] || !std::isfinite(points[v].x()) || !std::isfinite(points[v].y()) ||
            !std::isfinite(points[v].z()))
            return "a vertex is not used or not finite";
    if (!PMP::is_polygon_soup_a_polygon_mesh(faces))
        return "not a manifold, or not oriented";
    Mesh mesh;
    PMP::polygon_soup_to_polygon_mesh(points, faces, mesh);
    if (!CGAL::is_valid_polygon_mesh(mesh) || mesh.number_of_faces() != faces.size())
        return "not a valid mesh";
    auto component = mesh.add_property_map<Mesh::Face_index, std::size_t>("f:component", 0).first;
    std::size_t components = PMP::connected_components(mesh, component);
    std::vector<Mesh::Halfedge_index> borders;
    PMP::extract_boundary_cycles(mesh, std::back_inserter(borders));
    long euler = (long)mesh.number_of_vertices() - (long)mesh.number_of_edges() +
                 (long)mesh.number_of_faces();
    char text[200];
    std::snprintf(text, sizeof text, "manifold %zu %zu %zu %zu %ld",
                  (std::size_t)mesh.number_of_vertices(), (std::size_t)mesh.number_of_faces(),
                  components, borders.size(), euler);
    return text;
}

int main()
{
    std::string path;
    while (std::getline(std::cin, path))
        std::cout << judge(path) << std::endl;
}
