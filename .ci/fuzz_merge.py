# SPDX-License-Identifier: Apache-2.0
"""Adds to a fuzz target's kept inputs those that libFuzzer found to reach more code, as far as there is room for them.

Usage: fuzz_merge.py PROGRAM KEPT FOUND    (the target's program; folders of inputs)

Kept inputs stay whatever they reach. The others are taken by how much each reaches that none before it does, for its
size. They are replayed in every build, so that a folder has MOST_BYTES of them, in MOST files.
"""
import hashlib
import pathlib
import subprocess
import sys
import tempfile

MOST_BYTES = 16 << 10
MOST = 100
FILE_BYTES = 200  # what a file costs beside its bytes, so that a few inputs come before many that are shorter still


def features_of(program, kept, found):
    """Input -> what it reaches, as libFuzzer numbers it, without how often."""
    with tempfile.TemporaryDirectory() as folder:
        control = pathlib.Path(folder, "control")
        pathlib.Path(folder, "out").mkdir()
        subprocess.run([program, "-set_cover_merge=1", "-use_counters=0", f"-merge_control_file={control}",
                        "-close_fd_mask=3", pathlib.Path(folder, "out"), kept, found], check=True, capture_output=True)
        lines = control.read_text(encoding="utf-8").splitlines()
    paths = lines[2:2 + int(lines[0])]
    reached = {}
    for line in lines[2 + len(paths):]:
        kind, index, *numbers = line.split()
        if kind == "FT":
            reached[pathlib.Path(paths[int(index)])] = set(map(int, numbers))
    return reached


def choose(reached, covered, count, room):
    """At most so many inputs of so many bytes in all, in the order in which they are worth it."""
    chosen = []
    while len(chosen) < count:
        gains = {path: len(features - covered) / (path.stat().st_size + FILE_BYTES)
                 for path, features in reached.items() if path.stat().st_size <= room and features - covered}
        if not gains:
            break
        best = max(gains, key=gains.get)
        covered |= reached[best]
        room -= best.stat().st_size
        chosen.append(best)
    return chosen


def main():
    program, kept, found = (pathlib.Path(name).resolve() for name in sys.argv[1:4])
    reached = features_of(program, kept, found)
    covered = set().union(*(features for path, features in reached.items() if path.parent == kept))
    sizes = [path.stat().st_size for path in kept.iterdir()]
    chosen = choose({path: features for path, features in reached.items() if path.parent != kept}, covered,
                    MOST - len(sizes), MOST_BYTES - sum(sizes))
    for path in chosen:
        data = path.read_bytes()
        (kept / hashlib.sha1(data).hexdigest()).write_bytes(data)
    print(f"{len(chosen)} inputs of {len(reached)} added")


if __name__ == "__main__":
    main()
