# SPDX-License-Identifier: Apache-2.0
"""skipped.py finds what GoogleTest, unittest and programs of their own have skipped, in a log as ctest writes it."""
import pathlib
import subprocess
import sys
import tempfile
import unittest

import skipped

GOOGLE = """[ RUN      ] GpuTest.Runs
/tree/tests/training/gpu_test.cc:44: Skipped
LibTorch sees no GPU
[  SKIPPED ] GpuTest.Runs (0 ms)
[ RUN      ] GpuTest.Trains
/tree/tests/training/gpu_test.cc:44: Skipped
LibTorch sees no GPU
[  SKIPPED ] GpuTest.Trains (0 ms)
"""
PYTHON = """test_a (__main__.ShowTest.test_a) ... ok
test_b (__main__.ShowTest.test_b) ... skipped "there's no Xvfb"
OK (skipped=1)
"""
PROGRAM = "skipped: Node is not installed\n"


def log_of(**outputs):
    """The log of these tests, by their names."""
    return "Start testing: Nov 29 09:31 UTC\n" + "".join(
        f"{number}/9 Testing: {name}\n{number}/9 Test: {name}\nCommand: \"x\"\nOutput:\n{'-' * 58}\n{output}"
        f"<end of output>\nTest time =   0.98 sec\n{'-' * 58}\nTest Passed.\n"
        for number, (name, output) in enumerate(outputs.items(), 1))


class SkippedTest(unittest.TestCase):
    def test_every_reason_is_found_with_its_tests(self):
        log = log_of(gpu=GOOGLE, other=GOOGLE, show=PYTHON, node=PROGRAM, whole="[       OK ] A.B (0 ms)\n")
        self.assertEqual(skipped.skipped(log), {"LibTorch sees no GPU": {"gpu": 2, "other": 2},
                                                "there's no Xvfb": {"show": 1}, "Node is not installed": {"node": 1}})

    def test_a_skip_without_a_reason_is_no_silence(self):
        log = log_of(gpu=GOOGLE.replace("LibTorch sees no GPU", ""))
        self.assertEqual(skipped.skipped(log), {"no reason is given": {"gpu": 2}})

    def report(self, log):
        with tempfile.TemporaryDirectory(prefix="holdfast-skipped-") as folder:
            path = pathlib.Path(folder) / "release/Testing/Temporary/LastTest.log"
            path.parent.mkdir(parents=True)
            path.write_text(log, encoding="utf-8")
            return subprocess.run([sys.executable, skipped.__file__, path.parents[2]], check=True, capture_output=True,
                                  text=True).stdout

    def test_there_is_a_line_for_each_reason_or_for_none(self):
        self.assertEqual(self.report(log_of(gpu=GOOGLE, cpu=GOOGLE)),
                         "release: skipped 4: LibTorch sees no GPU (cpu, gpu)\n")
        self.assertEqual(self.report(log_of(whole="")), "release: nothing was skipped\n")


if __name__ == "__main__":
    unittest.main(verbosity=2)
