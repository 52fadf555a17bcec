// CGAL's surface mesh simplification (Debian's libcgal-dev): Lindstrom-Turk and Garland-Heckbert.
// CGAL takes manifolds only: what spbm's own import cleaned is what it should be given.
#include "ply_mesh.hpp"

#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_simplification/Edge_collapse_visitor_base.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Bounded_normal_change_filter.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/GarlandHeckbert_plane_policies.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_cost.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_placement.h>
#include <CGAL/Surface_mesh_simplification/edge_collapse.h>

namespace SMS = CGAL::Surface_mesh_simplification;
using Kernel = CGAL::Simple_cartesian<double>;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;

// CGAL stops by edges; this one stops by faces, so that counts compare. The number of faces falls
// by what a collapse takes: two, or one at the border. It is counted where the collapse happens.
struct FaceCounter : SMS::Edge_collapse_visitor_base<Mesh> {
    size_t *faces;
    explicit FaceCounter(size_t *count) : faces(count)
    {
    }
    template <class Profile, class Placement>
    void OnCollapsing(const Profile &profile, const Placement &)
    {
        *faces -= (profile.left_face_exists() ? 1 : 0) + (profile.right_face_exists() ? 1 : 0);
    }
};

struct StopAtFaces {
    const size_t *faces;
    size_t wanted;
    template <class... Anything> bool operator()(const Anything &...) const
    {
        return *faces <= wanted;
    }
};

int main(int argc, char **argv)
{
    Arguments arguments = parse(argc, argv, "lindstrom-turk|garland-heckbert");
    PlyMesh input = read_ply(arguments.input);
    double start = cpu_seconds();
    Mesh mesh;
    for (size_t i = 0; i < input.positions.size(); i += 3)
        mesh.add_vertex(
            Kernel::Point_3(input.positions[i], input.positions[i + 1], input.positions[i + 2]));
    for (size_t i = 0; i < input.faces.size(); i += 3)
        if (mesh.add_face(Mesh::Vertex_index(input.faces[i]),
                          Mesh::Vertex_index(input.faces[i + 1]),
                          Mesh::Vertex_index(input.faces[i + 2])) == Mesh::null_face())
            die("CGAL takes no non-manifold meshes: give it an exported store");
    input = PlyMesh();
    size_t faces = mesh.number_of_faces();
    StopAtFaces stop{&faces, arguments.faces};
    FaceCounter counter(&faces);
    if (arguments.method == "garland-heckbert") {
        using Policies = SMS::GarlandHeckbert_plane_policies<Mesh, Kernel>;
        Policies policies(mesh);
        SMS::edge_collapse(mesh, stop,
                           CGAL::parameters::get_cost(policies.get_cost())
                               .get_placement(policies.get_placement())
                               .filter(SMS::Bounded_normal_change_filter<>())
                               .visitor(counter));
    } else {
        SMS::edge_collapse(mesh, stop,
                           CGAL::parameters::get_cost(SMS::LindstromTurk_cost<Mesh>())
                               .get_placement(SMS::LindstromTurk_placement<Mesh>())
                               .visitor(counter));
    }
    mesh.collect_garbage();
    PlyMesh result;
    for (auto vertex : mesh.vertices())
        for (int axis = 0; axis < 3; ++axis)
            result.positions.push_back(static_cast<float>(mesh.point(vertex)[axis]));
    for (auto face : mesh.faces())
        for (auto vertex : mesh.vertices_around_face(mesh.halfedge(face)))
            result.faces.push_back(static_cast<uint32_t>(vertex));
    report(arguments, cpu_seconds() - start, result);
    write_ply(arguments.output, result);
}
