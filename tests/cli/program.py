"""What the tests of the program share: running it, small meshes made in code, a folder of their own."""
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from kit import bumpy_sphere  # noqa: E402

PROGRAM = os.environ["SPBM_PROGRAM"]


def write_ply(path, mesh, binary=True):
    vertices, faces = mesh
    head = ("ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
            "property float z\nelement face %d\nproperty list uchar int vertex_indices\nend_header\n"
            % ("binary_little_endian" if binary else "ascii", len(vertices), len(faces)))
    with open(path, "wb") as file:
        file.write(head.encode())
        if binary:
            file.write(b"".join(struct.pack("<3f", *v) for v in vertices))
            file.write(b"".join(struct.pack("<B3i", 3, *f) for f in faces))
        else:
            for v in vertices:
                single = struct.unpack("<3f", struct.pack("<3f", *v))
                file.write(("%.9g %.9g %.9g\n" % single).encode())
            for f in faces:
                file.write(("3 %d %d %d\n" % f).encode())


def read_bytes(path):
    with open(path, "rb") as file:
        return file.read()


def read_json(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


class ProgramTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="spbm-test-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.environment = {k: v for k, v in os.environ.items()
                            if not k.startswith(("SLURM_", "OMP_")) and k != "TMPDIR"}

    def path(self, name):
        return os.path.join(self.folder, name)

    def run_program(self, *words, code=0, stdin=b"", environment=None):
        """Runs it and checks the exit code; returns (stdout, stderr)."""
        done = subprocess.run([PROGRAM, *map(str, words)], input=stdin, capture_output=True,
                              timeout=300, env={**self.environment, **(environment or {})},
                              cwd=self.folder, check=False)
        out, err = done.stdout, done.stderr.decode(errors="replace")
        self.assertEqual(done.returncode, code, "spbm %s\n%s" % (" ".join(map(str, words)), err))
        self.assertNotIn("Sanitizer", err)
        return out, err

    def sphere(self, name="in.ply", n=24, **how):
        path = self.path(name)
        write_ply(path, bumpy_sphere(n), **how)
        return path
