"""spbm.h as its users meet it: the examples of its documentation compile as C and C++ and run, and
the shared library shows no other names than the header's."""
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from program import bumpy_sphere, write_ply  # noqa: E402

SOURCE = os.environ["SPBM_SOURCE"]
LIBRARY = os.environ["SPBM_LIBRARY_SO"]
HEADER = os.path.join(SOURCE, "src", "spbm.h")


def examples():
    with open(HEADER, encoding="utf-8") as file:
        text = file.read()
    # The comment that explains the marks holds them too, in backquotes.
    for block in re.findall(r"^ \* @code\n(.*?)^ \* @endcode$", text, re.M | re.S):
        yield "\n".join(re.sub(r"^ \* ?", "", line) for line in block.splitlines())


def is_sanitized():
    return b"__asan_init" in subprocess.run(["nm", "-D", LIBRARY], capture_output=True,
                                            check=True).stdout


class Header(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="spbm-test-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def compile(self, compiler, name, text, *flags):
        source, program = os.path.join(self.folder, name), os.path.join(self.folder, name + ".out")
        with open(source, "w", encoding="utf-8") as file:
            file.write(text)
        if is_sanitized():
            flags += ("-fsanitize=address,undefined",)
        done = subprocess.run([compiler, "-Wall", "-Wextra", "-Werror", *flags,
                               "-I", os.path.dirname(HEADER), source, "-o", program, LIBRARY,
                               "-Wl,-rpath," + os.path.dirname(LIBRARY)],
                              capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, text + done.stderr)
        return program

    def program(self, example):
        return ('#include "spbm.h"\n#include <stdio.h>\n\nint main(void)\n{\n%s\n%s}\n'
                % (example, "" if "return status;" in example else "    return 0;\n"))

    def test_examples_compile_and_run(self):
        found = list(examples())
        self.assertGreaterEqual(len(found), 2)
        for i, example in enumerate(found):
            program = self.compile("cc", "example%d.c" % i, self.program(example), "-std=c11")
            write_ply(os.path.join(self.folder, "scan.ply.gz"), bumpy_sphere(60))
            done = subprocess.run([program], cwd=self.folder, capture_output=True, text=True,
                                  timeout=120, check=False)
            # 3: all written, but the small sphere has no level as fine as the example asks for.
            self.assertIn(done.returncode, (0, 3), done.stdout + done.stderr)
            if "spbm_simplify" in example:
                self.assertIn("level 1: ", done.stdout)
                self.assertIn("small-1.ply", os.listdir(self.folder))

    @unittest.skipUnless(shutil.which("c++"), "no C++ compiler")
    def test_header_is_cplusplus(self):
        for i, example in enumerate(examples()):
            self.compile("c++", "example%d.cc" % i, self.program(example))

    def test_library_shows_the_header_s_names_only(self):
        with open(HEADER, encoding="utf-8") as file:
            declared = set(re.findall(r"^SPBM_API [^;(]*?(spbm_\w+)\(", file.read(), re.M))
        listing = subprocess.run(["nm", "-D", "--defined-only", LIBRARY], capture_output=True,
                                 text=True, check=True).stdout
        shown = {line.split()[-1].split("@")[0] for line in listing.splitlines()}
        shown = {name for name in shown
                 if not name.startswith(("_", "__")) and name not in ("SPBM",)}
        self.assertEqual(shown, declared)


if __name__ == "__main__":
    unittest.main()
