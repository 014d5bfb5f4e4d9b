# SPDX-License-Identifier: Apache-2.0
"""A Prometheus that scrapes real programs at work finds what dashboard, rules, alerts and autoscalers ask for.

A server tracks a video and bears more clients than it may take; a trainer trains. The test asks Prometheus for each
query of each panel, variable and annotation, again and again, until each has shown something or the time is up.

Usage: monitoring_test.py HOLDFAST_SERVER HOLDFAST [HOLDFAST_TRAIN]
Without a trainer the panels of the row "Training" are looked at but not asked.
"""
import math
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request

from dashboard import load_dashboard, queries
from kustomize import read_yaml
from prometheus_process import PrometheusProcess
from tools import DEPLOY, SOURCE, tool

sys.path.insert(0, str(SOURCE / "tests" / "e2e"))
from server_process import VIDEO, ServerProcess  # noqa: E402

SCRAPE_SECONDS = 0.5
RATE_WINDOW = "5s"  # what Grafana would take for $__rate_interval, with so short a time between scrapes
DEADLINE_SECONDS = 240
JOB, TRAINING_JOB = "holdfast", "holdfast-training"
SMALL = ["--processing_size=256x192", "--iterations=2", "--max_sessions=2"]

# What a healthy run leaves at zero. These queries must have series; every other one must also rise above zero.
ZERO_WHEN_HEALTHY = {
    "Resumes",              # no server is lost here; tests/e2e/resume_test.cc loses some
    "Precision fallbacks",  # a processor whose bfloat16 is wrong
    "Skipped",              # gradients that are not finite, damaged samples
    "bfloat16",             # the trainer's preset `test` runs in float32
}
# Queries of what does not happen here, which have no series then; they must be well-formed.
NOTHING_WHEN_HEALTHY = {
    "Restarts",  # the annotation: its expression compares
}


def filled_in(expression):
    """The expression as Grafana sends it, with all instances chosen."""
    for variable, value in (("$__rate_interval", RATE_WINDOW), ("$job", JOB), ("$training_job", TRAINING_JOB),
                            ("$instance", ".*"), ("$training_instance", ".*")):
        expression = re.sub(re.escape(variable) + r"\b", value, expression)
    return expression


class MonitoringTest(unittest.TestCase):
    server_program = client_program = None
    training_program = None

    @classmethod
    def setUpClass(cls):
        cls.directory = tempfile.TemporaryDirectory(prefix="holdfast-monitoring-")
        cls.addClassCleanup(cls.directory.cleanup)
        cls.server = ServerProcess(cls.server_program, *SMALL)
        cls.addClassCleanup(cls.server.stop)
        targets = {JOB: [re.search(r"//([^/]+)/", cls.server.metrics)[1]]}
        if cls.training_program:
            targets[TRAINING_JOB] = [cls.start_training()]
        cls.targets = targets
        cls.prometheus = PrometheusProcess(targets, SCRAPE_SECONDS, [DEPLOY / "rules.yaml", DEPLOY / "alerts.yaml"])
        cls.addClassCleanup(cls.prometheus.stop)
        cls.started = cls.prometheus.now()
        cls.deadline = time.monotonic() + DEADLINE_SECONDS
        # Rates need a value from before the work began.
        cls.wait_until(lambda: all(cls.value(f'scrape_samples_scraped{{job="{job}"}}') for job in targets),
                       "Prometheus has not scraped")
        cls.track()
        cls.start_load()

    @classmethod
    def start_training(cls):
        trainer = subprocess.Popen(
            [cls.training_program, "--preset=test", "--threads=1", "--steps=1000000", "--validate_every=50",
             "--validation_clips=1", "--log_every=1000000", "--metrics_address=127.0.0.1:0",
             f"--out={cls.directory.name}/training"],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        cls.addClassCleanup(cls.end, trainer)
        for line in trainer.stdout:
            port = re.search(r"metrics on port (\d+)", line)
            if port:
                return f"127.0.0.1:{port[1]}"
        raise RuntimeError("the trainer ended before it served metrics")

    @classmethod
    def track(cls):
        """One session from begin to end, with checkpoints."""
        done = subprocess.run(
            [cls.client_program, "track", str(VIDEO), f"--server={cls.server.address}", "--grid=9", "--max_frames=40",
             "--max_side=320", f"--out={cls.directory.name}/tracks.json"],
            capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(done.stderr)

    @classmethod
    def start_load(cls):
        """More sessions than the server takes; some of them go away and come back. It ends with the test."""
        load = subprocess.Popen(
            [cls.client_program, "load", str(VIDEO), f"--server={cls.server.address}", "--sessions=3", "--points=16",
             "--fps=10", "--max_side=320", "--cancel=34", "--live", f"--seconds={DEADLINE_SECONDS}"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        cls.addClassCleanup(cls.end, load)

    @staticmethod
    def end(process):
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)

    @classmethod
    def value(cls, expression):
        result = cls.prometheus.get("query", query=expression)["result"]
        return float(result[0]["value"][1]) if result else None

    @classmethod
    def wait_until(cls, condition, words):
        """Asks again as often as Prometheus scrapes, until the deadline."""
        while not condition():
            if time.monotonic() > cls.deadline:
                raise TimeoutError(f"{words} after {DEADLINE_SECONDS} s")
            try:
                cls.server.process.wait(SCRAPE_SECONDS)
                raise RuntimeError("the server ended")
            except subprocess.TimeoutExpired:
                pass

    def best(self, expression):
        """The greatest finite value that any series of the query has had so far; None when there is no such value."""
        data = self.prometheus.get("query_range", query=filled_in(expression), start=self.started,
                                   end=self.prometheus.now(), step=SCRAPE_SECONDS)
        values = [float(value) for series in data["result"] for _, value in series["values"]]
        return max((value for value in values if math.isfinite(value)), default=None)

    def test_every_query_shows_something(self):
        missing = dict.fromkeys(queries(load_dashboard(), with_training=self.training_program is not None))
        asked = len(missing)
        self.assertGreater(asked, 30)

        def all_shown():
            for title, expression in list(missing):
                best = self.best(expression)
                missing[title, expression] = best
                shown = best is not None and (best > 0 or title in ZERO_WHEN_HEALTHY)
                if shown or title in NOTHING_WHEN_HEALTHY:
                    del missing[title, expression]
            return not missing

        try:
            self.wait_until(all_shown, "queries show nothing")
        except TimeoutError as error:
            self.fail("\n".join([str(error), *(f"{title}: {best}: {expression}"
                                               for (title, expression), best in missing.items())]))
        print(f"{asked} queries, each with series", flush=True)

    def test_every_variable_offers_a_choice(self):
        for variable in load_dashboard()["templating"]["list"]:
            if variable["type"] == "datasource":
                continue
            question = variable["query"]["query"]
            if "training" in question and not self.training_program:
                continue
            metric, label = re.fullmatch(r"label_values\((.+), (\w+)\)", question).groups()
            found = self.prometheus.get(f"label/{label}/values", **{"match[]": filled_in(metric)})
            self.assertTrue(found, variable["name"])

    def rules(self, kind):
        return [rule for group in self.prometheus.get("rules", type=kind)["groups"] for rule in group["rules"]]

    def test_every_recording_rule_records(self):
        missing = {rule["name"] for rule in self.rules("record")}
        if not self.training_program:
            missing = {name for name in missing if "training" not in name}
        self.assertGreater(len(missing), 8)
        # Of sessions that resume there is none here, and 0 / 0 is no number.
        missing.remove("job:holdfast_resumes_refused:ratio_rate10m")
        self.wait_until(lambda: not {name for name in missing if self.best(name) is None}, "rules record nothing")

    def test_every_alert_can_be_evaluated_and_none_calls_for_help(self):
        alerts = self.rules("alert")
        self.assertGreater(len(alerts), 10)
        self.wait_until(lambda: all(rule["health"] == "ok" for rule in self.rules("alert")), "alerts are not evaluated")
        # Refusals are provoked here, but the alert waits for longer than this test takes.
        firing = [rule for rule in self.rules("alert") if rule["state"] == "firing"]
        self.assertEqual([rule["name"] for rule in firing if rule["labels"]["severity"] != "info"], [])

    def test_autoscalers_get_one_number_for_each_question(self):
        scaled = read_yaml(DEPLOY / "kubernetes" / "components" / "keda" / "scaled-object.yaml")
        for trigger in scaled["spec"]["triggers"]:
            found = self.prometheus.get("query", query=trigger["metadata"]["query"])["result"]
            self.assertEqual(len(found), 1, trigger["name"])
            self.assertTrue(math.isfinite(float(found[0]["value"][1])), trigger["name"])

    def test_promtool_finds_nothing_wrong_with_the_metrics(self):
        for job, addresses in self.targets.items():
            with urllib.request.urlopen(f"http://{addresses[0]}/metrics") as page:
                metrics = page.read()
            done = subprocess.run([tool("promtool"), "check", "metrics"], input=metrics, capture_output=True,
                                  check=False)
            self.assertEqual((done.returncode, done.stdout + done.stderr), (0, b""), job)
        bad = subprocess.run([tool("promtool"), "check", "metrics"], input=b"# TYPE frames counter\nframes 1\n",
                             capture_output=True, check=False)
        self.assertNotEqual(bad.returncode, 0)

    def test_exceptions_are_titles_of_the_dashboard(self):
        titles = {title for title, _ in queries(load_dashboard(), with_training=True)}
        self.assertLessEqual(ZERO_WHEN_HEALTHY | NOTHING_WHEN_HEALTHY, titles)

    def test_a_query_for_what_nobody_exports_is_noticed(self):
        self.assertIsNone(self.best('sum(rate(holdfast_no_such_total{job="$job"}[$__rate_interval]))'))
        with self.assertRaises(ValueError):
            self.best("sum(rate(holdfast_frames_total)")


if __name__ == "__main__":
    programs = [str(pathlib.Path(argument).resolve()) for argument in sys.argv[1:]]
    MonitoringTest.server_program, MonitoringTest.client_program = programs[:2]
    MonitoringTest.training_program = programs[2] if len(programs) > 2 else None
    unittest.main(argv=sys.argv[:1], verbosity=2)
