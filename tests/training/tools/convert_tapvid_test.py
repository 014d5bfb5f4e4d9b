#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""The converter of TAP-Vid pickles, on pickles made here."""
import io
import json
import os
import pickle
import subprocess
import sys
import tempfile
import unittest

import numpy as np
from PIL import Image

CONVERTER = os.path.join(os.path.dirname(__file__), "..", "..", "..", "training", "tools", "convert_tapvid.py")


def clip():
    video = np.zeros((3, 11, 21, 3), dtype=np.uint8)
    video[1] = (200, 100, 0)
    points = np.array([[[0, 0], [0.5, 0.5], [1, 1]], [[0.25, 0.1], [np.nan, 0], [0.5, 0]]], dtype=np.float32)
    return {"video": video, "points": points, "occluded": np.array([[False, True, False], [False, False, True]])}


class ConvertTapVidTest(unittest.TestCase):
    def setUp(self):
        self.scratch = tempfile.TemporaryDirectory()
        self.addCleanup(self.scratch.cleanup)

    def path(self, *names):
        return os.path.join(self.scratch.name, *names)

    def convert(self, content):
        with open(self.path("data.pkl"), "wb") as file:
            file.write(content if isinstance(content, bytes) else pickle.dumps(content))
        return subprocess.run([sys.executable, CONVERTER, self.path("data.pkl"), self.path("out")],
                              capture_output=True, text=True, check=False)

    def tracks(self, name):
        with open(self.path("out", name, "tracks.json"), encoding="utf-8") as file:
            return json.load(file)

    def test_writes_frames_and_tracks_in_pixels(self):
        result = self.convert({"goat": clip()})
        self.assertEqual(result.returncode, 0, result.stderr)
        tracks = self.tracks("goat")
        self.assertEqual((tracks["width"], tracks["height"]), (21, 11))
        first, second = tracks["points"]
        self.assertEqual(first["xy"], [[0, 0], None, [20, 10]])
        self.assertEqual(first["visible"], [True, False, True])
        self.assertEqual(second["frames"], [0, 2])
        self.assertEqual(second["xy"], [[5, 1], None])
        self.assertEqual(sorted(os.listdir(self.path("out", "goat", "frames"))), [f"{i:05d}.jpg" for i in range(3)])
        red = np.asarray(Image.open(self.path("out", "goat", "frames", "00001.jpg")))[5, 5]
        self.assertLess(np.abs(red.astype(int) - (200, 100, 0)).max(), 6)

    def test_a_shorter_clip_replaces_a_longer_one(self):
        self.assertEqual(self.convert({"goat": clip()}).returncode, 0)
        with open(self.path("out", "goat", "frames", "cover.jpg"), "wb"):
            pass
        short = clip()
        short = {"video": short["video"][:2], "points": short["points"][:, :2], "occluded": short["occluded"][:, :2]}
        self.assertEqual(self.convert({"goat": short}).returncode, 0)
        self.assertEqual(sorted(os.listdir(self.path("out", "goat", "frames"))),
                         ["00000.jpg", "00001.jpg", "cover.jpg"])

    def test_reads_lists_of_clips_with_encoded_frames(self):
        encoded = clip()
        buffers = []
        for frame in encoded["video"]:
            buffer = io.BytesIO()
            Image.fromarray(frame).save(buffer, "JPEG")
            buffers.append(buffer.getvalue())
        encoded["video"] = buffers
        self.assertEqual(self.convert([encoded]).returncode, 0)
        self.assertEqual(self.tracks("00000")["width"], 21)

    def test_names_cannot_leave_the_directory(self):
        self.assertEqual(self.convert({"../../evil": clip()}).returncode, 0)
        self.assertEqual(os.listdir(self.path("out")), ["_.._evil"])

    def test_skips_clips_that_do_not_fit_and_converts_the_rest(self):
        short, missing = clip(), clip()
        short["points"] = short["points"][:, :2]
        del missing["occluded"]
        result = self.convert({"short": short, "missing": missing, "good": clip()})
        self.assertEqual(result.returncode, 1)
        self.assertIn("short: skipped", result.stderr)
        self.assertIn("2 clips were skipped", result.stderr)
        self.assertEqual(len(self.tracks("good")["points"]), 2)

    def test_refuses_pickles_that_would_run_code(self):
        result = self.convert(b"cos\nsystem\n(S'touch " + self.path("ran").encode() + b"'\ntR.")
        self.assertEqual(result.returncode, 1)
        self.assertIn("os.system", result.stderr)
        self.assertFalse(os.path.exists(self.path("ran")))

    def test_refuses_files_that_are_cut(self):
        result = self.convert(pickle.dumps({"goat": clip()})[:200])
        self.assertEqual(result.returncode, 1)
        self.assertIn("data.pkl", result.stderr)


if __name__ == "__main__":
    unittest.main()
