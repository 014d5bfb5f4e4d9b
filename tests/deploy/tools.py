# SPDX-License-Identifier: Apache-2.0
"""Programs of Debian that these tests run, and the files of deploy/ that they look at."""
import pathlib
import shutil

SOURCE = pathlib.Path(__file__).resolve().parents[2]
DEPLOY = SOURCE / "deploy"


def tool(name):
    """The program's path: what `make tools` has unpacked, or else what is installed."""
    unpacked = SOURCE / "build" / "tools" / name
    found = str(unpacked) if unpacked.exists() else shutil.which(name)
    if found is None:
        raise FileNotFoundError(f"{name} is missing: run 'make tools'")
    return found
