# SPDX-License-Identifier: Apache-2.0
"""Tracks in bfloat16 are those in float32, at sizes that are landscape, portrait, small and odd multiples of 32.

Usage: precision_test.py HOLDFAST_SERVER HOLDFAST
"""
import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

from server_process import VIDEO, ServerProcess

FRAMES = 40
SIZES = ["512x384", "576x320", "320x608", "256x192"]  # as given to --processing_size: WIDTHxHEIGHT
MEAN_PX = 0.1    # of the video's 768x576 pixels
NEARLY_ALL = 0.99
NEAR_PX = 0.5


class PrecisionTest(unittest.TestCase):
    server_program = client_program = None

    def tracks(self, server, size, directory):
        out = pathlib.Path(directory) / f"{size}.json"
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        subprocess.run([self.client_program, "track", str(VIDEO), f"--server={server.address}", "--grid=60",
                        f"--max_frames={FRAMES}", f"--processing_size={size}", f"--out={out}"],
                       check=True, env=environment, capture_output=True, timeout=280)
        return {(point["id"], frame): xy
                for point in json.loads(out.read_text())["points"]
                for frame, xy in zip(point["frames"], point["xy"])}

    def test_both_precisions_track_alike_at_every_size(self):
        found = {}
        for precision in ["float32", "bfloat16"]:
            server = ServerProcess(self.server_program, f"--precision={precision}")
            with tempfile.TemporaryDirectory(prefix="holdfast-precision-") as directory:
                for size in SIZES:
                    found[precision, size] = self.tracks(server, size, directory)
            self.assertEqual(server.stop(), 0)
        for size in SIZES:
            exact, rounded = found["float32", size], found["bfloat16", size]
            self.assertEqual(exact.keys(), rounded.keys())
            self.assertGreater(len(exact), 50 * FRAMES)
            apart = sorted(math.dist(exact[key], rounded[key]) for key in exact)
            mean = sum(apart) / len(apart)
            near = sum(d <= NEAR_PX for d in apart) / len(apart)
            print(f"{size}: mean {mean:.4f} px, {100 * near:.2f} % within {NEAR_PX} px, largest {apart[-1]:.2f} px")
            with self.subTest(size=size):
                self.assertLessEqual(mean, MEAN_PX)
                self.assertGreaterEqual(near, NEARLY_ALL)


if __name__ == "__main__":
    PrecisionTest.server_program, PrecisionTest.client_program = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1])
