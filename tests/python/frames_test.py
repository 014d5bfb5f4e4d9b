# SPDX-License-Identifier: Apache-2.0
"""Frames as they are sent; no server takes part."""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import support

BROKEN = """
print("looked for")
raise ImportError("a library of the system is missing")
"""
ENCODE = """
import numpy as np
from holdfast_client._frames import FrameCodec

picture = np.zeros((4, 6), np.uint8)
codec = FrameCodec(picture)
assert all(codec.data(picture).startswith(b"\\xff\\xd8") for _ in range(10))
"""


class EncoderTest(unittest.TestCase):
    def test_opencv_that_does_not_load_is_looked_for_once(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        (pathlib.Path(directory.name) / "cv2.py").write_text(BROKEN, encoding="utf-8")
        path = os.pathsep.join([directory.name, str(support.STAGED)])
        said = subprocess.run([sys.executable, "-c", ENCODE], env={**os.environ, "PYTHONPATH": path}, check=True,
                              stdout=subprocess.PIPE, text=True).stdout
        self.assertEqual(said, "looked for\n")


if __name__ == "__main__":
    support.main()
