# SPDX-License-Identifier: Apache-2.0
"""Prometheus' rules and Alertmanager's sample, as promtool and amtool see them, and the runbook that they lead to.

Each alert fires and stays silent as alerts_test.yaml says; those tests are themselves tested, with each alert replaced
by one that always fires and by one that never does.
"""
import pathlib
import re
import subprocess
import tempfile
import unittest

import yaml

from tools import DEPLOY, SOURCE, tool

ALWAYS, NEVER = 'vector(1)', 'vector(1) < 0'
RECEIVERS = {"critical": "page", "warning": "ticket", "info": "nobody"}
RUNBOOK = "docs/runbook.md"
PARTS = ["Symptom", "Meaning", "Look at", "Do", "Escalate"]
# Metrics that no program of this project exports.
OF_PROMETHEUS = {"up"}


def read_yaml(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def rules(name):
    return [rule for group in read_yaml(DEPLOY / name)["groups"] for rule in group["rules"]]


def alerts():
    return [rule for rule in rules("alerts.yaml") if "alert" in rule]


def names_in(expression):
    """Names of metrics and of recorded series in a PromQL expression."""
    without_texts = re.sub(r'"[^"]*"', "", expression)
    return set(re.findall(r"\bup\b|\b(?:job\w*:)?(?:holdfast|process)_\w+(?::\w+)?|\bjob\w*:\w+:\w+", without_texts))


def exported_names():
    """Names of series that the server and the trainer export, as their sources spell them."""
    names = set()
    for source in ("server/prometheus_metrics.cc", "training/report/metrics_port.cc"):
        text = (SOURCE / source).read_text(encoding="utf-8")
        for name in re.findall(r'"((?:holdfast|process)_\w+)"', text):
            names |= {name, name + "_bucket", name + "_sum", name + "_count"}
    return names


def run(name, *arguments):
    return subprocess.run([tool(name), *map(str, arguments)], capture_output=True, text=True, check=False)


class RulesTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory(prefix="holdfast-alerts-")
        self.addCleanup(directory.cleanup)
        self.directory = pathlib.Path(directory.name)

    def written(self, name, content):
        path = self.directory / name
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return path

    def test_promtool_accepts_rules_and_configuration(self):
        for arguments in (["check", "rules", DEPLOY / "rules.yaml", DEPLOY / "alerts.yaml"],
                          ["check", "config", DEPLOY / "prometheus.yaml"]):
            done = run("promtool", *arguments)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_promtool_finds_what_is_wrong(self):
        bad = self.written("bad.yaml", {"groups": [{"name": "g", "rules": [{"alert": "A", "expr": "sum(rate(x))"}]}]})
        self.assertNotEqual(run("promtool", "check", "rules", bad).returncode, 0)

    def rule_tests(self, changed=None, expression=None):
        """What promtool says of the rule tests; with 'changed', of those of that alert, which has 'expression'."""
        content = read_yaml(DEPLOY / "alerts.yaml")
        for rule in (rule for group in content["groups"] for rule in group["rules"]):
            rule["annotations"] = {"summary": rule["annotations"]["summary"]}
            if rule["alert"] == changed:
                rule["expr"] = expression
        tests = read_yaml(SOURCE / "tests" / "deploy" / "alerts_test.yaml")
        tests["rule_files"] = [str(DEPLOY / "rules.yaml"), str(self.written("alerts.yaml", content))]
        if changed:
            tests["tests"] = [case for case in tests["tests"]
                              if any(check["alertname"] == changed for check in case["alert_rule_test"])]
        return run("promtool", "test", "rules", self.written("tests.yaml", tests))

    def test_alerts_fire_when_they_should_and_only_then(self):
        done = self.rule_tests()
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_the_rule_tests_notice_an_alert_that_always_or_never_fires(self):
        for alert in alerts():
            for expression in (ALWAYS, NEVER):
                with self.subTest(alert=alert["alert"], expression=expression):
                    done = self.rule_tests(alert["alert"], expression)
                    self.assertIn("FAILED", done.stdout + done.stderr)
                    self.assertNotEqual(done.returncode, 0)

    def test_names_are_exported_or_recorded(self):
        recorded = {rule["record"] for rule in rules("rules.yaml")}
        known = exported_names() | recorded | OF_PROMETHEUS
        self.assertIn("holdfast_frames_total", known)
        for rule in rules("rules.yaml") + alerts():
            found = names_in(rule["expr"])
            self.assertTrue(found, rule)
            self.assertLessEqual(found, known, rule)
        self.assertFalse(names_in("rate(holdfast_no_such_total[5m])") <= known)
        self.assertFalse(names_in("job:holdfast_no_such:rate5m > 1") <= known)


class AlertmanagerTest(unittest.TestCase):
    def test_amtool_accepts_the_sample(self):
        done = run("amtool", "check-config", DEPLOY / "alertmanager.yaml")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_amtool_finds_what_is_wrong(self):
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as bad:
            bad.write("route: {receiver: someone}\nreceivers: [{name: else}]\n")
            bad.flush()
            self.assertNotEqual(run("amtool", "check-config", bad.name).returncode, 0)

    def test_each_alert_goes_to_who_its_severity_calls(self):
        for alert in alerts():
            severity = alert["labels"]["severity"]
            done = run("amtool", "config", "routes", "test", f"--config.file={DEPLOY / 'alertmanager.yaml'}",
                       f"--verify.receivers={RECEIVERS[severity]}", f"alertname={alert['alert']}",
                       f"severity={severity}", "job=holdfast")
            self.assertEqual(done.returncode, 0, f"{alert['alert']}: {done.stdout}{done.stderr}")


class RunbookTest(unittest.TestCase):
    @staticmethod
    def sections():
        """{heading: text} of the runbook."""
        text = (SOURCE / RUNBOOK).read_text(encoding="utf-8")
        parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)
        return dict(zip(parts[1::2], parts[2::2]))

    def test_each_alert_has_its_section_and_each_section_its_alert(self):
        sections = self.sections()
        self.assertEqual([alert["alert"] for alert in alerts()], [name for name in sections if " " not in name])
        for alert in alerts():
            self.assertEqual(alert["annotations"]["runbook_url"], f"{RUNBOOK}#{alert['alert'].lower()}")

    def test_a_section_says_what_to_do_and_when_to_call_for_help(self):
        for alert in alerts():
            found = re.findall(r"^\*\*(.+?)\*\*", self.sections()[alert["alert"]], flags=re.MULTILINE)
            self.assertEqual(found, PARTS, alert["alert"])

    def test_logs_of_many_pods_are_asked_for_whole(self):
        """kubectl shows ten lines of each pod that a selector finds, unless it is told how many."""
        commands = re.findall(r"`(kubectl logs [^`]*)`", (SOURCE / RUNBOOK).read_text(encoding="utf-8"))
        selecting = [command for command in commands if " -l " in command]
        self.assertTrue(selecting)
        for command in selecting:
            self.assertRegex(command, r" --tail=-1 --since=\w+ --prefix\b")

    def test_metrics_of_the_runbook_exist(self):
        known = exported_names() | {rule["record"] for rule in rules("rules.yaml")}
        for text in self.sections().values():
            found = set(re.findall(r"\b(?:holdfast|process)_\w+", re.sub(r"job\w*:\S+", "", text)))
            self.assertLessEqual(found, known)


if __name__ == "__main__":
    unittest.main(verbosity=2)
