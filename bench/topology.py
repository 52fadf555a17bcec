#!/usr/bin/env python3
"""topology.py [--output FILE] [--work DIR] [--pictures DIR]

The record of topology simplification on real parts and scans: what goes and what stays, that
nothing else moves, counts that cannot be reached otherwise, time and memory, and the same bytes for
any threads and memory. The parts of the dissertation's table 2 and random plates are in the tests
(tests/unit/test_topology.c, tests/property/test_topology_random.c). Needs numpy.
"""
import argparse
import hashlib
import json
import math
import os

import numpy

from record import DATA, ROOT, Run, made, write

# file: options, what they are to do
PARTS = {
    "couplingdown.off": ["--max-feature", "10%"],
    "rotor.off": ["--max-feature", "20%", "--sharp-angle", "40"],
    "cad_42400.stl": ["--max-feature", "5%"],
    "holes.off": ["--close-cracks", "1.2", "--zip-tolerance", "0"],
    "mech-holes-shark.off": ["--close-cracks", "0.5", "--zip-tolerance", "0"],
}
VIEWS = {"mech-holes-shark.off": ["--view=-1,0.5,-0.6"]}
SCANS = [
    ("stanford_dragon.ply.gz", ["--drop-components", "3%"]),
    ("stanford_dragon.ply.gz", ["--drop-components", "2%"]),
    ("stanford_dragon.ply.gz", ["--close-cracks", "2%"]),
    ("stanford_bunny_ascii.ply", ["--close-cracks", "5%"]),
    ("stanford_bunny_ascii.ply", ["--close-cracks", "20%"]),
    ("photogrammetry_birdbath_holes.ply", ["--close-cracks", "2%"]),
    ("ct_cranium_open.ply.gz", ["--close-cracks", "2%"]),
]


def read_ply(path):
    """Positions and faces of a binary PLY of triangles without other properties."""
    with open(path, "rb") as file:
        data = file.read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    head = data[:end].decode()
    counts = [int(line.split()[2]) for line in head.splitlines() if line.startswith("element")]
    kind = "<f8" if "double x" in head else "<f4"
    points = numpy.frombuffer(data, kind, 3 * counts[0], end).reshape(-1, 3)
    row = numpy.dtype([("n", "u1"), ("v", "<i4", 3)])
    return points, numpy.frombuffer(data, row, counts[1], end + points.nbytes)["v"]


def rows(array):
    """Rows as single comparable items."""
    array = numpy.ascontiguousarray(array)
    return array.view(numpy.dtype((numpy.void, array.dtype.itemsize * array.shape[1]))).ravel()


def turned(faces):
    """Faces from their lowest corner on, so that equal ones are equal."""
    first = faces.argmin(axis=1)
    return numpy.stack([faces[numpy.arange(len(faces)), (first + k) % 3] for k in range(3)], 1)


def compare(before, after):
    """Vertices of `after` that are nowhere in `before`, bit for bit, and faces that are not."""
    old_points, old_faces = read_ply(before)
    points, faces = read_ply(after)
    old, new = rows(old_points), rows(points)
    moved = int((~numpy.isin(new, old)).sum())
    unique, numbers = numpy.unique(numpy.concatenate([old, new]), return_inverse=True)
    was = rows(turned(numbers[:len(old)][old_faces]))
    now = rows(turned(numbers[len(old):][faces]))
    return moved, int((~numpy.isin(now, was)).sum())


def fixture(path, side, corners):
    """A plate with side * side round holes, every cell of its triangles by itself, as ASCII OFF."""
    points, faces, numbers = [], [], {}

    def vertex(x, y, z):
        key = (round(x, 9), round(y, 9), z)
        if key not in numbers:
            numbers[key] = len(points)
            points.append(key)
        return numbers[key]

    for cx in range(side):
        for cy in range(side):
            square = [(cx, cy), (cx + 1, cy), (cx + 1, cy + 1), (cx, cy + 1)]
            ring = [(cx + .5 - .3 * math.cos(2 * math.pi * (i + .5) / corners),
                     cy + .5 - .3 * math.sin(2 * math.pi * (i + .5) / corners))
                    for i in range(corners)]
            rings = [[vertex(*at, z) for at in ring] for z in (0, 1)]
            for z in (0, 1):
                flip = slice(None, None, 1 if z else -1)
                for i in range(corners):
                    corner = vertex(*square[i * 4 // corners], z)
                    faces.append([rings[z][i], corner, rings[z][(i + 1) % corners]][flip])
                    if (i + 1) * 4 // corners != i * 4 // corners:
                        after = vertex(*square[(i + 1) * 4 // corners % 4], z)
                        faces.append([corner, after, rings[z][(i + 1) % corners]][flip])
            for i in range(corners):
                low, high = rings
                j = (i + 1) % corners
                faces += [[low[j], low[i], high[i]], [low[j], high[i], high[j]]]
            for k in range(4):
                a, b = square[k], square[(k + 1) % 4]
                if a[k % 2 == 0] == b[k % 2 == 0] == (0, side, side, 0)[k]:
                    v = [vertex(*a, 0), vertex(*b, 0), vertex(*b, 1), vertex(*a, 1)]
                    faces += [[v[0], v[1], v[2]], [v[0], v[2], v[3]]]
    with open(path, "w", encoding="ascii") as file:
        file.write(f"OFF\n{len(points)} {len(faces)} 0\n")
        file.writelines("%.9g %.9g %.9g\n" % point for point in points)
        file.writelines("3 %d %d %d\n" % tuple(face) for face in faces)
    return len(faces)


def peak_of(report):
    return report["memory_peak"]


class Bench:
    def __init__(self, options):
        self.spbm, self.work = options.spbm, options.work

    def path(self, name):
        return os.path.join(self.work, name)

    def json(self, *words, allowed=(0,)):
        run = Run([self.spbm, *words, "-q", "--json", "-"], allowed, keep_output=True)
        return json.loads(run.output), run

    def topology(self, source, words, output="out.ply"):
        report, run = self.json("topology", source, "-o", self.path(output), *words)
        mesh, _ = self.json("info", self.path(output))
        self.json("check", self.path(output))
        return report, mesh["mesh"], run

    def went(self, report):
        sizes = {}
        for one in report["removed"]:
            sizes.setdefault(one["kind"], []).append(one["size"] / report["store"]["diagonal"])
        return "; ".join(f"{len(found)} {kind} ({100 * min(found):.1f} to {100 * max(found):.1f} %)"
                         for kind, found in sorted(sizes.items())) or "nothing"

    def parts(self, pictures):
        text = ("| part | options | went (size of the diagonal) | faces in, out | Euler | border loops |"
                " vertices moved | faces that are new, reported |\n|---|---|---|---|---|---|---|---|\n")
        for name, words in PARTS.items():
            Run([self.spbm, "import", f"{DATA}/{name}", "-o", self.path("a.store"), "-q"])
            Run([self.spbm, "export", self.path("a.store"), "-o", self.path("in.ply"), "-q"])
            report, mesh, _ = self.topology(self.path("a.store"), words)
            moved, new = compare(self.path("in.ply"), self.path("out.ply"))
            was, is_now = report["store"]["topology"], mesh["topology"]
            text += (f"| {name} | `{' '.join(words)}` | {self.went(report)} | {was['faces']:,}, "
                     f"{is_now['faces']:,} | {was['euler']}, {is_now['euler']} | "
                     f"{was['border_loops']}, {is_now['border_loops']} | {moved} | {new}, "
                     f"{report['added_faces']} |\n")
            if pictures:
                os.makedirs(pictures, exist_ok=True)
                Run([self.spbm, "render", self.path("in.ply"), self.path("out.ply"), "-o",
                     f"{pictures}/topology-{name.split('.')[0]}.png", "--size", "320x240",
                     "--no-captions", "-q", *VIEWS.get(name, [])])
        return text

    def scans(self):
        text = ("| scan | options | components | border loops | Euler | faces in, out | CPU s | peak |\n"
                "|---|---|---|---|---|---|---|---|\n")
        for name, words in SCANS:
            report, mesh, run = self.topology(f"{DATA}/{name}", words)
            was, is_now = report["store"]["topology"], mesh["topology"]
            pairs = " | ".join(f"{was[key]:,}, {is_now[key]:,}"
                               for key in ("components", "border_loops", "euler", "faces"))
            text += (f"| {name} | `{' '.join(words)}` | {pairs} | {run.cpu:.2f} | "
                     f"{peak_of(report) >> 20} MiB |\n")
        return text

    def floor(self, part):
        text = ("| command | faces asked for | faces made | stop | what went |\n|---|---|---|---|---|\n")
        for command in ("simplify", "lod"):
            source = part
            if command == "lod":
                Run([self.spbm, "import", part, "-o", self.path("b.store"), "-q"])
                source = self.path("b.chains")
            for mode in ("collapse", "classic"):
                if command == "lod":
                    Run([self.spbm, "patchify", self.path("b.store"), "-o", source, "--faces", "2000",
                         "--mode", mode, "-q"])
                for words in ([], ["--max-feature", "0.7"]):
                    report, _ = self.json(command, source, "-o", self.path("s.ply"), "--faces", "12",
                                          "--mode", mode, *words, allowed=(0, 3))
                    level, went = report["levels"][0], report.get("removed_counts", {})
                    text += (f"| `{' '.join([command, '--mode', mode, *words])}` | 12 | {level['faces']:,} "
                             f"| {level['stop']} | {went.get('hole', 0)} holes |\n")
        return text

    def times(self, part, faces):
        best = {}
        for _ in range(5):
            for name, words in (("topology --merge-coplanar",
                                 ["topology", "--max-feature", "0.7", "--merge-coplanar"]),
                                ("simplify --faces 2000, holes kept", ["simplify", "--faces", "2000"])):
                run = Run([self.spbm, words[0], part, "-o", self.path("t.ply"), *words[1:], "-t", "1",
                           "-q"], (0, 3))
                best[name] = min(best.get(name, 9e9), run.cpu)
        return "".join(f"- {name}: {faces:,} faces in, {seconds:.2f} CPU seconds\n"
                       for name, seconds in best.items())

    def memory(self):
        text = "| mesh | options | faces | chain vertices | peak | bytes a face |\n|---|---|---|---|---|---|\n"
        name = "stanford_dragon.ply.gz"
        Run([self.spbm, "import", f"{DATA}/{name}", "-o", self.path("a.store"), "-q"])
        for words, angle in ((["--drop-components", "3%"], "15"), (["--max-feature", "1%"], "4")):
            Run([self.spbm, "patchify", self.path("a.store"), "-o", self.path("a.chains"), "--faces",
                 "1", "--mode", "classic", "--patch-angle", f"{angle},{angle}", "--face-angle",
                 f"{angle},{angle}", "-q"])
            chains, _ = self.json("info", self.path("a.chains"))
            report, _, run = self.topology(self.path("a.store"), words)
            faces = report["store"]["topology"]["faces"]
            text += (f"| {name} | `{' '.join(words)}` | {faces:,} | "
                     f"{chains['chains']['chain_vertices']:,} | {peak_of(report) >> 20} MiB | "
                     f"{peak_of(report) / faces:.0f} |\n")
        return text

    def bytes(self):
        seen = set()
        for threads in ("1", "2", "3", "8"):
            for memory in ("52M", "4G"):
                Run([self.spbm, "topology", f"{DATA}/stanford_bunny_ascii.ply", "-o",
                     self.path("b.ply"), "--close-cracks", "20%", "--max-feature", "2%", "-t", threads,
                     "-m", memory, "-q"])
                with open(self.path("b.ply"), "rb") as file:
                    seen.add(hashlib.sha256(file.read()).hexdigest())
        return f"8 runs (1, 2, 3, 8 threads; `-m 52M` and `4G`), {len(seen)} different output\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("--work", default=f"{ROOT}/build/topology")
    parser.add_argument("--pictures", help="folder for pictures before and after")
    parser.add_argument("--output", help="the record (default: standard output)")
    options = parser.parse_args()
    os.makedirs(options.work, exist_ok=True)
    bench = Bench(options)
    part = bench.path("fixture.off")
    faces = fixture(part, 20, 44)
    write(f"""# Topology simplification

{{made}}

Vertices moved: vertices of the output that are not, bit for bit, vertices of the cleaned input. Every output passes
`spbm check` (a manifold, consistently oriented).

## Parts

{bench.parts(options.pictures)}
## Scans: specks and cracks

{bench.scans()}
## Counts below the floor: a plate with 400 holes, {faces:,} faces

{bench.floor(part)}
## Time, best of 5

{bench.times(part, faces)}
## Memory

{bench.memory()}
## Threads and memory change no byte

{bench.bytes()}""".replace("{made}", made()), options.output)


if __name__ == "__main__":
    main()
