"""
Damaged files against the whole program. Ten small meshes (six cut from real scans and parts, where the
folder of data is there; the others made here), the stores and the chain files that the program makes
of them, are changed at random: bits flipped, bytes and numbers replaced, blocks cut out, inserted and
doubled, ends cut off. Every run on such a file must end in time, within a limit of memory, and

    in exit code 0 or 3 with an output that `spbm check` and a check made here accept, or
    in exit code 1 with one line of words,

with nothing left behind in its folder. Change number N of a seed is always the same, so that a
finding is made again by `--only N`. It is run by scripts/fuzz.sh and, briefly, by test_mutations.py.

    python3 mutate.py PROGRAM [--count 5000] [--seed 1] [--only N] [--keep DIR]
                      [--seconds 10] [--megabytes 256]
"""
import argparse
import gzip
import os
import random
import re
import shutil
import signal
import struct
import sys
import tempfile
import time
import zlib

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from kit import bumpy_sphere, run_limited  # noqa: E402

DATA = os.environ.get("SPBM_DATA", os.path.join(os.path.dirname(__file__), "../../../shared/data"))


# ---- the files ----

def grid(n):
    """A bumpy square with a hole: a surface with two border loops."""
    vertices = [(x, y, ((x * 7 + y * 3) % 5) * 0.1) for y in range(n + 1) for x in range(n + 1)]
    faces = []
    for y in range(n):
        for x in range(n):
            a, b = y * (n + 1) + x, (y + 1) * (n + 1) + x
            if not (n // 3 <= x < n // 2 and n // 3 <= y < n // 2):
                faces += [(a, a + 1, b + 1), (a, b + 1, b)]
    return vertices, faces


def ply(mesh, kind="binary_little_endian", colours=False):
    vertices, faces = mesh
    order = ">" if "big" in kind else "<"
    head = "ply\nformat %s 1.0\ncomment made for a test\nelement vertex %d\n" % (kind, len(vertices))
    head += "".join("property float %s\n" % name for name in "xyz")
    head += "".join("property uchar %s\n" % name for name in ("red", "green", "blue") if colours)
    head += "element face %d\nproperty list uchar int vertex_indices\nend_header\n" % len(faces)
    out = [head.encode()]
    for i, v in enumerate(vertices):
        colour = (i % 256, i * 7 % 256, 255 - i % 256) if colours else ()
        out.append(struct.pack(order + "3f%dB" % len(colour), *v, *colour) if "binary" in kind else
                   (" ".join(["%.6g %.6g %.6g" % v] + [str(c) for c in colour]) + "\n").encode())
    for f in faces:
        out.append(struct.pack(order + "B3i", 3, *f) if "binary" in kind else b"3 %d %d %d\n" % f)
    return b"".join(out)


def obj(mesh):
    vertices, faces = mesh
    return "".join(["# made for a test\n"] + ["v %.6g %.6g %.6g\n" % v for v in vertices] +
                   ["f %d//%d %d//%d %d//%d\n" % tuple(i + 1 for i in f for _ in "12")
                    for f in faces]).encode()


def stl_text(mesh):
    vertices, faces = mesh
    return ("solid test\n" + "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join("vertex %.6g %.6g %.6g\n" % vertices[i] for i in f) +
        "endloop\nendfacet\n" for f in faces) + "endsolid test\n").encode()


def cut(vertices, faces, count):
    """`count` faces round the first, as one piece, with the vertices that they use."""
    around = {}
    for number, face in enumerate(faces):
        for vertex in face:
            around.setdefault(vertex, []).append(number)
    reached, place = {0: None}, 0
    order = [0]
    while place < len(order) and len(order) < count:
        for vertex in faces[order[place]]:
            for number in around[vertex]:
                if number not in reached and len(order) < count:
                    reached[number] = None
                    order.append(number)
        place += 1
    numbers = {}
    kept = [tuple(numbers.setdefault(i, len(numbers)) for i in faces[number]) for number in order]
    return [vertices[i] for i in numbers], kept


def real_bytes(name):
    """A file of the data folder, None where that is not there."""
    path = os.path.join(DATA, name)
    if not os.path.exists(path):
        return None
    with (gzip.open if name.endswith(".gz") else open)(path, "rb") as file:
        return file.read()


def real_off(name, count):
    data = real_bytes(name)
    if data is None:
        return None
    words = iter(data.split()[1:])
    sizes = [int(next(words)) for _ in range(3)]
    vertices = [tuple(float(next(words)) for _ in range(3)) for _ in range(sizes[0])]
    faces = []
    for _ in range(sizes[1]):
        size = int(next(words))
        face = [int(next(words)) for _ in range(size)]
        faces += [(face[0], face[i], face[i + 1]) for i in range(1, size - 1)]
    return cut(vertices, faces, count)


def real_obj(name, count):
    data = real_bytes(name)
    if data is None:
        return None
    vertices, faces = [], []
    for line in data.decode(errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append(tuple(float(w) for w in words[1:4]))
        elif words[:1] == ["f"]:
            face = [int(w.split("/")[0]) - 1 for w in words[1:]]
            faces += [(face[0], face[i], face[i + 1]) for i in range(1, len(face) - 1)]
    return cut(vertices, faces, count)


def originals():
    """Name and bytes of each of the ten."""
    ball, sheet = bumpy_sphere(8), grid(14)
    return [
        ("box.stl", real_bytes("cad_box.stl") or stl_text(bumpy_sphere(1))),
        ("nut.stl", real_bytes("cad_m3_hex_nut.stl") or stl_text(bumpy_sphere(9))),
        ("polygons.off", real_bytes("cube_poly.off") or b"OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"),
        ("torus.off", real_bytes("double-torus-example.off") or obj(bumpy_sphere(6))),
        ("elephant.ply.gz", gzip.compress(ply(real_off("refined_elephant.off.gz", 600) or ball), 6, mtime=0)),
        ("skull.obj", obj(real_obj("skull.obj.gz", 500) or sheet)),
        ("ball.ply", ply(ball, "ascii")),
        ("big.ply", ply(sheet, "binary_big_endian")),
        ("colours.ply", ply(bumpy_sphere(9), colours=True)),
        ("text.stl", stl_text(bumpy_sphere(3))),
    ]


# ---- the changes ----

WORDS = [b"-1", b"4294967295", b"4294967296", b"99999999999999999999", b"nan", b"inf", b"1e38", b"1e-45",
         b"1e999", b"0", b"\n", b"\r\n", b" ", b"#", b"/", b"\\\n", b"\0", b"element vertex 4000000000\n",
         b"property list uchar int vertex_indices\n", b"property double x\n", b"end_header\n", b"f 1 2 3\n",
         b"f -1 -2 -3\n", b"facet", b"endsolid", b"OFF", b"\xef\xbb\xbf", b"\xff" * 4, b"\x7f\xff\xff\xff",
         b"\0\0\x80\x7f", b"\0\0\xc0\x7f", b"\1\0\0\0", b"\0\0\0\x80"]


def change(data, rng):
    """One change of a bytearray."""
    if not data:
        return
    at = rng.randrange(len(data))
    # Half of the changes keep the length, as what lies behind would not be looked at otherwise.
    kind = rng.randrange(6) if rng.randrange(2) else rng.randrange(12)
    some = min(len(data) - at, rng.choice((1, 2, 4, 8, 12, 16, 40, 200, 1000, 4096)))
    if kind <= 2 and chr(data[at]) in "0123456789":
        data[at] = rng.choice(b"0123456789")
    elif kind <= 2:
        data[at] ^= 1 << rng.randrange(8)
    elif kind == 3:
        data[at] = rng.choice((0, 1, 2, 3, 4, 0x7f, 0x80, 0xff, rng.randrange(256)))
    elif kind == 4:  # a number of four bytes
        at -= at % 4
        value = rng.choice((0, 1, 2, 3, 0x7fffffff, 0x80000000, 0xffffffff, 0xfffffffe, 0x7f800000,
                            0x7fc00000, 0x7f7fffff, rng.randrange(1 << 32), rng.randrange(1024)))
        data[at:at + 4] = struct.pack("<I", value)[:max(0, len(data) - at)]
    elif kind == 5:  # a number of four bytes, a little different
        at -= at % 4
        if at + 4 <= len(data):
            value = struct.unpack_from("<I", data, at)[0] + rng.choice((-3, -2, -1, 1, 2, 3, 8))
            struct.pack_into("<I", data, at, value & 0xffffffff)
    elif kind == 6:
        word = rng.choice(WORDS)
        data[at:at + rng.choice((0, len(word)))] = word
    elif kind == 7:  # a block is missing
        del data[at:at + some]
    elif kind == 8:  # or there twice
        data[at:at] = data[at:at + some]
    elif kind == 9:  # or somewhere else
        block = data[at:at + some]
        to = rng.randrange(len(data))
        data[to:to + len(block)] = block
    elif kind == 10:
        data[at:at + some] = bytes(rng.choice((0, 0xff)) for _ in "1") * some
    elif rng.randrange(3) == 0:
        del data[at:]
    else:
        data[at:at] = rng.randbytes(some)


def mutated(data, rng):
    gzipped = data[:2] == b"\x1f\x8b" and rng.randrange(2)
    changed = bytearray(gzip.decompress(data) if gzipped else data)
    for _ in range(rng.choice((1, 1, 1, 1, 1, 2, 3, 8))):
        change(changed, rng)
    return gzip.compress(bytes(changed), 1, mtime=0) if gzipped else bytes(changed)


# ---- our own formats, with right checksums (src/base/section_file_format.md) ----

def sections_of(data):
    """The sections of a store or chain file: a list of [kind, bytes], blocks unpacked."""
    table, count = struct.unpack_from("<QI", data, len(data) - 32)
    sections = []
    for i in range(count):
        kind, _, offset, length = struct.unpack_from("<4sIQQ", data, table + 24 * i)
        sections.append([kind, bytearray(data[offset:offset + length])])
    for section in sections:
        if section[0] in (b"BLKS", b"SEAM") and section[1]:
            stored, raw = struct.unpack_from("<II", section[1], 4)
            body = section[1][24:24 + stored]
            section[1] = bytearray(zlib.decompress(bytes(body), -15) if stored < raw else body)
    return sections


def assembled(head, sections):
    """A file of them that no checksum and no size contradicts; of one slab."""
    contents = {kind: bytes(content) for kind, content in sections}
    for kind in (b"BLKS", b"SEAM"):
        if kind in contents:
            body = contents[kind]
            block = b"blk1" + struct.pack("<4I", len(body), len(body), zlib.crc32(body), zlib.crc32(body))
            contents[kind] = block + struct.pack("<I", zlib.crc32(block)) + body
    if b"INDX" in contents:
        contents[b"INDX"] = (struct.pack("<II", len(contents[b"BLKS"]), len(contents[b"SEAM"])) +
                             contents[b"INDX"][8:])
    if b"STAB" in contents:
        table = contents[b"STAB"]
        contents[b"STAB"] = table[:24] + struct.pack("<I", zlib.crc32(contents[b"SLAB"])) + table[28:]
    out, table = bytearray(head[:64]), b""
    for kind, _ in sections:
        table += struct.pack("<4sIQQ", kind, zlib.crc32(contents[kind]), len(out), len(contents[kind]))
        out += contents[kind] + bytes(-len(contents[kind]) % 64)
    marker = struct.pack("<QIIQ8s", len(out), len(sections), 0, len(out) + len(table) + 32, b"spbm end")
    crc = zlib.crc32(bytes(out[:32]) + table + marker)
    return bytes(out) + table + marker[:12] + struct.pack("<I", crc) + marker[16:]


def mutated_sections(data, rng):
    sections = sections_of(data)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        change(rng.choice([content for _, content in sections for _ in range(1 + (len(content) > 500))]), rng)
    return assembled(data, sections)


# ---- the runs ----

class Finding(Exception):
    pass


def run(words, folder, seconds, megabytes):
    """Runs the program; a Finding when it does not end within so many seconds of processor time, or, if
    it waits for something, within twenty times as many on the clock. More memory of its own than allowed
    is refused and ends in exit code 4, which is a finding."""
    environment = {k: v for k, v in os.environ.items() if k not in ("TMPDIR", "LANGUAGE")}
    environment.setdefault("ASAN_OPTIONS", "detect_leaks=1:allocator_may_return_null=1")
    environment.setdefault("UBSAN_OPTIONS", "halt_on_error=1:print_stacktrace=1")

    ended = run_limited(words, folder, environment, 20 * seconds, megabytes)
    if ended.is_late or ended.seconds > seconds:
        raise Finding("does not end within %g s" % seconds)
    return ended


def judge(result):
    """Is this an end as it should be? True when there is an output."""
    if "Sanitizer" in result.err or "runtime error" in result.err or "LeakSan" in result.err:
        raise Finding("sanitizer report")
    if result.code < 0:
        raise Finding("died of %s" % signal.Signals(-result.code).name)
    if result.code not in (0, 1, 3):
        raise Finding("exit code %d" % result.code)
    lines = result.err.splitlines()
    errors = [line for line in lines if line.startswith("spbm: error: ")]
    if len(errors) != (result.code == 1):
        raise Finding("%d error lines with exit code %d" % (len(errors), result.code))
    for line in lines:
        if not re.match(r"spbm: (error|warning|note): .", line) or len(line) > 1500:
            raise Finding("a line that is no message: %r" % line[:200])
        if not line.isprintable():
            raise Finding("unprintable characters in %r" % line[:200])
    return result.code != 1


def check_ply(path):
    """Is the mesh manifold, oriented, without degenerate and duplicate faces, with finite coordinates?"""
    with open(path, "rb") as file:
        data = file.read()
    head, _, body = data.partition(b"end_header\n")
    counts = {name: int(number) for name, number in re.findall(r"element (\w+) (\d+)", head.decode())}
    sizes = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I",
             "float": "f", "double": "d"}
    row = "<" + "".join(sizes[kind] for kind in re.findall(r"property (\w+) \w+\n", head.decode()))
    step = struct.calcsize(row)
    if len(body) != counts["vertex"] * step + counts["face"] * 13:
        raise Finding("the output's size is not what its header says")
    for vertex in struct.iter_unpack(row, body[:counts["vertex"] * step]):
        if not all(abs(x) < 1e308 for x in vertex[:3]):
            raise Finding("a coordinate of the output is not finite")
    edges, seen, fans = set(), set(), {}
    for size, *face in struct.iter_unpack("<B3I", body[counts["vertex"] * step:]):
        if size != 3 or max(face) >= counts["vertex"] or len(set(face)) != 3:
            raise Finding("a bad face in the output: %d %s" % (size, face))
        if frozenset(face) in seen:
            raise Finding("a duplicate face in the output")
        seen.add(frozenset(face))
        for k in range(3):
            edge = face[k], face[(k + 1) % 3]
            if edge in edges:
                raise Finding("an edge of the output runs twice the same way")
            edges.add(edge)
            fans.setdefault(face[k], {})[face[(k + 1) % 3]] = face[(k + 2) % 3]
    if len(fans) != counts["vertex"]:
        raise Finding("the output has vertices that no face uses")
    for vertex, fan in fans.items():  # one fan: one walk reaches all of it
        starts = set(fan) - set(fan.values())
        at, steps = (starts.pop() if starts else next(iter(fan))), 0
        while at in fan and steps < len(fan):
            at, steps = fan[at], steps + 1
        if steps != len(fan):
            raise Finding("vertex %d of the output has several fans" % vertex)


def plans(kind, name, rng):
    """The commands for a damaged file, each with the name of its output (None: it has none)."""
    mode = rng.choice(("collapse", "classic"))
    target = rng.choice((["--faces", "40"], ["--faces", "300"], ["--ratio", "50%"], ["--ratio", "5%"],
                         ["--error", "2%"], ["--faces", "1"], ["--faces", "1000000"]))
    target = target + ["--mode", mode]
    if rng.randrange(4) == 0:
        target += ["--place", rng.choice(("subset", "optimal") if mode == "collapse" else ("subset",))]
    if kind == "mesh":
        return rng.choice((
            [(["simplify", name, "-o", "out.ply"] + target, "out.ply")],
            [(["simplify", name, "-o", "out.ply"] + target, "out.ply")],
            [(["import", name, "-o", "out.store"] + rng.choice(([], ["--weld"])), "out.store"),
             (["export", "out.store", "-o", "out.ply"], "out.ply")],
            [(["info", name], None), (["check", name], None)],
            [(["measure", name, "original"], None)],
            [(["measure", "original", name], None)],
            [(["render", name, "-o", "out.png"], "out.png")]))
    if kind == "store":
        patchify = target[:target.index("--place")] if "--place" in target else target
        return rng.choice((
            [(["check", name], None), (["info", name], None)],
            [(["export", name, "-o", "out.ply"], "out.ply")],
            [(["patchify", name, "-o", "out.chains"] + patchify, "out.chains"),
             (["lod", "out.chains", "-o", "out.ply"] + target, "out.ply")],
            [(["measure", name, "original"], None)]))
    return rng.choice((
        [(["check", name], None), (["info", name], None)],
        [(["lod", name, "-o", "out.ply"] + target, "out.ply")],
        [(["lod", name, "-o", "out.ply"] + target, "out.ply")],
        [(["lod", name, "-o", "out.ply"] + target, "out.ply")]))


class Driver:
    def __init__(self, options):
        self.options = options
        self.program = os.path.abspath(options.program)
        self.folder = tempfile.mkdtemp(prefix="spbm-mutate-")
        self.files = []  # kind, name, bytes, original's bytes and name
        self.codes, self.findings, self.slowest = {}, [], 0

    def command(self, words, quiet=True):
        return run([self.program] + words + (["-q"] if quiet else []), self.folder, self.options.seconds,
                   self.options.megabytes)

    def path(self, name):
        return os.path.join(self.folder, name)

    def read(self, name):
        with open(self.path(name), "rb") as file:
            return file.read()

    def write(self, name, data):
        with open(self.path(name), "wb") as file:
            file.write(data)

    def make_files(self):
        for name, data in originals():
            self.write(name, data)
            self.files.append(("mesh", name, data, data))
            for words in (["import", name, "-o", "x.store"],
                          ["patchify", "x.store", "-o", "x.chains", "--faces", "200"],
                          ["patchify", "x.store", "-o", "x.classic", "--faces", "60", "--mode", "classic"]):
                result = self.command(words)
                if result.code != 0:
                    sys.exit("%s: %s ends with %d\n%s" % (name, words, result.code, result.err))
            for kind, made in (("store", "x.store"), ("chains", "x.chains"), ("chains", "x.classic")):
                self.files.append((kind, name + made[1:], self.read(made), data))
                # The reading and writing of the formats here is right: nothing changed, all is well.
                self.write("again", assembled(self.read(made), sections_of(self.read(made))))
                result = self.command(["check", "again"])
                if result.code != 0:
                    sys.exit("%s taken apart and put together: %s" % (name + made[1:], result.err))
        self.clear()

    def clear(self):
        for name in os.listdir(self.folder):
            os.unlink(self.path(name))

    def one(self, number):
        """Makes change `number` and runs the program on it."""
        rng = random.Random("%d:%d" % (self.options.seed, number))
        kind, name, data, original = self.files[number % len(self.files)]
        behind = kind != "mesh" and rng.randrange(3) > 0  # behind the checksums
        changed = (mutated_sections if behind else mutated)(data, rng)
        self.write(name, changed)
        self.write("original", original)
        there = {name, "original"}
        done = []
        try:
            for words, output in plans(kind, name, rng):
                done.append(" ".join(words))
                result = self.command(words)
                if self.options.verbose:
                    print(number, " ".join(words), "->", result.code, result.err.strip(), flush=True)
                self.codes[result.code] = self.codes.get(result.code, 0) + 1
                self.slowest = max(self.slowest, result.seconds)
                has_output = judge(result)
                if output and has_output:
                    there.add(output)
                    self.check_output(output)
                if set(os.listdir(self.folder)) != there:
                    raise Finding("the folder holds %s, not %s" %
                                  (sorted(os.listdir(self.folder)), sorted(there)))
                if self.read(name) != changed:
                    raise Finding("the input was changed")
                if not has_output:
                    break
        except Finding as finding:
            self.findings.append(number)
            err = result.err if "result" in locals() else ""
            print("FINDING %d: %s\n  %s: %s\n%s" % (number, finding, name, "; ".join(done), err[:3000]),
                  flush=True)
            if self.options.keep:
                os.makedirs(self.options.keep, exist_ok=True)
                with open(os.path.join(self.options.keep, "%d-%s" % (number, name)), "wb") as file:
                    file.write(changed)
        self.clear()

    def check_output(self, name):
        if name.endswith(".png"):
            if self.read(name)[:8] != b"\x89PNG\r\n\x1a\n":
                raise Finding("no picture")
            return
        checked = self.command(["check", name])
        if checked.code != 0:
            raise Finding("`check` does not accept %s: %s" % (name, checked.err))
        if name.endswith(".ply"):
            check_ply(self.path(name))

    def go(self):
        self.make_files()
        begin = time.monotonic()
        only = self.options.only
        for number in [only] if only is not None else range(self.options.first,
                                                            self.options.first + self.options.count):
            self.one(number)
        shutil.rmtree(self.folder)
        codes = ", ".join("%d x exit %d" % (count, code) for code, count in sorted(self.codes.items()))
        print("%d changes, %s, slowest %.2f s of processor, %d findings, %.0f s" %
              (1 if only is not None else self.options.count, codes, self.slowest,
               len(self.findings), time.monotonic() - begin))
        return 1 if self.findings else 0


def main():
    parser = argparse.ArgumentParser(description="Runs the program on damaged files.")
    parser.add_argument("program")
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int)
    parser.add_argument("--keep")
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--megabytes", type=int, default=256, help="0: no limit (sanitizers)")
    sys.exit(Driver(parser.parse_args()).go())


if __name__ == "__main__":
    main()
