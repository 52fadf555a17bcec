// What every peer driver shares: the mesh of a binary little-endian PLY (float or double x y z
// first, triangles as `uchar int`, further vertex properties skipped), mapped and copied into flat
// arrays, and its writing. The peers' own readers are slow or lose precision; with this one,
// whole-process times compare the simplifications and not the parsers.
#pragma once

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fcntl.h>
#include <string>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

struct PlyMesh {
    std::vector<float> positions; // 3 a vertex
    std::vector<uint32_t> faces;  // 3 a face
};

[[noreturn]] inline void die(const std::string &text)
{
    fprintf(stderr, "%s\n", text.c_str());
    exit(1);
}

inline PlyMesh read_ply(const char *path)
{
    int fd = open(path, O_RDONLY);
    struct stat st;
    if (fd < 0 || fstat(fd, &st) != 0)
        die(std::string(path) + ": cannot be opened");
    size_t size = static_cast<size_t>(st.st_size);
    auto *data = static_cast<const char *>(mmap(nullptr, size, PROT_READ, MAP_PRIVATE, fd, 0));
    if (data == MAP_FAILED)
        die(std::string(path) + ": cannot be mapped");
    size_t vertices = 0, faces = 0, stride = 0;
    bool in_vertices = false, binary = false, wide = false;
    const char *line = data, *end = data + size;
    for (;;) {
        auto *newline =
            static_cast<const char *>(memchr(line, '\n', static_cast<size_t>(end - line)));
        if (!newline)
            die(std::string(path) + ": no end of header");
        std::string text(line, newline);
        line = newline + 1;
        if (text == "end_header")
            break;
        if (text == "format binary_little_endian 1.0")
            binary = true;
        if (sscanf(text.c_str(), "element vertex %zu", &vertices) == 1)
            in_vertices = true;
        else if (sscanf(text.c_str(), "element face %zu", &faces) == 1)
            in_vertices = false;
        else if (in_vertices && text.rfind("property float", 0) == 0)
            stride += 4;
        else if (in_vertices && text.rfind("property double", 0) == 0) {
            wide = wide || stride == 0;
            stride += 8;
        } else if (in_vertices && text.rfind("property uchar", 0) == 0)
            stride += 1;
        else if (in_vertices && text.rfind("property", 0) == 0)
            die(std::string(path) +
                ": only float, double and uchar vertex properties are read here");
    }
    if (!binary || stride < (wide ? 24u : 12u))
        die(std::string(path) + ": not a binary little-endian PLY with positions");
    PlyMesh mesh;
    mesh.positions.resize(3 * vertices);
    mesh.faces.resize(3 * faces);
    if (static_cast<size_t>(end - line) < vertices * stride + faces * 13)
        die(std::string(path) + ": is cut short");
    for (size_t i = 0; i < vertices; ++i, line += stride) {
        double position[3];
        if (wide)
            memcpy(position, line, 24);
        else
            memcpy(&mesh.positions[3 * i], line, 12);
        for (size_t axis = 0; wide && axis < 3; ++axis)
            mesh.positions[3 * i + axis] = static_cast<float>(position[axis]);
    }
    for (size_t i = 0; i < faces; ++i, line += 13) {
        if (*line != 3)
            die(std::string(path) + ": has a face that is not a triangle");
        memcpy(&mesh.faces[3 * i], line + 1, 12);
    }
    munmap(const_cast<char *>(data), size);
    close(fd);
    return mesh;
}

inline void write_ply(const char *path, const PlyMesh &mesh)
{
    FILE *file = fopen(path, "wb");
    if (!file)
        die(std::string(path) + ": cannot be written");
    fprintf(file,
            "ply\nformat binary_little_endian 1.0\nelement vertex %zu\nproperty float x\n"
            "property float y\nproperty float z\nelement face %zu\n"
            "property list uchar int vertex_indices\nend_header\n",
            mesh.positions.size() / 3, mesh.faces.size() / 3);
    fwrite(mesh.positions.data(), sizeof(float), mesh.positions.size(), file);
    std::vector<char> record(13 * (mesh.faces.size() / 3));
    for (size_t i = 0; i < mesh.faces.size() / 3; ++i) {
        record[13 * i] = 3;
        memcpy(&record[13 * i + 1], &mesh.faces[3 * i], 12);
    }
    if (fwrite(record.data(), 1, record.size(), file) != record.size() || fclose(file) != 0)
        die(std::string(path) + ": cannot be written");
}

// CPU seconds of this process so far; the drivers print what the simplification alone took.
inline double cpu_seconds()
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// The arguments of every driver: METHOD IN.ply OUT.ply FACES
struct Arguments {
    std::string method;
    const char *input, *output;
    size_t faces;
};

inline Arguments parse(int argc, char **argv, const char *methods)
{
    if (argc != 5)
        die(std::string("usage: ") + argv[0] + " " + methods + " IN.ply OUT.ply FACES");
    return {argv[1], argv[2], argv[3], strtoull(argv[4], nullptr, 10)};
}

inline void report(const Arguments &arguments, double seconds, const PlyMesh &result)
{
    fprintf(stderr, "%s %s: %zu faces, %.3f CPU seconds\n", arguments.method.c_str(),
            arguments.input, result.faces.size() / 3, seconds);
}
