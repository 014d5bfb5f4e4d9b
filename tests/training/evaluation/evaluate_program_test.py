#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""holdfast-eval as its users run it. Arguments: the program, the repository."""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

PROGRAM, REPOSITORY = sys.argv[1], Path(sys.argv[2])
SMALL = ["--format=synthetic", "--count=2", "--frames=10", "--points=6", "--clip_size=128x96"]
WEIGHTS = REPOSITORY / "weights/small.safetensors"


def evaluate(*flags, **environment):
    return subprocess.run([PROGRAM, *flags], capture_output=True, text=True, env={**os.environ, **environment})


class EvaluateProgramTest(unittest.TestCase):
    def test_compares_weights_and_baseline_on_the_same_clips(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "report.json"
            result = evaluate(*SMALL, f"--weights={WEIGHTS}", "--processing_size=128x96", "--baseline=lk",
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

    def test_calibrates_confidence_to_the_clips_it_evaluates(self):
        def calibrate(weights, calibrated):
            """Of the weights before they are calibrated."""
            with tempfile.NamedTemporaryFile() as report:
                result = evaluate(*SMALL, f"--weights={weights}", "--processing_size=128x96", "--precision=float32",
                                  "--baseline=lk", f"--calibrate={calibrated}", f"--json={report.name}")
                self.assertEqual(result.returncode, 0, result.stderr)
                ours, baseline = json.loads(Path(report.name).read_text())["reports"]
            self.assertIsNone(baseline["reliability"])
            claims = ours["reliability"]["claims"]
            self.assertEqual(claims, 2 * 6 * 9)  # every estimate after the queries in the first frames
            self.assertIn(f"over {claims} estimates", result.stdout)
            self.assertIn(f"confidence, fitted to {claims} estimates: {{", result.stdout)
            return ours

        with tempfile.TemporaryDirectory() as folder:
            calibrated, again, same = (Path(folder) / name for name in ("calibrated", "again", "same"))
            before = calibrate(WEIGHTS, calibrated)
            after = calibrate(calibrated, again)
            self.assertLessEqual(after["reliability"]["ece"], before["reliability"]["ece"])
            self.assertLessEqual(after["reliability"]["brier"], before["reliability"]["brier"])
            self.assertEqual(after["mean"]["delta_avg"], before["mean"]["delta_avg"])
            # What is fitted does not depend on a calibration that was there, nor on whether the file is the same.
            self.assertEqual(again.read_bytes(), calibrated.read_bytes())
            shutil.copy(WEIGHTS, same)
            calibrate(same, same)
            self.assertEqual(same.read_bytes(), calibrated.read_bytes())
            self.assertNotEqual(same.read_bytes(), WEIGHTS.read_bytes())

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
                               (["--baseline=lk", "clip.mp4"], "clip.mp4"),
                               (["--baseline=lk", "--calibrate=calibrated"], "--calibrate: needs --weights")):
            result = evaluate(*flags)
            self.assertEqual(result.returncode, 2, flags)
            self.assertIn(message, result.stderr)

    def test_missing_files_end_with_code_1(self):
        result = evaluate("--weights=/nowhere.safetensors")
        self.assertEqual(result.returncode, 1)
        self.assertIn("/nowhere.safetensors", result.stderr)
        self.assertEqual(evaluate("--baseline=lk", "--format=crohd", "--data=/nowhere").returncode, 1)

    def test_what_cannot_be_written_is_said_before_anything_is_evaluated(self):
        for flag in ("--calibrate", "--json"):
            result = evaluate(*SMALL, f"--weights={WEIGHTS}", "--processing_size=128x96", f"{flag}=/nowhere/result")
            self.assertEqual(result.returncode, 1)
            self.assertIn("/nowhere/result", result.stderr)
            self.assertNotIn("sequence 1", result.stderr)
            self.assertEqual(result.stdout, "")

    def test_help_names_the_flags(self):
        result = evaluate("--help")
        self.assertEqual(result.returncode, 0)
        self.assertIn("--processing_size", result.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
