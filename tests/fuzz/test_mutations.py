"""A few damaged files through the whole program (mutate.py; scripts/fuzz.sh makes many)."""
import os
import subprocess
import sys
import unittest

PROGRAM = os.environ["SPBM_PROGRAM"]


class Mutations(unittest.TestCase):
    def test_damaged_files_end_in_a_valid_mesh_or_in_words(self):
        with open(PROGRAM, "rb") as file:
            has_sanitizer = b"__asan_init" in file.read()
        limits = ["--seconds", "60", "--megabytes", "0"] if has_sanitizer else []
        script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "mutate.py")
        done = subprocess.run([sys.executable, script, PROGRAM, "--count",
                               os.environ.get("SPBM_MUTATIONS", "120")] + limits,
                              capture_output=True, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertIn("0 findings", done.stdout)


if __name__ == "__main__":
    unittest.main()
