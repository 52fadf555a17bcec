#!/usr/bin/env python3
"""interrupt.py [--faces 4M] [--kills 50] [--terms 20] [--seed N] [-o RECORD.md]

Ends `spbm simplify` on a generated scan at random moments. SIGKILL, with --resume: the same command then
gives the same bytes as an undisturbed run, and no temporary file is left. SIGTERM, without: the run ends
with 143, within a second, and nothing is left.
"""
import argparse
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time

from record import ROOT, made, write


def digest(path):
    with open(path, "rb") as file:
        return hashlib.sha256(file.read()).hexdigest()


class Interrupt:
    def __init__(self, options, work):
        self.options, self.work = options, work
        self.scan, self.out, self.tmp = work + "/scan.ply", work + "/out/small.ply", work + "/tmp"
        os.mkdir(work + "/out")
        os.mkdir(self.tmp)
        subprocess.run([options.generator, "--faces", options.faces, "-o", self.scan], check=True,
                       stderr=subprocess.DEVNULL)
        self.words = [options.spbm, "simplify", self.scan, "-o", self.out, "--ratio", "1%", "-q", "--tmp",
                      self.tmp, *options.more.split()]
        began = time.monotonic()
        subprocess.run(self.words, check=True)
        self.seconds = time.monotonic() - began
        self.good = digest(self.out)
        self.clear()

    def clear(self):
        if os.path.exists(self.out):
            os.unlink(self.out)

    def left(self):
        """Whatever is there that should not be."""
        return [name for name in os.listdir(self.work + "/out") if name != "small.ply"] + \
            os.listdir(self.tmp)

    def end(self, words, number):
        """Starts the run, sends the signal; (moment, exit code, seconds until it ended)."""
        process = subprocess.Popen(words, stderr=subprocess.DEVNULL)
        moment = random.uniform(0.02, self.seconds * 1.05)
        time.sleep(moment)
        began = time.monotonic()
        process.send_signal(number)
        code = process.wait()
        return moment, code, time.monotonic() - began

    def kills(self):
        words, wrong, resumed, ended = self.words + ["--resume"], 0, 0, 0
        for _ in range(self.options.kills):
            moment, code, _ = self.end(words, signal.SIGKILL)
            ended += code == 0
            resumed += any(os.path.exists("%s/%s/mesh.store" % (self.tmp, name))
                           for name in os.listdir(self.tmp))
            self.clear()
            done = subprocess.run(words, stderr=subprocess.PIPE, check=False)
            if done.returncode != 0 or digest(self.out) != self.good or self.left():
                wrong += 1
                print("killed after %.2f s: exit %d, %s %s" % (moment, done.returncode, self.left(),
                                                               done.stderr.decode()), flush=True)
            self.clear()
        return "%d kills at random moments of a run of %.1f s (%d came too late, %d left a finished " \
               "stage to go on from): %d wrong" % (self.options.kills, self.seconds, ended, resumed,
                                                   wrong), wrong == 0

    def terms(self):
        slowest, wrong = 0.0, 0
        for i in range(self.options.terms):
            number = (signal.SIGTERM, signal.SIGINT)[i % 2]
            moment, code, seconds = self.end(self.words, number)
            is_good = code in (128 + number, 0, -number) and not self.left() and \
                (code == 0 or not os.path.exists(self.out))
            slowest = max(slowest, seconds)
            wrong += not is_good
            if not is_good or seconds > 1:
                print("signal %d after %.2f s: exit %d after %.2f s, %s" % (
                    number, moment, code, seconds, self.left()), flush=True)
            self.clear()
        return "%d SIGTERM and SIGINT: %d wrong, the slowest end after %.2f s" % (
            self.options.terms, wrong, slowest), wrong == 0 and slowest <= 1


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[1])
    parser.add_argument("--spbm", default=f"{ROOT}/build/tools/spbm")
    parser.add_argument("--generator", default=f"{ROOT}/build/bench/gen_scan")
    parser.add_argument("--faces", default="4M")
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--terms", type=int, default=20)
    parser.add_argument("--more", default="", help="further words of the command")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", help="the record; default: standard output")
    options = parser.parse_args()
    random.seed(options.seed)
    with tempfile.TemporaryDirectory(prefix="spbm-interrupt-") as work:
        interrupt = Interrupt(options, work)
        results = [interrupt.kills(), interrupt.terms()]
    text = "# Interrupted runs\n\n%s %s faces.\n\n" % (made(), options.faces)
    text += "".join("- %s.\n" % words for words, _ in results)
    write(text, options.output)
    sys.exit(0 if all(holds for _, holds in results) else 1)


if __name__ == "__main__":
    main()
