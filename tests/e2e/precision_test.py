# SPDX-License-Identifier: Apache-2.0
"""Tracks in bfloat16 are those in float32, at sizes that are landscape, portrait, small and odd multiples of 32.

A point on weak or repeated texture comes to rest elsewhere after the smallest change, so that no fixed bound holds for
all points. The yardstick is a change of the input that nobody sees: bfloat16 must move the demo's points no further
from float32 than sending the frames as JPEG of quality 95 in place of 92 does.

Usage: precision_test.py HOLDFAST_SERVER HOLDFAST
"""
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import unittest

from server_process import VIDEO, ServerProcess

FRAMES = 40
SIZES = ["512x384", "576x320", "320x608", "256x192"]  # as given to --processing_size: WIDTHxHEIGHT
MEDIAN_PX = 0.2  # of the video's 768x576 pixels; with a wrong kernel it was tens of pixels
NEAR_PX = 0.5


class Distances:
    """Between two runs' positions of the same points in the same frames, in pixels of the video."""

    def __init__(self, one, other):
        apart = sorted(math.dist(one[key], other[key]) for key in one)
        self.mean = statistics.fmean(apart)
        self.median = statistics.median(apart)
        self.near = sum(distance <= NEAR_PX for distance in apart) / len(apart)

    def __str__(self):
        return f"mean {self.mean:.3f} px, median {self.median:.3f} px, {100 * self.near:.1f} % within {NEAR_PX} px"


def convolves_bfloat16():
    """Without these LibTorch convolves bfloat16 by a loop that takes minutes for a second of video."""
    flags = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").split()
    return {"avx512bw", "avx512vl", "avx512dq"} <= set(flags)


@unittest.skipUnless(convolves_bfloat16(), "the processor has no AVX-512: nobody computes in bfloat16 here")
class PrecisionTest(unittest.TestCase):
    server_program = client_program = None

    def tracks(self, server, size, quality=92):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        with tempfile.TemporaryDirectory(prefix="holdfast-precision-") as directory:
            out = pathlib.Path(directory) / "tracks.json"
            subprocess.run([self.client_program, "track", str(VIDEO), f"--server={server.address}",
                            f"--points={VIDEO.parent / 'pedestrians_points.csv'}", f"--max_frames={FRAMES}",
                            f"--processing_size={size}", f"--jpeg_quality={quality}", f"--out={out}"],
                           check=True, env=environment, capture_output=True, timeout=280)
            points = json.loads(out.read_text())["points"]
        return {(point["id"], frame): xy for point in points for frame, xy in zip(point["frames"], point["xy"])}

    def test_bfloat16_moves_points_no_further_than_an_invisible_change_of_the_input(self):
        exact, disturbed, rounded = {}, {}, {}
        server = ServerProcess(self.server_program, "--precision=float32")
        for size in SIZES:
            exact[size] = self.tracks(server, size)
            disturbed[size] = self.tracks(server, size, quality=95)
        self.assertEqual(server.stop(), 0)
        server = ServerProcess(self.server_program, "--precision=bfloat16")
        for size in SIZES:
            rounded[size] = self.tracks(server, size)
        self.assertEqual(server.stop(), 0)
        for size in SIZES:
            self.assertEqual(exact[size].keys(), rounded[size].keys())
            self.assertGreater(len(exact[size]), 30 * FRAMES)
            rounding = Distances(exact[size], rounded[size])
            input_change = Distances(exact[size], disturbed[size])
            print(f"{size}: bfloat16 {rounding}; JPEG quality {input_change}")
            with self.subTest(size=size):
                self.assertLessEqual(rounding.median, MEDIAN_PX)
                self.assertLessEqual(rounding.mean, 1.1 * input_change.mean)
                self.assertGreaterEqual(rounding.near, input_change.near - 0.01)


if __name__ == "__main__":
    PrecisionTest.server_program, PrecisionTest.client_program = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1], verbosity=2)
