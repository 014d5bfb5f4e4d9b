#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What one server bears: frames a second for numbers of sessions and points, and how many sessions keep a pace.

Usage: load_table.py BIN [--sizes=512x384,256x192] [--sessions=1,4,8] [--points=16,64,256] [--paces=15,30]
                     [--seconds=15] [-- SERVER_FLAGS]

BIN holds holdfast-server and holdfast. Prints two tables for each processing size: frames a second of all sessions
together at full pace, and the most sessions that kept a pace: 98 % of their frames were taken in time, and all of them
tracked two seconds later; `--paces=` leaves the second one out. A window of a session takes 24 frames: give it the
seconds for several times that. Run it on a machine that is otherwise quiet.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

from arguments import split

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "e2e"))
from server_process import VIDEO, ServerProcess  # noqa: E402

KEPT = 0.98  # of the frames of a pace
TAIL = 2  # seconds, for the last ones


def numbers(text):
    return [int(number) for number in text.split(",") if number]


class Load:
    """Runs of `holdfast load` against one server."""

    def __init__(self, programs, server, size, seconds):
        self.command = [programs / "holdfast", "load", VIDEO, f"--server={server.address}",
                        f"--processing_size={size}", f"--seconds={seconds}"]
        self.seconds = seconds

    def report(self, sessions, points, fps):
        """What `holdfast load` reports of sessions that send at 'fps' each, a number or "max"."""
        with tempfile.TemporaryDirectory(prefix="holdfast-load-") as out:
            report = pathlib.Path(out) / "load.json"
            subprocess.run([*self.command, f"--sessions={sessions}", f"--points={points}", f"--fps={fps}",
                            f"--out={report}"], check=True, stdout=subprocess.DEVNULL)
            return json.loads(report.read_text())

    def run(self, sessions, points, fps):
        """Frames of all sessions together, and seconds until the last one."""
        result = self.report(sessions, points, fps)
        return sum(total["frames"] for total in result["totals"]), result["seconds"]

    def rate(self, sessions, points):
        """Frames a second of all sessions together, at full pace."""
        frames, seconds = self.run(sessions, points, "max")
        return frames / seconds

    def keeping(self, pace, points, total):
        """The most sessions that keep 'pace', tried downwards from what 'total' frames a second could give."""
        for sessions in range(int(total / pace) + 1, 0, -1):
            frames, seconds = self.run(sessions, points, pace)
            if frames >= KEPT * sessions * pace * self.seconds and seconds <= self.seconds + TAIL:
                return sessions
        return 0


def table(heading, columns, rows):
    print(f"\n| {heading} | " + " | ".join(map(str, columns)) + " |")
    print("|---" * (len(columns) + 1) + "|")
    for name, cells in rows:
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def main():
    arguments, flags = split(sys.argv[1:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=pathlib.Path, metavar="BIN")
    parser.add_argument("--sizes", default="512x384,256x192")
    parser.add_argument("--sessions", type=numbers, default=[1, 4, 8])
    parser.add_argument("--points", type=numbers, default=[16, 64, 256])
    parser.add_argument("--paces", type=numbers, default=[15, 30])
    parser.add_argument("--seconds", type=int, default=15)
    options = parser.parse_args(arguments)
    server = ServerProcess(options.programs / "holdfast-server", *flags)
    for size in options.sizes.split(","):
        load = Load(options.programs, server, size, options.seconds)
        totals = {points: {sessions: load.rate(sessions, points) for sessions in options.sessions}
                  for points in options.points}
        table(f"{size}, points", [f"{sessions} sessions" for sessions in options.sessions],
              [(points, [f"{total:.1f}" for total in row.values()]) for points, row in totals.items()])
        if not options.paces:
            continue
        table(f"{size}, points", [f"sessions at {pace} frames/s" for pace in options.paces],
              [(points, [str(load.keeping(pace, points, max(row.values()))) for pace in options.paces])
               for points, row in totals.items()])
    server.stop()


if __name__ == "__main__":
    main()
