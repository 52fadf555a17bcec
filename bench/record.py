"""What every record in bench/results has: where it was made, of which commit, by which command; and
the measuring of whole processes."""
import os
import platform
import subprocess
import sys
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DATA = os.environ.get("SPBM_DATA", os.path.join(ROOT, "..", "shared", "data"))


class Run:
    """What one process took, as the system counts it: wall and CPU seconds, peak memory in bytes;
    its output if it is kept. Raises RuntimeError if it ends otherwise than allowed."""

    def __init__(self, command, allowed=(0,), keep_output=False):
        sink = os.memfd_create("output") if keep_output else os.open(os.devnull, os.O_WRONLY)
        actions = [(os.POSIX_SPAWN_DUP2, sink, 1)]
        if not keep_output:
            actions.append((os.POSIX_SPAWN_DUP2, sink, 2))
        began = time.monotonic()
        child = os.posix_spawnp(command[0], command, os.environ, file_actions=actions)
        _, status, usage = os.wait4(child, 0)
        self.wall = time.monotonic() - began
        self.cpu, self.peak = usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
        self.output = ""
        if keep_output:
            os.lseek(sink, 0, os.SEEK_SET)
            with os.fdopen(sink, "rb") as file:
                self.output = file.read().decode(errors="replace")
        else:
            os.close(sink)
        if os.waitstatus_to_exitcode(status) not in allowed:
            raise RuntimeError(f"{' '.join(command)} failed")


def made(command=None):
    """Date, commit, machine and load, and the command (default: this program's own command line)."""
    commit = subprocess.run(["git", "-C", ROOT, "describe", "--always", "--dirty", "--abbrev=7"],
                            capture_output=True, text=True, check=False).stdout.strip()
    own = " ".join([f"bench/{os.path.basename(sys.argv[0])}", *sys.argv[1:]])
    return (f"{time.strftime('%Y-%m-%d')}, commit {commit}, {platform.machine()}, {os.cpu_count()} cores, "
            f"load {os.getloadavg()[0]:.1f} at the end. Command: `{command or own}`.")


def write(text, path):
    """Into the file, or to standard output if there is none."""
    if path:
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)
    else:
        sys.stdout.write(text)
