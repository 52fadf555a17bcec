"""Running a command under a memory limit and watching what it takes: control groups of version 1 or 2
where they can be made, else sampling alone."""
import json
import os
import subprocess
import threading
import time


class Group:
    """A memory control group for one run; without one (`kind` None) nothing is limited."""

    def __init__(self, limit):
        self.path = self.kind = None
        name = "spbm-bench-%d" % os.getpid()
        places = (("v1", "/sys/fs/cgroup/memory", "memory.limit_in_bytes"),
                  ("v2", "/sys/fs/cgroup", "memory.max"))
        for kind, root, file in places:
            path = os.path.join(root, name)
            try:
                os.makedirs(path, exist_ok=True)
                with open(os.path.join(path, file), "w", encoding="ascii") as out:
                    out.write(str(limit))
            except OSError:
                if os.path.isdir(path):
                    os.rmdir(path)
                continue
            self.kind, self.path = kind, path
            return

    def enter(self):
        """In the child, before it becomes the command."""
        if self.path:
            with open(os.path.join(self.path, "cgroup.procs"), "w", encoding="ascii") as out:
                out.write("0")

    def peak(self):
        """Most bytes charged, page cache counted; None if that is not told."""
        name = {"v1": "memory.max_usage_in_bytes", "v2": "memory.peak"}.get(self.kind)
        try:
            with open(os.path.join(self.path, name), encoding="ascii") as file:
                return int(file.read())
        except (OSError, TypeError):
            return None

    def close(self):
        for _ in range(50):
            try:
                if self.path:
                    os.rmdir(self.path)
                return
            except OSError:
                time.sleep(0.1)


def temporary_bytes(pid):
    """Disk space of the files without a name that a process has open."""
    total, seen = 0, set()
    try:
        for fd in os.listdir("/proc/%d/fd" % pid):
            path = "/proc/%d/fd/%s" % (pid, fd)
            try:
                info = os.stat(path)
                if info.st_nlink == 0 and (info.st_dev, info.st_ino) not in seen and \
                        os.readlink(path).startswith("/"):
                    seen.add((info.st_dev, info.st_ino))
                    total += info.st_blocks * 512
            except OSError:
                pass
    except OSError:
        pass
    return total


def forget_cache(path):
    """Takes a file out of the page cache, so that reading it is charged to who reads."""
    fd = os.open(path, os.O_RDONLY)
    os.fsync(fd)
    os.posix_fadvise(fd, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(fd)


def read_io(pid):
    with open("/proc/%d/io" % pid, encoding="ascii") as file:
        return {key: int(value) for key, value in (line.split(": ") for line in file)}


def run(words, limit=None, timeout=7200):
    """Runs a command whose JSON report goes to standard output. Returns what it took: code, seconds
    (wall), report, rchar/wchar (bytes of read and write calls), read_bytes/write_bytes (of the disk),
    temporary (most bytes of temporary files), group (kind), group_peak."""
    group = Group(limit) if limit else None
    began = time.monotonic()
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               preexec_fn=group.enter if group else None)
    texts = {}
    readers = [threading.Thread(target=lambda n=name, f=file: texts.update({n: f.read()}))
               for name, file in (("out", process.stdout), ("err", process.stderr))]
    for reader in readers:
        reader.start()
    result = {"words": words, "limit": limit, "temporary": 0}
    while True:
        result["temporary"] = max(result["temporary"], temporary_bytes(process.pid))
        # The dead process stays to be asked what it read and wrote.
        if os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            break
        if time.monotonic() - began > timeout:
            process.kill()
        time.sleep(0.05)
    result["seconds"] = time.monotonic() - began
    result.update(read_io(process.pid))
    for reader in readers:
        reader.join()
    result["code"] = process.wait()
    result["error"] = texts["err"].decode(errors="replace").strip()
    result["report"] = json.loads(texts["out"]) if texts["out"].startswith(b"{") else None
    if group:
        result["group"], result["group_peak"] = group.kind, group.peak()
        group.close()
    return result
