// OpenMesh (Debian's libopenmesh-dev): the decimater with its quadric module.
#include "ply_mesh.hpp"

#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>

using Mesh = OpenMesh::TriMesh_ArrayKernelT<>;

int main(int argc, char **argv)
{
    Arguments arguments = parse(argc, argv, "quadric");
    PlyMesh input = read_ply(arguments.input);
    double start = cpu_seconds();
    Mesh mesh;
    std::vector<Mesh::VertexHandle> handles;
    for (size_t i = 0; i < input.positions.size(); i += 3)
        handles.push_back(mesh.add_vertex(
            Mesh::Point(input.positions[i], input.positions[i + 1], input.positions[i + 2])));
    for (size_t i = 0; i < input.faces.size(); i += 3)
        mesh.add_face(handles[input.faces[i]], handles[input.faces[i + 1]],
                      handles[input.faces[i + 2]]);
    OpenMesh::Decimater::DecimaterT<Mesh> decimater(mesh);
    OpenMesh::Decimater::ModQuadricT<Mesh>::Handle module;
    decimater.add(module);
    decimater.module(module).unset_max_err();
    decimater.initialize();
    decimater.decimate_to_faces(0, arguments.faces);
    mesh.garbage_collection();
    PlyMesh result;
    for (auto vertex : mesh.vertices())
        for (int axis = 0; axis < 3; ++axis)
            result.positions.push_back(mesh.point(vertex)[static_cast<unsigned>(axis)]);
    for (auto face : mesh.faces())
        for (auto vertex : mesh.fv_range(face))
            result.faces.push_back(static_cast<uint32_t>(vertex.idx()));
    report(arguments, cpu_seconds() - start, result);
    write_ply(arguments.output, result);
}
