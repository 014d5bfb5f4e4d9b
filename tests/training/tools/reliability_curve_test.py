#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The picture of how far confidence is to be trusted."""
import json
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as xml
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[3] / "training/tools/reliability_curve.py"
LUCAS_KANADE = {"method": "lucas-kanade (window 21, 4 levels)", "mean": {}, "reliability": None}


def report(method="holdfast small (preset small, bfloat16 on cpu)", auc=0.875, **changes):
    """30 of 40 estimates in the tenth from 0.9, the others in the one from 0.2; all other tenths are empty."""
    bins = [{"claims": 0, "confidence": 0.0, "right": 0.0} for _ in range(10)]
    bins[2] = {"claims": 10, "confidence": 0.25, "right": 0.5}
    bins[9] = {"claims": 30, "confidence": 1.0, "right": 0.75}
    return {"method": method, "mean": {},
            "reliability": {"claims": 40, "ece": 0.25, "brier": 0.1234, "auc": auc, "bins": bins, **changes}}


class ReliabilityCurveTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.picture = self.folder / "reliability.svg"

    def write(self, name, *reports):
        (self.folder / name).write_text(json.dumps({"settings": {}, "reports": reports}))

    def run_script(self, *arguments):
        return subprocess.run([sys.executable, str(SCRIPT), *arguments], cwd=self.folder, capture_output=True,
                              text=True)

    def draw(self, *files):
        """The elements of the picture of these files, by their kinds."""
        result = self.run_script(*files, f"--out={self.picture}")
        self.assertEqual(result.returncode, 0, result.stderr)
        elements = {}
        for element in xml.parse(self.picture).getroot():
            elements.setdefault(element.tag.partition("}")[2], []).append(element)
        return elements

    def texts(self, elements):
        return [element.text for element in elements["text"]]

    def assert_fails(self, code, said, *arguments):
        result = self.run_script(*arguments)
        self.assertEqual(result.returncode, code, result.stderr)
        self.assertIn(said, result.stderr)
        self.assertNotIn("Traceback", result.stderr)
        self.assertFalse(self.picture.exists())

    def test_a_curve_goes_through_confidence_and_share_right_of_each_tenth_that_is_not_empty(self):
        self.write("eval.json", report())
        elements = self.draw("eval.json")
        (curve,) = elements["polyline"]
        # The square's corners are (60, 502) and (500, 62).
        self.assertEqual(curve.get("points"), "170.0,282.0 500.0,172.0")
        self.assertEqual([(c.get("cx"), c.get("cy")) for c in elements["circle"]],
                         [("170.0", "282.0"), ("500.0", "172.0")])
        (diagonal,) = [line for line in elements["line"] if line.get("stroke-dasharray")]
        self.assertEqual([diagonal.get(end) for end in ("x1", "y1", "x2", "y2")], ["60.0", "502.0", "500.0", "62.0"])

    def test_bars_show_the_share_of_all_estimates(self):
        self.write("eval.json", report())
        elements = self.draw("eval.json")
        few, most = [bar for bar in elements["rect"] if bar.get("x")]
        self.assertEqual((few.get("x"), few.get("width"), few.get("height")), ("152.4", "35.2", "20.0"))
        self.assertEqual((most.get("x"), most.get("height")), ("460.4", "60.0"))
        self.assertIn("75 %", self.texts(elements))

    def test_title_and_legend_name_method_and_figures(self):
        self.write("eval.json", report())
        texts = self.texts(self.draw("eval.json"))
        self.assertEqual(texts[0], "Reliability of confidence: holdfast small")
        self.assertEqual(texts[1], "eval: ECE 0.250, Brier 0.123, AUC 0.875")

    def test_there_need_not_be_an_area_under_the_curve(self):
        self.write("eval.json", report(auc=None))
        self.assertIn("eval: ECE 0.250, Brier 0.123, AUC –", self.texts(self.draw("eval.json")))

    def test_every_file_has_a_curve_and_a_label(self):
        self.write("before.json", report())
        self.write("a=b.json", report("holdfast <other>"))
        self.write("c.json", report())
        elements = self.draw("before.json", "a=b.json", "cal & ibrated=c.json")
        self.assertEqual(len(elements["polyline"]), 3)
        self.assertEqual(len({curve.get("stroke") for curve in elements["polyline"]}), 3)
        self.assertEqual(len([bar for bar in elements["rect"] if bar.get("x")]), 6)
        texts = self.texts(elements)
        self.assertEqual(texts[0], "Reliability of confidence: holdfast small, holdfast <other>")
        self.assertEqual([text.partition(":")[0] for text in texts[1:4]], ["before", "a=b", "cal & ibrated"])

    def test_a_title_that_is_too_long_is_cut(self):
        self.write("eval.json", report("holdfast " + "x" * 100))
        title = self.texts(self.draw("eval.json"))[0]
        self.assertEqual(len(title), 70)
        self.assertTrue(title.endswith("x…"))

    def test_reports_of_one_file_without_confidence_are_left_out(self):
        self.write("eval.json", report(), LUCAS_KANADE)
        elements = self.draw("eval.json")
        self.assertEqual(len(elements["polyline"]), 1)
        self.assertIn("eval: ECE 0.250, Brier 0.123, AUC 0.875", self.texts(elements))

    def test_several_data_sets_of_one_file_have_a_curve_each(self):
        self.write("suite.json", report("PointOdyssey (test): holdfast small (preset)"), report("CroHD: holdfast"))
        texts = self.texts(self.draw("suite.json"))
        self.assertEqual([text.rpartition(": ")[0] for text in texts[1:3]],
                         ["suite, PointOdyssey: holdfast small", "suite, CroHD: holdfast"])

    def test_a_file_without_reliability_is_an_error_that_names_it(self):
        self.write("good.json", report())
        self.write("baseline.json", LUCAS_KANADE)
        self.write("old.json", {"method": "holdfast small", "mean": {}})
        for name in ("baseline.json", "old.json"):
            self.assert_fails(1, f"{name}: no report has a reliability", "good.json", name, f"--out={self.picture}")

    def test_bad_files_are_errors_that_name_them(self):
        self.assert_fails(1, "cannot read absent.json", "absent.json", f"--out={self.picture}")
        contents = ("", "[]", "{}", '{"reports": 3}', '{"reports": [4]}', '{"reports": [{"reliability": {}}]}', "\xff",
                    *(json.dumps({"reports": [bad]}) for bad in (
                        report(bins=[]), report(bins=[{"claims": 0, "confidence": 0, "right": 0}]), report(ece=1.5),
                        report(bins=[{"claims": 1, "confidence": "high", "right": 0}]), report(brier=None),
                        report(bins=[{"claims": float("nan"), "confidence": 0, "right": 0}]), report(method=5))))
        for content in contents:
            with self.subTest(content):
                (self.folder / "bad.json").write_text(content, encoding="latin-1")
                self.assert_fails(1, "bad.json is no report of holdfast-eval", "bad.json", f"--out={self.picture}")

    def test_a_picture_that_cannot_be_written_is_an_error_that_names_it(self):
        self.write("eval.json", report())
        self.assert_fails(1, "cannot write absent/x.svg", "eval.json", "--out=absent/x.svg")

    def test_wrong_usage_ends_with_2(self):
        self.write("eval.json", report())
        out = f"--out={self.picture}"
        for arguments, said in ((["eval.json"], "--out"), ([out], "FILE"), (["=eval.json", out], "[LABEL=]PATH"),
                                (["label=", out], "[LABEL=]PATH"), (["eval.json", out, "--wrong"], "--wrong"),
                                (["eval.json", "eval=eval.json", out], "called eval: name them")):
            self.assert_fails(2, said, *arguments)


if __name__ == "__main__":
    unittest.main()
