#!/usr/bin/env python3
"""memory.py [-o RECORD.md]

Peak memory (VmHWM, mapped pages counted) and CPU seconds of each stage of `spbm simplify` on a
generated, closed, noisy, scan-like mesh of 1,087,716 faces to 12,700, for both modes, all efforts
and one and two threads.
"""
import argparse
import json
import subprocess
import tempfile

from record import ROOT, made, write


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("--generator", default=f"{ROOT}/build/bench/gen_scan")
    parser.add_argument("-o", "--output", help="the record; default: standard output")
    options = parser.parse_args()
    lines = ["# Peak memory of `spbm simplify`\n",
             f"{made()} That is `gen_scan --faces 1087716 -o scan.ply` (543,860 vertices, noise of "
             "0.04 edges), then `spbm simplify scan.ply -o small.ply --faces 12700 OPTIONS --json -`.\n",
             "| options | peak, bytes | bytes a vertex | CPU s: import | patchify | lod |",
             "|---|---|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as work:
        scan = f"{work}/scan.ply"
        subprocess.run([options.generator, "--faces", "1087716", "-o", scan], check=True,
                       stderr=subprocess.DEVNULL)
        for choice in ("--effort 1", "--effort 2", "--effort 3", "--mode classic"):
            for threads in ("1", "2"):
                report = json.loads(subprocess.run(
                    [options.spbm, "simplify", scan, "-o", f"{work}/small.ply", "--faces", "12700",
                     *choice.split(), "-t", threads, "--json", "-", "-q"],
                    check=True, capture_output=True, text=True).stdout)
                vertices = report["store"]["topology"]["vertices"]
                stages = " | ".join(f"{stage['cpu_seconds']:.2f}" for stage in report["stages"])
                lines.append(f"| {choice} -t {threads} | {report['memory_peak']:,} "
                             f"| {report['memory_peak'] / vertices:.0f} | {stages} |")
    text = "\n".join(lines) + "\n"
    write(text, options.output)


if __name__ == "__main__":
    main()
