# SPDX-License-Identifier: Apache-2.0
"""A Prometheus of its own for a test, on a port that the system chooses."""
import json
import pathlib
import re
import subprocess
import tempfile
import threading
import urllib.error
import urllib.parse
import urllib.request

from tools import tool


class PrometheusProcess:
    """Starts with the object and answers queries from then on; stop() ends it and forgets what it has stored.

    'targets' is {job: [host:port, ...]}, scraped every 'interval' seconds; 'rule_files' are evaluated as often.
    """

    def __init__(self, targets, interval, rule_files=()):
        self.directory = tempfile.TemporaryDirectory(prefix="holdfast-prometheus-")
        period = f"{round(interval * 1000)}ms"
        config = pathlib.Path(self.directory.name) / "prometheus.json"  # which is YAML too
        config.write_text(json.dumps({
            "global": {"scrape_interval": period, "scrape_timeout": period, "evaluation_interval": period},
            "rule_files": [str(path) for path in rule_files],
            "scrape_configs": [{"job_name": job, "static_configs": [{"targets": addresses}]}
                               for job, addresses in targets.items()]}))
        self.process = subprocess.Popen(
            [tool("prometheus"), f"--config.file={config}", f"--storage.tsdb.path={self.directory.name}/data",
             "--web.listen-address=127.0.0.1:0"], stderr=subprocess.PIPE, text=True)
        self.url = None
        read = []
        for line in self.process.stderr:
            read.append(line)
            address = re.search(r'msg="Listening on" address=(\S+)', line)
            if address:
                self.url = f"http://{address[1]}"
            if "Server is ready to receive web requests" in line and self.url:
                break
        else:
            raise RuntimeError("Prometheus ended: " + "".join(read))
        # Its log is read on, so that it never waits for a reader.
        threading.Thread(target=lambda: [None for _ in self.process.stderr], daemon=True).start()

    def get(self, path, **parameters):
        """The 'data' of an answer of the HTTP API; ValueError with Prometheus' words when it refuses the question."""
        try:
            with urllib.request.urlopen(f"{self.url}/api/v1/{path}?{urllib.parse.urlencode(parameters)}") as page:
                return json.load(page)["data"]
        except urllib.error.HTTPError as error:
            raise ValueError(f"{parameters}: {json.load(error)['error']}") from error

    def now(self):
        """The time by Prometheus' clock, by which it stamps what it scrapes."""
        return float(self.get("query", query="time()")["result"][1])

    def stop(self):
        self.process.terminate()
        self.process.wait(60)
        self.directory.cleanup()
