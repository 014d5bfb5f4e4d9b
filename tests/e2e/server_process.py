# SPDX-License-Identifier: Apache-2.0
"""A holdfast-server of its own for a test, on ports that the system chooses."""
import os
import pathlib
import subprocess
import tempfile

SOURCE = pathlib.Path(__file__).resolve().parents[2]
VIDEO = SOURCE / "media" / "pedestrians.mp4"


class ServerProcess:
    """Starts with the object; stop() asks it to end and returns its exit code."""

    def __init__(self, program, *flags):
        self.directory = tempfile.TemporaryDirectory(prefix="holdfast-e2e-")
        ports = pathlib.Path(self.directory.name) / "ports"
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        self.log = open(pathlib.Path(self.directory.name) / "log", "w+")
        self.process = subprocess.Popen(
            [program, "--listen=127.0.0.1:0", "--metrics_listen=127.0.0.1:0", f"--port_file={ports}",
             f"--weights={SOURCE / 'weights' / 'small.safetensors'}", *flags],
            stderr=self.log, env=environment)
        while not ports.exists():
            if self._ended_within(0.05):
                self.log.seek(0)
                raise RuntimeError(f"the server ended with {self.process.returncode}: {self.log.read()}")
        lines = dict(line.split("=") for line in ports.read_text().split())
        self.address = f"127.0.0.1:{lines['grpc']}"

    def _ended_within(self, seconds):
        try:
            self.process.wait(seconds)
            return True
        except subprocess.TimeoutExpired:
            return False

    def kill(self):
        self.process.kill()
        self.process.wait()

    def stop(self):
        self.process.terminate()
        code = self.process.wait(60)
        self.log.close()
        self.directory.cleanup()
        return code
