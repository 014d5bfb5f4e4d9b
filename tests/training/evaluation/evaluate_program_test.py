#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""holdfast-eval as its users run it. Arguments: the program, the repository."""
import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

PROGRAM, REPOSITORY = sys.argv[1], Path(sys.argv[2])
SMALL = ["--format=synthetic", "--count=2", "--frames=10", "--points=6", "--clip_size=128x96"]


def evaluate(*flags, **environment):
    return subprocess.run([PROGRAM, *flags], capture_output=True, text=True, env={**os.environ, **environment})


class EvaluateProgramTest(unittest.TestCase):
    def test_compares_weights_and_baseline_on_the_same_clips(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "report.json"
            weights = REPOSITORY / "weights/small.safetensors"
            result = evaluate(*SMALL, f"--weights={weights}", "--processing_size=128x96", "--baseline=lk",
                              f"--json={path}")
            self.assertEqual(result.returncode, 0, result.stderr)
            ours, baseline = json.loads(path.read_text())["reports"]
        self.assertIn("holdfast", ours["method"])
        self.assertIn("lucas-kanade", baseline["method"])
        self.assertEqual([s["name"] for s in ours["sequences"]], [s["name"] for s in baseline["sequences"]])
        self.assertEqual(len(ours["sequences"]), 2)
        self.assertEqual(ours["sequences"][0]["processing_size"], {"width": 128, "height": 96})
        self.assertGreater(ours["mean"]["delta_avg"], 0)
        self.assertIn("processed at 128x96", result.stdout)

    def test_the_same_seed_gives_the_same_figures(self):
        def mean(seed):
            return evaluate(*SMALL, "--baseline=lk", f"--seed={seed}").stdout.splitlines()[-2].split()[5:]

        self.assertEqual(mean(3), mean(3))
        self.assertNotEqual(mean(3), mean(4))

    def test_the_suite_names_every_absent_data_set(self):
        with tempfile.TemporaryDirectory() as folder:
            result = evaluate("--suite=paper", f"--data={folder}", "--baseline=lk")
        self.assertEqual(result.returncode, 0, result.stderr)
        for name in ("PointOdyssey (test)", "TAP-Vid-DAVIS", "CroHD"):
            self.assertIn(f"\n{name}: absent", result.stdout)
        self.assertIn("52.1", result.stdout)

    def test_flags_come_from_the_environment_too(self):
        result = evaluate(*SMALL, HOLDFAST_BASELINE="lk")
        self.assertEqual(result.returncode, 0, result.stderr)

    def test_wrong_use_ends_with_code_2_and_names_the_flag(self):
        for flags, message in ((["--baseline=raft"], "--baseline"), (["--colour"], "--colour"),
                               (["--baseline=lk", "--format=avi"], "avi"), ([], "nothing to evaluate"),
                               (["--baseline=lk", "clip.mp4"], "clip.mp4")):
            result = evaluate(*flags)
            self.assertEqual(result.returncode, 2, flags)
            self.assertIn(message, result.stderr)

    def test_missing_files_end_with_code_1(self):
        result = evaluate("--weights=/nowhere.safetensors")
        self.assertEqual(result.returncode, 1)
        self.assertIn("/nowhere.safetensors", result.stderr)
        self.assertEqual(evaluate("--baseline=lk", "--format=crohd", "--data=/nowhere").returncode, 1)

    def test_help_names_the_flags(self):
        result = evaluate("--help")
        self.assertEqual(result.returncode, 0)
        self.assertIn("--processing_size", result.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
