"""What `meson install` leaves for others: program, man page, header, both libraries and a pkg-config
file, with which a program of somebody else compiles, links either library, and runs."""
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from program import PROGRAM, bumpy_sphere, write_ply  # noqa: E402

BUILD = os.path.dirname(os.path.dirname(PROGRAM))
SOURCE = os.environ["SPBM_SOURCE"]

# A name of the library's inside (src/base/report.h) as a function of the user's own: no clash.
USER = """
#include <spbm.h>
#include <stdio.h>

int fail(void);
int fail(void)
{
    return 7;
}

int main(int argc, char **argv)
{
    const char *input = argv[1];
    spbm_simplify_options options;
    spbm_simplify_report report;
    spbm_job *job;
    if (argc != 3 || fail() != 7 || spbm_job_open(NULL, &job) != SPBM_OK)
        return 1;
    spbm_simplify_defaults(&options);
    options.target.count = 1;
    options.target.values[0] = 200;
    spbm_status status = spbm_simplify(job, &input, 1, argv[2], &options, &report);
    if (status == SPBM_OK)
        printf("%llu faces, version %s\\n", (unsigned long long)report.levels.levels[0].faces,
               spbm_version());
    else
        fprintf(stderr, "%s\\n", spbm_job_error(job));
    spbm_job_close(&job);
    return (int)status;
}
"""


@unittest.skipUnless(shutil.which("meson") and shutil.which("pkg-config"), "no meson or pkg-config")
class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="spbm-test-")
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.root = os.path.join(cls.folder, "root")
        done = subprocess.run(["meson", "install", "-C", BUILD, "--no-rebuild", "--destdir",
                               cls.root], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        cls.files = {os.path.relpath(os.path.join(place, name), cls.root)
                     for place, _, names in os.walk(cls.root) for name in names}
        cls.pkgconfig = os.path.join(cls.root, os.path.dirname(cls.find(r"/pkgconfig/spbm\.pc$")))

    @classmethod
    def find(cls, pattern):
        found = [name for name in cls.files if re.search(pattern, name)]
        assert len(found) == 1, (pattern, found, sorted(cls.files))
        return found[0]

    def flags(self, *words):
        environment = {**os.environ, "PKG_CONFIG_SYSROOT_DIR": self.root,
                       "PKG_CONFIG_LIBDIR": self.pkgconfig, "PKG_CONFIG_PATH": ""}
        return subprocess.run(["pkg-config", *words, "spbm"], env=environment, check=True,
                              capture_output=True, text=True).stdout.split()

    def test_files(self):
        for pattern in (r"/bin/spbm$", r"/man1/spbm\.1$", r"/doc/spbm/json\.md$",
                        r"/include/spbm\.h$", r"/libspbm\.a$", r"/libspbm\.so$",
                        r"/libspbm\.so\.0$", r"/libspbm\.so\.[0-9]+\.[0-9]+\.[0-9]+$"):
            self.find(pattern)
        self.assertEqual(len(self.files), 9, sorted(self.files))
        out = subprocess.run([os.path.join(self.root, self.find(r"/bin/spbm$")), "--version"],
                             capture_output=True, text=True, check=True).stdout
        self.assertEqual(out.split()[1], self.flags("--modversion")[0])

    def use(self, name, libraries, **environment):
        """Compiles the user's program against the installed files only, and runs it."""
        source, program = (os.path.join(self.folder, name + end) for end in (".c", ".out"))
        with open(source, "w", encoding="utf-8") as file:
            file.write(USER)
        library = os.path.join(self.root, self.find(r"/libspbm\.so\.0$"))
        is_sanitized = b"__asan_init" in subprocess.run(["nm", "-D", library], check=True,
                                                        capture_output=True).stdout
        sanitize = ["-fsanitize=address,undefined"] if is_sanitized else []
        done = subprocess.run(["cc", "-std=c11", "-Wall", "-Wextra", "-Werror", *sanitize,
                               *self.flags("--cflags"), source, "-o", program, *libraries],
                              capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        scan, small = (os.path.join(self.folder, name) for name in ("in.ply", name + ".ply"))
        write_ply(scan, bumpy_sphere(10))
        done = subprocess.run([program, scan, small], capture_output=True, text=True, check=False,
                              timeout=120, env={**os.environ, **environment})
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"^(200|199) faces, version ")
        with open(small, "rb") as file:
            self.assertTrue(file.read().startswith(b"ply\n"))
        return program

    def needs_library(self, program):
        return "libspbm" in subprocess.run(["readelf", "-d", program], check=True, text=True,
                                           capture_output=True).stdout

    def test_shared(self):
        folder = os.path.dirname(os.path.join(self.root, self.find(r"/libspbm\.so\.0$")))
        program = self.use("shared", self.flags("--libs"), LD_LIBRARY_PATH=folder)
        self.assertTrue(self.needs_library(program))

    def test_static(self):
        archive = os.path.join(self.root, self.find(r"/libspbm\.a$"))
        flags = [archive if flag == "-lspbm" else flag for flag in self.flags("--static", "--libs")]
        self.assertIn(archive, flags)
        self.assertFalse(self.needs_library(self.use("static", flags)))

    def test_man_page_is_clean(self):
        if not shutil.which("man"):
            self.skipTest("no man")
        done = subprocess.run(["man", "--warnings", "-l", os.path.join(SOURCE, "doc", "spbm.1")],
                              capture_output=True, text=True, check=False,
                              env={**os.environ, "MANWIDTH": "80", "LC_ALL": "C.UTF-8"})
        self.assertEqual((done.returncode, done.stderr), (0, ""))


if __name__ == "__main__":
    unittest.main()
