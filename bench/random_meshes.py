#!/usr/bin/env python3
"""
Random closed and open manifolds (random genus, noise, degenerate triangles) through every mode, effort, placement
and several levels. Every output must pass `spbm check` and CGAL (bench/peers/manifold.cpp, built by
scripts/peers.sh), and have the components, border loops and Euler characteristic of the mesh that
import made of the input; that is exported, and CGAL counts it too.

    /usr/bin/python3 bench/random_meshes.py PROGRAM MANIFOLD [--count 1000] [--first 0] [--keep DIR]

Mesh number N is always the same, so that a finding is made again by `--first N --count 1`.
"""
import argparse
import collections
import os
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import time

# ---- shapes: vertices as lists of three, faces as tuples of three ----


def voxels(rng):
    """The surface of a random heap of cubes: any genus, several components, cavities."""
    n = rng.randint(2, 7)
    density = rng.uniform(0.25, 0.8)
    full = {(x, y, z) for x in range(n) for y in range(n) for z in range(n) if rng.random() < density}
    numbers, vertices, faces = {}, [], []

    def vertex(*p):
        if p not in numbers:
            numbers[p] = len(vertices)
            vertices.append([float(c) for c in p])
        return numbers[p]
    for x, y, z in sorted(full):
        for axis in range(3):
            for side in (0, 1):
                step = [0, 0, 0]
                step[axis] = 2 * side - 1
                if (x + step[0], y + step[1], z + step[2]) in full:
                    continue
                corners = []
                for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    p = [x, y, z]
                    p[axis] += side
                    p[(axis + 1) % 3] += u
                    p[(axis + 2) % 3] += v
                    corners.append(vertex(*p))
                a, b, c, d = corners if side else corners[::-1]
                faces += [(a, b, c), (a, c, d)] if rng.randrange(2) else [(a, b, d), (b, c, d)]
    return vertices, faces


def holed_slab(rng):
    """A thick plate with h holes through it: closed, genus h, with h known."""
    n = rng.randint(5, 14)
    solid = {(x, y) for x in range(n) for y in range(n)}
    for _ in range(rng.randint(0, n * n // 12)):
        x, y = rng.randrange(1, n - 1), rng.randrange(1, n - 1)
        around = {(x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)}
        if around <= solid:
            solid.discard((x, y))
    numbers, vertices, faces = {}, [], []

    def vertex(x, y, z):
        if (x, y, z) not in numbers:
            numbers[x, y, z] = len(vertices)
            vertices.append([float(x), float(y), float(z)])
        return numbers[x, y, z]

    def quad(a, b, c, d):
        faces.extend([(a, b, c), (a, c, d)])
    for x, y in sorted(solid):
        quad(vertex(x, y, 1), vertex(x + 1, y, 1), vertex(x + 1, y + 1, 1), vertex(x, y + 1, 1))
        quad(vertex(x, y, 0), vertex(x, y + 1, 0), vertex(x + 1, y + 1, 0), vertex(x + 1, y, 0))
        for (i, j), (p, q) in (((-1, 0), ((0, 1), (0, 0))), ((1, 0), ((1, 0), (1, 1))),
                               ((0, -1), ((0, 0), (1, 0))), ((0, 1), ((1, 1), (0, 1)))):
            if (x + i, y + j) not in solid:
                quad(vertex(x + p[0], y + p[1], 0), vertex(x + q[0], y + q[1], 0),
                     vertex(x + q[0], y + q[1], 1), vertex(x + p[0], y + p[1], 1))
    return vertices, faces


def tube(rng):
    """A torus, or, cut open, a ring with two borders."""
    m, n, is_open = rng.randint(3, 40), rng.randint(3, 24), rng.randrange(2)
    turn = complex(0.6, 0.8)  # powers of it go round without sin and cos
    around, across, p, q = [], [], complex(1, 0), complex(1, 0)
    for _ in range(max(m, n)):
        around.append(p)
        across.append(q)
        p *= turn
        q *= turn
    around = sorted(around[:m], key=lambda c: (c.imag < 0, -c.real if c.imag >= 0 else c.real))
    across = sorted(across[:n], key=lambda c: (c.imag < 0, -c.real if c.imag >= 0 else c.real))
    vertices = [[a.real * (3 + c.real), a.imag * (3 + c.real), c.imag] for a in around for c in across]
    faces = []
    for i in range(m - is_open):
        for j in range(n):
            a, b = i * n + j, (i + 1) % m * n + j
            c, d = (i + 1) % m * n + (j + 1) % n, i * n + (j + 1) % n
            faces += [(a, b, c), (a, c, d)]
    return vertices, faces


def sheet(rng):
    """A square with holes and torn edges."""
    n = rng.randint(3, 24)
    vertices = [[float(x), float(y), 0.0] for y in range(n + 1) for x in range(n + 1)]
    faces = []
    for y in range(n):
        for x in range(n):
            a, b = y * (n + 1) + x, (y + 1) * (n + 1) + x
            faces += [(a, a + 1, b + 1), (a, b + 1, b)] if rng.randrange(2) else [(a, a + 1, b), (a + 1, b + 1, b)]
    return vertices, faces


def split(vertices, faces, rng):
    """Puts a vertex into some faces: finer, and with vertices of three faces."""
    out = []
    for a, b, c in faces:
        if rng.randrange(4):
            out.append((a, b, c))
            continue
        weights = [rng.random() for _ in range(3)]
        total = sum(weights)
        vertices.append([sum(w * vertices[v][k] for w, v in zip(weights, (a, b, c))) / total for k in range(3)])
        out += [(a, b, len(vertices) - 1), (b, c, len(vertices) - 1), (c, a, len(vertices) - 1)]
    return out


def make(number):
    """Vertices and faces of mesh `number`, and words for it."""
    rng = random.Random("spbm:%d" % number)
    shape = rng.choice((voxels, voxels, holed_slab, tube, sheet))
    vertices, faces = shape(rng)
    words = [shape.__name__]
    while rng.randrange(3) and len(faces) < 4000:
        faces = split(vertices, faces, rng)
    if rng.randrange(3) == 0:  # holes
        faces = [face for face in faces if rng.random() > 0.05] or faces
        words.append("torn")
    amplitude = rng.choice((0, 0.001, 0.02, 0.1, 0.3, 2))
    words.append("noise %g" % amplitude)
    for vertex in vertices:
        for k in range(3):
            vertex[k] += amplitude * rng.uniform(-1, 1)
    if rng.randrange(3) == 0:  # degenerate triangles: a corner goes where another is
        words.append("degenerate")
        for face in rng.sample(faces, min(len(faces), max(1, len(faces) // 20))):
            vertices[face[0]] = list(vertices[face[1]])
    if rng.randrange(8) == 0:
        words.append("flat")
        axis = rng.randrange(3)
        for vertex in vertices:
            vertex[axis] = 0.0
    scale = rng.choice((1, 1, 1, 1e-6, 1e6))
    for vertex in vertices:
        vertex[:] = [scale * c for c in vertex]
    if rng.randrange(2):
        rng.shuffle(faces)
    return vertices, faces, " ".join(words)


def write_ply(path, vertices, faces):
    with open(path, "wb") as file:
        file.write(("ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
                    "property float z\nelement face %d\nproperty list uchar int vertex_indices\nend_header\n"
                    % (len(vertices), len(faces))).encode())
        file.write(b"".join(struct.pack("<3f", *v) for v in vertices))
        file.write(b"".join(struct.pack("<B3i", 3, *f) for f in faces))


# ---- the runs ----

RUNS = [("collapse", effort, place) for effort in (1, 2, 3) for place in ("optimal", "subset")] + \
       [("classic", 2, "subset")]


class Test:
    def __init__(self, options):
        self.options = options
        self.folder = tempfile.mkdtemp(prefix="spbm-random-")
        self.judge = subprocess.Popen([options.manifold], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.findings, self.outputs, self.codes, self.kinds = 0, 0, collections.Counter(), collections.Counter()
        self.genus, self.borders, self.faces = collections.Counter(), 0, 0

    def path(self, name):
        return os.path.join(self.folder, name)

    def run(self, *words):
        return subprocess.run([self.options.program, *map(str, words)], capture_output=True, text=True, check=False)

    def cgal(self, name):
        self.judge.stdin.write(self.path(name) + "\n")
        self.judge.stdin.flush()
        return self.judge.stdout.readline().split("\n")[0]

    def finding(self, number, words):
        self.findings += 1
        print("FINDING: mesh %d: %s" % (number, words), flush=True)
        if self.options.keep:
            os.makedirs(self.options.keep, exist_ok=True)
            shutil.copy(self.path("in.ply"), os.path.join(self.options.keep, "%d.ply" % number))

    def one(self, number):
        vertices, faces, words = make(number)
        write_ply(self.path("in.ply"), vertices, faces)
        for command in (("import", self.path("in.ply"), "-o", self.path("store"), "-q"),
                        ("check", self.path("store"), "-q"),
                        ("export", self.path("store"), "-o", self.path("whole.ply"), "-q")):
            done = self.run(*command)
            if done.returncode:
                return self.finding(number, "%s: %s: %s" % (words, command[0], done.stderr))
        whole = self.cgal("whole.ply").split()
        if whole[0] != "manifold":
            return self.finding(number, "%s: the store: %s" % (words, " ".join(whole)))
        self.kinds[words.split()[0]] += 1
        self.faces += int(whole[2])
        self.borders += int(whole[4]) > 0
        self.genus[int(whole[3]) * 2 - int(whole[4]) - int(whole[5])] += 1
        count = int(whole[2])
        levels = sorted({max(1, count * 9 // 10), max(1, count // 3), max(1, count // 20), 1}, reverse=True)
        for mode, effort, place in RUNS:
            self.check_run(number, words, whole, (mode, effort, place), levels)
        return None

    def check_run(self, number, words, whole, how, levels):
        mode, effort, place = how
        done = self.run("simplify", self.path("in.ply"), "-o", self.path("out-%d.ply"),
                        "--faces", ",".join(map(str, levels)), "--mode", mode, "--effort", effort, "--place", place,
                        "--tmp", self.folder, "-q")
        self.codes[done.returncode] += 1
        words = "%s, %s effort %d %s" % (words, mode, effort, place)
        if done.returncode not in (0, 3):
            self.finding(number, "%s: exit %d: %s" % (words, done.returncode, done.stderr))
            return
        last = None
        for i in range(len(levels)):
            name = "out-%d.ply" % i
            self.outputs += 1
            checked = self.run("check", self.path(name), "-q")
            found = self.cgal(name).split()
            if checked.returncode:
                self.finding(number, "%s: level %d: %s" % (words, i, checked.stderr))
            elif found[0] != "manifold" or found[3:] != whole[3:]:
                self.finding(number, "%s: level %d: CGAL says %s, of the original %s"
                             % (words, i, " ".join(found), " ".join(whole)))
            else:
                if last is not None and int(found[2]) > last:
                    self.finding(number, "%s: level %d has %s faces, the finer one %d" % (words, i, found[2], last))
                last = int(found[2])
            os.unlink(self.path(name))

    def go(self):
        begin = time.monotonic()
        for number in range(self.options.first, self.options.first + self.options.count):
            self.one(number)
        self.judge.stdin.close()
        self.judge.wait()
        shutil.rmtree(self.folder)
        print("%d meshes (%s), %d faces on average, %d with border; handles: %s" % (
            sum(self.kinds.values()), ", ".join("%d %s" % (n, k) for k, n in sorted(self.kinds.items())),
            self.faces // max(1, sum(self.kinds.values())), self.borders,
            "none %d, 1 to 9 %d, 10 and more %d" % (
                self.genus[0], sum(n for g, n in self.genus.items() if 2 <= g < 20),
                sum(n for g, n in self.genus.items() if g >= 20))))
        print("%d runs (%s), %d outputs, %d findings, %.0f s" % (
            sum(self.codes.values()), ", ".join("exit %d: %d" % item for item in sorted(self.codes.items())),
            self.outputs, self.findings, time.monotonic() - begin))
        return 1 if self.findings else 0


def main():
    parser = argparse.ArgumentParser(description="Random manifolds through every mode and level.")
    parser.add_argument("program", type=os.path.abspath)
    parser.add_argument("manifold", type=os.path.abspath)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--keep")
    sys.exit(Test(parser.parse_args()).go())


if __name__ == "__main__":
    main()
