# SPDX-License-Identifier: Apache-2.0
"""What the Python client's tests share. Importing it puts the package together and makes it importable.

Usage of each test: x_test.py HOLDFAST_SERVER PROTOC
"""
import atexit
import contextlib
import io
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import unittest

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "e2e"), str(ROOT / "tests" / "docs")]
from server_process import ServerProcess  # noqa: E402

SERVER, PROTOC = sys.argv[1:3]
del sys.argv[1:3]
_directory = tempfile.TemporaryDirectory(prefix="holdfast-python-")
atexit.register(_directory.cleanup)
STAGED = pathlib.Path(_directory.name)
subprocess.run([sys.executable, ROOT / "python" / "stage.py", STAGED, f"--protoc={PROTOC}", "--google"], check=True)
sys.path.insert(0, str(STAGED))

WIDTH, HEIGHT, FRAMES = 128, 96, 48
POINTS = np.array([[40.5, 50.25], [80, 30], [60, 40]], np.float32)


def picture(index):
    """uint8 [HEIGHT, WIDTH]: a texture that moves one pixel to the right each frame."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float64)
    x -= index
    wave = 128 + 60 * np.sin(x * 0.35) * np.cos(y * 0.3) + 40 * np.sin(x * 0.11 + y * 0.17)
    return wave.astype(np.uint8)


PICTURES = [picture(i) for i in range(FRAMES)]


@contextlib.contextmanager
def frozen(server):
    """The server stands still meanwhile."""
    os.kill(server.process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(server.process.pid, signal.SIGCONT)


def resident_bytes():
    """Of memory that this process has."""
    with open("/proc/self/statm", encoding="ascii") as pages:
        return int(pages.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def run_python(blocks, names, server, secure=""):
    """Runs Python blocks of a document as one program, which knows 'names' and leaves its own there. What it printed.
    'server' is the address of localhost:50051, 'secure' that of localhost:50443."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for block in blocks:
            text = block.text.replace("localhost:50051", server).replace("localhost:50443", secure)
            exec(compile(text, str(block), "exec"), names)
    return printed.getvalue()


class ServedTest:
    """With a server for all tests of a class, whose sessions other servers of start_server() can resume."""

    @classmethod
    def setUpClass(cls):
        directory = tempfile.TemporaryDirectory(prefix="holdfast-served-")
        cls.addClassCleanup(directory.cleanup)
        cls.directory = pathlib.Path(directory.name)
        keys = cls.directory / "keys"
        keys.write_text("k1:" + "a" * 64 + "\n", encoding="utf-8")
        cls.flags = [f"--processing_size={WIDTH}x{HEIGHT}", "--iterations=2", "--precision=float32",
                     "--compute_threads=1", f"--checkpoint_keys={keys}", "--grace_period=0s"]
        cls.server = cls.start_server()
        cls.addClassCleanup(cls.server.stop)

    @classmethod
    def start_server(cls, *flags):
        return ServerProcess(SERVER, *cls.flags, *flags)

    def assert_same(self, tracks, expected):
        np.testing.assert_array_equal(tracks.ids, expected.ids)
        np.testing.assert_allclose(tracks.xy, expected.xy, atol=1e-3)
        np.testing.assert_array_equal(tracks.visible, expected.visible)
        self.assertTrue(tracks.final.all())


def main():
    unittest.main(verbosity=2)
