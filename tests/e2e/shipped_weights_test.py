# SPDX-License-Identifier: Apache-2.0
"""A server that is told of no weights finds those that came with it, wherever it is started from.

Usage: shipped_weights_test.py HOLDFAST_SERVER
"""
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

from server_process import SOURCE, ServerProcess

SMALL = ("--processing_size=64x64", "--precision=float32", "--compute_threads=1")
WEIGHTS = SOURCE / "weights" / "small.safetensors"
INSTALLED = pathlib.Path("/usr/share/holdfast/weights/small.safetensors")


class ShippedWeightsTest(unittest.TestCase):
    program = None

    def setUp(self):
        directory = tempfile.TemporaryDirectory(prefix="holdfast-e2e-")
        self.addCleanup(directory.cleanup)
        self.directory = pathlib.Path(directory.name).resolve()

    def assert_serves(self, program, directory):
        server = ServerProcess(program, *SMALL, weights=None, directory=directory)
        self.assertEqual(server.stop(), 0)

    def copy_of_program(self):
        copy = self.directory / "bin" / "holdfast-server"
        copy.parent.mkdir()
        shutil.copy(self.program, copy)
        return copy

    def test_asked_to_stop_while_it_loads_it_never_serves(self):
        ports = self.directory / "ports"
        with subprocess.Popen([self.program, *SMALL, "--listen=127.0.0.1:0", "--metrics_listen=127.0.0.1:0",
                               f"--port_file={ports}"], stderr=subprocess.PIPE, text=True) as server:
            for line in server.stderr:
                if "loading the model" in line:
                    server.send_signal(signal.SIGTERM)
                    break
            rest = server.stderr.read()
        self.assertEqual(server.returncode, 0)
        self.assertNotIn("ready:", rest)
        self.assertFalse(ports.exists())

    def test_from_any_directory(self):
        self.assert_serves(self.program, "/")

    def test_through_a_symbolic_link(self):
        link = self.directory / "server"
        link.symlink_to(self.program)
        self.assert_serves(link, self.directory)

    def test_installed_at_any_prefix(self):
        copy = self.copy_of_program()
        place = self.directory / "share" / "holdfast" / "weights" / WEIGHTS.name
        place.parent.mkdir(parents=True)
        place.symlink_to(WEIGHTS)
        self.assert_serves(copy, "/")

    @unittest.skipIf(INSTALLED.exists(), "weights are installed here")
    def test_without_any_the_error_names_every_place(self):
        copy = self.copy_of_program()
        # The current directory has weights, but does not count.
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        done = subprocess.run([copy, "--listen=127.0.0.1:0", "--metrics_listen=127.0.0.1:0"], cwd=SOURCE,
                              env=environment, stderr=subprocess.PIPE, text=True, timeout=120)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn(str(self.directory / "share" / "holdfast" / "weights" / WEIGHTS.name), done.stderr)
        self.assertIn(str(INSTALLED), done.stderr)


if __name__ == "__main__":
    ShippedWeightsTest.program = str(pathlib.Path(sys.argv[1]).resolve())
    unittest.main(argv=sys.argv[:1], verbosity=2)
