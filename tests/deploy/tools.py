# SPDX-License-Identifier: Apache-2.0
"""Programs of Debian that these tests run, and the files of deploy/ that they look at."""
import os
import pathlib
import shutil

SOURCE = pathlib.Path(__file__).resolve().parents[2]
DEPLOY = SOURCE / "deploy"
UNPACKED = SOURCE / "build" / "tools"


def tool(name):
    """The program's path: what `make tools` has unpacked, or else what is installed."""
    unpacked = UNPACKED / name
    installed = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin"])
    found = str(unpacked) if unpacked.exists() else shutil.which(name, path=installed)
    if found is None:
        raise FileNotFoundError(f"{name} is missing: run 'make tools'")
    return found


def tool_environment():
    """The environment in which unpacked programs find the libraries that were unpacked with them."""
    return {**os.environ, "LD_LIBRARY_PATH": str(UNPACKED / "lib")}
