#!/usr/bin/env python3
"""cleaning.py [-o TABLE.md]

Runs every mesh of the data folder ($SPBM_DATA, else ../shared/data) through `spbm simplify` to 2 %
of its faces (at least twice the floor), checks store and output, and writes the table of what
import cleaned.
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DATA = os.environ.get("SPBM_DATA", os.path.join(ROOT, "..", "shared", "data"))
COUNTS = {"triangulated_faces": "triangles from polygons", "welded_vertices": "welded",
          "unreferenced_vertices": "unreferenced", "degenerate_faces": "degenerate",
          "duplicate_faces": "duplicate", "nonmanifold_edges": "non-manifold edges",
          "nonmanifold_vertices": "non-manifold vertices", "vertices_added": "vertices added",
          "flipped_faces": "flipped", "cut_edges": "edges cut",
          "zero_area_faces": "zero area (kept)"}


def run(command, allowed=(0,)):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in allowed:
        sys.exit(f"{' '.join(command)}: exit {done.returncode}: {done.stderr}")
    return done


def row(spbm, work, name):
    store, output = f"{work}/mesh.store", f"{work}/mesh.ply"
    report = json.loads(run([spbm, "import", os.path.join(DATA, name), "-o", store, "-q", "--json",
                             "-"]).stdout)["store"]
    run([spbm, "check", store, "-q"])
    topology, cleaning = report["topology"], report["cleaning"]
    wanted = max(topology["faces"] // 50, 2 * topology["floor"], 4)
    verdicts = []
    for mode in ("collapse", "classic"):
        done = run([spbm, "simplify", os.path.join(DATA, name), "-o", output, "-q", "--mode", mode,
                    "--faces", str(wanted), "--json", "-"], (0, 3))
        level = json.loads(done.stdout)["levels"][0]
        mesh = json.loads(run([spbm, "info", output, "--json", "-"]).stdout)["mesh"]
        kept = mesh["is_manifold"] and all(mesh["topology"][key] == topology[key] for key in
                                           ("components", "border_loops", "euler"))
        verdicts.append(f"{level['faces']:,} of {wanted:,}" + ("" if kept else " **BROKEN**"))
    found = ", ".join(f"{cleaning[key]:,} {words}" for key, words in COUNTS.items()
                      if cleaning[key])
    return (f"| {name} | {cleaning['input_vertices']:,} / {cleaning['input_faces']:,} "
            f"| {topology['vertices']:,} / {topology['faces']:,} | {found or 'nothing'} "
            f"| {topology['components']:,} | {topology['border_loops']:,} | {topology['euler']:,} "
            f"| {topology['floor']:,} | {verdicts[0]} | {verdicts[1]} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("-o", "--output", help="default: standard output")
    options = parser.parse_args()
    lines = ["| file | V / F in the file | V / F of the store | cleaned | components | loops | Euler "
             "| floor | collapse | classic |", "|---|---|---|---|---|---|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as work:
        for name in sorted(os.listdir(DATA)):
            if not name.endswith(".md"):
                lines.append(row(options.spbm, work, name))
    text = "\n".join(lines) + "\n"
    if options.output:
        with open(options.output, "w", encoding="utf-8") as file:
            file.write(text)
    else:
        print(text, end="")


if __name__ == "__main__":
    main()
