"""The program from outside: every command, exit codes, JSON, standard streams, limits, signals."""
import gzip
import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from program import (PROGRAM, ProgramTest, bumpy_sphere, read_bytes, read_json,  # noqa: E402
                     write_ply)

SOURCE = os.environ["SPBM_SOURCE"]
COMMANDS = ["simplify", "import", "patchify", "lod", "export", "info", "check", "measure", "render"]


def ply_counts(data):
    return tuple(int(re.search(rb"element %s (\d+)" % kind, data).group(1))
                 for kind in (b"vertex", b"face"))


class Help(ProgramTest):
    def test_help_goes_to_stdout(self):
        out, err = self.run_program("--help")
        self.assertEqual(err, "")
        for command in COMMANDS:
            self.assertIn(command.encode(), out)
            own, err = self.run_program(command, "--help")
            self.assertEqual(err, "")
            self.assertIn(b"usage: spbm " + command.encode(), own)
            self.assertIn(b"--json", own)
            self.assertNotIn(b"@", own)
            self.assertLessEqual(max(map(len, own.splitlines())), 100)
            self.assertEqual(self.run_program("help", command)[0], own)

    def test_version_is_the_build_s(self):
        with open(os.path.join(SOURCE, "meson.build"), encoding="utf-8") as file:
            version = re.search(r"version: '([0-9.]+)'", file.read()).group(1)
        self.assertEqual(self.run_program("--version")[0].decode(), "spbm %s\n" % version)
        self.assertEqual(self.run_program("lod", "--version")[0].decode(), "spbm %s\n" % version)

    def test_every_option_is_in_the_man_page(self):
        with open(os.path.join(SOURCE, "doc", "spbm.1"), encoding="utf-8") as file:
            page = file.read().replace("\\-", "-")
        for command in COMMANDS:
            self.assertIn(command, page)
            for option in re.findall(r"--[a-z][a-z-]+", self.run_program(command, "-h")[0].decode()):
                self.assertIn(option, page)


class Misuse(ProgramTest):
    """Exit code 2, one line, and a hint."""

    def misuse(self, *words, says):
        out, err = self.run_program(*words, code=2)
        self.assertEqual(out, b"")
        self.assertEqual(err.count("\n"), 1, err)
        for text in says:
            self.assertIn(text, err)

    def test_words(self):
        mesh = self.sphere(n=3)
        self.misuse("simplfy", says=["simplfy", "did you mean simplify"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--face", "3", says=["did you mean --faces"])
        self.misuse("simplify", mesh, "-o", "x.ply", says=["target is missing"])
        self.misuse("simplify", says=["input is missing"])
        self.misuse("simplify", mesh, says=["-o OUT is missing"])
        self.misuse("simplify", mesh, "-o", "-", "--faces", "9", says=["-o - needs --format"])
        self.misuse("simplify", mesh, "-o", "x.xyz", "--faces", "9", says=["x.xyz", ".obj"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "9", "--error", "1%,2%",
                    says=["--error 1%,2%", "bound"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "9", "--mode", "classic",
                    "--place", "optimal", says=["classic", "optimal"])
        self.misuse("render", mesh, "-o", "x.jpg", says=["x.jpg", ".png"])
        self.misuse("-v", says=["command comes before -v"])
        self.misuse("simplify", mesh, "--faces", "10", says=["-o OUT is missing"])
        self.misuse("simplify", "--faces", "10", "-o", "x.ply", says=["input is missing"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "ten", says=["--faces ten"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "0", says=["--faces 0"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "1.5", says=["--faces 1.5"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", says=["needs a value"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--ratio", "1.5", says=["--ratio 1.5"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--ratio", "200%", says=["--ratio 200%"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--error", "nan", says=["--error nan"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "9", "--ratio", "0.5",
                    says=["--faces and --ratio"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "9", "--mode", "fast",
                    says=["--mode fast", "classic"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "9", "-m", "lots", says=["--memory"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "9", "-t", "0", says=["--threads"])
        self.misuse("simplify", mesh, "-o", "x.ply", "--faces", "9", "--weld=yes",
                    says=["takes no value"])
        self.misuse("info", mesh, "--weld", says=["--weld is an option of simplify, import"])
        self.misuse("info", says=["input is missing"])
        self.misuse("info", mesh, mesh, says=["one input too many"])
        self.misuse("lod", mesh, "-o", "-", "--faces", "9", "--json", "-", says=["standard output"])

    def test_no_command(self):
        out, err = self.run_program(code=2)
        self.assertEqual(out, b"")
        self.assertIn("usage", err)

    def test_levels_need_a_number_in_the_name(self):
        mesh = self.sphere(n=6)
        for name in ("x.ply", "x%%d.ply", "%d-%d.ply"):
            _, err = self.run_program("simplify", mesh, "-o", name, "--faces", "90,40", code=2)
            self.assertIn("%d", err)

    def test_output_needs_a_format(self):
        mesh = self.sphere(n=6)
        self.run_program("simplify", mesh, "-o", "-", "--faces", "90", code=2)
        self.run_program("simplify", mesh, "-o", "x.unknown", "--faces", "90", code=2)

    def test_output_is_input(self):
        mesh = self.sphere(n=6)
        before = read_bytes(mesh)
        os.symlink(mesh, self.path("link.ply"))
        os.link(mesh, self.path("hard.ply"))
        for out in (mesh, "link.ply", "hard.ply", "./in.ply"):
            _, err = self.run_program("simplify", mesh, "-o", out, "--faces", "90", code=2)
            self.assertIn("same", err)
        self.assertEqual(read_bytes(mesh), before)
        self.run_program("import", mesh, "-o", "link.ply", code=2)
        self.run_program("info", mesh, "--json", "hard.ply", code=2)
        self.assertEqual(read_bytes(mesh), before)


class Failure(ProgramTest):
    def test_counts_beyond_an_index_are_refused_with_words(self):
        """At once, in sparse files as large as they claim to be."""
        def ply(vertices, faces):
            return ("ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\n"
                    "property float y\nproperty float z\nelement face %d\n"
                    "property list uchar int vertex_indices\nend_header\n" % (vertices, faces))
        for name, head, size in (("v.ply", ply(2**32 - 1, 1), 12 * (2**32 - 1) + 13),
                                 ("w.ply", ply(2**64 - 1, 2**64 - 1), 1000),
                                 ("o.off", "OFF\n4294967296 4294967296 0\n", 0)):
            with open(self.path(name), "wb") as file:
                file.write(head.encode())
                file.truncate(len(head) + size)
            began = time.monotonic()
            _, err = self.run_program("simplify", name, "-o", "x.ply", "--faces", "9", code=1)
            self.assertIn(name, err)
            self.assertLess(time.monotonic() - began, 5)
            if name != "w.ply":
                self.assertIn("4294967294", err)

    def test_missing_and_bad_inputs(self):
        _, err = self.run_program("simplify", "nothing.ply", "-o", "x.ply", "--faces", "9", code=1)
        self.assertIn("nothing.ply", err)
        self.assertIn("No such file", err)
        with open(self.path("bad.ply"), "wb") as file:
            file.write(b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                       b"property float y\nproperty float z\nelement face 1\n"
                       b"property list uchar int vertex_indices\nend_header\n"
                       b"0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
        _, err = self.run_program("simplify", "bad.ply", "-o", "x.ply", "--faces", "9", code=1)
        self.assertIn("bad.ply", err)
        self.assertIn("7", err)
        with open(self.path("text.txt"), "wb") as file:
            file.write(b"this is no mesh\n")
        for command in (["info"], ["check"], ["import", "-o", "x.store"]):
            _, err = self.run_program(command[0], "text.txt", *command[1:], code=1)
            self.assertIn("text.txt", err)
        _, err = self.run_program("patchify", "text.txt", "-o", "x.chains", "--faces", "9", code=1)
        self.assertIn("import makes one", err)
        _, err = self.run_program("lod", "text.txt", "-o", "x.ply", "--faces", "9", code=1)
        self.assertIn("patchify makes one", err)
        _, err = self.run_program("simplify", "text.txt", "-o", "x.ply", "--faces", "9", "--keep",
                                  "bad.ply", code=1)
        self.assertIn("bad.ply: is not a directory", err)
        self.assertEqual(sorted(os.listdir(self.folder)), ["bad.ply", "text.txt"])

    def test_unwritable_output(self):
        mesh = self.sphere(n=6)
        _, err = self.run_program("simplify", mesh, "-o", "no/such/x.ply", "--faces", "90", code=1)
        self.assertIn("no/such", err)
        _, err = self.run_program("simplify", mesh, "-o", self.folder, "--faces", "90",
                                  "--format", "ply", code=1)
        self.assertIn("directory", err)
        _, err = self.run_program("import", mesh, "-o", "no/such/x.store", code=1)
        self.assertEqual(os.listdir(self.folder), ["in.ply"])

    def test_full_disk(self):
        mesh = self.sphere(n=24)
        _, err = self.run_program("simplify", mesh, "-o", "/dev/full", "--format", "ply", "--faces",
                                  "900", code=4)
        self.assertIn("No space left", err)

    def test_no_memory(self):
        mesh = self.sphere(n=24)
        _, err = self.run_program("simplify", mesh, "-o", "x.ply", "--faces", "900", "-m", "10k",
                                  code=4)
        self.assertIn("memory", err)
        self.assertEqual(os.listdir(self.folder), ["in.ply"])

    def test_target_below_the_floor(self):
        mesh = self.sphere(n=12)
        _, err = self.run_program("simplify", mesh, "-o", "x.ply", "--faces", "2", code=3)
        self.assertIn("floor", err)
        vertices, faces = ply_counts(read_bytes(self.path("x.ply")))
        self.assertGreaterEqual(faces, 4)
        self.assertEqual(vertices * 2 - 4, faces)
        self.run_program("check", "x.ply")

    def test_target_above_the_input(self):
        mesh = self.sphere(n=12)
        _, err = self.run_program("simplify", mesh, "-o", "x.ply", "--faces", "1M", code=3)
        self.assertIn("more faces", err)
        self.run_program("check", "x.ply")

    def test_places_for_temporary_files(self):
        mesh = self.sphere(n=6)
        _, err = self.run_program("simplify", mesh, "-o", "x.ply", "--faces", "90", "--tmp", "no",
                                  code=2)
        self.assertIn("--tmp no", err)
        self.run_program("simplify", mesh, "-o", "x.ply", "--faces", "90",
                         environment={"TMPDIR": self.folder})
        self.assertEqual(sorted(os.listdir(self.folder)), ["in.ply", "x.ply"])


class Work(ProgramTest):
    def stages_apart(self, mode, wanted):
        mesh = self.sphere(n=30)
        target = ["--faces", ",".join(map(str, wanted)), "--mode", mode]
        self.run_program("simplify", mesh, "-o", "one-%d.ply", *target, "-t", "1")
        self.run_program("simplify", mesh, "-o", "two-%d.ply", *target, "-t", "2")
        self.run_program("import", mesh, "-o", "a.store")
        self.run_program("patchify", "a.store", "-o", "a.chains", *target)
        self.run_program("lod", "a.chains", "-o", "three-%d.ply", *target)
        self.run_program("simplify", mesh, "-o", "four-%d.ply", *target, "--keep", "kept")
        for level, faces in enumerate(wanted):
            first = read_bytes(self.path("one-%d.ply" % level))
            self.assertIn(ply_counts(first)[1], (faces, faces - 1))
            for name in ("two", "three", "four"):
                self.assertEqual(read_bytes(self.path("%s-%d.ply" % (name, level))), first, name)
            self.run_program("check", "one-%d.ply" % level)
        self.assertEqual(sorted(os.listdir(self.path("kept"))), ["mesh.chains", "mesh.store"])
        self.assertEqual(read_bytes(self.path("kept/mesh.store")),
                         read_bytes(self.path("a.store")))
        # What is kept differs by one section more, where that makes levels cheaper.
        own, kept = (read_bytes(self.path(name)) for name in ("a.chains", "kept/mesh.chains"))
        table = struct.unpack_from("<Q", own, len(own) - 32)[0]
        self.assertEqual(kept[:table], own[:table])
        self.assertEqual(b"TRNK" in kept, mode == "collapse")
        self.run_program("check", "kept/mesh.chains")
        self.run_program("lod", "kept/mesh.chains", "-o", "five-%d.ply", *target)
        # lod leaves it, too, when told so, and only once.
        self.run_program("lod", "a.chains", "-o", "five-%d.ply", *target, "--cache")
        self.assertEqual(read_bytes(self.path("a.chains")), kept)
        before = os.stat(self.path("a.chains"))
        self.run_program("lod", "a.chains", "-o", "five-%d.ply", *target, "--cache")
        after = os.stat(self.path("a.chains"))
        if mode == "collapse":
            self.assertEqual((after.st_ino, after.st_mtime_ns), (before.st_ino, before.st_mtime_ns))
        self.run_program("lod", "a.chains", "-o", "five.ply", "--faces", "9", "--cache",
                         "--max-feature", "1", code=2)
        for level in range(len(wanted)):
            self.assertEqual(read_bytes(self.path("five-%d.ply" % level)),
                             read_bytes(self.path("one-%d.ply" % level)))
        for name in ("a.store", "a.chains"):
            self.run_program("check", name)

    def test_stages_apart_are_one_run(self):
        self.stages_apart("collapse", (2000, 500, 100))

    def test_stages_apart_are_one_run_classic(self):
        self.stages_apart("classic", (500, 200, 50))

    def test_the_same_mesh_by_any_way_in(self):
        mesh = self.sphere(n=16)
        self.sphere("text.ply", n=16, binary=False)
        with gzip.open(self.path("in.ply.gz"), "wb") as file:
            file.write(read_bytes(mesh))
        how = ["--faces", "400", "-o"]
        self.run_program("simplify", mesh, *how, "a.ply")
        expected = read_bytes(self.path("a.ply"))
        self.run_program("simplify", "text.ply", *how, "b.ply")
        self.run_program("simplify", "in.ply.gz", *how, "c.ply")
        self.run_program("simplify", "-", *how, "d.ply", stdin=read_bytes(mesh))
        self.run_program("simplify", "-", *how, "e.ply", stdin=read_bytes(self.path("in.ply.gz")))
        for name in "bcde":
            self.assertEqual(read_bytes(self.path(name + ".ply")), expected, name)
        out, _ = self.run_program("simplify", mesh, *how, "-", "--format", "ply")
        self.assertEqual(out, expected)
        self.run_program("simplify", mesh, *how, "/dev/null", "--format", "ply")

    def test_formats(self):
        mesh = self.sphere(n=10)
        for name, start in (("a.ply", b"ply\nformat binary_little"), ("a.obj", b""), ("a.stl", b""),
                            ("a.off", b"OFF")):
            self.run_program("simplify", mesh, "-o", name, "--faces", "300")
            self.assertTrue(read_bytes(self.path(name)).startswith(start))
            self.run_program("check", name)
        for word, start in (("ply-ascii", b"ply\nformat ascii"), ("ply-big", b"ply\nformat binary_big")):
            self.run_program("simplify", mesh, "-o", "b.ply", "--faces", "300", "--format", word)
            self.assertTrue(read_bytes(self.path("b.ply")).startswith(start))
            self.run_program("check", "b.ply")

    def test_targets(self):
        mesh = self.sphere(n=16)
        faces = 8 * 16 * 16
        self.run_program("simplify", mesh, "-o", "a.ply", "--ratio", "25%")
        self.assertIn(ply_counts(read_bytes(self.path("a.ply")))[1], (faces // 4, faces // 4 - 1))
        self.run_program("simplify", mesh, "-o", "b.ply", "-r", "0.25")
        self.assertEqual(read_bytes(self.path("a.ply")), read_bytes(self.path("b.ply")))
        self.run_program("simplify", mesh, "-o", "e%d.ply", "--error", "3%,6%,12%")
        counts = [ply_counts(read_bytes(self.path("e%d.ply" % i)))[1] for i in range(3)]
        self.assertEqual(counts, sorted(counts, reverse=True))
        self.assertLess(counts[2], counts[0])

    def first_reached(self, mode):
        mesh = self.sphere(n=30)
        how = ["simplify", mesh, "--mode", mode, "--json", "r.json", "-o"]
        self.run_program(*how, "a.ply", "--error", "6%")
        free = read_json(self.path("r.json"))["levels"][0]
        few, many = free["faces"] // 2, free["faces"] * 2
        self.run_program(*how, "b%d.ply", "--faces", "%d,%d" % (few, many), "--error", "6%")
        fine, coarse = read_json(self.path("r.json"))["levels"]
        self.assertEqual((fine["stop"], coarse["stop"]), ("reached", "error_bound"))
        self.assertIn(fine["faces"], (many, many - 1))
        self.assertGreater(coarse["faces"], few)
        self.assertLess(coarse["faces"], many)
        for level in (fine, coarse):
            self.assertLessEqual(level["error"], 0.06 * 1.000001 * level["error"] /
                                 level["error_of_diagonal"])
            self.assertEqual(level["wanted_error"], free["wanted_error"])
            self.run_program("check", level["file"])
        # No bound that is never met changes anything; one that cannot be kept is a miss.
        self.run_program(*how, "c.ply", "--ratio", "10%", "--error", "1000%")
        self.run_program(*how, "d.ply", "--ratio", "10%")
        self.assertEqual(read_bytes(self.path("c.ply")), read_bytes(self.path("d.ply")))
        _, err = self.run_program(*how, "e.ply", "--faces", "400", "--error", "1e-9",
                                  "--patch-angle", "20", "--face-angle", "17", code=3)
        self.assertIn("1e-09", err)
        self.assertEqual(read_json(self.path("r.json"))["levels"][0]["stop"], "too_fine")

    def test_count_and_error_together(self):
        self.first_reached("collapse")

    def test_count_and_error_together_classic(self):
        self.first_reached("classic")

    def test_export_gives_the_mesh(self):
        mesh = self.sphere(n=10)
        self.run_program("import", mesh, "-o", "a.store")
        self.run_program("export", "a.store", "-o", "back.ply")
        self.assertEqual(ply_counts(read_bytes(self.path("back.ply"))),
                         ply_counts(read_bytes(mesh)))
        out, _ = self.run_program("export", "a.store", "-o", "-", "--format", "off")
        self.assertTrue(out.startswith(b"OFF"))

    def test_several_inputs_are_one_mesh(self):
        self.sphere("one.ply", n=4)
        self.sphere("two.ply", n=6)
        self.run_program("import", "one.ply", "two.ply", "-o", "a.store", "--json", "a.json")
        topology = read_json(self.path("a.json"))["store"]["topology"]
        self.assertEqual(topology["components"], 2)
        self.assertEqual(topology["faces"], 8 * 16 + 8 * 36)

    def test_check_finds_defects(self):
        vertices, faces = bumpy_sphere(4)
        write_ply(self.path("a.ply"), (vertices, faces + [faces[0]]))
        _, err = self.run_program("check", "a.ply", code=1)
        self.assertIn("duplicate", err)
        write_ply(self.path("b.ply"), (vertices, [faces[0][::-1]] + faces[1:]))
        _, err = self.run_program("check", "b.ply", code=1)
        self.assertIn("orientation", err)
        self.run_program("import", self.sphere(n=8), "-o", "a.store")
        data = bytearray(read_bytes(self.path("a.store")))
        data[len(data) // 2] ^= 4
        with open(self.path("a.store"), "wb") as file:
            file.write(data)
        _, err = self.run_program("check", "a.store", code=1)
        self.assertIn("a.store", err)

    def test_pictures(self):
        mesh = self.sphere(n=10)
        self.run_program("import", mesh, "-o", "a.store")
        self.run_program("patchify", "a.store", "-o", "a.chains", "--faces", "100")
        self.run_program("render", mesh, "a.store", "a.chains", "-o", "a.png", "--size", "200x150",
                         "--wireframe", "--view", "1,-1,0.5")
        data = read_bytes(self.path("a.png"))
        self.assertTrue(data.startswith(b"\x89PNG"))
        self.assertEqual(int.from_bytes(data[16:20], "big"), 400)
        _, err = self.run_program("render", "a.chains", "-o", "b.png", code=2)
        self.assertIn("no surface", err)
        # A store of as many faces and vertices that is not the one the chains came from.
        write_ply(self.path("other.ply"), bumpy_sphere(10, 0.11))
        self.run_program("import", "other.ply", "-o", "b.store")
        _, err = self.run_program("render", "b.store", "a.chains", "-o", "b.png", code=1)
        self.assertIn("a.chains: was not made from b.store", err)
        self.assertNotIn("b.png", os.listdir(self.folder))

    def test_picture_of_errors(self):
        mesh = self.sphere(n=16)
        self.run_program("simplify", mesh, "-o", "a.ply", "--faces", "300")
        self.run_program("measure", mesh, "a.ply", "--error-ply", "e.ply", "--json", "r.json")
        data = read_bytes(self.path("e.ply"))
        self.assertEqual(ply_counts(data), ply_counts(read_bytes(self.path("a.ply"))))
        head, body = data.split(b"end_header\n", 1)
        for line in (b"property float quality", b"property uchar red", b"property uchar blue"):
            self.assertIn(line, head)
        vertices = ply_counts(data)[0]
        errors = [struct.unpack_from("<4f3B", body, 19 * i)[3] for i in range(vertices)]
        self.assertGreaterEqual(min(errors), 0)
        largest = read_json(self.path("r.json"))["measurement"]["backward"]["largest"]
        self.assertGreater(max(errors), 0)
        self.assertLessEqual(max(errors), largest * 1.0001)
        # Its picture has the legend, and colours that the plain mesh's has not.
        self.run_program("render", "e.ply", "-o", "e.png", "--size", "300x260")
        self.run_program("render", "e.ply", "-o", "f.png", "--size", "300x260", "--legend", "mm")
        self.run_program("render", "a.ply", "-o", "a.png", "--size", "300x260")
        pictures = [read_bytes(self.path(name)) for name in ("e.png", "f.png", "a.png")]
        self.assertEqual(len(set(pictures)), 3)
        for name in ("e.obj", "e"):
            _, err = self.run_program("measure", mesh, "a.ply", "--error-ply", name, code=2)
            self.assertIn(".ply", err)
        self.run_program("measure", mesh, "a.ply", "--error-ply", "a.ply", code=2)
        self.run_program("measure", mesh, "a.ply", "--error-ply", "g.ply", "--json", "g.ply", code=2)

    def test_measure(self):
        mesh = self.sphere(n=16)
        self.run_program("simplify", mesh, "-o", "a.ply", "--faces", "500")
        self.run_program("measure", mesh, mesh, "--json", "same.json")
        same = read_json(self.path("same.json"))["measurement"]
        self.assertLess(same["hausdorff"], 1e-6)
        out, _ = self.run_program("measure", mesh, "a.ply", "--json", "a.json")
        self.assertIn(b"Hausdorff", out)
        found = read_json(self.path("a.json"))["measurement"]
        self.assertGreater(found["hausdorff"], 0)
        self.assertLess(found["hausdorff"], 0.2 * found["diagonal"])


class Report(ProgramTest):
    def test_json_of_simplify(self):
        mesh = self.sphere(n=16)
        self.run_program("simplify", mesh, "-o", "s%d.ply", "--faces", "500,100", "--json", "r.json",
                         "-q")
        report = read_json(self.path("r.json"))
        self.assertEqual(report["program"], "spbm")
        self.assertEqual(report["command"], "simplify")
        self.assertEqual(report["exit_code"], 0)
        self.assertIsNone(report["error"])
        self.assertEqual(report["inputs"], [mesh])
        self.assertEqual([stage["name"] for stage in report["stages"]],
                         ["import", "patchify", "lod"])
        self.assertEqual(report["store"]["topology"]["faces"], 8 * 16 * 16)
        self.assertEqual(report["store"]["topology"]["euler"], 2)
        self.assertGreater(report["chains"]["patches"], 0)
        self.assertEqual([level["file"] for level in report["levels"]], ["s0.ply", "s1.ply"])
        for level in report["levels"]:
            self.assertIn(level["faces"], (level["wanted_faces"], level["wanted_faces"] - 1))
            self.assertEqual(level["stop"], "reached")
        self.assertGreater(report["memory_peak"], 1 << 20)

    def speck(self):
        """A large tetrahedron and a small one."""
        with open(self.path("speck.off"), "w", encoding="ascii") as file:
            file.write("OFF\n8 8 0\n")
            for scale, shift in ((1, 0), (0.1, 2)):
                for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)):
                    file.write("%g %g %g\n" % (scale * x + shift, scale * y, scale * z))
            for first in (0, 4):
                for a, b, c in ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)):
                    file.write("3 %d %d %d\n" % (first + a, first + b, first + c))
        return "speck.off"

    def test_topology(self):
        _, err = self.run_program("topology", self.speck(), "-o", "c.ply", "--drop-components",
                                  "50%", "--json", "t.json")
        report = read_json(self.path("t.json"))
        self.assertIn("8 faces in, 4 faces out", err)
        self.assertEqual(report["removed_counts"]["component"], 1)
        self.assertEqual(report["removed"][0]["kind"], "component")
        self.run_program("check", "c.ply")
        for words, says in (([], "no size is given"), (["--max-feature", "0"], "--max-feature 0"),
                            (["--max-feature", "1", "--size", "x"], "exact, sampled, box, extent")):
            _, err = self.run_program("topology", "speck.off", "-o", "d.ply", *words, code=2)
            self.assertIn(says, err)
        self.run_program("topology", "speck.off", "-o", "d.ply", "--drop-components", "200%",
                         code=1)

    def drop_speck(self, command, name, first_stage):
        _, err = self.run_program(command, name, "-o", "s.ply", "--faces", "4",
                                  "--drop-components", "50%", "--json", "t.json")
        report = read_json(self.path("t.json"))
        self.assertIn("component removed: 1", err)
        self.assertIn("8 faces in, 4 faces out", err)
        self.assertEqual(report["removed_counts"]["component"], 1)
        self.assertEqual([stage["name"] for stage in report["stages"]],
                         [first_stage, "topology", "patchify", "lod"])

    def test_topology_before_simplifying(self):
        self.drop_speck("simplify", self.speck(), "import")
        _, err = self.run_program("simplify", "speck.off", "-o", "s.ply", "--faces", "4", "--size",
                                  "box", code=2)
        self.assertIn("no size is given", err)
        _, err = self.run_program("export", "a.store", "-o", "s.ply", "--max-feature", "3", code=2)
        self.assertIn("option of simplify, lod, topology", err)

    def test_topology_of_chains(self):
        self.run_program("import", self.speck(), "-o", "a.store")
        self.run_program("patchify", "a.store", "-o", "a.chains", "--faces", "8")
        self.drop_speck("lod", "a.chains", "unfold")
        self.run_program("check", "s.ply")

    def test_every_key_is_documented(self):
        with open(os.path.join(SOURCE, "doc", "json.md"), encoding="utf-8") as file:
            page = file.read()
        mesh = self.sphere(n=8)
        self.run_program("simplify", mesh, "-o", "a.ply", "--faces", "2", "--keep", "k",
                         "--json", "0.json", code=3)
        self.run_program("import", "none.ply", "-o", "a.store", "--json", "1.json", code=1)
        emitted = set()
        for i, words in enumerate((["info", mesh], ["info", "k/mesh.store"],
                                   ["info", "k/mesh.chains"], ["check", mesh],
                                   ["measure", mesh, "a.ply"],
                                   ["export", "k/mesh.store", "-o", "b.ply"],
                                   ["topology", self.speck(), "-o", "c.ply", "--drop-components",
                                    "50%"],
                                   ["simplify", mesh, "-o", "d.ply", "--faces", "9", "--dry-run"])):
            self.run_program(*words, "--json", "%d.json" % (i + 2))

        def walk(value):
            if isinstance(value, dict):
                for key, inner in value.items():
                    self.assertIn("`%s`" % key, page)
                    emitted.add(key)
                    walk(inner)
            elif isinstance(value, list):
                for inner in value:
                    walk(inner)
        for i in range(10):
            walk(read_json(self.path("%d.json" % i)))
        # And the other way round: the page promises no key that never comes.
        documented = set(re.findall(r"`([a-z_][a-z_0-9]*)`", page)) - {"null"}
        # Attributes and messages: the sphere has no properties, and gives rise to no message.
        # Nor more than one slab, whose small meshes would be joined.
        self.assertEqual(documented - emitted - {"type", "text", "faces_in", "largest_in", "faces_out"},
                         set())

    def test_json_of_a_failure(self):
        self.run_program("simplify", "none.ply", "-o", "a.ply", "--faces", "9", "--json", "r.json",
                         code=1)
        report = read_json(self.path("r.json"))
        self.assertEqual(report["exit_code"], 1)
        self.assertIn("none.ply", report["error"])

    def test_json_to_stdout_is_alone_there(self):
        import json
        mesh = self.sphere(n=8)
        for words in (["info", mesh], ["check", mesh], ["import", mesh, "-o", "a.store"]):
            out, _ = self.run_program(*words, "--json", "-")
            self.assertEqual(json.loads(out)["exit_code"], 0)

    def test_dry_run(self):
        """Foretold and true figures agree to a factor; nothing is written."""
        mesh = self.sphere(n=60, binary=False)
        words = ["simplify", mesh, "-o", "a.ply", "--faces", "2k"]
        out, err = self.run_program(*words, "--dry-run", "--json", "plan.json")
        self.assertEqual(err, "")
        for word in ("time", "disk", "memory", "at least", "28,800 faces"):
            self.assertIn(word, out.decode())
        self.assertEqual(sorted(os.listdir(self.folder)), ["in.ply", "plan.json"])
        plan = read_json(self.path("plan.json"))["plan"]
        self.run_program(*words, "--json", "r.json")
        report = read_json(self.path("r.json"))
        self.assertEqual(plan["faces"], report["store"]["topology"]["faces"])
        self.assertEqual(plan["vertices"], report["store"]["topology"]["vertices"])
        self.assertTrue(plan["is_counted"])
        self.assertLess(plan["output_bytes"] / os.path.getsize(self.path("a.ply")), 2)
        self.assertGreater(plan["output_bytes"] / os.path.getsize(self.path("a.ply")), 0.5)
        self.run_program(*words, "--keep", "kept")
        kept = os.path.getsize(self.path("kept/mesh.store"))
        self.assertLess(plan["temporary_bytes"] / kept, 3)
        self.assertGreater(plan["temporary_bytes"] / kept, 0.5)
        # The least is enough, and less is refused with it.
        self.run_program(*words, "-m", plan["memory_least"])
        _, err = self.run_program(*words, "-m", plan["memory_least"] * 9 // 10, code=4)
        self.assertIn("at least", err)
        self.run_program(*words, "-m", plan["memory_least"] * 9 // 10, "--dry-run", code=4)
        # Text without counts is scaled up from its beginning.
        self.run_program("export", "kept/mesh.store", "-o", "in.obj")
        out, _ = self.run_program("simplify", "in.obj", "-o", "a.ply", "--faces", "2k", "--dry-run",
                                  "--json", "-")
        guessed = json.loads(out)["plan"]
        self.assertFalse(guessed["is_counted"])
        self.assertTrue(0.6 < guessed["faces"] / plan["faces"] < 1.6, guessed)
        self.run_program("simplify", "-", "-o", "a.ply", "--faces", "2k", "--dry-run", code=2)
        self.run_program("simplify", "a.json", "-o", "a.ply", "--faces", "2k", "--dry-run", code=1)

    def test_closing_line(self):
        mesh = self.sphere(n=16)
        _, err = self.run_program("simplify", mesh, "-o", "a.ply", "--faces", "500")
        last = err.splitlines()[-1]
        self.assertRegex(last, r"^spbm [0-9.]+ simplify: 2,048 faces in, (500|499) faces out; "
                               r"[0-9.]+ s wall, [0-9.]+ s CPU, peak memory [0-9.]+ [KMG]iB "
                               r"of [0-9.]+ [KMG]iB \(half of .*\)$")
        self.assertNotIn("\r", err)
        self.assertNotIn("\033", err)
        _, err = self.run_program("simplify", mesh, "-o", "a.ply", "--faces", "500", "-q")
        self.assertEqual(err, "")
        _, err = self.run_program("simplify", mesh, "-o", "a.ply", "--faces", "500", "-v")
        self.assertIn("memory:", err)

    def test_info_names_the_floor(self):
        mesh = self.sphere(n=8)
        self.run_program("import", mesh, "-o", "a.store")
        for name in (mesh, "a.store"):
            out, _ = self.run_program("info", name)
            self.assertRegex(out.decode(), r"floor +4 faces")
        out, _ = self.run_program("info", "-", stdin=read_bytes(mesh))
        self.assertIn(b"512", out)

    def test_limits_from_the_environment(self):
        mesh = self.sphere(n=4)
        for variable in ("SLURM_CPUS_PER_TASK", "OMP_NUM_THREADS"):
            self.run_program("info", mesh, "--json", "r.json", environment={variable: "1"})
            limits = read_json(self.path("r.json"))["limits"]
            self.assertEqual(limits["threads"], 1)
        self.run_program("info", mesh, "--json", "r.json", environment={"SLURM_MEM_PER_NODE": "100"})
        limits = read_json(self.path("r.json"))["limits"]
        self.assertEqual(limits["memory"], 50 << 20)
        self.assertIn("SLURM_MEM_PER_NODE", limits["memory_from"])
        self.run_program("info", mesh, "--json", "r.json", "-m", "1.5G", "-t3")
        limits = read_json(self.path("r.json"))["limits"]
        self.assertEqual((limits["memory"], limits["threads"]), (3 << 29, 3))


    def test_limit_of_the_control_group(self):
        """Half of it is the default, and the report says so."""
        for root, name in (("/sys/fs/cgroup/memory", "memory.limit_in_bytes"),
                           ("/sys/fs/cgroup", "memory.max")):
            group = os.path.join(root, "spbm-test-%d" % os.getpid())
            try:
                os.mkdir(group)
                self.addCleanup(os.rmdir, group)
                with open(os.path.join(group, name), "w", encoding="ascii") as file:
                    file.write(str(400 << 20))
                break
            except OSError:
                continue
        else:
            self.skipTest("no control group can be made here")

        def enter():
            with open(os.path.join(group, "cgroup.procs"), "w", encoding="ascii") as file:
                file.write("0")
        subprocess.run([PROGRAM, "info", self.sphere(n=4), "--json", "r.json"], check=True,
                       preexec_fn=enter, cwd=self.folder, env=self.environment,
                       stdout=subprocess.DEVNULL)
        limits = read_json(self.path("r.json"))["limits"]
        self.assertEqual(limits["memory"], 200 << 20)
        self.assertEqual(limits["memory_from"], "half of the control group's memory")
        for _ in range(50):  # the group is left a moment after the process has ended
            with open(os.path.join(group, "cgroup.procs"), encoding="ascii") as file:
                if not file.read():
                    break
            time.sleep(0.05)


class Signals(ProgramTest):
    def start(self, number, *words, **how):
        """Starts it on an input that does not end, sends the signal, returns (code, seconds)."""
        reader, writer = os.pipe()
        process = subprocess.Popen([PROGRAM, "simplify", "-", *words], stdin=reader,
                                   stderr=subprocess.PIPE, env=self.environment, cwd=self.folder)
        os.close(reader)
        os.write(writer, self.beginning)
        time.sleep(0.7)
        began = time.monotonic()
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
        os.close(writer)
        return process.returncode, time.monotonic() - began, err.decode()

    def test_signals_leave_nothing_behind(self):
        self.beginning = read_bytes(self.sphere(n=8))[:-100]
        os.unlink(self.path("in.ply"))
        for number in (signal.SIGTERM, signal.SIGINT):
            code, seconds, err = self.start(number, "-o", "a.ply", "--faces", "90")
            self.assertEqual(code, 128 + number, err)
            self.assertLess(seconds, 5)
            self.assertEqual(os.listdir(self.folder), [])
        code, _, _ = self.start(signal.SIGKILL, "-o", "a.ply", "--faces", "90")
        self.assertEqual(code, -signal.SIGKILL)
        self.assertEqual(os.listdir(self.folder), [])

    def test_a_signal_in_the_middle(self):
        mesh = self.sphere(n=150)
        for delay in (0.05, 0.15, 0.3, 0.5):
            process = subprocess.Popen([PROGRAM, "simplify", mesh, "-o", "a.ply", "--faces", "2k"],
                                       stderr=subprocess.DEVNULL, env=self.environment,
                                       cwd=self.folder)
            time.sleep(delay)
            process.send_signal(signal.SIGTERM)
            code = process.wait(timeout=60)
            # It may have been done before, or have had no handler yet.
            self.assertIn(code, (0, 128 + signal.SIGTERM, -signal.SIGTERM))
            names = sorted(os.listdir(self.folder))
            self.assertEqual(names, ["a.ply", "in.ply"] if code == 0 else ["in.ply"])
            if code == 0:
                os.unlink(self.path("a.ply"))

    def test_a_signal_while_nothing_comes_of_what_is_read(self):
        """56 GB of a sparse file: faces without corners, all of them left out."""
        count = 2**32 - 2
        head = (b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n"
                b"property float y\nproperty float z\nelement face %d\n"
                b"property list uchar int vertex_indices\nend_header\n" % count)
        with open(self.path("sparse.ply"), "wb") as file:
            file.write(head)
            file.truncate(len(head) + 36 + 13 * count)
        process = subprocess.Popen([PROGRAM, "simplify", "sparse.ply", "-o", "a.ply", "--faces", "9"],
                                   stderr=subprocess.DEVNULL, env=self.environment,
                                   cwd=self.folder)
        time.sleep(0.7)
        began = time.monotonic()
        process.send_signal(signal.SIGTERM)
        self.assertEqual(process.wait(timeout=60), 128 + signal.SIGTERM)
        self.assertLess(time.monotonic() - began, 5)
        self.assertEqual(os.listdir(self.folder), ["sparse.ply"])

    def test_a_closed_pipe_is_words(self):
        mesh = self.sphere(n=60)
        reader, writer = os.pipe()
        os.close(reader)
        done = subprocess.run([PROGRAM, "simplify", mesh, "-o", "-", "--format", "ply-ascii",
                               "--faces", "20k"], stdout=writer, stderr=subprocess.PIPE,
                              env=self.environment, timeout=120, check=False)
        os.close(writer)
        self.assertEqual(done.returncode, 1, done.stderr)


if __name__ == "__main__":
    unittest.main()
