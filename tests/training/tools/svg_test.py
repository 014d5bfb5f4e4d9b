#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The parts that pictures are made of."""
import sys
import unittest
import xml.etree.ElementTree as xml
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "training/tools"))
import svg  # noqa: E402


class SvgTest(unittest.TestCase):
    def test_a_panel_shows_0_at_its_lower_left_and_the_ends_at_its_upper_right(self):
        panel = svg.Panel(left=10, top=20, width=100, height=50, x_end=4, y_end=2)
        self.assertEqual(panel.at(0, 0), (10, 70))
        self.assertEqual(panel.at(4, 2), (110, 20))
        self.assertEqual(panel.at(1, 1), (35, 45))
        self.assertIn('x1="10.0" y1="45.0" x2="110.0" y2="45.0"', panel.across(1))

    def test_texts_are_shown_as_they_are(self):
        picture = xml.fromstring(svg.document(30, 20, [svg.text((1, 2), "a<b & \x00\ud800c \"δ\"")]))
        self.assertEqual(picture.find("{*}text").text, "a<b & c \"δ\"")
        self.assertEqual((picture.get("width"), picture.get("height")), ("30", "20"))

    def test_lines_may_be_dashed(self):
        plain, dashed = svg.line((0, 0), (1, 1)), svg.line((0, 0), (1, 1), dashed=True)
        self.assertNotIn("dash", plain)
        self.assertIn("stroke-dasharray", dashed)

    def test_a_bar_lies_between_its_corners(self):
        self.assertIn('x="1.0" y="2.0" width="4.0" height="7.0"', svg.bar((1, 2), (5, 9), "red"))

    def test_colours_repeat_when_there_are_more_curves(self):
        self.assertEqual(svg.colour(len(svg.COLOURS)), svg.colour(0))


if __name__ == "__main__":
    unittest.main()
