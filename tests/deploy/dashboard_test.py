# SPDX-License-Identifier: Apache-2.0
"""Every query of the Grafana dashboard finds what it asks for, in a Prometheus that scrapes real programs at work.

A server tracks a video and bears more clients than it may take; a trainer trains. The test asks Prometheus for each
query of each panel, variable and annotation, again and again, until each has shown something or the time is up.

Usage: dashboard_test.py HOLDFAST_SERVER HOLDFAST [HOLDFAST_TRAIN]
Without a trainer the panels of the row "Training" are looked at but not asked.
"""
import json
import math
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest

from prometheus_process import PrometheusProcess
from tools import DEPLOY, SOURCE

sys.path.insert(0, str(SOURCE / "tests" / "e2e"))
from server_process import VIDEO, ServerProcess  # noqa: E402

SCRAPE_SECONDS = 0.5
RATE_WINDOW = "5s"  # what Grafana would take for $__rate_interval, with so short a time between scrapes
DEADLINE_SECONDS = 240
JOB, TRAINING_JOB = "holdfast", "holdfast-training"
TRAINING_ROW = "Training"
SMALL = ["--processing_size=256x192", "--iterations=2", "--max_sessions=2"]

# What a healthy run leaves at zero. These queries must have series; every other one must also rise above zero.
ZERO_WHEN_HEALTHY = {
    "Resumes",              # no server is lost here; tests/e2e/resume_test.cc loses some
    "Precision fallbacks",  # a processor whose bfloat16 is wrong
    "Skipped",              # gradients that are not finite, damaged samples
    "bfloat16",             # the trainer's preset `test` runs in float32
    "Restarts",             # the annotation
}


def load_dashboard():
    return json.loads((DEPLOY / "grafana" / "holdfast.json").read_text(encoding="utf-8"))


def panels_by_row(dashboard):
    """(title of the row, panel) of every panel."""
    row = None
    for panel in dashboard["panels"]:
        if panel["type"] == "row":
            row = panel["title"]
        else:
            yield row, panel


def queries(dashboard, with_training):
    """(title, expression) of every query, but those of training where there is none."""
    found = [(panel["title"], target["expr"]) for row, panel in panels_by_row(dashboard) for target in panel["targets"]
             if with_training or row != TRAINING_ROW]
    return found + [(item["name"], item["expr"]) for item in dashboard["annotations"]["list"]]


def filled_in(expression):
    """The expression as Grafana sends it, with all instances chosen."""
    for variable, value in (("$__rate_interval", RATE_WINDOW), ("$job", JOB), ("$training_job", TRAINING_JOB),
                            ("$instance", ".*"), ("$training_instance", ".*")):
        expression = re.sub(re.escape(variable) + r"\b", value, expression)
    return expression


class DashboardTest(unittest.TestCase):
    """The file by itself."""

    def setUp(self):
        self.dashboard = load_dashboard()

    def test_panels_have_their_own_number_place_and_description(self):
        panels = self.dashboard["panels"]
        self.assertEqual(len({panel["id"] for panel in panels}), len(panels))
        taken = {}
        for panel in panels:
            place = panel["gridPos"]
            self.assertLessEqual(place["x"] + place["w"], 24, panel["title"])
            for x in range(place["x"], place["x"] + place["w"]):
                for y in range(place["y"], place["y"] + place["h"]):
                    self.assertNotIn((x, y), taken, f"{panel['title']} lies on {taken.get((x, y))}")
                    taken[x, y] = panel["title"]
        for _, panel in panels_by_row(self.dashboard):
            self.assertTrue(panel["description"].endswith("."), panel["title"])
            self.assertTrue(panel["targets"], panel["title"])

    def test_every_data_source_is_the_variable(self):
        def sources(value):
            if isinstance(value, dict):
                if "datasource" in value:
                    yield value["datasource"]
                for item in value.values():
                    yield from sources(item)
            elif isinstance(value, list):
                for item in value:
                    yield from sources(item)

        found = list(sources(self.dashboard))
        self.assertGreater(len(found), 40)
        self.assertTrue(all(source == {"type": "prometheus", "uid": "${datasource}"} for source in found))

    def test_every_variable_in_a_query_is_known(self):
        known = {variable["name"] for variable in self.dashboard["templating"]["list"]}
        for title, expression in queries(self.dashboard, with_training=True):
            for name in re.findall(r"\$(\w+)", expression):
                self.assertIn(name, known | {"__rate_interval"}, title)

    def test_exceptions_are_titles_of_the_dashboard(self):
        self.assertLessEqual(ZERO_WHEN_HEALTHY, {title for title, _ in queries(self.dashboard, with_training=True)})


class LiveDashboardTest(unittest.TestCase):
    """The file against programs at work."""
    server_program = client_program = None
    training_program = None

    @classmethod
    def setUpClass(cls):
        cls.directory = tempfile.TemporaryDirectory(prefix="holdfast-dashboard-")
        cls.addClassCleanup(cls.directory.cleanup)
        cls.server = ServerProcess(cls.server_program, *SMALL)
        cls.addClassCleanup(cls.server.stop)
        targets = {JOB: [re.search(r"//([^/]+)/", cls.server.metrics)[1]]}
        if cls.training_program:
            targets[TRAINING_JOB] = [cls.start_training()]
        cls.prometheus = PrometheusProcess(targets, SCRAPE_SECONDS)
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
                if best is not None and (best > 0 or title in ZERO_WHEN_HEALTHY):
                    del missing[title, expression]
                elif title == "Restarts":  # `... > 0` has no series where nothing restarts: it is only parsed
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

    def test_a_query_for_what_nobody_exports_is_noticed(self):
        self.assertIsNone(self.best('sum(rate(holdfast_no_such_total{job="$job"}[$__rate_interval]))'))
        with self.assertRaises(ValueError):
            self.best("sum(rate(holdfast_frames_total)")


if __name__ == "__main__":
    programs = [str(pathlib.Path(argument).resolve()) for argument in sys.argv[1:]]
    LiveDashboardTest.server_program, LiveDashboardTest.client_program = programs[:2]
    LiveDashboardTest.training_program = programs[2] if len(programs) > 2 else None
    unittest.main(argv=sys.argv[:1], verbosity=2)
