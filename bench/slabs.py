#!/usr/bin/env python3
"""slabs.py [--work DIR] [-o RECORD.md]

What slabs cost in accuracy: each mesh is imported with slabs of the format's size (2^18 faces; one
slab holds the small meshes, four the dragon, twelve the brain) and with slabs so much smaller that
there are a dozen to two hundred, simplified from both stores to the same counts, and measured. The
error near seams, within ten mean edges of a vertex that lies in two of the small slabs, is compared
with that elsewhere. (A surface of more than 2^18 faces has no store of one slab to compare with.)

Needs numpy.
"""
import argparse
import json
import os

import numpy

import record

MESHES = {  # file, shift of the small slabs, counts
    "koala": ("koala.obj.gz", 13, (9999, 2000, 1000)),
    "skull": ("skull.obj.gz", 13, (10000, 2000, 1000)),
    "bunny": ("stanford_bunny_ascii.ply", 13, (6945, 1504, 695)),
    "dragon": ("stanford_dragon.ply.gz", 14, (87000, 17400, 8700)),
    "brain": ("mri_brain_3m.ply.gz", 14, (61000, 30600)),
}
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


def compare(options, name):
    path, shift, counts = MESHES[name]
    base = f"{options.work}/slabs-{name}"
    record.Run([options.spbm, "import", os.path.join(record.DATA, path), "-o", base + "-18.store", "-q"])
    record.Run([options.spbm, "export", base + "-18.store", "-o", base + ".ply", "-q"])
    record.Run([options.slab_store, base + ".ply", f"{base}-{shift}.store", str(shift)])
    record.Run([options.spbm, "export", f"{base}-{shift}.store", "-o", base + ".ply", "-q"])
    seams, edge = seam_points(base + ".ply", shift)
    rows = []
    for faces in counts:
        mean, rms, ratio = {}, {}, ""
        for slabs in (18, shift):
            store, chains, output = f"{base}-{slabs}.store", base + ".chains", base + "-out.ply"
            record.Run([options.spbm, "patchify", store, "-o", chains, "--faces", str(faces), "-q"])
            record.Run([options.spbm, "lod", chains, "-o", output, "--faces", str(faces), "-q"])
            run = record.Run([options.spbm, "measure", base + ".ply", output, "-q", "--json", "-",
                              "--error-ply", base + "-error.ply"], keep_output=True)
            found = json.loads(run.output)["measurement"]
            ways = [found["forward"], found["backward"]]
            mean[slabs] = sum(way["mean"] for way in ways) / 2 / found["diagonal"]
            rms[slabs] = (sum(way["rms"] ** 2 for way in ways) / 2) ** .5 / found["diagonal"]
            points, quality, _ = read_ply(base + "-error.ply")
            near = is_near(points, seams, NEAR * edge)
            ratio = quality[near].mean() / quality[~near].mean()
            if slabs == 18:
                without = ratio
        rows.append(f"| {name} | {faces:,} | {mean[18]:.3e} | {mean[shift]:.3e} | "
                    f"**{mean[shift] / mean[18]:.3f}** | {rms[shift] / rms[18]:.3f} | "
                    f"{near.mean():.0%} | {ratio:.2f} | {without:.2f} | **{ratio / without:.2f}** |")
    for kind in ("-18.store", f"-{shift}.store", ".ply", ".chains", "-out.ply", "-error.ply"):
        os.unlink(base + kind)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{record.ROOT}/build/tools/spbm")
    parser.add_argument("--slab-store", default=f"{record.ROOT}/build/bench/slab_store")
    parser.add_argument("--work", default=f"{record.ROOT}/build/accuracy")
    parser.add_argument("--only", help="comma-separated names of meshes")
    parser.add_argument("-o", "--output", help="the record; default: standard output")
    options = parser.parse_args()
    os.makedirs(options.work, exist_ok=True)
    lines = ["# What slabs cost in accuracy\n", record.made() + " Mean error of both directions as a "
             "fraction of the diagonal. Near: vertices of the level within ten mean edges of a seam of "
             "the small slabs; their mean error to that of the others, in the level made with small "
             "slabs and, for the shape's own part, at the same places in the one made without.\n",
             "| mesh | faces | slabs of 2^18 | small slabs | mean, ratio | RMS, ratio | near | "
             "near to elsewhere | the same without | ratio |", "|---|---|---|---|---|---|---|---|---|---|"]
    for name in options.only.split(",") if options.only else MESHES:
        lines += compare(options, name)
    record.write("\n".join(lines) + "\n", options.output)


if __name__ == "__main__":
    main()
