# SPDX-License-Identifier: Apache-2.0
"""holdfast-import takes its flags from the environment and the command line, as every program does.

Usage: import_program_test.py HOLDFAST_IMPORT REPOSITORY
"""
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import unittest


class ImportProgramTest(unittest.TestCase):
    program = repository = None

    def setUp(self):
        directory = tempfile.TemporaryDirectory(prefix="holdfast-import-")
        self.addCleanup(directory.cleanup)
        self.out = pathlib.Path(directory.name) / "tiny.safetensors"

    def run_import(self, *flags, **variables):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        return subprocess.run([self.program, *flags, self.repository / "tests" / "data" / "tiny.pth", self.out],
                              env={**environment, **variables}, capture_output=True, text=True, timeout=120)

    def types(self):
        data = self.out.read_bytes()
        header = json.loads(data[8:8 + struct.unpack("<Q", data[:8])[0]])
        return {entry["dtype"] for name, entry in header.items() if name != "__metadata__"}

    def test_without_flags_parameters_are_float32(self):
        done = self.run_import()
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.types(), {"F32"})

    def test_a_variable_sets_a_flag(self):
        done = self.run_import(HOLDFAST_DTYPE="float16")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.types(), {"F16"})

    def test_the_command_line_wins(self):
        done = self.run_import("--dtype=bfloat16", HOLDFAST_DTYPE="float16")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.types(), {"BF16"})

    def test_a_bad_variable_is_named(self):
        done = self.run_import(HOLDFAST_WINDOW="wide")
        self.assertEqual(done.returncode, 2)
        self.assertIn("HOLDFAST_WINDOW", done.stderr)
        self.assertFalse(self.out.exists())


if __name__ == "__main__":
    ImportProgramTest.program, ImportProgramTest.repository = map(pathlib.Path, sys.argv[1:3])
    unittest.main(argv=sys.argv[:1], verbosity=2)
