# SPDX-License-Identifier: Apache-2.0
"""holdfast-server end to end, through gRPC with JPEG: quiet, beside busy processes, on one core, and under a quota."""
import contextlib
import os
import pathlib
import subprocess
import sys

from load_table import Load, ServerProcess
from process_usage import memory_kb, processor_ms

CGROUPS = pathlib.Path("/sys/fs/cgroup")
ENTER = 'echo $$ > "$0" && exec "$@"'  # for sh: into the group whose cgroup.procs is $0
QUOTAS = (1, 1.5)  # processors
PERIOD = 100_000  # microseconds, of quotas


@contextlib.contextmanager
def busy(count):
    """So many processes that compute all the time, as important as any other."""
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def group_places(text):
    """[(folder of this process's group, version)] of the trees that may limit processors, from /proc/self/cgroup."""
    places = []
    for line in text.splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers == "" and (CGROUPS / "cgroup.controllers").exists():
            places.append((CGROUPS / path.lstrip("/"), 2))
        elif "cpu" in controllers.split(","):
            places.append((CGROUPS / controllers / path.lstrip("/"), 1))
    return places


@contextlib.contextmanager
def quota(processors):
    """The cgroup.procs of a new group that gets at most so many processors. OSError where there can be none."""
    folder, version = next(iter(group_places(pathlib.Path("/proc/self/cgroup").read_text())), (CGROUPS, 2))
    group = folder / f"holdfast-bench-{os.getpid()}-{processors}"
    group.mkdir()
    try:
        if version == 2:
            (group / "cpu.max").write_text(f"{int(processors * PERIOD)} {PERIOD}")
        else:
            (group / "cpu.cfs_period_us").write_text(str(PERIOD))
            (group / "cpu.cfs_quota_us").write_text(str(int(processors * PERIOD)))
        yield group / "cgroup.procs"
    finally:
        group.rmdir()


class Place:
    """A server, and how many busy processes are to be beside it."""

    def __init__(self, server, size, points, seconds, programs, neighbours=0):
        self.server = server
        self.load = Load(programs, server, size, seconds)
        self.points = points
        self.neighbours = neighbours

    def measure(self, sessions):
        """The measures of one run, by name."""
        pid = self.server.process.pid
        before = processor_ms(pid)
        with busy(self.neighbours):
            report = self.load.report(sessions, self.points, "max")
        total = report["totals"][0]
        return {"frames_per_second": total["frames"] / report["seconds"],
                "first_ms": total["first_estimate_ms"]["p50"], "first_ms_95": total["first_estimate_ms"]["p95"],
                "processor_ms": (processor_ms(pid) - before) / max(1, total["frames"])}


def places(programs, flags, stack, notes, **options):
    """{name: Place}; servers live as long as 'stack'. What cannot be here is said in 'notes'."""
    def start(*prefix):
        server = ServerProcess(programs / "holdfast-server", *flags, prefix=prefix)
        stack.callback(server.stop)
        return server

    plain = start()
    found = {"quiet": Place(plain, programs=programs, **options)}
    for count in (1, 2):
        found[f"{count} busy"] = Place(plain, programs=programs, neighbours=count, **options)
    core = min(os.sched_getaffinity(0))
    found["on one core"] = Place(start("taskset", "-c", str(core)), programs=programs, **options)
    for processors in QUOTAS:
        try:
            procs = stack.enter_context(quota(processors))
        except OSError as error:
            notes.append(f"Left out: under a quota of {processors} processors ({error.strerror}: {error.filename}).")
            continue
        found[f"quota {processors}"] = Place(start("sh", "-c", ENTER, procs), programs=programs, **options)
    return found


def serve(programs, flags, sessions_of, rounds, notes, **options):
    """Rows of every place with each number of 'sessions_of(place)', in turns, so that what else the machine does meets
    all alike."""
    rows = {}
    with contextlib.ExitStack() as stack:
        all_places = places(programs, flags, stack, notes, **options)
        for _ in range(rounds):
            for name, place in all_places.items():
                for sessions in sessions_of(name):
                    row = rows.setdefault(f"served/{options['size']}/{options['points']}/{name}/{sessions}",
                                          {"part": "served"})
                    for measure, value in place.measure(sessions).items():
                        row.setdefault(measure, []).append(value)
                    print(f"{name}, {sessions} sessions: {row['frames_per_second'][-1]:.1f} frames/s", file=sys.stderr)
                    row["peak_bytes"] = memory_kb(place.server.process.pid, "VmHWM") * 1024
    return rows
