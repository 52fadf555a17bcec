#!/usr/bin/env python3
"""accuracy.py [--folder DIR] [--work DIR] [--only NAME,...] [--peers DIR] [--cached] [-o RECORD.md]

Compares the accuracy of spbm with that of Debian's other simplifiers at equal face counts: each
input is imported and exported once (so that all simplify the same clean manifold), simplified by
each program to the same counts, and measured by `spbm measure`. The record is a Markdown table a
mesh: mean, RMS and symmetric maximum as fractions of the diagonal, each also as a ratio to the best
quadric collapse, whether topology survived, CPU seconds and peak memory of the whole process.

With --folder every mesh of at least 1,500 faces in that folder is taken instead, down to 10, 2 and 1 %
of its faces, with a row for each: for meshes that nobody tuned anything on (Debian's libcgal-demo
brings a hundred, in /usr/share/doc/libcgal-dev/data.tar.gz).

The peers' results are kept in DIR, as they do not change: only spbm's are made again.
scripts/peers.sh installs the peers and builds their drivers (bench/peers).
"""
import argparse
import json
import os
import sys

from record import DATA, ROOT, Run, made, write


# Counts: about 10 %, 2 %, 1 % and less of the faces, at least five times the floor.
MESHES = {
    "bunny": ("stanford_bunny_ascii.ply", [6945, 1504, 695]),
    "elephant": ("refined_elephant.off.gz", [8892, 1778, 889]),
    "koala": ("koala.obj.gz", [9999, 2000, 1000]),
    "skull": ("skull.obj.gz", [10000, 2000, 1000]),
    "dragon": ("stanford_dragon.ply.gz", [87000, 17400, 8700]),
    "cranium": ("ct_cranium_open.ply.gz", [40000, 34200]),
    "brain": ("mri_brain_3m.ply.gz", [61000, 30600]),
    "fandisk": ("fandisk.off.gz", [1294, 260, 130]),
    "noisy": ("gen:--faces 1087716 --noise 0.04", [108770, 12700, 3500]),
    "clean": ("gen:--faces 1087716 --noise 0", [108770, 12700, 3500]),
}

PEERS = {
    "CGAL Lindstrom-Turk": ("cgal", "lindstrom-turk"),
    "CGAL Garland-Heckbert": ("cgal", "garland-heckbert"),
    "VTK quadric": ("vtk", "quadric"),
    "OpenMesh quadric": ("openmesh", "quadric"),
    "meshoptimizer": ("meshoptimizer", "simplify"),
}
EXACT = 1e-9  # of the diagonal: less than this is rounding
QUADRIC = ("CGAL Garland-Heckbert", "VTK quadric")


def prepare(spbm, generator, work, name):
    """The clean mesh of an input as a binary PLY, and its store's report."""
    source, _ = MESHES[name]
    mesh, report = f"{work}/{name}.ply", f"{work}/{name}.json"
    if not os.path.exists(report):
        if source.startswith("gen:"):
            path = f"{work}/{name}-generated.ply"
            Run([generator, *source[4:].split(), "-o", path])
        else:
            path = os.path.join(DATA, source)
        Run([spbm, "import", path, "-o", f"{work}/{name}.store", "-q", "--json", report + "~"])
        Run([spbm, "export", f"{work}/{name}.store", "-o", mesh, "-q"])
        os.rename(report + "~", report)
    with open(report, encoding="utf-8") as file:
        return mesh, json.load(file)["store"]


def simplify(spbm, peers, work, name, method, mesh, faces, cached=False):
    """Runs one simplification and measures it. Peers' results come from the work folder if there."""
    slug = method.lower().replace(" ", "-")
    output, record = f"{work}/{name}-{faces}-{slug}.ply", f"{work}/{name}-{faces}-{slug}.json"
    own = method.startswith("spbm")
    if not own and os.path.exists(record):
        with open(record, encoding="utf-8") as file:
            return json.load(file)
    if not own and cached:
        return None
    if own:
        effort = method.split()[-1]
        made_by = Run([spbm, "simplify", mesh, "-o", output, "--faces", str(faces), "-q", "--effort",
                       effort, "--json", "-"], (0, 3), keep_output=True)
        level = json.loads(made_by.output)["levels"][0]
    else:
        program, argument = PEERS[method]
        made_by = Run([f"{peers}/{program}", argument, mesh, output, str(faces)])
        level = None
    measured = Run([spbm, "measure", mesh, output, "-q", "--json", "-"], keep_output=True)
    result = {"cpu": made_by.cpu, "peak": made_by.peak, "level": level,
              "measurement": json.loads(measured.output)["measurement"]}
    with open(record, "w", encoding="utf-8") as file:
        json.dump(result, file)
    return result


def describe_topology(wanted, result):
    """What a simplification did to the topology; "kept" when nothing."""
    quality = result["measurement"]["simplified"]
    found = [f"{quality[key]:,} {words}" for key, words in (
        ("nonmanifold_edges", "non-manifold edges"),
        ("nonmanifold_vertices", "non-manifold vertices"),
        ("misoriented_edges", "misoriented edges"),
        ("duplicate_faces", "duplicate faces"),
        ("degenerate_faces", "degenerate faces")) if quality[key]]
    for key in ("components", "border_loops", "euler"):
        if quality["topology"][key] != wanted[key]:
            found.append(f"{key.replace('_', ' ')} {quality['topology'][key]:,} "
                         f"for {wanted[key]:,}")
    return "; ".join(found) or "kept"


def check_count(store, result, faces):
    """Nothing, or what is wrong with the count: it is N or N-1, or the run says that it missed."""
    level = result["level"]
    if level["faces"] in (faces, faces - 1) or level["stop"] != "reached":
        return None
    return f"{level['faces']} faces for {faces}, stop {level['stop']}"


def summarise(rows):
    """What holds and what does not, over all rows of spbm: (mesh, faces, method, figures, ratios,
    estimate, topology, count)."""
    lines = [f"{len(rows)} runs of spbm. Topology kept in {sum(row[6] == 'kept' for row in rows)}; "
             f"N or N-1 faces, or a reason: {sum(row[7] is None for row in rows)}."]
    for effort in "123":
        own = [row for row in rows if row[2].endswith(effort)]
        if not own:
            continue
        ratios = [row for row in own if row[4] and row[3]["max"] > 1e3 * EXACT]
        above = [f"{row[0]} {row[1]:,} {row[4]['max']:.2f}" for row in ratios if row[4]["max"] > 1.3]
        estimates = [row[5] for row in own if row[3]["max"] > 1e3 * EXACT]
        lines.append(
            f"- effort {effort}: mean to the better quadric collapse's "
            f"{min(row[4]['mean'] for row in ratios):.2f} to {max(row[4]['mean'] for row in ratios):.2f}; "
            f"maximum above 1.3 of it in {len(above)} of {len(ratios)}: {', '.join(above) or 'none'}; "
            f"--error {min(estimates):.2f} to {max(estimates):.2f} of the measured maximum.")
    return lines


def folder_meshes(folder):
    """Meshes in a folder, by name; their counts are known when they are imported."""
    return {os.path.splitext(name)[0]: (os.path.join(folder, name), None)
            for name in sorted(os.listdir(folder)) if name.endswith((".off", ".ply", ".stl", ".obj"))}


def counts_of(counts, store):
    """The counts given, or 10, 2 and 1 % of the faces as far as there are enough."""
    if counts is not None:
        return counts
    faces, floor = store["topology"]["faces"], store["topology"]["floor"]
    return [int(faces * part) // 2 * 2 for part in (0.1, 0.02, 0.01)
            if faces >= 1500 and faces * part >= max(40, 5 * floor)]


def row_of(name, store, faces, results):
    """Mean and maximum of the three efforts, as ratios to the better quadric collapse."""
    quadrics = [figures(results[method]) for method in QUADRIC if method in results]
    cells = []
    for effort in "123":
        result = results.get(f"spbm effort {effort}")
        if not result or not quadrics:
            cells.append("")
            continue
        own = figures(result)
        best = {key: min(one[key] for one in quadrics) for key in own}
        cells.append(", ".join(f"{own[key] / max(best[key], EXACT):.2f}" for key in ("mean", "max")))
    return (f"| {name} | {store['topology']['faces']:,} | {faces:,} | " + " | ".join(cells) + " |")


def figures(result):
    measurement = result["measurement"]
    diagonal = measurement["diagonal"]
    both = [measurement["forward"], measurement["backward"]]
    return {"mean": sum(way["mean"] for way in both) / 2 / diagonal,
            "rms": (sum(way["rms"] ** 2 for way in both) / 2) ** 0.5 / diagonal,
            "max": measurement["hausdorff"] / diagonal}


def table(name, store, faces, results, summary):
    rows = [f"\n### {name}: {store['topology']['faces']:,} faces to {faces:,}"
            f" (floor {store['topology']['floor']:,})\n",
            "| method | faces | mean | RMS | max | mean, RMS, max to the quadric collapses' best |"
            " --error to max | topology | CPU s | peak MB |", "|---|---|---|---|---|---|---|---|---|---|"]
    best = {}
    for method in QUADRIC:
        if method in results:
            for key, value in figures(results[method]).items():
                best[key] = max(EXACT, min(value, best.get(key, value)))
    for method, result in results.items():
        own = figures(result)
        ratios = ", ".join(f"{own[key] / best[key]:.2f}" for key in own) if best else ""
        level = result["level"]
        estimate = ""
        if level:
            part = level["error"] / max(result["measurement"]["hausdorff"], EXACT)
            estimate = f"{part:.2f}"
            summary.append((name, faces, method, own,
                            {key: own[key] / best[key] for key in own} if best else None, part,
                            describe_topology(store["topology"], result),
                            check_count(store, result, faces)))
        rows.append(
            f"| {method} | {result['measurement']['simplified']['topology']['faces']:,} "
            f"| {own['mean']:.3e} | {own['rms']:.3e} | {own['max']:.3e} | {ratios} | {estimate} "
            f"| {describe_topology(store['topology'], result)} | {result['cpu']:.2f} "
            f"| {result['peak'] / 1e6:.0f} |")
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("--generator", default=f"{ROOT}/build/bench/gen_scan")
    parser.add_argument("--peers", default=f"{ROOT}/build/peers", help="folder of the drivers")
    parser.add_argument("--methods", help="comma-separated; default: all whose driver is there")
    parser.add_argument("--work", default=f"{ROOT}/build/accuracy")
    parser.add_argument("--folder", help="take the meshes of this folder")
    parser.add_argument("--only", help="comma-separated names of meshes")
    parser.add_argument("--cached", action="store_true", help="no peer is run: what DIR has counts")
    parser.add_argument("-o", "--output", help="the record; default: standard output")
    options = parser.parse_args()
    os.makedirs(options.work, exist_ok=True)
    methods = ["spbm effort 1", "spbm effort 2", "spbm effort 3"]
    methods += [peer for peer, (program, _) in PEERS.items()
                if os.path.exists(f"{options.peers}/{program}")]
    if options.methods:
        methods = options.methods.split(",")
    lines = ["# Accuracy at equal face counts\n",
             f"{made()} Lengths are fractions of the bounding box's diagonal, mean of both directions;"
             " CPU seconds and peak memory are of the whole process, reading and writing"
             " included."]
    summary, head = [], len(lines)
    if options.folder:
        MESHES.clear()
        MESHES.update(folder_meshes(options.folder))
        lines += ["\nMean and largest distance to the better of CGAL's and VTK's quadric collapses.\n",
                  "| mesh | faces | to | effort 1 | effort 2 | effort 3 |", "|---|---|---|---|---|---|"]
    for name in options.only.split(",") if options.only else MESHES:
        try:
            mesh, store = prepare(options.spbm, options.generator, options.work, name)
        except RuntimeError as error:
            if not options.folder:
                raise
            print(error, file=sys.stderr)  # not all files of strangers are surfaces
            continue
        for faces in counts_of(MESHES[name][1], store):
            results = {}
            for method in methods:
                try:
                    result = simplify(options.spbm, options.peers, options.work, name, method,
                                      mesh, faces, options.cached)
                    if result:
                        results[method] = result
                except RuntimeError as error:
                    print(error, file=sys.stderr)
            rows = table(name, store, faces, results, summary)
            lines += [row_of(name, store, faces, results)] if options.folder else rows
            print("\n".join(rows), file=sys.stderr)
    lines[head:head] = ["", *summarise(summary)] if summary else []
    text = "\n".join(lines) + "\n"
    write(text, options.output)


if __name__ == "__main__":
    main()
