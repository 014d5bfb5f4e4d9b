# SPDX-License-Identifier: Apache-2.0
"""A holdfast-server of its own for a test, on ports that the system chooses."""
import os
import pathlib
import subprocess
import tempfile
import urllib.request

SOURCE = pathlib.Path(__file__).resolve().parents[2]
VIDEO = SOURCE / "media" / "pedestrians.mp4"


class ServerProcess:
    """Starts with the object; stop() asks it to end and returns its exit code.

    'weights' None: what the server finds by itself; 'directory': where it is started; 'prefix': a command that starts
    it as the same process.
    """

    def __init__(self, program, *flags, weights=SOURCE / "weights" / "small.safetensors", directory=None,
                 prefix=()):
        self.directory = tempfile.TemporaryDirectory(prefix="holdfast-e2e-")
        ports = pathlib.Path(self.directory.name) / "ports"
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        self.log = open(pathlib.Path(self.directory.name) / "log", "w+")
        self.process = subprocess.Popen(
            [*prefix, program, "--listen=127.0.0.1:0", "--metrics_listen=127.0.0.1:0", f"--port_file={ports}",
             *([f"--weights={weights}"] if weights else []), *flags],
            stderr=self.log, env=environment, cwd=directory)
        while not ports.exists():
            if self._ended_within(0.05):
                self._fail()
        lines = dict(line.split("=") for line in ports.read_text().split())
        self.address = f"127.0.0.1:{lines['grpc']}"
        self.metrics = f"http://127.0.0.1:{lines['metrics']}/metrics"

    def _fail(self):
        with self.directory, self.log:
            self.log.seek(0)
            raise RuntimeError(f"the server ended with {self.process.returncode}: {self.log.read()}")

    def _ended_within(self, seconds):
        try:
            self.process.wait(seconds)
            return True
        except subprocess.TimeoutExpired:
            return False

    def metric(self, name):
        with urllib.request.urlopen(self.metrics) as page:
            lines = page.read().decode().splitlines()
        return next(float(line.rsplit(" ", 1)[1]) for line in lines if line.startswith(name + " "))

    def wait_for_metric(self, name, least):
        """Returns once the metric is at least so large."""
        for _ in range(2400):
            value = self.metric(name)
            if value >= least:
                return
            if self._ended_within(0.05):
                raise RuntimeError(f"the server ended with {self.process.returncode}")
        raise TimeoutError(f"{name} is {value}, not {least}")

    def kill(self):
        self.process.kill()
        self.process.wait()

    def stop(self):
        self.process.terminate()
        code = self.process.wait(60)
        self.log.close()
        self.directory.cleanup()
        return code
