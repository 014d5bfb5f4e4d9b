# SPDX-License-Identifier: Apache-2.0
"""What documents and examples show, run as it is printed."""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
from datetime import datetime, timezone
from unittest import mock

import numpy as np
from PIL import Image

import support
from certificates import Authority
from documents import read_blocks
from support import PICTURES, POINTS, ROOT

TOKEN = "a-token-of-the-operators"


async def async_camera():
    for frame in PICTURES:
        yield frame


class DocsTest(support.ServedTest, unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)

    def serve_securely(self):
        """A server for those that know its authority, ca.pem, and have the token. Its address."""
        authority = Authority(self.folder, "ca")
        certificate, key = authority.issue("server")
        access = self.folder / "access"
        access.write_text(f"reader:{TOKEN}\n", encoding="utf-8")
        server = self.start_server(f"--tls_cert={certificate}", f"--tls_key={key}", f"--token_file={access}")
        self.addCleanup(server.stop)
        return server.address

    def run_blocks(self, document, secure=""):
        """Runs a document's blocks as one program. What it printed, and the names that it leaves."""
        blocks = read_blocks(document)
        self.assertEqual({block.language for block in blocks}, {"python"})
        names = {"np": np, "datetime": datetime, "timezone": timezone, "frames": PICTURES, "points": POINTS,
                 "camera": iter(PICTURES), "async_camera": async_camera, "show": mock.Mock()}
        return support.run_python(blocks, names, self.server.address, secure), names

    def test_the_pages_blocks_are_a_program(self):
        printed, names = self.run_blocks("docs/python.md", self.serve_securely())
        self.assertIn("config.points[0].x", printed)
        self.assertRegex(printed, r"\n\d+\.\d+\.\d+\n$")  # the build of the server that has a token
        self.assertTrue(names["show"].call_args_list)
        self.assertEqual(names["first"].xy.shape, (3, len(PICTURES), 2))
        np.testing.assert_array_equal(names["first"].xy, names["second"].xy)
        written = {path.name for path in self.folder.iterdir()}
        self.assertLessEqual({"tracks.npz", "tracks.csv", "tracks_dlc.csv", "tracks.xml", "tracks.svg"}, written)

    def test_the_packages_readme(self):
        _, names = self.run_blocks("python/README.md")
        self.assertEqual(names["tracks"].xy.shape, (3, len(PICTURES), 2))

    def test_the_notebooks_cells(self):
        notebook = json.loads((ROOT / "examples" / "quickstart.ipynb").read_text(encoding="utf-8"))
        cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
        names = {}
        with mock.patch.dict(os.environ, HOLDFAST_SERVER=self.server.address):
            for number, cell in enumerate(cells):
                exec(compile(cell, f"quickstart.ipynb, cell {number}", "exec"), names)
        self.assertLess(np.median(names["error"]), 1)
        self.assertEqual(set(names["newest"]), {0, 1, 2, 3})
        self.assertIn("<polyline", names["tracks"].show(names["frames"][-1])._repr_svg_())
        for cell in notebook["cells"]:
            self.assertFalse(cell.get("outputs"), "a notebook is kept without its outputs")

    def test_the_example_follows_a_point(self):
        for i, frame in enumerate(PICTURES):
            Image.fromarray(frame).save(self.folder / f"{i:03}.jpg", quality=95)
        x, y = POINTS[0]
        followed = subprocess.run(
            [sys.executable, ROOT / "examples/python/follow.py", self.server.address, self.folder, str(x), str(y)],
            env={**os.environ, "PYTHONPATH": str(support.STAGED)}, capture_output=True, text=True, check=True)
        lines = [line.split() for line in followed.stdout.splitlines()]
        self.assertEqual([line[0] for line in lines], [str(i) for i in range(len(PICTURES))])
        positions = np.array([[float(line[1]), float(line[2])] for line in lines])
        np.testing.assert_allclose(positions[20], [x + 20, y], atol=1.5)
        self.assertIn(lines[20][3], ("visible", "hidden"))


if __name__ == "__main__":
    support.main()
