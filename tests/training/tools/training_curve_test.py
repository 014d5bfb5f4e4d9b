#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The picture of a training's validation curve."""
import json
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as xml
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[3] / "training/tools/training_curve.py"
EVENTS = [{"event": "validation", "step": 0, "delta_vis": 5.0}, {"event": "step", "step": 1, "elapsed_s": 600},
          {"event": "validation", "step": 1, "delta_vis": 99.0}, {"event": "notice", "text": "going on from step 0"},
          {"event": "step", "step": 1, "elapsed_s": 660}, {"event": "validation", "step": 1, "delta_vis": 18.0}]


class TrainingCurveTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def draw(self, events, *flags):
        (self.folder / "log.jsonl").write_text("".join(json.dumps(e) + "\n" for e in events))
        return subprocess.run([sys.executable, str(SCRIPT), str(self.folder), f"--out={self.folder / 'curve.svg'}",
                               *flags], capture_output=True, text=True)

    def test_draws_every_validation_once_and_the_baseline(self):
        result = self.draw(EVENTS, "--baseline=LK=10")
        self.assertEqual(result.returncode, 0, result.stderr)
        picture = xml.parse(self.folder / "curve.svg").getroot()
        (line,) = picture.findall("{*}polyline")
        # From (0 minutes, 5) to (11 minutes, 18) on axes that end at 11 minutes and 20 per cent.
        self.assertEqual(line.get("points"), "60.0,282.5 740.0,55.0")
        texts = [text.text for text in picture.iter("{http://www.w3.org/2000/svg}text")]
        self.assertIn("LK 10.0", texts)
        self.assertEqual(texts[texts.index("20") + 1:][:6], ["0", "2", "4", "6", "8", "10"])  # minutes
        self.assertIn(f"{self.folder}: 5.0 to 18.0", texts)

    def test_half_a_line_is_passed_over(self):
        result = self.draw(EVENTS)
        whole = (self.folder / "curve.svg").read_text()
        log = self.folder / "log.jsonl"
        log.write_text(log.read_text() + '{"event": "validation", "st')
        result = subprocess.run([sys.executable, str(SCRIPT), str(self.folder), f"--out={self.folder / 'curve.svg'}"],
                                capture_output=True, text=True)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual((self.folder / "curve.svg").read_text(), whole)

    def test_a_log_without_validations_is_an_error(self):
        result = self.draw(EVENTS[1:2])
        self.assertEqual(result.returncode, 1)
        self.assertIn("no validation", result.stderr)


if __name__ == "__main__":
    unittest.main()
