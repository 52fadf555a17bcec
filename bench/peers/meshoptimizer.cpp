// meshoptimizer (Debian's libmeshoptimizer-dev): `simplify` and `simplifySloppy`.
#include "ply_mesh.hpp"

#include <meshoptimizer.h>

int main(int argc, char **argv)
{
    Arguments arguments = parse(argc, argv, "simplify|sloppy");
    PlyMesh mesh = read_ply(arguments.input);
    double start = cpu_seconds();
    std::vector<uint32_t> faces(mesh.faces.size());
    size_t vertices = mesh.positions.size() / 3;
    float error = 0;
    size_t count = arguments.method == "sloppy"
                       ? meshopt_simplifySloppy(faces.data(), mesh.faces.data(), mesh.faces.size(),
                                                mesh.positions.data(), vertices, 12,
                                                3 * arguments.faces, 1.0f, &error)
                       : meshopt_simplify(faces.data(), mesh.faces.data(), mesh.faces.size(),
                                          mesh.positions.data(), vertices, 12, 3 * arguments.faces,
                                          1.0f, 0, &error);
    faces.resize(count);
    PlyMesh result;
    result.faces.resize(count);
    result.positions.resize(mesh.positions.size());
    std::vector<uint32_t> remap(vertices);
    size_t kept = meshopt_optimizeVertexFetchRemap(remap.data(), faces.data(), count, vertices);
    meshopt_remapVertexBuffer(result.positions.data(), mesh.positions.data(), vertices, 12,
                              remap.data());
    meshopt_remapIndexBuffer(result.faces.data(), faces.data(), count, remap.data());
    result.positions.resize(3 * kept);
    report(arguments, cpu_seconds() - start, result);
    write_ply(arguments.output, result);
}
