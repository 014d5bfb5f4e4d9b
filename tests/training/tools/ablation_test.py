#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The ablation runner with programs that only pretend to train and evaluate."""
import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[3] / "training/tools/ablation.py"

# Appends its arguments to calls.txt and writes "weights" that remember them. Fails when a file named "broken" exists.
FAKE_TRAIN = """#!/bin/sh
here=${0%/*}
echo "$@" >> "$here/calls.txt"
[ -e "$here/broken" ] && exit 3
for a in "$@"; do case $a in --out=*) out=${a#--out=} ;; esac; done
echo "$@" > "$out/final.safetensors"
"""

# delta_avg = 10 * seed, and 1 more with attention; left_object = 20, and 'seed' less with an objectness loss.
FAKE_EVAL = """#!/bin/sh
for a in "$@"; do case $a in --weights=*) w=${a#--weights=} ;; --json=*) j=${a#--json=} ;; esac; done
read -r flags < "$w"
seed=${flags#*--seed=} && seed=${seed%% *}
plus=1 && minus=$seed
case "$flags " in *--attention_blocks=0*) plus=0 ;; esac
case "$flags " in *"--alpha=0 "*) minus=0 ;; esac
echo '{"reports": [{"mean": {"delta_avg": '$((10 * seed + plus))', "survival_50": 50, "mte": null,' \
  '"left_object": '$((20 - minus))'}}]}' > "$j"
"""


class AblationTest(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.bin = Path(self._folder.name) / "bin"
        self.out = Path(self._folder.name) / "out"
        self.bin.mkdir()
        for name, text in (("holdfast-train", FAKE_TRAIN), ("holdfast-eval", FAKE_EVAL)):
            (self.bin / name).write_text(text)
            os.chmod(self.bin / name, 0o755)

    def tearDown(self):
        self._folder.cleanup()

    def run_script(self, *flags):
        command = [sys.executable, str(SCRIPT), "--bin", str(self.bin), "--out", str(self.out), *flags]
        return subprocess.run(command, capture_output=True, text=True)

    def calls(self):
        path = self.bin / "calls.txt"
        return path.read_text().splitlines() if path.exists() else []

    def tables(self):
        return json.loads((self.out / "ablation.json").read_text())["tables"]

    def test_trains_every_variant_of_both_tables_once_a_seed(self):
        self.assertEqual(self.run_script("--seeds", "1,2").returncode, 0)
        self.assertEqual(len(self.calls()), 14)
        self.assertEqual(len(set(self.calls())), 14)
        self.assertEqual(sum("--attention_blocks=0" in call for call in self.calls()), 4)
        self.assertEqual(sum("--alpha=0.05 " in call + " " for call in self.calls()), 2)
        self.assertTrue(all("--steps=0 --time_budget=30m" in call for call in self.calls()))

    def test_tables_show_mean_and_deviation_over_the_seeds(self):
        result = self.run_script("--seeds", "1,2")
        neither, _, _, both = self.tables()["table5"]["rows"]
        self.assertEqual(neither["ours"]["delta_avg"]["values"], [10, 20])
        self.assertEqual(neither["ours"]["delta_avg"]["mean"], 15)
        self.assertAlmostEqual(neither["ours"]["delta_avg"]["deviation"], 7.0710678)
        self.assertEqual(both["ours"]["delta_avg"]["mean"], 16)
        self.assertEqual(both["published"]["delta_avg"], 32.8)
        self.assertIsNone(both["ours"]["mte"]["mean"])
        self.assertIsNone(both["published"]["left_object"])
        self.assertIn("| both | 16.0 ± 7.1 (32.8) | 50.0 ± 0.0 (52.1) | – (37.6) | 18.5 ± 0.7 | 2 |", result.stdout)
        self.assertEqual((self.out / "ablation.md").read_text(), result.stdout[result.stdout.index("Preset"):])

    def test_one_seed_has_no_deviation(self):
        self.run_script("--seeds", "3")
        self.assertIsNone(self.tables()["table6"]["rows"][0]["ours"]["delta_avg"]["deviation"])
        self.assertIn("| α = 0 | 31.0 |", (self.out / "ablation.md").read_text())

    def test_evaluations_that_lack_a_metric_count_where_they_have_it(self):
        self.run_script("--seeds", "1,2")
        self.rewrite("attention-on_alpha-0", 1, delta_avg=11, survival_50=50, mte=3)
        text = self.run_script("--seeds", "1,2").stdout
        self.assertIn("| α = 0 | 16.0 ± 7.1 | 50.0 ± 0.0 (49.1) | 3.0, n = 1 | 20.0, n = 1 | 2 |", text)
        self.assertEqual(len(self.calls()), 14, "the older evaluation is kept")

    def differences(self):
        """{(factor, the other one): {metric: difference}}"""
        return {(row["factor"], row["other"]): row["ours"] for row in self.tables()["table5"]["differences"]}

    def rewrite(self, variant, seed, **mean):
        path = self.out / variant / f"seed{seed}" / "evaluation.json"
        path.write_text(json.dumps({"reports": [{"mean": mean}]}))

    def test_differences_pair_the_runs_of_a_seed(self):
        text = self.run_script("--seeds", "1,2,3", "--tables=table5").stdout
        self.assertEqual(list(self.differences()), [
            ("objectness loss", "without attention"), ("objectness loss", "with attention"),
            ("objectness loss", "mean of both"), ("contextual attention", "without objectness loss"),
            ("contextual attention", "with objectness loss"), ("contextual attention", "mean of both")])
        for setting in ("without attention", "with attention", "mean of both"):
            left = self.differences()["objectness loss", setting]["left_object"]
            self.assertEqual((left["seeds"], left["values"]), ([1, 2, 3], [-1, -2, -3]))
            self.assertEqual((left["mean"], left["deviation"], left["n"]), (-2, 1, 3))
            self.assertAlmostEqual(left["t"], -2 / (1 / 3 ** 0.5))
            self.assertEqual((left["above_0"], left["below_0"]), (0, 3))
        self.assertIn("| objectness loss | with attention | +0.00 ± 0.00; n = 3 | +0.00 ± 0.00; n = 3 | – |"
                      " -2.00 ± 1.00; t = -3.46, n = 3 |", text)
        self.assertIn("4.30 for n = 3", text)

    def test_differences_that_are_all_equal_have_no_t(self):
        self.run_script("--seeds", "1,2", "--tables=table5")
        delta = self.differences()["contextual attention", "mean of both"]["delta_avg"]
        self.assertEqual((delta["mean"], delta["deviation"], delta["t"]), (1, 0, None))
        for seed, value in ((1, 0.1), (2, 0.2)):  # differences that differ by rounding alone
            self.rewrite("attention-off_alpha-0", seed, delta_avg=value)
            self.rewrite("attention-on_alpha-0", seed, delta_avg=value + 0.2)
        self.run_script("--seeds", "1,2", "--tables=table5")
        self.assertIsNone(self.differences()["contextual attention", "without objectness loss"]["delta_avg"]["t"])

    def test_one_seed_has_a_difference_without_deviation(self):
        text = self.run_script("--seeds", "2", "--tables=table5").stdout
        self.assertIn("| contextual attention | mean of both | +1.00; n = 1 | +0.00; n = 1 | – | +0.00; n = 1 |", text)

    def test_the_mean_of_both_settings_takes_the_seeds_that_have_all_four_runs(self):
        self.run_script("--seeds", "1,2,3", "--tables=table5")
        self.rewrite("attention-off_alpha-0", 2, delta_avg=22)  # as an older evaluation
        self.rewrite("attention-on_alpha-0", 3, delta_avg=35, left_object=30)
        self.run_script("--seeds", "1,2,3", "--tables=table5")
        found = self.differences()
        self.assertEqual(found["contextual attention", "without objectness loss"]["delta_avg"]["values"], [1, -1, 5])
        self.assertEqual(found["contextual attention", "with objectness loss"]["delta_avg"]["values"], [1, 1, 1])
        self.assertEqual(found["contextual attention", "mean of both"]["delta_avg"]["values"], [1, 0, 3])
        self.assertEqual(found["objectness loss", "without attention"]["left_object"]["seeds"], [1, 3])
        self.assertEqual(found["objectness loss", "with attention"]["left_object"]["values"], [-1, -2, -13])
        both = found["objectness loss", "mean of both"]["left_object"]
        self.assertEqual((both["seeds"], both["values"]), ([1, 3], [-1, -8]))

    def test_differences_belong_to_table_5(self):
        text = self.run_script("--seeds", "1", "--tables=table6").stdout
        self.assertNotIn("What each factor changes", text)
        self.assertNotIn("differences", self.tables()["table6"])

    def test_trains_and_writes_the_tables_asked_for(self):
        text = self.run_script("--seeds", "1", "--tables", "table5").stdout
        self.assertEqual(len(self.calls()), 4)
        self.assertEqual(list(self.tables()), ["table5"])
        self.assertNotIn("Table 6", text)
        text = self.run_script("--seeds", "1", "--tables=table6").stdout
        self.assertEqual(len(self.calls()), 4 + 3, "two of the five are there")
        self.assertEqual(list(self.tables()), ["table6"])
        self.assertNotIn("Table 5", text)
        self.run_script("--seeds", "1", "--tables=table6,table5")
        self.assertEqual(list(self.tables()), ["table5", "table6"])
        self.assertEqual(len(self.calls()), 7, "all runs are there")

    def test_refuses_tables_that_do_not_exist(self):
        for names in ("table7", "table5,", ""):
            result = self.run_script(f"--tables={names}")
            self.assertEqual(result.returncode, 2)
            self.assertIn("but table5 and table6", result.stderr)
        self.assertFalse(self.out.exists())

    def test_goes_on_where_it_was_stopped(self):
        (self.bin / "broken").touch()
        stopped = self.run_script("--seeds", "1")
        self.assertNotEqual(stopped.returncode, 0)
        self.assertIn("holdfast-train ended with code 3", stopped.stderr)
        (self.bin / "broken").unlink()
        self.assertEqual(self.run_script("--seeds", "1").returncode, 0)
        self.assertEqual(len(self.calls()), 1 + 7)
        self.assertEqual(self.run_script("--seeds", "1,2").returncode, 0)
        self.assertEqual(len(self.calls()), 1 + 14, "finished runs are kept")

    def test_refuses_to_mix_budgets(self):
        self.assertEqual(self.run_script("--seeds", "1", "--steps", "10").returncode, 0)
        mixed = self.run_script("--seeds", "1", "--steps", "20")
        self.assertNotEqual(mixed.returncode, 0)
        self.assertIn("another budget", mixed.stderr)

    def test_goes_on_with_the_budgets_of_earlier_versions(self):
        self.out.mkdir()
        budget = {"preset": "small", "time_budget": "30m", "steps": 0, "train_flags": [],
                  "eval_flags": ["--format=synthetic", "--processing_size=512x384", "--seed=1000", "--count=50"]}
        text = json.dumps(budget, indent=2) + "\n"
        (self.out / "budget.json").write_text(text)
        self.assertEqual(self.run_script("--seeds", "1", "--tables", "table5").returncode, 0)
        self.assertEqual((self.out / "budget.json").read_text(), text)
        (self.out / "budget.json").unlink()
        self.run_script("--seeds", "1")
        self.assertEqual((self.out / "budget.json").read_text(), text, "and writes the same")

    def test_passes_the_budget_and_further_flags_to_every_run(self):
        self.run_script("--seeds", "1", "--steps", "10", "--preset", "test", "--", "--pictures=here")
        for call in self.calls():
            self.assertIn("--preset=test", call)
            self.assertIn("--steps=10", call)
            self.assertIn("--pictures=here", call)
            self.assertNotIn("--time_budget", call)


if __name__ == "__main__":
    unittest.main()
