"""What all tests in Python share: a surface made in code, and runs with limits."""
import os
import resource
import subprocess
import tempfile
import threading


def bumpy_sphere(n, bump=0.1):
    """A closed surface of 8 n^2 faces: an octahedron, each face cut n x n, on a bumpy sphere."""
    numbers, vertices, faces = {}, [], []

    def vertex(x, y, z):
        if (x, y, z) not in numbers:
            numbers[x, y, z] = len(vertices)
            length = (x * x + y * y + z * z) ** 0.5
            radius = (1 + bump * (3 * x * y - 2 * y * z + x * x) / (n * n)) / length
            vertices.append((x * radius, y * radius, z * radius))
        return numbers[x, y, z]

    for sx in (1, -1):
        for sy in (1, -1):
            for sz in (1, -1):
                def at(i, j):
                    return vertex(sx * i, sy * j, sz * (n - i - j))
                for i in range(n):
                    for j in range(n - i):
                        found = [(at(i, j), at(i + 1, j), at(i, j + 1))]
                        if i + j < n - 1:
                            found.append((at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)))
                        faces += [face if sx * sy * sz > 0 else face[::-1] for face in found]
    return vertices, faces


class Ended:
    """How a run ended: exit code (negative: the signal), what it said, seconds of processors, and
    whether it had to be stopped by the clock."""

    def __init__(self, code, err, seconds, is_late):
        self.code, self.err, self.seconds, self.is_late = code, err, seconds, is_late


def run_limited(words, folder, environment, patience, megabytes=0, prepare=None):
    """Runs a command in the folder, with so much memory of its own (0: any) and so many seconds on the
    clock; `prepare` is called in the child."""
    def limit():
        if megabytes:
            resource.setrlimit(resource.RLIMIT_DATA, (megabytes << 20, megabytes << 20))
        if prepare:
            prepare()
    with tempfile.TemporaryFile() as err:
        process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=err,
                                   cwd=folder, env=environment, preexec_fn=limit)
        late = threading.Event()
        timer = threading.Timer(patience, lambda: (late.set(), process.kill()))
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        err.seek(0)
        text = err.read().decode(errors="replace")
    return Ended(process.returncode, text, usage.ru_utime + usage.ru_stime, late.is_set())
