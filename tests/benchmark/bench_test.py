# SPDX-License-Identifier: Apache-2.0
"""What bench.py makes of measurements: nothing here is timed."""
import contextlib
import io
import pathlib
import re
import tempfile
import unittest
from unittest import mock

import bench
import bench_report
import served


def run_of(name, milliseconds, **more):
    return {"name": f"{name}/real_time", "run_type": "iteration", "real_time": milliseconds, "time_unit": "ms", **more}


def stage(name, milliseconds, operations=0, data=0):
    part = "ceilings" if name.startswith("ceiling.") else "stages"
    return {name: {"part": part, "ms": milliseconds, "operations": operations, "bytes": data}}


CEILINGS = {**stage("ceiling.convolution/-/float32/wide/-/2", [1], operations=2e8),  # 200 GFLOP/s
            **stage("ceiling.convolution/-/float32/narrow/-/2", [1], operations=1e8),
            **stage("ceiling.matmul/-/float32/square/-/2", [1], operations=1.5e8),
            **stage("ceiling.memory/-/-/triad/-/2", [2], data=4e7)}  # 20 GB/s
MACHINE = {"processor": "a", "processors": 2}


def measured(**rows_of_part):
    rows = {name: row for rows in rows_of_part.values() for name, row in rows.items()}
    return {"machine": MACHINE, "rows": rows,
            "parts": {part: {"commit": "c", "notes": []} for part in rows_of_part}}


class ReadTest(unittest.TestCase):
    def test_repetitions_of_a_case_come_together(self):
        runs = [run_of("encode/small/float32/64x64/-/2", 3.0, operations=9.0, peak_bytes=5.0),
                run_of("encode/small/float32/64x64/-/2", 4.0, operations=9.0, peak_bytes=5.0),
                {**run_of("encode/small/float32/64x64/-/2", 3.5), "run_type": "aggregate"}, run_of("BM_Norm/0", 1.0)]
        self.assertEqual(bench_report.read_stages({"benchmarks": runs}), {
            "encode/small/float32/64x64/-/2": {"part": "stages", "ms": [3.0, 4.0], "operations": 9.0,
                                               "peak_bytes": 5.0}})

    def test_other_units_and_errors_are_not_taken_for_figures(self):
        for broken in ({"time_unit": "ns"}, {"error_occurred": True, "error_message": "no memory"}):
            with self.subTest(broken), self.assertRaises(ValueError):
                bench_report.read_stages({"benchmarks": [{**run_of("decode/-/-/64x64/-/1", 1.0), **broken}]})


class DeriveTest(unittest.TestCase):
    def test_the_ceiling_is_the_best_of_its_kind(self):
        best = bench_report.ceilings(CEILINGS)
        self.assertEqual(best["convolution", "float32", "2"], (200, "wide"))
        self.assertEqual(best["memory", "-", "2"], (20, "triad"))

    def test_the_share_is_of_what_limits(self):
        rows = bench_report.derive({**CEILINGS,
                                    **stage("update/small/float32/-/64/2", [2, 9, 2], operations=2e8, data=1e6),
                                    **stage("pyramid/small/float32/64x64/-/2", [1], data=1e7),
                                    **stage("update/small/float32/-/64/1", [2], operations=1, data=1),
                                    **stage("decode/-/-/64x64/-/1", [1])})
        self.assertEqual(rows["update/small/float32/-/64/2"]["gflops"], 100)
        self.assertEqual(rows["update/small/float32/-/64/2"]["share"], 0.5)
        self.assertEqual(rows["pyramid/small/float32/64x64/-/2"]["share"], 0.5)
        self.assertNotIn("share", rows["update/small/float32/-/64/1"])  # no ceiling for one thread
        self.assertNotIn("gflops", rows["decode/-/-/64x64/-/1"])


class MergeTest(unittest.TestCase):
    def test_a_part_measured_again_replaces_that_part_alone(self):
        old = measured(ceilings=CEILINGS, stages=stage("encode/small/float32/64x64/-/2", [1]))
        new = measured(stages=stage("update/small/float32/-/64/2", [1], operations=1e8, data=1))
        rows = bench_report.merge(old, new)["rows"]
        self.assertNotIn("encode/small/float32/64x64/-/2", rows)
        self.assertEqual(rows["update/small/float32/-/64/2"]["share"], 0.5)  # of the old ceilings
        self.assertEqual(bench_report.merge(None, new)["parts"], new["parts"])

    def test_machines_do_not_mix(self):
        with self.assertRaisesRegex(ValueError, "machine: expected"):
            bench_report.merge({**measured(), "machine": {"processor": "b"}}, measured())


class TableTest(unittest.TestCase):
    def test_numbers_have_the_digits_that_count(self):
        self.assertEqual([bench_report.number(value) for value in (0.1234, 1.234, 12.34, 1234.5, None)],
                         ["0.123", "1.23", "12.3", "1234", ""])

    def test_every_part_has_its_table(self):
        row = {"part": "served", "frames_per_second": [10, 5, 6], "first_ms": [1], "first_ms_95": [2],
               "processor_ms": [100], "peak_bytes": 2e8}
        quiet = {**row, "frames_per_second": [12]}
        bench = measured(ceilings=CEILINGS, stages=stage("decode/-/-/64x64/-/1", [1.5]),
                         served={"served/256x192/64/quiet/4": quiet, "served/256x192/64/1 busy/4": row})
        bench["parts"]["stages"]["notes"].append("Left out: something.")
        text = bench_report.report(bench)
        self.assertIn("| convolution | float32 | 2 | 200 | GFLOP/s | wide |", text)
        self.assertIn("| decode | - | - | 64x64 | - | 1 | 1.50 |  |  |  |", text)
        self.assertIn("| 256x192 | 64 | 1 busy | 4 | 6.00 | 50 % | 1 / 2 | 100 | 200 |", text)
        self.assertIn("\nLeft out: something.\n", text)


class CompareTest(unittest.TestCase):
    def test_stages_stand_in_one_order_whatever_was_measured_first(self):
        names = ["decode/-/-/64x64/-/1", "encode/small/float32/64x64/-/1", "encode/small/float32/64x64/-/2",
                 "encode/small/float32/256x320/-/1", "update/small/float32/-/1/2", "update/small/float32/-/64/1",
                 "update/small/float32/-/256/1"]
        rows = {}
        for name in [names[i] for i in (6, 2, 0, 5, 3, 1, 4)]:
            rows.update(stage(name, [1]))
        lines = bench_report.stages_table(rows).splitlines()[2:]
        self.assertEqual(["/".join(cell.strip() for cell in line.split("|")[1:7]) for line in lines], names)

    def test_only_what_is_beyond_every_repetition_has_moved(self):
        for before, now, more_is_better, expected in (
                ([10, 11, 12], [8, 9, 9.5], False, 1), ([10, 11, 12], [8, 9, 10.5], False, 0),
                ([8, 9, 9.5], [10, 11, 12], False, -1), ([10, 11, 12], [13, 14, 15], True, 1),
                ([10, 10, 10], [10.1, 10.2, 10.3], False, 0), ([5], [5], True, 0)):
            with self.subTest(before=before, now=now):
                self.assertEqual(bench_report.moved(before, now, more_is_better), expected)

    def test_rows_of_both_are_compared_the_better_the_larger(self):
        name = "encode/small/float32/64x64/-/2"
        place = "served/256x192/64/quiet/4"
        old = measured(stages={**stage(name, [10]), **stage("gone/-/-/-/-/1", [1])},
                       served={place: {"part": "served", "frames_per_second": [10]}})
        new = measured(stages={**stage(name, [5]), **stage("new/-/-/-/-/1", [1])},
                       served={place: {"part": "served", "frames_per_second": [5]}})
        text = bench_report.compare(old, new)
        self.assertIn(f"| {name} | ms | 10.0 | 5.00 | 2.00 | better |", text)
        self.assertIn(f"| {place} | frames_per_second | 10.0 | 5.00 | 0.50 | worse |", text)
        self.assertIn("2 compared: 1 better, 1 worse beyond noise.", text)
        self.assertNotIn("gone", text)


class ChoiceTest(unittest.TestCase):
    def chosen(self, names, parts, full=False):
        pattern = re.compile(bench.stage_filter(parts, full, 2))
        return [name for name in names if pattern.search(f"{name}/real_time")]

    def test_quick_has_every_stage_and_preset(self):
        stages = ("encode/small", "encode/pips2", "attention/paper", "pyramid/small")
        names = [f"{one}/float32/384x512/-/2" for one in stages]
        names += ["decode/-/-/384x512/-/1", "flow/-/-/384x512/64/1", "correlation/small/float32/384x512/256/2",
                  "update/pips2/float32/-/64/2", "window/paper/bfloat16/256x320/64/2"]
        self.assertEqual(self.chosen(names, ["stages"]), names)
        self.assertEqual(self.chosen(names, ["ceilings"]), [])
        self.assertEqual(self.chosen(["window/paper/float32/512x896/1024/2"], ["stages"]), [])
        self.assertEqual(self.chosen(["BM_Norm", "window/paper/float32/512x896/1024/2"], ["stages"], full=True),
                         ["window/paper/float32/512x896/1024/2"])

    def test_unknown_parts_and_missing_files_are_refused(self):
        for flag, words in (("--only=stages,all", "--only: expected of ceilings, stages, served, got all"),
                            ("--compare=/nowhere.json", "--compare: expected a file, got /nowhere.json")):
            with contextlib.redirect_stderr(io.StringIO()) as said, self.assertRaises(SystemExit):
                bench.parse(["bin", flag])
            self.assertIn(words, said.getvalue())
        self.assertEqual(bench.parse(["bin", "--", "--precision=float32"]).flags, ["--precision=float32"])


class QuotaTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.tree = pathlib.Path(folder.name)
        self.addCleanup(mock.patch.stopall)
        mock.patch.object(served, "CGROUPS", self.tree).start()

    def test_groups_of_both_versions_are_found(self):
        text = "8:pids:/\n1:cpu,cpuacct:/a\n0::/b\n"
        self.assertEqual(served.group_places(text), [(self.tree / "cpu,cpuacct" / "a", 1)])
        (self.tree / "cgroup.controllers").touch()
        self.assertEqual(served.group_places("0::/b\n"), [(self.tree / "b", 2)])

    def test_where_there_can_be_no_group_it_is_said(self):
        with mock.patch.object(served, "group_places", return_value=[(self.tree / "none", 2)]):
            with self.assertRaises(OSError), served.quota(1.5):
                pass


if __name__ == "__main__":
    unittest.main(verbosity=2)
