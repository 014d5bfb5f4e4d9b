# SPDX-License-Identifier: Apache-2.0
"""The files of this source tree, for tests of the tree itself."""
import pathlib
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[1]
NOT_SOURCES = {"build", "out"}  # as in .gitignore


def source_files(root=ROOT):
    """Paths relative to 'root', sorted: what git knows or would add; without git, all but hidden and built files."""
    listing = subprocess.run(["git", "-C", root, "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
                             capture_output=True, text=True, check=False)
    if listing.returncode == 0:
        names = listing.stdout.split("\0")
    else:
        names = [path.relative_to(root).as_posix() for path in root.rglob("*")]
        names = [name for name in names if name.split("/")[0] not in NOT_SOURCES and not name.startswith(".git/")]
    return sorted({name for name in names if name and (root / name).is_file()})
