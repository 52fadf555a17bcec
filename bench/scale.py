#!/usr/bin/env python3
"""scale.py [--largest 64M] [--only LINES] [--work DIR] [-o RECORD.md] [--plot PLOT.svg]

How `spbm simplify` scales: generated scans (gen_scan) of 1, 4, 16 and 64 million faces, in coherent and
random order, as a soup and as gzip'd text, within memory budgets and control groups. Checks what issue 4
promises (its lines 1 to 5) and says of each whether it holds. With --largest smaller than 64M all sizes
shrink by the same factor, budgets do not: a trial of the script, not of the program. Needs 12 GB of disk
and an hour for 64M. Page cache counts against a control group; inputs are not in the cache when a run
begins.
"""
import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile

import groups
import plot
from record import ROOT, made

MIB = 1 << 20


def count(text):
    units = {"k": 10 ** 3, "M": 10 ** 6, "G": 10 ** 9}
    return int(float(text[:-1]) * units[text[-1]]) if text[-1] in units else int(text)


def words_of(faces):
    return "%g M" % (faces / 1e6)


class Bench:
    def __init__(self, options):
        self.options = options
        self.scale = count(options.largest) / 64e6
        self.work = options.work
        self.rows, self.checks, self.curve, self.notes = [], [], [], []

    # ---- inputs and runs ----

    def faces(self, millions):
        return int(millions * 1e6 * self.scale)

    def target(self, millions):
        """The same ratio at every size: 100,000 faces of 64 million."""
        return max(int(100000 * millions / 64 * self.scale), 64)

    def scan(self, millions, order="tiles", form="ply"):
        gzip = form == "gz"
        name = "%s/%g-%s.%s" % (self.work, millions, order, {"gz": "ply.gz"}.get(form, form))
        if os.path.exists(name):
            return name
        words = [self.options.generator, "--faces", str(self.faces(millions)), "--order", order,
                 "--format", "ply-ascii" if gzip else form, "-o", "-" if gzip else name + "~"]
        if gzip:
            with open(name + "~", "wb") as out:
                maker = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
                subprocess.run(["gzip", "-1"], stdin=maker.stdout, stdout=out, check=True)
                if maker.wait() != 0:
                    sys.exit("gen_scan failed")
        else:
            subprocess.run(words, check=True, stderr=subprocess.DEVNULL)
        os.rename(name + "~", name)
        return name

    def run(self, what, scan, millions, memory, limit=None, faces=None):
        output = "%s/out.ply" % self.work
        if os.path.exists(output):
            os.unlink(output)
        groups.forget_cache(scan)
        words = [self.options.spbm, "simplify", scan, "-o", output, "--faces",
                 str(faces or self.target(millions)), "-q", "--json", "-", "--tmp", self.work]
        if memory:
            words += ["-m", str(memory)]
        result = groups.run(words, limit)
        report = result["report"] or {}
        result["what"], result["memory"], result["faces"] = what, memory, self.faces(millions)
        result["peak"] = report.get("memory_peak", 0)
        result["cpu"] = report.get("cpu_seconds", 0)
        result["vertices"] = report.get("store", {}).get("topology", {}).get("vertices", 0)
        result["topology"] = report.get("store", {}).get("topology")
        result["good"] = result["code"] == 0
        if result["good"]:
            with open(output, "rb") as file:
                result["digest"] = hashlib.file_digest(file, "sha256").hexdigest() \
                    if hasattr(hashlib, "file_digest") else hashlib.sha256(file.read()).hexdigest()
        self.rows.append(result)
        print("%s: exit %d, %.1f s wall, %.1f s CPU, peak %.1f MiB%s" % (
            what, result["code"], result["seconds"], result["cpu"], result["peak"] / MIB,
            "; " + result["error"] if result["error"] else ""), flush=True)
        return result

    def check(self, line, text, holds):
        self.checks.append((line, text, holds))
        print("  line %d: %s: %s" % (line, text, "holds" if holds else "DOES NOT HOLD"), flush=True)

    def seconds(self, result):
        return result["cpu"] if self.options.judge == "cpu" else result["seconds"]

    def ratio(self, line, result, base, most, words):
        part = self.seconds(result) / max(self.seconds(base), 1e-9)
        self.check(line, "%s %.2f times as long (%s), at most %g" % (
            words, part, self.options.judge, most), result["good"] and base["good"] and part <= most)

    def within(self, line, result, budget):
        self.check(line, "VmHWM %.1f MiB of %.0f MiB" % (result["peak"] / MIB, budget / MIB),
                   result["good"] and result["peak"] <= budget)

    # ---- the lines of the issue ----

    def lines_1_and_2(self):
        scan = self.scan(64)
        free = self.run("64 M coherent, 4 GiB", scan, 64, 4096 * MIB)
        tight = self.run("64 M coherent, 256 MiB in a group of 320", scan, 64, 256 * MIB, 320 * MIB)
        self.within(1, tight, 256 * MIB)
        self.check(1, "the same bytes as with 4 GiB",
                   tight["good"] and tight.get("digest") == free.get("digest"))
        self.ratio(1, tight, free, 1.5, "than with 4 GiB")
        store = 72 * tight["vertices"]
        moved = max(tight["rchar"] + tight["wchar"], tight["read_bytes"] + tight["write_bytes"])
        self.check(1, "%.2f GB read and written by calls, %.2f GB from and to the disk; the larger is %.1f times "
                   "72 bytes a vertex" % ((tight["rchar"] + tight["wchar"]) / 1e9, (tight["read_bytes"] + tight["write_bytes"]) / 1e9,
                                 moved / max(store, 1)), tight["good"] and moved <= 6 * store)
        self.joins(tight)
        if 2 in self.options.only:
            shuffled = self.run("64 M shuffled, 256 MiB in a group of 320",
                                self.scan(64, "shuffled"), 64, 256 * MIB, 320 * MIB)
            self.within(2, shuffled, 256 * MIB)
            same = shuffled["good"] and tight["good"] and all(
                shuffled["topology"][key] == tight["topology"][key] for key in tight["topology"])
            self.check(2, "the same topology and counts", same)
            self.ratio(2, shuffled, tight, 6, "than in coherent order")

    def line_3(self):
        scan = self.scan(16)
        free = self.run("16 M coherent, no limit asked", scan, 16, None)
        tight = self.run("16 M coherent, 64 MiB in a group of 96", scan, 16, 64 * MIB, 96 * MIB)
        self.within(3, tight, 64 * MIB)
        self.check(3, "the same bytes", tight["good"] and tight["digest"] == free.get("digest"))
        self.ratio(3, tight, free, 3, "than without a limit")
        refused = self.run("16 M coherent, 8 MiB", scan, 16, 8 * MIB)
        self.check(3, "8 MiB are refused in %.2f s: %s" % (refused["seconds"], refused["error"]),
                   refused["code"] == 4 and refused["seconds"] < 2 and "at least" in refused["error"])

    def line_4(self):
        for millions in (1, 4, 16, 64):
            result = self.run("%g M coherent, 1 GiB" % millions, self.scan(millions), millions,
                              1024 * MIB)
            self.curve.append(result)
            bound = min(100 * result["vertices"] + 8 * MIB, 1024 * MIB)
            self.check(4, "%s faces: VmHWM %.1f MiB, at most %.1f (100 bytes a vertex and 8 MiB, or the "
                       "budget)" % (words_of(result["faces"]), result["peak"] / MIB, bound / MIB),
                       result["good"] and result["peak"] <= bound)
        per_face = [self.seconds(result) / result["faces"] for result in self.curve]
        self.check(4, "time a face at the largest %.2f times that at the smallest, at most 1.5"
                   % (per_face[-1] / per_face[0]),
                   all(r["good"] for r in self.curve) and per_face[-1] <= 1.5 * per_face[0])

    def line_5(self):
        for what, scan in (("soup", self.scan(16, "tiles", "stl")),
                           ("gzip'd text", self.scan(16, "tiles", "gz"))):
            result = self.run("16 M %s, 128 MiB" % what, scan, 16, 128 * MIB)
            self.within(5, result, 128 * MIB)
            closed = result["good"] and result["topology"]["border_edges"] == 0 and \
                result["topology"]["euler"] == 2
            self.check(5, "%s: closed and of genus 0 again" % what, closed)

    def joins(self, result):
        joins = (result["report"] or {}).get("joins")
        if joins:
            self.notes.append("Joins of the tree of blocks at the largest size: " + "; ".join(
                "%(joins)d joins of %(faces_in)d faces, the largest %(largest_in)d, thinned to "
                "%(faces_out)d" % join for join in joins) + ".")

    # ---- the record ----

    def record(self, file):
        file.write("# How `spbm simplify` scales\n\n%s Control groups: %s. Times are judged by %s seconds.\n\n" % (
            made(), next((r["group"] for r in self.rows if r.get("group")), None) or "none, sampled",
            self.options.judge))
        file.write("| run | exit | wall s | CPU s | import | patchify | lod | VmHWM MiB | bytes a vertex | "
                   "group peak MiB | read GB | written GB | disk read GB | disk written GB | temporary GB "
                   "|\n|" + "---|" * 15 + "\n")
        for row in self.rows:
            stages = {stage["name"]: "%.1f" % stage["cpu_seconds"]
                      for stage in (row["report"] or {}).get("stages", [])}
            group = row.get("group_peak")
            file.write("| %s | %d | %.1f | %.1f | %s | %s | %s | %.1f | %.0f | %s | %.2f | %.2f | %.2f | "
                       "%.2f | %.2f |\n" % (
                           row["what"], row["code"], row["seconds"], row["cpu"],
                           stages.get("import", "-"), stages.get("patchify", "-"),
                           stages.get("lod", "-"), row["peak"] / MIB,
                           row["peak"] / row["vertices"] if row["vertices"] else 0,
                           "%.1f" % (group / MIB) if group else "-", row["rchar"] / 1e9,
                           row["wchar"] / 1e9, row["read_bytes"] / 1e9, row["write_bytes"] / 1e9,
                           row["temporary"] / 1e9))
        file.write("\n| line of issue 4 | check | holds |\n|---|---|---|\n")
        for line, text, holds in sorted(self.checks, key=lambda check: check[0]):
            file.write("| %d | %s | %s |\n" % (line, text, "yes" if holds else "**no**"))
        for note in self.notes:
            file.write("\n%s\n" % note)

    def plot(self, path):
        rows = [row for row in self.curve if row["good"]]
        if len(rows) < 2:
            return
        curves = (("CPU seconds", lambda row: row["cpu"]),
                  ("VmHWM, MiB", lambda row: row["peak"] / MIB),
                  ("temporary space, GB", lambda row: row["temporary"] / 1e9),
                  ("read and written by calls, GB", lambda row: (row["rchar"] + row["wchar"]) / 1e9))
        last = rows[-1]
        plot.chart(path, "spbm simplify, budget 1 GiB", "faces", "see the lines' names", [
            (name, [(row["faces"], max(of(row), 1e-3), name if row is last else "") for row in rows], True)
            for name, of in curves])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("--generator", default=f"{ROOT}/build/bench/gen_scan")
    parser.add_argument("--largest", default="64M", help="faces of the largest scan (64M)")
    parser.add_argument("--only", default="1,2,3,4,5", help="lines of the issue, as 1,3")
    parser.add_argument("--judge", choices=("wall", "cpu"), default="wall",
                        help="which seconds are compared")
    parser.add_argument("--work", help="folder for inputs, which are then kept (temporary)")
    parser.add_argument("-o", "--output", help="the record; default: standard output")
    parser.add_argument("--plot", help="curves as SVG")
    options = parser.parse_args()
    options.only = [int(line) for line in options.only.split(",")]
    keeps = options.work is not None
    options.work = options.work or tempfile.mkdtemp(prefix="spbm-scale-")
    os.makedirs(options.work, exist_ok=True)
    bench = Bench(options)
    try:
        if 4 in options.only:
            bench.line_4()
        if 3 in options.only:
            bench.line_3()
        if 5 in options.only:
            bench.line_5()
        if 1 in options.only or 2 in options.only:
            bench.lines_1_and_2()
    finally:  # what was measured is kept also when the rest was too long
        if options.output:
            with open(options.output, "w", encoding="utf-8") as file:
                bench.record(file)
        else:
            bench.record(sys.stdout)
        if options.plot:
            bench.plot(options.plot)
        if not keeps:
            shutil.rmtree(options.work, ignore_errors=True)
    sys.exit(0 if all(holds for _, _, holds in bench.checks) else 1)


if __name__ == "__main__":
    main()
