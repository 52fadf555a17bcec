#!/usr/bin/env python3
"""slabs.py --build DIR [--work DIR] [-o RECORD.md]

What slabs cost in accuracy: each mesh is simplified from a store of one slab and from one of
several, to the same counts, and measured. The dragon and the brain have the program's own slabs (of
2^16 faces: 14 and 47), the small meshes thirteen much smaller ones. The error near seams, within ten
mean edges of a vertex that lies in two slabs, is compared with that elsewhere.

A store's slab has at most 2^18 faces, as a whole mesh, so DIR is a build whose slabs may be larger:

    meson setup DIR -Dbuildtype=release -Dc_args=-DSPBM_SLAB_SHIFT=22

Both stores are made from the same order of faces, read by the same program, and cut into patches by
the same angles: those chosen for the store with slabs. (The choice goes by samples of a store, whose
places differ a little with the slabs.) Each level is made
for three counts that differ by a five-hundredth: collapses are chaotic, and how far the ratios of
the three lie apart says what is chance.

Needs numpy.
"""
import argparse
import json
import os

import numpy

import record

ONE = 22
MESHES = {  # file, shift of the slabs, counts
    "koala": ("koala.obj.gz", 13, (9999, 2000, 1000)),
    "skull": ("skull.obj.gz", 13, (10000, 2000, 1000)),
    "bunny": ("stanford_bunny_ascii.ply", 13, (6945, 1504, 695)),
    "dragon": ("stanford_dragon.ply.gz", 16, (87000, 17400, 8700)),
    "brain": ("mri_brain_3m.ply.gz", 16, (306000, 61000, 30600)),
}
TIMES = 3
NEAR = 10  # mean edges


def read_ply(path):
    """Positions, first extra float (or None) and faces of a binary PLY as spbm writes it."""
    types = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
    counts, fields = {}, []
    with open(path, "rb") as file:
        while (words := file.readline().decode().split()) != ["end_header"]:
            if words[0] == "element":
                element = words[1]
                counts[element] = int(words[2])
            elif words[0] == "property" and element == "vertex":
                fields.append((words[2], types[words[1]]))
        vertices = numpy.fromfile(file, dtype=fields, count=counts["vertex"])
        faces = numpy.fromfile(file, dtype=[("n", "u1"), ("i", "<i4", 3)], count=counts["face"])
    points = numpy.stack([vertices[axis].astype(float) for axis in "xyz"], 1)
    return points, vertices["quality"] if "quality" in vertices.dtype.names else None, faces["i"]


def seam_points(mesh, shift):
    """Vertices of a mesh in store order that faces of two slabs have; the mean edge."""
    points, _, faces = read_ply(mesh)
    slab = numpy.arange(len(faces)) >> shift
    low, high = numpy.full(len(points), len(faces)), numpy.full(len(points), -1)
    for k in range(3):
        numpy.minimum.at(low, faces[:, k], slab)
        numpy.maximum.at(high, faces[:, k], slab)
    edge = numpy.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1).mean()
    return points[high > low], edge


def is_near(points, seams, reach):
    """Whether a point has a seam vertex within reach, to the size of a cell of a third of it."""
    cell = reach / 3
    keys = {tuple(key) for key in numpy.floor(seams / cell).astype(int)}
    steps = [(i, j, k) for i in range(-3, 4) for j in range(-3, 4) for k in range(-3, 4)
             if i * i + j * j + k * k <= 9]
    near = numpy.zeros(len(points), bool)
    for at, key in enumerate(numpy.floor(points / cell).astype(int)):
        near[at] = any((key[0] + i, key[1] + j, key[2] + k) in keys for i, j, k in steps)
    return near


def choose_patches(options, base, shift, faces, effort):
    """The angles and smoothings that patchify chooses, as options."""
    run = record.Run([options.spbm, "patchify", f"{base}-{shift}.store", "-o", base + ".chains", "-q",
                      "--faces", str(faces), "--effort", str(effort), "--json", "-"], keep_output=True)
    chosen = json.loads(run.output)["chains"]
    pair = lambda angles: ",".join(f"{angle:.9g}" for angle in angles)
    return ["--patch-angle", pair(chosen["patch_angle"]), "--face-angle", pair(chosen["face_angle"]),
            "--smooth", str(chosen["smoothings"])]


def simplify(options, base, shift, faces, effort, patches, seams, edge):
    """Mean and RMS error, the part of the vertices near seams, and their mean error to the others'."""
    store, chains, output = f"{base}-{shift}.store", base + ".chains", base + "-out.ply"
    target = ["--faces", str(faces), "--effort", str(effort), "-q"]
    record.Run([options.spbm, "patchify", store, "-o", chains] + target + patches)
    record.Run([options.spbm, "lod", chains, "-o", output] + target)
    run = record.Run([options.spbm, "measure", base + ".ply", output, "-q", "--json", "-",
                      "--error-ply", base + "-error.ply"], keep_output=True)
    found = json.loads(run.output)["measurement"]
    ways = [found["forward"], found["backward"]]
    points, quality, _ = read_ply(base + "-error.ply")
    near = is_near(points, seams, NEAR * edge)
    return (sum(way["mean"] for way in ways) / 2 / found["diagonal"],
            (sum(way["rms"] ** 2 for way in ways) / 2) ** .5 / found["diagonal"],
            near.mean(), quality[near].mean() / quality[~near].mean())


def compare(options, name):
    path, shift, counts = MESHES[name]
    base = f"{options.work}/slabs-{name}"
    record.Run([options.slab_store, os.path.join(record.DATA, path), f"{base}-{shift}.store", str(shift)])
    record.Run([options.spbm, "export", f"{base}-{shift}.store", "-o", base + ".ply", "-q"])
    record.Run([options.slab_store, base + ".ply", f"{base}-{ONE}.store", str(ONE)])
    seams, edge = seam_points(base + ".ply", shift)
    rows = []
    for faces in counts:
        for effort in options.efforts:
            patches = choose_patches(options, base, shift, faces, effort)
            one, cut = ([simplify(options, base, slabs, faces - faces * i // 500, effort, patches, seams,
                                  edge) for i in range(TIMES)] for slabs in (ONE, shift))
            ratios = [c[0] / o[0] for c, o in zip(cut, one)]
            mean = [[sum(run[i] for run in runs) / TIMES for i in range(4)] for runs in (one, cut)]
            rows.append(f"| {name} | {faces:,} | {effort} | {mean[0][0]:.3e} | {mean[1][0]:.3e} | "
                        f"**{mean[1][0] / mean[0][0]:.3f}** | {min(ratios):.3f} to {max(ratios):.3f} | "
                        f"{mean[1][1] / mean[0][1]:.3f} | {mean[1][2]:.0%} | {mean[1][3]:.2f} | "
                        f"{mean[0][3]:.2f} | **{mean[1][3] / mean[0][3]:.2f}** |")
            print(rows[-1], flush=True)
    for kind in (f"-{ONE}.store", f"-{shift}.store", ".ply", ".chains", "-out.ply", "-error.ply"):
        os.unlink(base + kind)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--build", required=True, help="the build with larger slabs")
    parser.add_argument("--efforts", type=lambda text: [int(x) for x in text.split(",")],
                        default=[1, 2, 3], help="comma-separated; default: 1,2,3")
    parser.add_argument("--work", default=f"{record.ROOT}/build/accuracy")
    parser.add_argument("--only", help="comma-separated names of meshes")
    parser.add_argument("-o", "--output", help="the record; default: standard output")
    options = parser.parse_args()
    options.spbm, options.slab_store = f"{options.build}/tools/spbm", f"{options.build}/bench/slab_store"
    os.makedirs(options.work, exist_ok=True)
    lines = ["# What slabs cost in accuracy\n", record.made() + " Mean error of both directions as a "
             "fraction of the diagonal, mean of three counts that differ by a five-hundredth. Near: vertices "
             "of the level within ten mean edges of a seam; their mean error to that of the others, in the "
             "level made with slabs and, for the shape's own part, at the same places in the one made "
             "without.\n",
             "| mesh | faces | effort | one slab | slabs | mean, ratio | of each count | RMS, ratio | near | "
             "near to elsewhere | the same without | ratio |", "|" + "---|" * 12]
    for name in options.only.split(",") if options.only else MESHES:
        lines += compare(options, name)
    record.write("\n".join(lines) + "\n", options.output)


if __name__ == "__main__":
    main()
