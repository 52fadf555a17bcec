"""Runs that are interrupted and taken up again, from outside: what is kept, for whom, and how it goes."""
import os
import signal
import subprocess
import sys
import time
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from program import PROGRAM, ProgramTest, read_bytes, read_json  # noqa: E402


class Resume(ProgramTest):
    def setUp(self):
        super().setUp()
        self.mesh = self.sphere(n=40)
        self.place = self.path("work")
        os.mkdir(self.place)
        self.words = ["simplify", self.mesh, "-o", "a.ply", "--faces", "900"]
        self.run_program(*self.words)
        self.good = read_bytes(self.path("a.ply"))
        os.unlink(self.path("a.ply"))

    def resumable(self, *more, **how):
        return self.run_program(*self.words, "--tmp", self.place, "--resume", "--json", "r.json", *more,
                                **how)

    def folders(self):
        return sorted(os.listdir(self.place))

    def resumed(self):
        return [stage["resumed"] for stage in read_json(self.path("r.json"))["stages"]]

    def check_done(self):
        self.assertEqual(read_bytes(self.path("a.ply")), self.good)
        self.assertEqual(self.folders(), [])
        os.unlink(self.path("a.ply"))

    def kill_when(self, name):
        """Kills a run as soon as the named file is in its new folder, which is returned; None if the
        run was done before."""
        before = self.folders()
        process = subprocess.Popen([PROGRAM, *self.words, "--tmp", self.place, "--resume", "-q"],
                                   cwd=self.folder, env=self.environment)
        found = None
        while process.poll() is None and not found:
            for folder in self.folders():
                path = os.path.join(self.place, folder)
                if folder not in before and os.path.exists(os.path.join(path, name)):
                    found = path
        process.kill()
        process.wait()
        return found if found and os.path.exists(os.path.join(found, name)) else None

    def leave(self, name):
        """The folder of a run that was killed when it had just made the named file."""
        for _ in range(20):
            found = self.kill_when(name)
            if os.path.exists(self.path("a.ply")):
                os.unlink(self.path("a.ply"))
            if found:
                return found
        return self.skipTest("this machine is too quick to be stopped")

    def test_an_undisturbed_run_leaves_nothing(self):
        self.resumable()
        self.assertEqual(self.resumed(), [False, False, False])
        self.check_done()

    def test_finished_stages_are_not_done_again(self):
        self.leave("mesh.store")
        self.resumable("-t", "1", "-m", "1G")
        self.assertTrue(self.resumed()[0])
        self.check_done()
        self.leave("mesh.chains")
        _, err = self.resumable()
        self.assertEqual(self.resumed(), [True, True, False])
        self.assertIn("import: was finished by an earlier run", err)
        self.check_done()

    def test_damage_is_not_trusted(self):
        for name, where in (("job.state", 100), ("job.state", 8), ("mesh.store", 20000),
                            ("mesh.store", 9), ("mesh.chains", 3000), ("mesh.chains", -1)):
            folder = self.leave("mesh.chains")
            path = os.path.join(folder, name)
            data = bytearray(read_bytes(path))
            data[where] ^= 255
            with open(path, "wb") as file:
                file.write(data)
            self.resumable()
            self.check_done()
            folder = self.leave("mesh.store")
            path = os.path.join(folder, "job.state")
            os.truncate(path, os.path.getsize(path) // 2)
            self.resumable()
            self.assertEqual(self.resumed(), [False, False, False])
            self.check_done()

    def test_other_jobs_are_left_alone_and_dead_ones_removed(self):
        first = self.leave("mesh.store")
        self.words[5] = "700"
        second = self.leave("mesh.store")
        self.assertNotEqual(first, second)
        self.assertEqual(len(self.folders()), 2)
        self.words[5] = "900"
        self.resumable()
        self.assertEqual(self.resumed()[0], True)
        self.assertEqual(self.folders(), [os.path.basename(second)])
        os.unlink(self.path("a.ply"))
        # When its input has changed, nobody can go on from it.
        os.utime(self.mesh, ns=(0, 12345))
        self.resumable()
        self.assertEqual(self.resumed()[0], False)
        self.check_done()

    def test_an_input_that_changed_is_read_again(self):
        self.leave("mesh.chains")
        os.utime(self.mesh, ns=(0, 777))
        self.resumable()
        self.assertEqual(self.resumed(), [False, False, False])
        self.check_done()

    def test_a_lock_not_a_number(self):
        folder = self.leave("mesh.store")
        holder = subprocess.Popen([sys.executable, "-c",
                                   "import fcntl,os,sys,time\n"
                                   "fd=os.open(sys.argv[1], os.O_RDONLY)\n"
                                   "fcntl.flock(fd, fcntl.LOCK_EX)\nprint('x', flush=True)\n"
                                   "time.sleep(60)", folder], stdout=subprocess.PIPE)
        holder.stdout.read(1)
        _, err = self.resumable(code=1)
        self.assertIn("another process runs the same job", err)
        self.assertTrue(os.path.exists(os.path.join(folder, "mesh.store")))
        holder.kill()
        holder.wait()
        holder.stdout.close()
        self.resumable()
        self.assertTrue(self.resumed()[0])
        self.check_done()

    def test_a_folder_of_another_kind_is_refused(self):
        folder = self.leave("mesh.store")
        os.chmod(folder, 0o755)
        _, err = self.resumable(code=1)
        self.assertIn("own folder", err)
        os.chmod(folder, 0o700)
        os.rename(folder, self.path("elsewhere"))
        os.symlink(self.path("elsewhere"), folder)
        self.resumable(code=1)
        os.unlink(folder)

    def test_failures_that_pass_keep_what_is_finished(self):
        self.run_program(*self.words[:3], "no/a.ply", *self.words[4:], "--tmp", self.place, "--resume",
                         code=1)
        self.assertEqual(self.folders(), [])
        process = subprocess.Popen([PROGRAM, *self.words, "--tmp", self.place, "--resume"],
                                   stderr=subprocess.PIPE, cwd=self.folder, env=self.environment)
        while process.poll() is None and not any(
                os.path.exists(os.path.join(self.place, folder, "mesh.store"))
                for folder in self.folders()):
            pass
        process.send_signal(signal.SIGTERM)
        began = time.monotonic()
        err = process.communicate()[1].decode()
        self.assertLess(time.monotonic() - began, 5)
        if process.returncode == 0:
            self.check_done()
            return
        self.assertEqual(process.returncode, 128 + signal.SIGTERM)
        self.assertIn("finished stages are kept", err)
        self.assertEqual(os.listdir(os.path.join(self.place, self.folders()[0])).count("mesh.store"), 1)
        self.resumable()
        self.assertTrue(self.resumed()[0])
        self.check_done()

    def test_bad_input_leaves_nothing(self):
        with open(self.mesh, "r+b") as file:
            file.truncate(os.path.getsize(self.mesh) - 100)
        self.resumable(code=1)
        self.assertEqual(self.folders(), [])

    def test_misuse(self):
        self.run_program(*self.words, "--resume", code=2)
        self.run_program(*self.words, "--resume", "--tmp", self.place, "--keep", "k", code=2)
        _, err = self.run_program("simplify", "-", *self.words[2:], "--tmp", self.place, "--resume",
                                  code=2, stdin=read_bytes(self.mesh))
        self.assertIn("standard input", err)
        self.assertEqual(self.folders(), [])


if __name__ == "__main__":
    unittest.main()
