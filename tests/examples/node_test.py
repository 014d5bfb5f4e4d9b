# SPDX-License-Identifier: Apache-2.0
"""The example for Node against a real server. It needs Node and the modules of examples/node (npm install there, which
no test does); without them it is skipped.

Usage: node_test.py HOLDFAST_SERVER
"""
import io
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "e2e"))
from PIL import Image  # noqa: E402
from protocol import picture  # noqa: E402
from server_process import ServerProcess  # noqa: E402

EXAMPLE = ROOT / "examples" / "node"
SKIPPED = 77  # as CMakeLists.txt says
WIDTH, HEIGHT, FRAMES = 128, 96, 32


class NodeTest(unittest.TestCase):
    server_program = None

    def setUp(self):
        directory = tempfile.TemporaryDirectory(prefix="holdfast-node-")
        self.addCleanup(directory.cleanup)
        self.files = [pathlib.Path(directory.name) / f"{number:03}.jpg" for number in range(FRAMES)]
        for number, file in enumerate(self.files):
            content = io.BytesIO()
            Image.frombytes("L", (WIDTH, HEIGHT), picture(number, WIDTH, HEIGHT)).save(content, "JPEG", quality=95)
            file.write_bytes(content.getvalue())
        server = ServerProcess(self.server_program, f"--processing_size={WIDTH}x{HEIGHT}", "--iterations=2",
                               "--precision=float32", "--compute_threads=1")
        self.addCleanup(server.stop)
        self.address = server.address

    def follow(self, *arguments):
        return subprocess.run(["node", EXAMPLE / "follow.js", *arguments], capture_output=True, text=True, timeout=120,
                              check=False)

    def test_a_point_is_followed(self):
        done = self.follow(self.address, "40.5", "50.25", *self.files)
        self.assertEqual(done.returncode, 0, done.stderr)
        lines = [line.split() for line in done.stdout.splitlines()]
        self.assertEqual([int(line[0]) for line in lines], list(range(FRAMES)))
        self.assertLess(abs(float(lines[20][1]) - 60.5) + abs(float(lines[20][2]) - 50.25), 1.5)

    def test_what_a_server_refuses_is_said(self):
        done = self.follow(self.address, "4000", "50", *self.files)
        self.assertEqual(done.returncode, 1)
        self.assertIn("points[0].x", done.stderr)


if __name__ == "__main__":
    NodeTest.server_program = sys.argv[1]
    if not shutil.which("node") or not (EXAMPLE / "node_modules").is_dir():
        print("skipped: Node or the modules of examples/node are not installed")
        sys.exit(SKIPPED)
    unittest.main(argv=sys.argv[:1], verbosity=2)
