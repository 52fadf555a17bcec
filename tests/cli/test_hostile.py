"""
Inputs that claim too much, unusual files and places, and machines that are shared. Whatever comes in, a run
ends soon, in little memory, in an output that is right or in one line of words.
"""
import gzip
import os
import re
import resource
import struct
import subprocess
import sys
import threading
import time
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from program import PROGRAM, ProgramTest, bumpy_sphere, read_bytes, write_ply  # noqa: E402
from kit import run_limited  # noqa: E402

with open(PROGRAM, "rb") as program_file:
    HAS_SANITIZER = b"__asan_init" in program_file.read()

PLY_HEAD = ("ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
            "element face %d\nproperty list %s int vertex_indices\nend_header\n")


def ply(vertices=3, faces=1, kind="binary_little_endian", count="uchar", body=b""):
    return (PLY_HEAD % (kind, vertices, faces, count)).encode() + body


TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
FACE = struct.pack("<B3i", 3, 0, 1, 2)


class Hostile(ProgramTest):
    def write(self, name, data):
        with open(self.path(name), "wb") as file:
            file.write(data)
        return self.path(name)

    def run_limited(self, *words, code=(0, 1, 3), seconds=10, megabytes=64, prepare=None):
        """Runs it with so much time of processors and memory of its own; the exit code must be one of
        `code` (no memory would be 4). Returns its stderr."""
        ended = run_limited([PROGRAM, *map(str, words), "-q"], self.folder, self.environment, 6 * seconds,
                            0 if HAS_SANITIZER else megabytes, prepare)
        self.assertIn(ended.code, (code,) if isinstance(code, int) else code, ended.err)
        self.assertNotIn("Sanitizer", ended.err)
        self.assertNotIn("runtime error", ended.err)
        if not HAS_SANITIZER:
            self.assertLess(ended.seconds, seconds)
        if ended.code == 1:
            self.assertEqual(len(re.findall("^spbm: error: ", ended.err, re.M)), 1, ended.err)
        return ended.err

    def refused(self, data, *says, name="in", megabytes=64):
        """The bytes are refused as an import, in words that hold all of `says`; nothing is left."""
        self.write(name, data)
        before = sorted(os.listdir(self.folder))
        text = self.run_limited("import", name, "-o", "out.store", code=1, megabytes=megabytes)
        self.assertEqual(sorted(os.listdir(self.folder)), before)
        for words in says:
            self.assertIn(words, text)
        self.assertIn(name, text)

    def taken(self, data, name="in", faces=None, megabytes=64):
        """The bytes are imported, and the store is right."""
        self.write(name, data)
        self.run_limited("import", name, "-o", "out.store", code=0, megabytes=megabytes)
        self.run_limited("check", "out.store", code=0)
        self.run_limited("export", "out.store", "-o", "out.ply", code=0)
        if faces is not None:
            self.assertIn(b"element face %d\n" % faces, read_bytes(self.path("out.ply")))


class Claims(Hostile):
    def test_four_thousand_million_vertices(self):
        for kind in ("ascii", "binary_little_endian", "binary_big_endian"):
            self.refused(ply(4000000000, 1, kind), "vertex")
            self.refused(ply(3, 4000000000, kind, body=b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
                                                   if kind == "ascii" else TRIANGLE + FACE), "face")
        self.refused(ply(2 ** 63, 1), "in")
        self.refused(ply(10 ** 30, 1), "line 3")
        self.refused(b"OFF\n4000000000 1 0\n0 0 0\n", "vert")
        self.refused(b"OFF\n3 4000000000 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "face")
        self.refused(bytes(80) + struct.pack("<I", 4000000000) + struct.pack("<12fH", *[1.0] * 12, 0), "in")

    def test_a_polygon_of_65535_corners(self):
        self.refused(ply(count="ushort", body=TRIANGLE + struct.pack("<H", 65535)), "face")
        self.refused(ply(count="uint", body=TRIANGLE + struct.pack("<I", 0xffffffff)), "face")
        self.refused(ply(kind="ascii", body=b"0 0 0\n1 0 0\n0 1 0\n4294967295 0 1 2\n"), "face")
        self.refused(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4294967295 0 1 2\n", "face")
        n = 65535  # a parabola: convex, and exact in float32
        points = b"".join(struct.pack("<3f", i - n // 2, (i - n // 2) ** 2 / 65536, 0) for i in range(n))
        self.taken(ply(n, 1, count="ushort", body=points + struct.pack("<H%di" % n, n, *range(n))),
                   faces=n - 2, megabytes=128)

    def test_lists_of_negative_length(self):
        self.refused(ply(count="char", body=TRIANGLE + struct.pack("<b3i", -1, 0, 1, 2)), "face 0")
        self.refused(ply(count="int", body=TRIANGLE + struct.pack("<4i", -3, 0, 1, 2)), "face 0")
        self.refused(ply(kind="ascii", count="int", body=b"0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n"), "face 0")
        self.refused(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n", "face 0")

    def test_gzip_bombs(self):
        """100 MB from 100 kB: what counts is what is in it, and how little is held."""
        blanks = gzip.compress(b"OFF\n" + b" \n" * 50000000, 9)
        self.refused(blanks, "in", name="blanks.off.gz")
        self.refused(gzip.compress(b"ply\nformat ascii 1.0\ncomment " + b"x" * 100000000, 9), "line 3")
        self.refused(gzip.compress(bytes(100000000), 9), "in")

    def test_indices_out_of_range(self):
        for index in (3, 0xffffffff, 0x80000000):
            bad = struct.pack("<B3I", 3, 0, 1, index)
            self.refused(ply(body=TRIANGLE + bad).replace(b"uchar int", b"uchar uint"), "face 0", str(index))
        self.refused(ply(body=TRIANGLE + struct.pack("<B3i", 3, 0, 1, -1)), "face 0", "-1")
        for index in (b"4", b"4294967295", b"4294967296", b"99999999999999999999", b"0", b"-4"):
            self.refused(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 " + index + b"\n", "face 0" if index == b"4" else "")
        self.refused(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 4294967295\n", "face 0")

    def test_headers_that_do_not_end(self):
        head = b"ply\nformat ascii 1.0\n"
        vertex = b"element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        face = b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        body = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        others = [b"element e%d 0\n" % i for i in range(64)]
        self.taken(head + vertex + b"".join(others[:62]) + face + body, faces=1)
        self.refused(head + vertex + b"".join(others) + face + body, "64 elements")
        self.refused(head + vertex + b"element a 0\n" + b"".join(b"property int p%d\n" % i for i in range(1025)) + face + body, "1024 properties")
        self.refused(head + vertex + b"property int " + b"p" * 256 + b"\n" + face + body, "line 7", "255 characters")
        self.refused(head + b"comment\n" * 1000000, "does not end")
        self.refused(head + vertex + face[:-11], "ends within the header")

    def test_coordinates_of_any_type_must_be_finite(self):
        for order, kind in (("<", "little"), (">", "big")):
            head = (PLY_HEAD % ("binary_%s_endian" % kind, 3, 1, "uchar")).replace("float y", "double y")
            rows = [struct.pack(order + "fdf", *p) for p in ((0, 0, 0), (1, 0, 0), (0, 1, 0))]
            face = struct.pack(order + "B3i", 3, 0, 1, 2)
            self.taken(head.encode() + b"".join(rows) + face, faces=1)
            for value in (float("nan"), float("inf")):
                bad = [rows[0], struct.pack(order + "fdf", 1, value, 0), rows[2]]
                self.refused(head.encode() + b"".join(bad) + face, "vertex 1", "y is not finite")

    def test_inputs_of_different_kinds_are_one_mesh(self):
        """Doubles that float32 can't hold, before, between and behind files of float32."""
        far = "v 5000000.001 0 %d\nv 5000001.002 0 %d\nv 5000000.003 1.5 %d\nf 1 2 3\n"
        self.write("far.obj", (far % (0, 0, 0)).encode())
        self.write("far2.obj", (far % (9, 9, 9)).encode())
        self.write("near.ply", ply(body=TRIANGLE + FACE))
        for names in (("far.obj", "near.ply", "far2.obj"), ("near.ply", "far.obj", "far2.obj"),
                      ("far.obj", "far2.obj", "near.ply")):
            self.run_limited("import", *names, "-o", "out.store", code=0)
            self.run_limited("check", "out.store", code=0)
            self.run_limited("export", "out.store", "-o", "out.obj", code=0)
            with open(self.path("out.obj"), encoding="ascii") as file:
                lines = file.read().splitlines()
            found = sorted(tuple(map(float, line.split()[1:4])) for line in lines if line.startswith("v "))
            self.assertEqual(len(found), 9)
            right = sorted([(0, 0, 0), (0, 1, 0), (1, 0, 0)] +
                           [(5000000 + x, y, z) for z in (0, 9) for x, y in ((.001, 0), (1.002, 0), (.003, 1.5))])
            for a, b in zip(found, right):  # within 2^-24 of the box's largest side
                self.assertLess(max(abs(p - q) for p, q in zip(a, b)), 5000001 / 2 ** 24)
            self.assertEqual(sum(line.startswith("f ") for line in lines), 3)

    def test_numbers_at_the_edge(self):
        for value in (float("nan"), float("inf"), -float("inf")):
            self.refused(ply(body=struct.pack("<9f", 0, 0, 0, 1, value, 0, 0, 1, 0) + FACE), "vertex 1", "y")
        for word in (b"nan", b"inf", b"-inf", b"1e999"):
            self.refused(b"v 0 0 0\nv 1 " + word + b" 0\nv 0 1 0\nf 1 2 3\n", "line 2")
            self.refused(b"OFF\n3 1 0\n0 0 0\n1 " + word + b" 0\n0 1 0\n3 0 1 2\n", "line 4")
        for scale in (1e-45, 1e-40, 1e-38, 1e38, 1.7e38, 1e300, 1e-310, 5e-324):
            text = "v 0 0 0\nv %r 0 0\nv 0 %r 0\nv 0 0 %r\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n" % ((scale,) * 3)
            self.write("edge.obj", text.encode())
            for mode in ("collapse", "classic"):
                err = self.run_limited("simplify", "edge.obj", "-o", "out.ply", "--faces", 4, "--mode", mode)
                if "error" not in err:
                    self.run_limited("check", "out.ply", code=0)

    def test_ten_megabytes_without_a_line_end(self):
        long = b"1" * 10000000
        self.refused(b"v " + long, "line 1", name="long.obj")
        self.refused(b"OFF\n3 1 0\n" + long, "line 3")
        self.refused(ply(kind="ascii", body=long), "line 10")
        self.refused(b"solid x\nfacet normal 0 0 1\nouter loop\nvertex " + long, "line 4")
        self.refused(b"ply\nformat ascii 1.0\ncomment " + long, "line 3")
        # All of it one polygon: to triangulate it takes about 300 bytes a corner, or there is no memory.
        self.write("long.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + b"1 " * 5000000)
        self.run_limited("import", "long.obj", "-o", "out.store", code=(1, 4), megabytes=256)
        self.refused(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + b"1 " * 100000, "long.obj", name="long.obj")

    def test_line_ends_and_marks(self):
        plain = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
        for text in (plain.replace(b"\n", b"\r\n"), b"\xef\xbb\xbf" + plain, plain[:-1]):
            self.taken(text, name="in.obj", faces=1)
        head = ply(kind="ascii")
        body = b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        self.taken((head + body).replace(b"\n", b"\r\n"), faces=1)
        self.taken(head.replace(b"\n", b"\r\n").replace(b"ascii", b"binary_little_endian") + TRIANGLE + FACE,
                   faces=1)
        self.taken(b"OFF\r\n3 1 0\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n", faces=1)
        self.refused(b"v 0 0 0\nv 1 0\0 0\nv 0 1 0\nf 1 2 3\n", "line 2", name="nul.obj")
        self.refused(b"OFF\n3 1 0\n0 0 0\n1 \0 0\n0 1 0\n3 0 1 2\n", "line 4")
        self.refused(bytes(1000), "in")
        self.refused(b"", "in")

    def test_a_locale_with_decimal_comma(self):
        self.write("in.obj", b"v 0 0 0\nv 1.5 0 0\nv 0 1.5 0\nf 1 2 3\n")
        outputs = []
        for locale in ("C", "de_DE.UTF-8", "de_DE"):
            self.run_program("simplify", "in.obj", "-o", "out.off", "--error", "0.5%",
                             environment={"LC_ALL": locale, "LANG": locale})
            outputs.append(read_bytes(self.path("out.off")))
        self.assertIn(b"1.5", outputs[0])
        self.assertEqual(outputs, [outputs[0]] * 3)
        self.refused(b"v 0 0 0\nv 1,5 0 0\nv 0 1 0\nf 1 2 3\n", "line 2", name="comma.obj")


class Files(Hostile):
    def test_no_files_at_all(self):
        os.mkdir(self.path("folder"))
        for path in ("folder", "/dev/zero", "/dev/null", "absent", "folder/absent", ""):
            for words in (["import", path, "-o", "out"], ["info", path], ["check", path],
                          ["patchify", path, "-o", "out", "--faces", "9"],
                          ["lod", path, "-o", "out.ply", "--faces", "9"],
                          ["measure", path, path], ["render", path, "-o", "out.png"]):
                self.run_limited(*words, code=(1, 2))
                self.assertEqual(os.listdir(self.folder), ["folder"], words)

    def test_pipes(self):
        """A named pipe gives a mesh as a file does; what must be mapped refuses one without waiting."""
        os.mkfifo(self.path("pipe"))
        for words in (["patchify", "pipe", "-o", "out", "--faces", "9"],
                      ["lod", "pipe", "-o", "out.ply", "--faces", "9"], ["export", "pipe", "-o", "out.ply"]):
            self.run_limited(*words, code=1, seconds=2)
        data = read_bytes(self.sphere("in.ply", 4))

        def feed():
            with open(self.path("pipe"), "wb") as file:
                file.write(data)
        feeder = threading.Thread(target=feed)
        feeder.start()
        self.run_limited("import", "pipe", "-o", "out.store", code=0)
        feeder.join()
        self.run_limited("check", "out.store", code=0)

    def test_the_output_is_the_input(self):
        path = self.sphere("in.ply", 4)
        data = read_bytes(path)
        os.symlink("in.ply", self.path("link.ply"))
        os.link(path, self.path("hard.ply"))
        for output in ("in.ply", "./in.ply", "link.ply", "hard.ply"):
            self.run_limited("simplify", "in.ply", "-o", output, "--faces", 20, code=2)
            self.run_limited("import", "in.ply", "-o", output, code=2)
            self.assertEqual(read_bytes(path), data)

    def test_no_room_and_no_right(self):
        self.sphere("in.ply", 4)
        os.mkdir(self.path("folder"))
        for output, code in (("/dev/full", 4), ("folder", (1, 2)), ("absent/out.ply", 1), ("in.ply/out.ply", 1),
                             ("/proc/out.ply", 1), ("/dev/null", 0)):
            self.run_limited("simplify", "in.ply", "-o", output, "--format", "ply", "--faces", 20, code=code)
            self.run_limited("import", "in.ply", "-o", output, code=code)
            self.assertEqual(sorted(os.listdir(self.folder)), ["folder", "in.ply"])
        self.assertEqual(os.listdir(self.path("folder")), [])

    def test_no_room_for_what_looks_at_meshes(self):
        self.sphere("in.ply", 12)
        os.symlink("/dev/full", self.path("full.ply"))
        for words in (["render", "in.ply", "-o", "/dev/full"], ["measure", "in.ply", "in.ply", "--error-ply", "full.ply"],
                      ["topology", "in.ply", "-o", "/dev/full", "--format", "ply", "--max-feature", "1%"],
                      ["simplify", "in.ply", "-o", "/dev/null", "--format", "ply", "--faces", "99", "--json", "/dev/full"]):
            text = self.run_limited(*words, code=4)
            self.assertEqual(text.count("\n"), 1, text)
            self.assertRegex(text, "full.*No space left on device")
        self.assertEqual(sorted(os.listdir(self.folder)), ["full.ply", "in.ply"])

    def test_a_limit_of_file_size(self):
        """A disk that fills up, as RLIMIT_FSIZE: words, not a signal, and nothing is left."""
        self.sphere("in.ply", 24)
        for output in ("out.store", "out.ply"):
            words = ["import", "in.ply"] if output == "out.store" else ["simplify", "in.ply", "--ratio", "1"]
            text = self.run_limited(*words, "-o", output, code=(1, 4),
                                    prepare=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000)))
            self.assertIn("spbm: error", text)
            self.assertEqual(os.listdir(self.folder), ["in.ply"])

    def test_odd_paths(self):
        data = read_bytes(self.sphere("in.ply", 4))
        for name in ("with spaces.ply", "new\nline.ply", "tab\t.ply", "ünï.ply", "-dash.ply", "%n%s.ply",
                     "a" * 250 + ".ply"):
            self.write(name, data)
            output = "./out " + name[:200] + ".ply"
            self.run_limited("simplify", "./" + name, "-o", output.replace("%", "%%"), "--faces", 20, code=0)
            self.run_limited("check", output, code=0)
            self.write(name, data[:300])
            err = self.run_limited("info", "./" + name, code=1)
            self.assertEqual(err.count("\n"), 1, err)
        for length in (300, 4095, 4096, 70000):
            name = ("d/" * length)[:length - 4] + ".ply"
            self.assertEqual(self.run_limited("info", name, code=1).count("\n"), 1)
            for output in (name, "a" * length + ".ply"):  # said before the work, and whatever is too long is not the reason
                said = self.run_limited("simplify", "in.ply", "-o", output, "--faces", 20, code=(1, 2))
                self.assertEqual(said.count("\n"), 1)
                self.assertRegex(said, "too long|No such file")

    def test_a_store_that_shrinks_while_it_is_mapped(self):
        """No death by SIGBUS: words, and nothing left behind."""
        write_ply(self.path("in.ply"), bumpy_sphere(90))
        self.run_limited("import", "in.ply", "-o", "whole.store", code=0, megabytes=256)
        whole = read_bytes(self.path("whole.store"))
        begin = time.monotonic()
        self.write("in.store", whole)
        self.run_limited("patchify", "in.store", "-o", "out.chains", "--faces", 500, code=0, megabytes=256)
        took = time.monotonic() - begin
        os.unlink(self.path("out.chains"))
        for part in range(8):
            path = self.write("in.store", whole)
            cutter = threading.Timer(took * part / 10, os.truncate, (path, 100))
            cutter.start()
            self.run_limited("patchify", "in.store", "-o", "out.chains", "--faces", 500, code=(0, 1),
                             megabytes=256)
            cutter.join()
            self.assertLessEqual(set(os.listdir(self.folder)),
                                 {"in.ply", "whole.store", "in.store", "out.chains"})

    def test_an_input_that_changes_while_it_is_read(self):
        data = read_bytes(self.sphere("in.ply", 60))
        for change in (lambda path: os.truncate(path, 5000), lambda path: os.truncate(path, len(data) + 9999)):
            for delay in (0, 0.01, 0.03, 0.1):
                path = self.write("in.ply", data)
                changer = threading.Timer(delay, change, (path,))
                changer.start()
                self.run_limited("import", "in.ply", "-o", "out.store", megabytes=256)
                changer.join()


class SharedMachines(Hostile):
    def test_a_link_in_the_way_is_not_followed(self):
        """Someone guesses the name under which an output is written before it is whole."""
        self.sphere("in.ply", 4)
        self.write("victim", b"precious")

        def plant():
            for name in ("out.ply", "out.store"):
                for counter in range(3):
                    os.symlink("victim", ".%s.spbm-%d-%d~" % (name, os.getpid(), counter))
        self.run_limited("simplify", "in.ply", "-o", "out.ply", "--faces", 20, code=0,
                         prepare=lambda: (os.chdir(self.folder), plant()))
        self.run_limited("import", "in.ply", "-o", "out.store", code=0,
                         prepare=lambda: (os.chdir(self.folder), plant()))
        self.assertEqual(read_bytes(self.path("victim")), b"precious")
        for name in ("out.ply", "out.store"):
            self.assertFalse(os.path.islink(self.path(name)))
            self.run_limited("check", name, code=0)

    def test_temporary_files_are_where_they_were_asked_for_and_nobody_s(self):
        """Watches the folder for temporary files during a run: what has a name has mode 0600."""
        write_ply(self.path("in.ply"), bumpy_sphere(60))
        os.mkdir(self.path("tmp"))
        seen, stop = set(), threading.Event()

        def watch():
            while not stop.is_set():
                for name in os.listdir(self.path("tmp")):
                    try:
                        seen.add((name, os.stat(self.path("tmp/" + name)).st_mode & 0o777))
                    except FileNotFoundError:
                        pass
        watcher = threading.Thread(target=watch)
        watcher.start()
        self.run_limited("simplify", "in.ply", "-o", "out.ply", "--faces", 100, "--tmp", "tmp", code=0,
                         megabytes=256)
        stop.set()
        watcher.join()
        self.assertLessEqual({mode for _, mode in seen}, {0o600}, seen)
        self.assertEqual(os.listdir(self.path("tmp")), [])

    def test_the_umask_is_respected(self):
        self.sphere("in.ply", 4)
        for mask, mode in ((0o022, 0o644), (0o027, 0o640), (0o077, 0o600), (0o002, 0o664)):
            self.run_limited("simplify", "in.ply", "-o", "out.ply", "--faces", 20, "--keep", "kept", "--json",
                             "out.json", code=0, prepare=lambda mask=mask: os.umask(mask))
            for name in ("out.ply", "out.json", "kept/mesh.store", "kept/mesh.chains"):
                self.assertEqual(os.stat(self.path(name)).st_mode & 0o777, mode, name)
                os.unlink(self.path(name))

    def test_an_output_is_replaced_whole_or_not_at_all(self):
        self.sphere("in.ply", 4)
        path = self.write("out.ply", b"old")
        with open(path, "rb") as old:
            self.write("bad.ply", b"ply\nbroken")
            self.run_limited("simplify", "bad.ply", "-o", "out.ply", "--faces", 20, code=1)
            self.assertEqual(read_bytes(path), b"old")
            self.run_limited("simplify", "in.ply", "-o", "out.ply", "--faces", 20, code=0)
            self.assertEqual(old.read(), b"old")  # who has the old one open keeps it
        self.run_limited("check", "out.ply", code=0)

    def test_runs_at_the_same_time_do_not_meet(self):
        self.sphere("in.ply", 12)
        self.run_limited("simplify", "in.ply", "-o", "right.ply", "--faces", 100, code=0)
        right = read_bytes(self.path("right.ply"))
        runs = [subprocess.Popen([PROGRAM, "simplify", "in.ply", "-o", name, "--faces", "100", "-q"],
                                 cwd=self.folder, env=self.environment)
                for name in ("same.ply", "same.ply", "same.ply", "a.ply", "b.ply")]
        self.assertEqual([run.wait(timeout=120) for run in runs], [0] * 5)
        for name in ("same.ply", "a.ply", "b.ply"):
            self.assertEqual(read_bytes(self.path(name)), right)
        self.assertEqual(sorted(os.listdir(self.folder)), ["a.ply", "b.ply", "in.ply", "right.ply", "same.ply"])


if __name__ == "__main__":
    unittest.main()
