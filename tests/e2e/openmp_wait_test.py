# SPDX-License-Identifier: Apache-2.0
"""Programs that run the network choose by themselves how their OpenMP threads wait; the user's own choice wins.

Usage: openmp_wait_test.py HOLDFAST_SERVER PROGRAM...
"""
import os
import pathlib
import re
import subprocess
import sys
import unittest

from server_process import SOURCE, ServerProcess

SPIN_COUNT = re.search(r'kSpinCount\[\] = "(\d+)"', (SOURCE / "program" / "openmp_wait.h").read_text()).group(1)


class OpenMpWaitTest(unittest.TestCase):
    programs = None

    def policies(self, program, *flags, **variables):
        """The spin counts that libgomp reports, one each time it is loaded, and the run."""
        environment = {name: value for name, value in os.environ.items()
                       if name not in ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT")}
        done = subprocess.run([program, *flags], env={**environment, "OMP_DISPLAY_ENV": "verbose", **variables},
                              capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        return re.findall(r"GOMP_SPINCOUNT = '(\w+)'", done.stderr), done

    def test_every_program_chooses_a_short_spin(self):
        for program in self.programs[1:]:  # the server answers before it chooses: its process is looked at below
            with self.subTest(program):
                spins, _ = self.policies(program, "--help")
                self.assertEqual(spins[-1], SPIN_COUNT)

    def test_arguments_survive(self):
        program = self.programs[-1]
        spins, done = self.policies(program, "--version", "", "a b")
        self.assertEqual(len(spins), 2, "it is started again")
        self.assertRegex(done.stdout, rf"^{pathlib.Path(program).name} \d+\.\d+\.\d+\n$")

    def test_a_choice_of_the_user_wins_and_nothing_is_started_again(self):
        choices = [({"GOMP_SPINCOUNT": "77"}, "77"), ({"GOMP_SPINCOUNT": "0"}, "0"),
                   ({"OMP_WAIT_POLICY": "active"}, "30000000000"), ({"OMP_WAIT_POLICY": "passive"}, "0")]
        # What the first program does with all of them, the others do with one.
        for program, some in [(self.programs[0], choices), *((program, choices[:1]) for program in self.programs[1:])]:
            for variables, expected in some:
                with self.subTest(program, **variables):
                    self.assertEqual(self.policies(program, "--help", **variables)[0], [expected])

    def test_the_process_keeps_its_number_and_its_name(self):
        server = ServerProcess(self.programs[0], "--processing_size=64x64", "--precision=float32")
        try:  # the number is the one that stop() asks to end
            process = pathlib.Path("/proc") / str(server.process.pid)
            self.assertEqual((process / "comm").read_text().strip(), "holdfast-server"[:15])
            self.assertIn(f"GOMP_SPINCOUNT={SPIN_COUNT}".encode(), (process / "environ").read_bytes().split(b"\0"))
        finally:
            self.assertEqual(server.stop(), 0)


if __name__ == "__main__":
    os.environ.pop("GOMP_SPINCOUNT", None)  # which presets set, so that other tests do without the second start
    OpenMpWaitTest.programs = sys.argv[1:]
    unittest.main(argv=sys.argv[:1], verbosity=2)
