#!/usr/bin/env python3
"""
Makes doc/errors.md: 40 bad inputs and what the program says of each. Every input is made here, the program is
run on it, and its words are put down as they are.

    make_error_table.py PROGRAM [OUTPUT]

PROGRAM is build/tools/spbm; OUTPUT defaults to doc/errors.md, `-` is standard output. `--check`
instead of OUTPUT fails if the page in doc/ says something else.
"""
import gzip
import os
import shutil
import struct
import subprocess
import sys
import tempfile

PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "doc", "errors.md")

HEAD = """# What the program says of bad input

Every message is one line on standard error: the file, the place in it (line, element or byte) and the reason. Vertices, faces and
facets are counted from 0, lines from 1. The exit code is 1 for these, as it is for every input that cannot be used. Warnings that come
before are shown with the word.

PLY and OFF in text are read as numbers, not as lines, as other programs do: files that break their lines anywhere are taken. So a number too
few or too many moves all that follows (row 15). Mostly that ends in an index that does not exist, a word where a number should be, or a
warning that something follows the last element; where a whole row's worth is missing and the counts in the header agree, nothing can tell. OBJ
and STL are read by lines and keywords. A polygon takes about 300 bytes of memory a corner while it is triangulated, the only cost that one
face alone can have; where there is no room for that, the exit code is 4.

This page is made by `scripts/make_error_table.py`, which makes each of these
files and runs the program on it.

| # | the input | what is said (after `spbm: error: `) |
| --- | --- | --- |
"""

VERTICES = b"0 0 0\n1 0 0\n0 1 0\n"
TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
FACE = struct.pack("<B3i", 3, 0, 1, 2)
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FACET = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"


def ply(kind="ascii", vertices=3, faces=1, body=b"", index="uchar int", third="float z"):
    return ("ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty %s\n"
            "element face %d\nproperty list %s vertex_indices\nend_header\n"
            % (kind, vertices, third, faces, index)).encode() + body


def changed(data, at, value):
    return data[:at] + value + data[at + len(value):]


def cases(run):
    """Description, name and bytes (None: no such file is made) of each, and the command."""
    little = "binary_little_endian"
    whole = ply(little, body=TRIANGLE + FACE)
    zipped = gzip.compress(ply(body=VERTICES * 200 + b"3 0 1 2\n", vertices=600), 6, mtime=0)
    yield "no such file", "scan.ply", None
    yield "a folder", ".", None
    yield "an empty file", "scan.ply", b""
    yield "text that is no mesh", "notes.txt", b"Dear colleague,\nhere is the scan.\n"
    yield "a picture", "scan.png", b"\x89PNG\r\n\x1a\n" + bytes(50)
    yield "PLY: a version that does not exist", "scan.ply", whole.replace(b" 1.0\n", b" 2.0\n")
    yield "PLY: a typing error in the header", "scan.ply", ply().replace(b"property float y", b"proprety float y")
    yield "PLY: a type that does not exist", "scan.ply", ply(third="floaty z")
    yield "PLY: no z", "scan.ply", ply(third="float w")
    yield "PLY: the header does not end", "scan.ply", ply()[:ply().index(b"element face")]
    yield "PLY: 4,000,000,000 vertices in 200 bytes", "scan.ply", ply(little, 4000000000, 1, TRIANGLE)
    yield "PLY: cut off within a face", "scan.ply", whole[:-5]
    yield "PLY: more faces claimed than there are", "scan.ply", ply(faces=2, body=VERTICES + b"3 0 1 2\n")
    yield "PLY: a coordinate that is no number", "scan.ply", ply(body=b"0 0 0\n1 O 0\n0 1 0\n3 0 1 2\n")
    yield "PLY: a coordinate is missing", "scan.ply", ply(body=b"0 0 0\n1 0\n0 1 0\n3 0 1 2\n")
    yield "PLY: a coordinate is NaN", "scan.ply", ply(little, body=changed(TRIANGLE, 16, b"\0\0\xc0\x7f") + FACE)
    yield "PLY: an index too large", "scan.ply", ply(body=VERTICES + b"3 0 1 3\n")
    yield "PLY: an index of -1", "scan.ply", ply(little, body=TRIANGLE + struct.pack("<B3i", 3, 0, 1, -1))
    yield "PLY: a list of negative length", "scan.ply", ply(body=VERTICES + b"-3 0 1 2\n", index="char int")
    yield "PLY: a face of two corners", "scan.ply", ply(body=VERTICES + b"2 0 1\n")
    yield "PLY: points, no faces", "scan.ply", ply(faces=0, body=VERTICES)
    yield "OBJ: an index too large", "part.obj", OBJ + b"f 1 2 4\n"
    yield "OBJ: an index of 0", "part.obj", OBJ + b"f 0 1 2\n"
    yield "OBJ: an index relative to nothing", "part.obj", OBJ + b"f -4 -2 -1\n"
    yield "OBJ: a word instead of an index", "part.obj", OBJ + b"f 1 2 three\n"
    yield "OBJ: a decimal comma", "part.obj", b"v 0 0 0\nv 1,5 0 0\nv 0 1 0\nf 1 2 3\n"
    yield "OFF: a count that is no number", "part.off", b"OFF\n3 one 0\n" + VERTICES
    yield "OFF: fewer vertices than claimed", "part.off", b"OFF\n9 1 0\n" + VERTICES
    yield "OFF: infinite", "part.off", b"OFF\n3 1 0\n0 0 0\n1 inf 0\n0 1 0\n3 0 1 2\n"
    yield "STL: cut off", "part.stl", \
        b"made by a test".ljust(80) + struct.pack("<I", 100) + struct.pack("<12fH", 0, 0, 1, *range(9), 0) * 60
    yield "STL: a facet of two corners", "part.stl", \
        b"solid\n" + FACET.replace(b"vertex 0 1 0\n", b"") + b"endsolid\n"
    yield "STL: text that stops", "part.stl", b"solid\n" + FACET + FACET[:40]
    yield "gzip: cut off", "scan.ply.gz", zipped[:len(zipped) // 2]
    yield "gzip: damaged", "scan.ply.gz", changed(zipped, len(zipped) - 8, b"\1\2\3\4")
    good = gzip.compress(ply(body=VERTICES + b"3 0 1 2\n"), mtime=0)
    run("good.ply.gz", good, ["import", "good.ply.gz", "-o", "good.store"])
    run(None, None, ["patchify", "good.store", "-o", "good.chains", "--faces", "1"])
    store, chains = run("good.store"), run("good.chains")
    out = ["-o", "out.ply"]
    yield "a store that is cut off", "scan.store", store[:700], ["export", "scan.store"] + out
    yield "a store with a flipped bit", "scan.store", changed(store, 70, bytes([store[70] ^ 4])), \
        ["export", "scan.store"] + out
    yield "a store of a later version", "scan.store", changed(store, 8, b"\7"), ["export", "scan.store"] + out
    yield "a mesh where a store is wanted", "scan.ply", ply(body=VERTICES + b"3 0 1 2\n"), \
        ["patchify", "scan.ply", "-o", "out.chains", "--faces", "1"]
    yield "a store where a chain file is wanted", "scan.store", store, ["lod", "scan.store", "--faces", "1"] + out
    yield "a chain file with a flipped bit", "scan.chains", changed(chains, 100, bytes([chains[100] ^ 1])), \
        ["lod", "scan.chains", "--faces", "1"] + out


class Maker:
    def __init__(self, program):
        self.program = os.path.abspath(program)
        self.folder = tempfile.mkdtemp(prefix="spbm-errors-")

    def path(self, name):
        return os.path.join(self.folder, name)

    def run(self, name, data=None, words=None):
        """Writes a file and runs the program; without `words`: the bytes of a file."""
        if words is None:
            with open(self.path(name), "rb") as file:
                return file.read()
        if data is not None:
            with open(self.path(name), "wb") as file:
                file.write(data)
        return subprocess.run([self.program] + words + ["-q"], cwd=self.folder, capture_output=True,
                              text=True, check=False)

    def table(self):
        rows = []
        for what, name, data, *words in cases(self.run):
            words = words[0] if words else ["import", name, "-o", "out.store"]
            done = self.run(name, data, words)
            lines = [line for line in done.stderr.splitlines() if line.startswith("spbm: error: ")]
            if done.returncode != 1 or len(lines) != 1:
                sys.exit("%s: exit code %d, %r" % (what, done.returncode, done.stderr))
            said = [line[len("spbm: "):] if line not in lines else line[len("spbm: error: "):]
                    for line in done.stderr.splitlines()]
            cell = "<br>".join("`%s`" % line.replace("|", "\\|").replace("`", "'") for line in said)
            rows.append("| %d | %s | %s |\n" % (len(rows) + 1, what, cell))
            if data is not None:
                os.unlink(self.path(name))
        shutil.rmtree(self.folder)
        return HEAD + "".join(rows)


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__.strip())
    page = Maker(sys.argv[1]).table()
    output = sys.argv[2] if len(sys.argv) > 2 else PAGE
    if output == "-":
        sys.stdout.write(page)
    elif output == "--check":
        with open(PAGE, encoding="utf-8") as file:
            if file.read() != page:
                sys.exit("doc/errors.md is out of date: run scripts/make_error_table.py")
    else:
        with open(output, "w", encoding="utf-8") as file:
            file.write(page)


if __name__ == "__main__":
    main()
