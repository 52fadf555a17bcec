#!/usr/bin/env python3
"""speed.py [--work DIR] [--peers DIR] [--runs N] [--only PART,...] [-o RECORD.md] [--chart OUT.svg]

Times `spbm simplify` as a whole process, and each stage alone, in turn with meshoptimizer's simplify
on the same binary PLY: medians of N runs, ratios run by run, peak memory, bytes a vertex, faces a
second, and the ratio to one pass over the file's bytes. Parts: scan (1,087,716 faces to 12,700), large
(10 M faces to 100,000), shuffled (both in random order), gzip (the Stanford dragon), threads, level (a
further level from an existing chain file), levels (five in one run), stages, chart (time against error of all peers).
"""
import argparse
import hashlib
import json
import os
import statistics
import subprocess
import sys

import accuracy
import plot
from record import DATA, ROOT, Run, made, write

SCAN, LARGE = ("1087716", "12700"), ("10000000", "100000")


def in_turn(runs, commands):
    """Each command once in every round, after one round that is not counted: lists of Run."""
    found = {name: [] for name in commands}
    for number in range(runs + 1):
        for name, command in commands.items():
            run = Run(command)
            if number > 0:
                found[name].append(run)
    return found


def median(runs, key):
    return statistics.median(getattr(run, key) for run in runs)


def ratio(runs, others, key="wall"):
    return statistics.median(getattr(run, key) / getattr(other, key)
                             for run, other in zip(runs, others))


class Bench:
    def __init__(self, options):
        self.options, self.lines = options, []
        os.makedirs(options.work, exist_ok=True)

    def say(self, *lines):
        self.lines += lines
        print("\n".join(lines), file=sys.stderr)

    def generated(self, faces, order="tiles"):
        path = f"{self.options.work}/scan-{faces}-{order}.ply"
        if not os.path.exists(path):
            subprocess.run([self.options.generator, "--faces", faces, "--order", order, "-o",
                            path + "~"], check=True, stderr=subprocess.DEVNULL)
            os.rename(path + "~", path)
        return path

    def simplify(self, path, faces, *options):
        return [self.options.spbm, "simplify", path, "-o", f"{self.options.work}/out.ply", "--faces",
                faces, "-q", *options]

    def against_peer(self, title, path, size):
        """Whole runs at each effort in turn with meshoptimizer."""
        faces, target = int(size[0]), size[1]
        vertices = faces // 2 + 2
        commands = {"one pass over the file (cksum)": ["cksum", path]}
        if os.path.exists(f"{self.options.peers}/meshoptimizer"):
            commands["meshoptimizer simplify"] = [f"{self.options.peers}/meshoptimizer", "simplify",
                                                  path, f"{self.options.work}/peer.ply", target]
        for effort in ("1", "2", "3"):
            commands[f"spbm --effort {effort} -t 2"] = self.simplify(path, target, "--effort", effort,
                                                                     "-t", "2")
        found = in_turn(self.options.runs, commands)
        peer = found.get("meshoptimizer simplify")
        first = next(iter(found.values()))
        self.say(f"\n## {title}\n", "| | wall s | CPU s | peak MB | bytes a vertex | M faces/s |"
                 " wall to meshoptimizer's | peak to its | wall to one pass |",
                 "|---|---|---|---|---|---|---|---|---|")
        for name, runs in found.items():
            wall, peak = median(runs, "wall"), median(runs, "peak")
            to_peer = (f"{ratio(runs, peer):.2f} | {ratio(runs, peer, 'peak'):.2f}" if peer
                       else " | ")
            self.say(f"| {name} | {wall:.2f} | {median(runs, 'cpu'):.2f} | {peak / 1e6:.0f} "
                     f"| {peak / vertices:.0f} | {faces / wall / 1e6:.2f} | {to_peer} "
                     f"| {ratio(runs, first):.1f} |")

    def scan(self):
        self.against_peer("1,087,716 faces to 12,700", self.generated(SCAN[0]), SCAN)

    def large(self):
        self.against_peer("10 M faces to 100,000", self.generated(LARGE[0]), LARGE)

    def shuffled(self):
        for size in (SCAN, LARGE):
            coherent, shuffled = self.generated(size[0]), self.generated(size[0], "shuffled")
            found = in_turn(self.options.runs, {
                "coherent": self.simplify(coherent, size[1]),
                "shuffled": self.simplify(shuffled, size[1])})
            self.say(f"\n## {int(size[0]):,} faces shuffled\n",
                     f"Wall {median(found['shuffled'], 'wall'):.2f} s against "
                     f"{median(found['coherent'], 'wall'):.2f} s coherent: "
                     f"**{ratio(found['shuffled'], found['coherent']):.2f}** times (wanted: 2.5).")

    def gzip(self):
        path = os.path.join(DATA, "stanford_dragon.ply.gz")
        found = in_turn(self.options.runs, {"gzip -dc": ["gzip", "-dc", path],
                                            "spbm": self.simplify(path, "10000", "-t", "2")})
        self.say("\n## stanford_dragon.ply.gz (ASCII, gzip) to 10,000\n",
                 f"Wall {median(found['spbm'], 'wall'):.2f} s against {median(found['gzip -dc'], 'wall'):.2f}"
                 f" s of `gzip -dc`: **{ratio(found['spbm'], found['gzip -dc']):.2f}** times (wanted: 2).")

    def threads(self):
        path = self.generated(LARGE[0])
        found = in_turn(max(self.options.runs // 2, 1), {
            name: self.simplify(path, LARGE[1], "-t", name) for name in ("1", "2")})
        self.say("\n## Threads, 10 M faces\n",
                 f"Two threads {median(found['2'], 'wall'):.2f} s, one {median(found['1'], 'wall'):.2f} s: "
                 f"**{ratio(found['2'], found['1']):.2f}** (wanted: 0.62).")
        sums = set()
        for name in ("1", "2", "3", "8"):
            Run(self.simplify(path, LARGE[1], "-t", name))
            with open(f"{self.options.work}/out.ply", "rb") as file:
                sums.add(hashlib.sha256(file.read()).hexdigest())
        self.say(f"Outputs of 1, 2, 3 and 8 threads: {len(sums)} different.")

    def level(self):
        """Levels from the chain file that a whole run has kept, and from one of patchify alone."""
        path, store = self.generated(SCAN[0]), f"{self.options.work}/level.store"
        folder, bare = f"{self.options.work}/level-kept", f"{self.options.work}/level.chains"
        Run([self.options.spbm, "import", path, "-o", store, "-q"])
        Run([self.options.spbm, "patchify", store, "-o", bare, "--faces", SCAN[1], "-q"])
        Run(self.simplify(path, SCAN[1], "--keep", folder))
        kept = f"{folder}/mesh.chains"
        lod = lambda chains, faces: [self.options.spbm, "lod", chains, "-o", f"{self.options.work}/out.ply",
                                     "--faces", faces, "-q"]
        commands = {"whole": self.simplify(path, SCAN[1])}
        commands.update({f"{faces}, {name}": lod(chains, faces) for faces in (SCAN[1], "6000", "1000")
                         for name, chains in (("kept", kept), ("patchify's", bare))})
        found = in_turn(self.options.runs, commands)
        self.say("\n## A further level from an existing chain file\n",
                 f"1,087,716 faces; the whole run to {SCAN[1]}: {median(found['whole'], 'wall'):.2f} s. The file that"
                 f" it keeps has {os.path.getsize(kept):,} bytes, patchify's {os.path.getsize(bare):,}. Wanted: 0.15.\n",
                 "| faces, chain file | wall s | CPU s | of the whole run, wall | CPU |", "|---|---|---|---|---|")
        for name, runs in found.items():
            if name != "whole":
                self.say(f"| {name} | {median(runs, 'wall'):.3f} | {median(runs, 'cpu'):.3f} "
                         f"| **{ratio(runs, found['whole']):.2f}** | {ratio(runs, found['whole'], 'cpu'):.2f} |")

    def levels(self):
        """Five levels in one run against the coarsest alone, from one chain file (issue 3, line 5)."""
        self.say("\n## Five levels from one chain file against the coarsest alone\n",
                 "20, 5, 1, 0.3 and 0.1 % of the faces; CPU seconds, one thread.\n",
                 "| mesh | five levels | the coarsest | times (wanted: 1.15) |", "|---|---|---|---|")
        store, chains, out = (f"{self.options.work}/levels.{end}" for end in ("store", "chains", "%d.ply"))
        for name in ("stanford_bunny_ascii.ply", "koala.obj.gz", None):
            path = os.path.join(DATA, name) if name else self.generated(SCAN[0])
            Run([self.options.spbm, "import", path, "-o", store, "-q"])
            Run([self.options.spbm, "patchify", store, "-o", chains, "--ratio", "20%,5%,1%,0.3%,0.1%", "-q"])
            lod = [self.options.spbm, "lod", chains, "-o", out, "-t", "1", "-q", "--ratio"]
            found = in_turn(self.options.runs, {"five": lod + ["20%,5%,1%,0.3%,0.1%"],
                                                "one": lod + ["0.1%"]})
            self.say(f"| {name or 'generated scan'} | {median(found['five'], 'cpu'):.2f} "
                     f"| {median(found['one'], 'cpu'):.2f} "
                     f"| {ratio(found['five'], found['one'], 'cpu'):.2f} |")

    def stages(self):
        self.say("\n## Stages alone, as the program times them (two threads)\n",
                 "Faces a second of the original; syncing to the disk is in the whole and not in them.\n",
                 "| faces | effort | import | patchify | lod | wall s of each | CPU s of each |",
                 "|---|---|---|---|---|---|---|")
        for size in (SCAN, LARGE):
            for effort in ("1", "2", "3"):
                reports = []
                for _ in range(self.options.runs):
                    Run(self.simplify(self.generated(size[0]), size[1], "--effort", effort, "-t", "2",
                                      "--json", f"{self.options.work}/report.json"))
                    with open(f"{self.options.work}/report.json", encoding="utf-8") as file:
                        reports.append(json.load(file)["stages"])
                wall, cpu = ([statistics.median(report[stage][key] for report in reports)
                              for stage in range(3)] for key in ("wall_seconds", "cpu_seconds"))
                rates = " | ".join(f"{int(size[0]) / seconds / 1e6:.1f} M/s" for seconds in wall)
                self.say(f"| {int(size[0]):,} | {effort} | {rates} "
                         f"| {', '.join(f'{seconds:.2f}' for seconds in wall)} "
                         f"| {', '.join(f'{seconds:.2f}' for seconds in cpu)} |")

    def chart(self):
        """Time against error of every program, on the scan; measured by `spbm measure`."""
        path, work, series = self.generated(SCAN[0]), self.options.work, []
        commands = {}
        for peer, (program, argument) in accuracy.PEERS.items():
            if os.path.exists(f"{self.options.peers}/{program}"):
                commands[peer] = [f"{self.options.peers}/{program}", argument, path,
                                  f"{work}/chart.ply", SCAN[1]]
        if os.path.exists(f"{self.options.peers}/meshoptimizer"):
            commands["meshoptimizer sloppy"] = [f"{self.options.peers}/meshoptimizer", "sloppy", path,
                                                f"{work}/chart.ply", SCAN[1]]
        for effort in ("1", "2", "3"):
            commands[f"spbm effort {effort}"] = [self.options.spbm, "simplify", path, "-o",
                                                 f"{work}/chart.ply", "--faces", SCAN[1], "-q",
                                                 "--effort", effort]
        self.say("\n## Time against error, 1,087,716 faces to 12,700\n",
                 "| program | wall s | CPU s | mean error, of the diagonal | peak MB |",
                 "|---|---|---|---|---|")
        own = []
        for name, command in commands.items():
            runs = [Run(command)]
            if runs[0].wall < 5:
                runs += [Run(command) for _ in range(self.options.runs - 1)]
            Run([self.options.spbm, "measure", path, f"{work}/chart.ply", "-q", "--json",
                 f"{work}/measure.json"])
            with open(f"{work}/measure.json", encoding="utf-8") as file:
                mean = accuracy.figures(json.load(file))["mean"]
            self.say(f"| {name} | {median(runs, 'wall'):.2f} | {median(runs, 'cpu'):.2f} | {mean:.3e} "
                     f"| {median(runs, 'peak') / 1e6:.0f} |")
            point = (median(runs, "wall"), mean, name)
            if name.startswith("spbm"):
                own.append(point)
            else:
                series.append((name, [point], False))
        if self.options.chart:
            plot.chart(self.options.chart, "1,087,716 noisy faces to 12,700: time against error",
                       "wall seconds, whole process", "mean error, of the diagonal",
                       [("spbm", own, True)] + series)


def main():
    parts = ("scan", "large", "shuffled", "gzip", "threads", "level", "levels", "stages", "chart")
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("--generator", default=f"{ROOT}/build/bench/gen_scan")
    parser.add_argument("--peers", default=f"{ROOT}/build/peers", help="folder of the drivers")
    parser.add_argument("--work", default=f"{ROOT}/build/speed")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--only", help=f"comma-separated; of {', '.join(parts)}")
    parser.add_argument("--chart", help="SVG of the part `chart`")
    parser.add_argument("-o", "--output", help="the record; default: standard output")
    options = parser.parse_args()
    bench = Bench(options)
    bench.say("# Speed\n", f"{made()} Medians of {options.runs} runs made in turn, whole processes, files in the page cache.")
    for part in options.only.split(",") if options.only else parts:
        getattr(bench, part)()
    text = "\n".join(bench.lines) + "\n"
    write(text, options.output)


if __name__ == "__main__":
    main()
