#!/usr/bin/env python3
"""distances.py [--work DIR] [--peers DIR] [-o RECORD.md]

Checks the distances of `spbm measure` against CGAL's on real pairs of a scan and a level of it: the
driver cgal_distance (scripts/peers.sh builds it) asks CGAL's AABB_tree about the same points. Ends
with 1 when a largest, mean or RMS distance differs by more than 1e-6 of itself.
"""
import argparse
import json
import os
import sys

from record import DATA, ROOT, Run, made, write

PAIRS = {
    "bunny": ("stanford_bunny_ascii.ply", 1504),
    "dragon": ("stanford_dragon.ply.gz", 8700),
    "cranium": ("ct_cranium_open.ply.gz", 40000),
    "fandisk": ("fandisk.off.gz", 260),
}
FIGURES = ("largest", "mean", "rms")
TOLERANCE = 1e-6


def measure_pair(options, name):
    """Both programs' figures by direction: {"forward": {"largest": ...}, ...}, twice."""
    source, faces = PAIRS[name]
    mesh, level = f"{options.work}/{name}.ply", f"{options.work}/{name}-{faces}.ply"
    store = f"{options.work}/{name}.store"
    Run([options.spbm, "import", os.path.join(DATA, source), "-o", store, "-q"])
    Run([options.spbm, "export", store, "-o", mesh, "-q"])
    Run([options.spbm, "simplify", mesh, "-o", level, "--faces", str(faces), "-q"], (0, 3))
    own = Run([options.spbm, "measure", mesh, level, "-q", "--json", "-"], keep_output=True)
    theirs = Run([f"{options.peers}/cgal_distance", mesh, level], keep_output=True)
    found = {}
    for line in theirs.output.splitlines():
        way, *values = line.split()
        found[way] = dict(zip((*FIGURES, "samples"), (float(value) for value in values)))
    return json.loads(own.output)["measurement"], found


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("--peers", default=f"{ROOT}/build/peers", help="folder of the drivers")
    parser.add_argument("--work", default=f"{ROOT}/build/distances")
    parser.add_argument("-o", "--output", help="the record; default: standard output")
    options = parser.parse_args()
    os.makedirs(options.work, exist_ok=True)
    worst, lines = 0, [
        "# Distances of `spbm measure` against CGAL's\n", "",
        "| pair | way | points | largest | mean | RMS | largest relative difference |",
        "|---|---|---|---|---|---|---|"]
    for name, (_, faces) in PAIRS.items():
        own, theirs = measure_pair(options, name)
        for way in ("forward", "backward"):
            apart = max(abs(own[way][key] / theirs[way][key] - 1) for key in FIGURES)
            if own[way]["samples"] != theirs[way]["samples"]:
                apart = float("inf")
            worst = max(worst, apart)
            figures = " | ".join(f"{own[way][key]:.6e}" for key in FIGURES)
            lines.append(f"| {name} to {faces:,} | {way} | {own[way]['samples']:,} | {figures} "
                         f"| {apart:.1e} |")
    lines[1] = (f"{made()} Lengths are the models' own. CGAL's AABB_tree (doubles, no exact numbers)"
                f" is asked about the very points that `measure` takes: all vertices for the"
                f" largest distance, and samples by area. Wanted: at most {TOLERANCE:g} apart;"
                f" found: {worst:.1e}.\n")
    write("\n".join(lines) + "\n", options.output)
    return 0 if worst <= TOLERANCE else 1


if __name__ == "__main__":
    sys.exit(main())
