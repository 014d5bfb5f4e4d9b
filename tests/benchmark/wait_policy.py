#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Frames a second of holdfast-server for several ways its OpenMP threads may wait, quiet and beside busy processes.

Usage: wait_policy.py BIN [--rounds=3] [--grids=60,256] [--spins=0,300,1000,3000,10000,30000,default] [--frames=120]
                      [--busy=0,1] [--precision=float32]

BIN holds holdfast-server and holdfast. Every round measures each spin count once, in turn, so that what else the
machine does meets all of them alike; medians and the best of the rounds are printed. "program" is what the program
chooses by itself. Run it on a machine that is otherwise quiet.
"""
import argparse
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

VIDEO = pathlib.Path(__file__).resolve().parents[2] / "media" / "pedestrians.mp4"
LIBGOMP_DEFAULT = "300000"


def environment(spins):
    values = {name: value for name, value in os.environ.items()
              if name not in ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT") and not name.startswith("HOLDFAST_")}
    if spins != "program":
        values["GOMP_SPINCOUNT"] = LIBGOMP_DEFAULT if spins == "default" else spins
    return values


class Server:
    def __init__(self, programs, spins, precision):
        self.directory = tempfile.TemporaryDirectory(prefix="holdfast-bench-")
        ports = pathlib.Path(self.directory.name) / "ports"
        self.process = subprocess.Popen(
            [programs / "holdfast-server", "--listen=127.0.0.1:0", "--metrics_listen=127.0.0.1:0",
             f"--port_file={ports}", f"--precision={precision}", "--log_level=warning"], env=environment(spins))
        while not ports.exists():
            try:
                sys.exit(f"the server ended with {self.process.wait(0.05)}")
            except subprocess.TimeoutExpired:
                pass
        self.address = "127.0.0.1:" + dict(line.split("=") for line in ports.read_text().split())["grpc"]

    def stop(self):
        self.process.terminate()
        self.process.wait()
        self.directory.cleanup()


def measure(programs, server, grid, frames, neighbours):
    """Frames a second of one clip beside so many busy processes, as the client says at its end."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(neighbours)]
    try:
        with tempfile.TemporaryDirectory(prefix="holdfast-bench-") as out:
            done = subprocess.run(
                [programs / "holdfast", "track", VIDEO, f"--server={server.address}", f"--grid={grid}",
                 f"--max_frames={frames}", f"--out={out}/tracks.json"],
                stderr=subprocess.PIPE, text=True, check=True, env=environment("program"))
    finally:
        for process in busy:
            process.kill()
            process.wait()
    return float(re.findall(r"([\d.]+) frames/s", done.stderr)[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=pathlib.Path, metavar="BIN")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--grids", default="60,256")
    parser.add_argument("--spins", default="0,300,1000,3000,10000,30000,default")
    parser.add_argument("--frames", type=int, default=120)
    parser.add_argument("--busy", default="0,1")
    parser.add_argument("--precision", default="float32")
    options = parser.parse_args()
    cases = [(int(grid), int(busy)) for grid in options.grids.split(",") for busy in options.busy.split(",")]
    spins = options.spins.split(",")
    rates = {(spin, case): [] for spin in spins for case in cases}
    for _ in range(options.rounds):
        for spin in spins:
            server = Server(options.programs.resolve(), spin, options.precision)
            for case in cases:
                rates[spin, case].append(measure(options.programs.resolve(), server, case[0], options.frames, case[1]))
            server.stop()
    print("spin count  " + "  ".join(f"{grid:4} points {busy} busy  median best" for grid, busy in cases))
    for spin in spins:
        row = [f"{statistics.median(rates[spin, case]):23.1f} {max(rates[spin, case]):7.1f}" for case in cases]
        print(f"{spin:>10}  " + "  ".join(row), flush=True)


if __name__ == "__main__":
    main()
