#!/usr/bin/env python3
"""instructions.py [--update] [--build DIR]

Counts the instructions that each stage takes on a small generated scan (callgrind, one thread, vector
level pinned), and compares them with the record bench/results/instructions.json: more than 10 %
above it fails, so that a slow-down shows on machines too noisy for clocks. --update writes the
record anew. The counts are those of the release build with the record's compiler: another compiler,
or a machine without the vector level, is said and passes.
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
RECORD = os.path.join(ROOT, "bench", "results", "instructions.json")
STAGES = ("spbm_import", "spbm_patchify", "spbm_lod")
FACES, TARGET, EFFORTS, LEVEL, LEVEL_FLAG = 60_000, 1_500, (1, 2), 2, "avx2"
ALLOWED = 1.10


def count(build, work, effort):
    """Instructions of each stage: callgrind writes one file when a stage's function returns."""
    out = f"{work}/counts"
    subprocess.run(
        ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}",
         *(f"--dump-after={stage}" for stage in STAGES),
         f"{build}/bench/one_run", f"{work}/scan.ply", work, str(TARGET), str(effort), str(LEVEL)],
        check=True, stderr=subprocess.DEVNULL)
    counts = {}
    for stage, part in zip(STAGES, range(1, len(STAGES) + 1)):
        with open(f"{out}.{part}", encoding="utf-8") as file:
            line = next(line for line in file if line.startswith(("totals:", "summary:")))
        counts[stage] = int(line.split()[1])
    return counts


def compiler(build):
    """What made the program, as its object files say."""
    section = subprocess.run(["readelf", "-p", ".comment", f"{build}/bench/one_run"], check=True,
                             capture_output=True, text=True).stdout
    return section.split("]", 1)[1].split("\n")[0].strip()


def has_level():
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        return any(LEVEL_FLAG in line.split() for line in file if line.startswith("flags"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--update", action="store_true")
    parser.add_argument("--build", default=f"{ROOT}/build", help="a release build")
    options = parser.parse_args()
    if not has_level():
        print(f"instructions: this machine has no {LEVEL_FLAG}, nothing compared")
        return 0
    with tempfile.TemporaryDirectory() as work:
        subprocess.run([f"{options.build}/bench/gen_scan", "--faces", str(FACES), "-o",
                        f"{work}/scan.ply"], check=True, stderr=subprocess.DEVNULL)
        counts = {f"effort {effort}": count(options.build, work, effort) for effort in EFFORTS}
    found = {"compiler": compiler(options.build), "faces": FACES, "target": TARGET, "counts": counts}
    if options.update:
        with open(RECORD, "w", encoding="utf-8") as file:
            json.dump(found, file, indent=2)
            file.write("\n")
    with open(RECORD, encoding="utf-8") as file:
        record = json.load(file)
    if any(record[key] != found[key] for key in ("compiler", "faces", "target")):
        print("instructions: the record is of another compiler or scan, nothing compared")
        return 0
    slower = 0
    for effort, stages in counts.items():
        for stage, instructions in stages.items():
            ratio = instructions / record["counts"][effort][stage]
            slower += ratio > ALLOWED
            print(f"instructions: {effort}, {stage}: {instructions / FACES:,.0f} a face, "
                  f"{ratio:.3f} of the record{', SLOWER' if ratio > ALLOWED else ''}")
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
