# SPDX-License-Identifier: Apache-2.0
"""Frames as they are sent; no server takes part."""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import numpy as np

import support
from holdfast_client._frames import FrameCodec

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

JPEG, PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"  # as such files begin
GREY, COLOUR = np.zeros((4, 6), np.uint8), np.zeros((4, 6, 3), np.uint8)


class EncodingTest(unittest.TestCase):
    def test_opencv_that_does_not_load_is_looked_for_once(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        (pathlib.Path(directory.name) / "cv2.py").write_text(BROKEN, encoding="utf-8")
        path = os.pathsep.join([directory.name, str(support.STAGED)])
        said = subprocess.run([sys.executable, "-c", ENCODE], env={**os.environ, "PYTHONPATH": path}, check=True,
                              stdout=subprocess.PIPE, text=True).stdout
        self.assertEqual(said, "looked for\n")

    def test_arrays_may_follow_a_jpeg_file_as_jpeg(self):
        self.assertTrue(FrameCodec(JPEG).data(GREY).startswith(JPEG[:2]))
        self.assertEqual(FrameCodec(GREY).data(JPEG), JPEG)

    def test_a_frame_of_another_kind_than_the_first_one_is_refused(self):
        for first, frame, said in (
                (PNG, GREY, r"a frame is an array \[H, W\], the first one was sent as a PNG file"),
                (PNG, JPEG, "a frame is a JPEG file, .* sent as a PNG file"),
                (JPEG, PNG, "a frame is a PNG file, .* sent as a JPEG file"),
                (GREY, JPEG, r"a frame is a JPEG file, .* sent as an array \[H, W\]"),
                (GREY, COLOUR, r"a frame is an array \[H, W, 3\], .* sent as an array \[H, W\]"),
                (COLOUR, GREY, r"a frame is an array \[H, W\], .* sent as an array \[H, W, 3\]"),
                (JPEG, b"GIF89a", "neither JPEG nor PNG")):
            with self.subTest(first=first, frame=frame), self.assertRaisesRegex(ValueError, said):
                FrameCodec(first, "raw").data(frame)


if __name__ == "__main__":
    support.main()
