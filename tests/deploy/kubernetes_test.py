# SPDX-License-Identifier: Apache-2.0
"""The kustomizations of deploy/kubernetes/, rendered: fields and types as Kubernetes has them, and what fits together.

kubernetes_schemas.json (made by make_schemas.py) knows fields and types. What no schema knows is looked at here: names
by which objects find each other, flags, metrics, and the time that a server gets to end. Faults that are put in on
purpose must be found.
"""
import copy
import functools
import itertools
import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

import jsonschema
import yaml

from alerts_test import alerts, exported_names, names_in
from kustomize import documents, read_yaml, render
from tools import DEPLOY, SOURCE, tool

KUBERNETES = DEPLOY / "kubernetes"
KUSTOMIZATIONS = ["base", "overlays/production", "training/job", "training/pytorchjob", "batch"]
COMPONENTS = sorted(path.parent.name for path in (KUBERNETES / "components").glob("*/kustomization.yaml"))
EXCLUSIVE = {"autoscaling", "keda"}  # both say how many servers there are
# Where the flags of a container's program are defined, by the container's name.
FLAGS = {"server": "server/flags.cc", "client": "client/cli/command_line.cc", "trainer": "training/flags.cc",
         "pytorch": "training/flags.cc"}
# What says how many threads compute; the programs' own choice knows limits of CPU, and no requests.
THREADS = {"server": "HOLDFAST_COMPUTE_THREADS", "trainer": "HOLDFAST_THREADS", "pytorch": "HOLDFAST_THREADS"}


@functools.lru_cache(maxsize=None)
def schemas():
    return json.loads((pathlib.Path(__file__).parent / "kubernetes_schemas.json").read_text(encoding="utf-8"))


@functools.lru_cache(maxsize=None)
def rendered(name, components=()):
    return tuple(render(KUBERNETES / name, [KUBERNETES / "components" / component for component in components]))


def number_in_source(file, pattern):
    return float(re.search(pattern, (SOURCE / file).read_text(encoding="utf-8"))[1])


def name_of(item):
    return f"{item['kind']} {item['metadata']['name']}"


def schema_findings(item):
    kind = f"{item.get('apiVersion')}/{item.get('kind')}"
    if kind not in schemas()["definitions"]:
        return [f"{kind} is not known"]
    pointer = kind.replace("/", "~1")  # a slash within a name
    validator = jsonschema.Draft7Validator({**schemas(), "$ref": f"#/definitions/{pointer}"})
    return [f"{name_of(item)}: {'.'.join(map(str, error.absolute_path))}: {error.message}"
            for error in validator.iter_errors(item)]


def pod_templates(item):
    """Templates of the pods that an object starts."""
    if item["kind"] == "PyTorchJob":
        return [replica["template"] for replica in item["spec"]["pytorchReplicaSpecs"].values()]
    return [item["spec"]["template"]] if "template" in item.get("spec", {}) else []


def selects(selector, labels):
    for wanted in selector.get("matchExpressions", []):
        if wanted["operator"] != "In" or labels.get(wanted["key"]) not in wanted["values"]:
            return False
    return all(labels.get(key) == value for key, value in selector.get("matchLabels", {}).items())


def port_names(template):
    return {port["name"] for container in template["spec"]["containers"] for port in container.get("ports", [])}


def mounted_paths(container):
    return {mount["mountPath"] for mount in container.get("volumeMounts", [])}


def temporary_directory(container):
    values = {variable["name"]: variable.get("value") for variable in container.get("env", [])}
    return values.get("TMPDIR", "/var/tmp")


def bounds_threads(container):
    wanted = {"name": THREADS[container["name"]],
              "valueFrom": {"resourceFieldRef": {"resource": "requests.cpu"}}}
    return "cpu" in container.get("resources", {}).get("limits", {}) or wanted in container.get("env", [])


def pod_findings(item, template):
    """Of one template: safe by default, and every name in it leads somewhere."""
    spec = template["spec"]
    volumes = {volume["name"] for volume in spec.get("volumes", [])}
    if spec.get("enableServiceLinks") is not False:
        yield "Kubernetes would set variables HOLDFAST_..., which are flags"
    if spec.get("automountServiceAccountToken") is not False:
        yield "has a token of the cluster, and needs none"
    if not spec.get("securityContext", {}).get("runAsNonRoot"):
        yield "may run as root"
    for container in spec["containers"]:
        security = container.get("securityContext", {})
        if (security.get("allowPrivilegeEscalation") is not False or not security.get("readOnlyRootFilesystem")
                or security.get("capabilities") != {"drop": ["ALL"]}):
            yield f"container {container['name']} may do more than it must"
        if "memory" not in container.get("resources", {}).get("limits", {}):
            yield f"container {container['name']} has no limit of memory"
        if container["name"] == "client" and temporary_directory(container) not in mounted_paths(container):
            yield "--both keeps frames where nothing can be written: TMPDIR is not mounted"
        if container["name"] in THREADS and not bounds_threads(container):
            yield f"container {container['name']} starts a thread for every core of its node"
        if container["image"] != f"holdfast-{container['name'].replace('pytorch', 'trainer')}":
            yield f"container {container['name']} has the image {container['image']}"
        mounted = {mount["name"] for mount in container.get("volumeMounts", [])}
        for name in mounted ^ volumes:
            yield f"volume {name} is mounted and not there, or there and not mounted"
        flags = (SOURCE / FLAGS[container["name"]]).read_text(encoding="utf-8")
        for variable in container.get("env", []):
            flag = variable["name"].removeprefix("HOLDFAST_").lower()
            if variable["name"].startswith("HOLDFAST_") and not re.search(rf"\b{flag}\b", flags):
                yield f"{variable['name']}: there is no flag --{flag}"
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            port = container.get(probe, {}).get("httpGet", {}).get("port")
            if port is not None and port not in port_names(template):
                yield f"{probe}: there is no port {port}"
            if "grpc" in container.get(probe, {}):
                yield f"{probe}: by gRPC it fails with --tls_cert and with --noopen_health"
    if item["kind"] == "Deployment":
        yield from drain_findings(spec)


def drain_findings(spec):
    """A server has the time to hand its sessions on: preStop, --grace_period and the sending of checkpoints."""
    server = spec["containers"][0]
    values = {variable["name"]: variable.get("value") for variable in server["env"]}
    grace = values.get("HOLDFAST_GRACE_PERIOD", "20s")
    sleep = server.get("lifecycle", {}).get("preStop", {}).get("sleep", {}).get("seconds", 0)
    flush = number_in_source("server/streams/served_streams.cc", r"kFlushTime = absl::Seconds\((\d+)\)")
    needed = sleep + int(grace.removesuffix("s")) + flush
    if sleep < 1:
        yield "no preStop: a server refuses sessions before it is out of the Service"
    if spec.get("terminationGracePeriodSeconds", 30) < needed:
        yield f"a server is killed before it has ended, which may take {needed:.0f} s"


def joint_findings(items):
    """What the objects of one kustomization want of each other."""
    templates = [(item, template) for item in items for template in pod_templates(item)]
    for item, template in templates:
        for text in pod_findings(item, template):
            yield f"{name_of(item)}: {text}"
    for item in items:
        kind, spec = item["kind"], item.get("spec", {})
        selector = spec.get("podSelector", spec.get("selector"))
        if kind == "Service":
            selector = {"matchLabels": selector}
        if kind in ("Service", "Deployment", "PodDisruptionBudget", "NetworkPolicy", "PodMonitor"):
            chosen = [template for _, template in templates if selects(selector, template["metadata"]["labels"])]
            ports = set().union(*map(port_names, chosen))
            if not chosen:
                yield f"{name_of(item)}: selects no pod"
            for port in ports_of(item):
                if isinstance(port, str) and port not in ports:
                    yield f"{name_of(item)}: its pods have no port {port}"
        if kind in ("HorizontalPodAutoscaler", "ScaledObject"):
            yield from scaling_findings(item, items)
        if kind == "GRPCRoute":
            yield from route_findings(item, items)
        if kind == "Job" and spec.get("completionMode") == "Indexed":
            yield from job_findings(item)
    if sum(item["kind"] in ("HorizontalPodAutoscaler", "ScaledObject") for item in items) > 1:
        yield "two objects say how many servers there are"
    yield from claim_findings(items, templates)


def ports_of(item):
    spec = item["spec"]
    if item["kind"] == "Service":
        return [port["targetPort"] for port in spec["ports"] if "targetPort" in port]
    if item["kind"] == "NetworkPolicy":
        return [port["port"] for rule in spec.get("ingress", []) for port in rule["ports"]]
    if item["kind"] == "PodMonitor":
        return [endpoint["port"] for endpoint in spec["podMetricsEndpoints"]]
    return []


def scaling_findings(item, items):
    spec = item["spec"]
    target = next((other for other in items if other["kind"] == "Deployment"
                   and other["metadata"]["name"] == spec["scaleTargetRef"]["name"]), None)
    if target is None:
        yield f"{name_of(item)}: there is no such Deployment"
    elif "replicas" in target["spec"]:
        yield f"{name_of(item)}: the Deployment says too how many there are"
    most = number_in_source("server/engine/engine_options.h", r"int max_sessions = (\d+);")
    if item["kind"] == "ScaledObject":
        names = set().union(*(names_in(trigger["metadata"]["query"]) for trigger in spec["triggers"]))
        sessions = float(spec["triggers"][0]["metadata"]["threshold"])
    else:
        names = {metric["pods"]["metric"]["name"] for metric in spec["metrics"]}
        sessions = float(spec["metrics"][0]["pods"]["target"]["averageValue"])
    for name in names - exported_names():
        yield f"{name_of(item)}: nobody exports {name}"
    if not 0.5 * most <= sessions <= 0.75 * most:
        yield f"{name_of(item)}: {sessions} sessions a server, of {most}"


def route_findings(item, items):
    text = (SOURCE / "proto/holdfast/v1/point_tracking.proto").read_text(encoding="utf-8")
    package, service = re.search(r"package (\S+);", text)[1], re.search(r"service (\w+)", text)[1]
    known = {f"{package}.{service}", "grpc.health.v1.Health"}
    services = {other["metadata"]["name"]: {port["port"] for port in other["spec"]["ports"]}
                for other in items if other["kind"] == "Service"}
    for rule in item["spec"]["rules"]:
        for match in rule["matches"]:
            if match["method"]["service"] not in known:
                yield f"{name_of(item)}: the server has no service {match['method']['service']}"
        for backend in rule["backendRefs"]:
            if backend["port"] not in services.get(backend["name"], set()):
                yield f"{name_of(item)}: no Service {backend['name']} has port {backend['port']}"


def job_findings(item):
    """The number of pods is said twice: to Kubernetes, and to the program."""
    container = item["spec"]["template"]["spec"]["containers"][0]
    number = item["spec"]["completions"]
    world = [variable["value"] for variable in container["env"] if variable["name"] == "WORLD_SIZE"]
    if container["name"] == "trainer" and world != [str(number)]:
        yield f"{name_of(item)}: WORLD_SIZE is not {number}"
    if container["name"] == "client" and container["command"][2] != str(number):
        yield f"{name_of(item)}: track.sh is not told of {number} shards"


def claim_findings(items, templates):
    names = {(item["kind"], item["metadata"]["name"]) for item in items}
    for item, template in templates:
        for volume in template["spec"].get("volumes", []):
            claim = volume.get("persistentVolumeClaim", {}).get("claimName")
            if claim and ("PersistentVolumeClaim", claim) not in names:
                yield f"{name_of(item)}: there is no claim {claim}"
            configuration = volume.get("configMap", {}).get("name")
            if configuration and ("ConfigMap", configuration) not in names:
                yield f"{name_of(item)}: there is no ConfigMap {configuration}"


def findings(items):
    wrong = [text for item in items for text in schema_findings(item)]
    return wrong or list(joint_findings(items))  # the second look trusts the first


def selections():
    """Components that may be taken together: each one, each two, and as many as can be."""
    for number in (1, 2, len(COMPONENTS) - 1):
        for chosen in itertools.combinations(COMPONENTS, number):
            if not EXCLUSIVE <= set(chosen):
                yield chosen


class ManifestsTest(unittest.TestCase):
    def test_every_kustomization_is_looked_at(self):
        found = {path.parent.relative_to(KUBERNETES).as_posix() for path in KUBERNETES.rglob("kustomization.yaml")}
        parts = {f"components/{name}" for name in COMPONENTS} | {"training/base"}
        self.assertEqual(found, set(KUSTOMIZATIONS) | parts)
        used = {path.name for path in KUBERNETES.rglob("*.yaml")}
        used -= {"kustomization.yaml", "adapter-rules.yaml", "scrape.yaml"}
        named = "".join(path.read_text(encoding="utf-8") for path in KUBERNETES.rglob("kustomization.yaml"))
        self.assertEqual({name for name in used if name not in named}, set())

    def test_every_kustomization_is_right(self):
        for name in KUSTOMIZATIONS:
            with self.subTest(name):
                self.assertEqual(findings(rendered(name)), [])

    def test_components_go_together(self):
        chosen = list(selections())
        self.assertGreater(len(chosen), 20)
        for components in chosen:
            with self.subTest(components):
                self.assertEqual(findings(rendered("base", components)), [])

    def test_a_component_does_what_it_is_for(self):
        def pod(components):
            return pod_templates(next(item for item in rendered("base", components) if item["kind"] == "Deployment"))[0]

        self.assertIn("prometheus.io/scrape", pod(())["metadata"]["annotations"])
        self.assertFalse(pod(("pod-monitor",))["metadata"].get("annotations"))
        self.assertIn({"name": "HOLDFAST_CHECKPOINT_KEYS", "value": "/run/checkpoint-keys/keys"},
                      pod(("resume-keys",))["spec"]["containers"][0]["env"])
        self.assertIn({"name": "HOLDFAST_OTLP_ENDPOINT", "value": "collector.monitoring:4317"},
                      pod(("tracing",))["spec"]["containers"][0]["env"])
        services = [item for item in rendered("base", ("headless-service",)) if item["kind"] == "Service"]
        self.assertEqual([item["spec"].get("clusterIP") for item in services].count("None"), 1)
        self.assertEqual(len(pod(("topology-spread",))["spec"]["topologySpreadConstraints"]), 2)

    def test_spans_get_past_the_policies(self):
        policies = [item["spec"] for item in rendered("base", ("network-policy", "tracing"))
                    if item["kind"] == "NetworkPolicy"]
        ways = {(rule["to"][0]["namespaceSelector"]["matchLabels"]["kubernetes.io/metadata.name"], port["port"])
                for policy in policies for rule in policy["egress"] for port in rule["ports"]}
        self.assertEqual(ways, {("monitoring", 4317), ("kube-system", 53)})  # the collector, and its name

    def test_a_newer_kustomize_says_the_same(self):
        program = shutil.which("kubectl")
        done = subprocess.run([program or "false", "version", "--client"], capture_output=True, text=True, check=False)
        if not re.search(r"Kustomize Version: v[5-9]", done.stdout):
            self.skipTest("there is no kubectl with kustomize 5 or newer")

        def by_name(items):
            return sorted(items, key=name_of)

        for name in KUSTOMIZATIONS:
            self.assertEqual(by_name(documents(program, KUBERNETES / name)), by_name(rendered(name)), name)
        everything = tuple(name for name in COMPONENTS if name != "keda")
        with tempfile.TemporaryDirectory(prefix="holdfast-kustomize-") as scratch:
            root = os.path.relpath(KUBERNETES, scratch)
            (pathlib.Path(scratch) / "kustomization.yaml").write_text(yaml.safe_dump({
                "resources": [f"{root}/base"], "components": [f"{root}/components/{name}" for name in everything]}))
            self.assertEqual(by_name(documents(program, scratch)), by_name(rendered("base", everything)))

    def test_rules_of_the_adapter_are_promql_over_exported_metrics(self):
        rules = read_yaml(KUBERNETES / "components/autoscaling/adapter-rules.yaml")["rules"]
        autoscaler = next(item for item in rendered("base", ("autoscaling",))
                          if item["kind"] == "HorizontalPodAutoscaler")
        self.assertEqual([rule["name"]["as"] for rule in rules],
                         [metric["pods"]["metric"]["name"] for metric in autoscaler["spec"]["metrics"]])
        for rule in rules:
            self.assertEqual(set(rule), {"seriesQuery", "resources", "name", "metricsQuery"})
            self.assertLessEqual(names_in(rule["seriesQuery"]), exported_names())
            query = rule["metricsQuery"]
            for placeholder, value in (("<<.Series>>", rule["name"]["as"]), ("<<.GroupBy>>", "pod"),
                                       ("<<.LabelMatchers>>", 'namespace="n",pod=~"a|b"')):
                self.assertIn(placeholder, query)
                query = query.replace(placeholder, value)
            self.assert_promql(query, rule["seriesQuery"])

    def test_queries_of_keda_are_promql(self):
        scaled = next(item for item in rendered("base", ("keda",)) if item["kind"] == "ScaledObject")
        self.assert_promql(*(trigger["metadata"]["query"] for trigger in scaled["spec"]["triggers"]))

    def test_keda_counts_the_work_that_is_promised_and_no_frames_that_wait(self):
        scaled = next(item for item in rendered("base", ("keda",)) if item["kind"] == "ScaledObject")
        work = next(trigger["metadata"] for trigger in scaled["spec"]["triggers"] if trigger["name"] == "work")
        for name in set().union(*(names_in(trigger["metadata"]["query"]) for trigger in scaled["spec"]["triggers"])):
            self.assertNotIn("lag", name)
        servers = {"a": (450, 380), "b": (150, 420), "loading": (0, 0)}  # work promised, and the budget for it
        series = [{"series": f'holdfast_work_{name}{{job="holdfast", instance="{server}"}}', "values": str(value)}
                  for server, values in servers.items() for name, value in zip(("promised", "budget"), values)]
        self.assert_value(work["query"], series, 1.5)  # budgets of a server; at three quarters of each, two servers
        self.assert_value(work["query"], [], 0)
        self.assertEqual(float(work["threshold"]), 0.75)

    def assert_value(self, expression, series, value):
        self.assert_promtool("test", {"tests": [{"input_series": series, "promql_expr_test": [
            {"expr": expression, "eval_time": "0m", "exp_samples": [{"labels": "{}", "value": value}]}]}]})

    def assert_promql(self, *expressions):
        rules = [{"record": f"r{number}", "expr": expression} for number, expression in enumerate(expressions)]
        self.assert_promtool("check", {"groups": [{"name": "g", "rules": rules}]})

    def assert_promtool(self, command, content):
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            yaml.safe_dump(content, file)
            done = subprocess.run([tool("promtool"), command, "rules", file.name], capture_output=True, text=True,
                                  check=False)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)

    def test_the_alert_about_memory_knows_the_limit(self):
        alert = next(rule for rule in alerts() if rule["alert"] == "HoldfastMemoryHigh")
        gibibytes = re.search(r"> 0\.9 \* (\d+) \* 1024 \^ 3$", alert["expr"])[1]
        server = pod_templates(next(item for item in rendered("base") if item["kind"] == "Deployment"))[0]
        self.assertEqual(server["spec"]["containers"][0]["resources"]["limits"]["memory"], f"{gibibytes}Gi")
        compose = read_yaml(DEPLOY / "compose.yaml")["services"]["server"]
        self.assertEqual(compose["deploy"]["resources"]["limits"]["memory"], f"{gibibytes}g")

    def test_compose_takes_no_variable_that_bash_exports_to_nobody(self):
        self.assertNotRegex((DEPLOY / "compose.yaml").read_text(encoding="utf-8"), r"\$\{?(E?UID|GID|GROUPS)\b")

    def test_compose_gives_the_server_time_to_end(self):
        server = read_yaml(DEPLOY / "compose.yaml")["services"]["server"]
        grace = int(server["environment"]["HOLDFAST_GRACE_PERIOD"].removesuffix("s"))
        flush = number_in_source("server/streams/served_streams.cc", r"kFlushTime = absl::Seconds\((\d+)\)")
        self.assertGreater(int(server["stop_grace_period"].removesuffix("s")), grace + flush)


class SeededFaultsTest(unittest.TestCase):
    """What the test above would be worth nothing without: each of these must be found."""

    def assert_found(self, expected, name, kind, change, components=()):
        items = copy.deepcopy(rendered(name, components))
        item = next(item for item in items if item["kind"] == kind)
        change(item)
        found = findings(items)
        self.assertTrue(any(expected in text for text in found), f"{expected!r} is not in {found}")

    def pod(self, expected, change, name="base", kind="Deployment"):
        self.assert_found(expected, name, kind, lambda item: change(item["spec"]["template"]["spec"]))

    def test_a_field_that_does_not_exist(self):
        self.assert_found("replcas", "base", "Deployment", lambda item: item["spec"].update(replcas=2))
        self.pod("livenesProbe", lambda spec: spec["containers"][0].update(livenesProbe={}))
        self.assert_found("targetCPU", "base", "HorizontalPodAutoscaler",
                          lambda item: item["spec"].update(targetCPU=80), ("autoscaling",))
        self.assert_found("treshold", "base", "ScaledObject",
                          lambda item: item["spec"]["triggers"][0].update(treshold="1"), ("keda",))
        self.assert_found("timeouts", "base", "GRPCRoute",
                          lambda item: item["spec"]["rules"][0].update(timeouts={"request": "0s"}), ("gateway",))
        self.assert_found("podMetricEndpoints", "base", "PodMonitor",
                          lambda item: item["spec"].update(podMetricEndpoints=[]), ("pod-monitor",))
        self.assert_found("workers", "training/pytorchjob", "PyTorchJob", lambda item: item["spec"].update(workers=3))

    def test_a_value_of_the_wrong_type(self):
        self.assert_found("'2' is not of type 'integer'", "base", "Deployment",
                          lambda item: item["spec"].update(replicas="2"))
        self.pod("30 is not of type 'string'", lambda spec: spec["containers"][0]["env"][0].update(value=30))
        self.assert_found("12 is not of type 'string'", "base", "ScaledObject",
                          lambda item: item["spec"]["triggers"][0]["metadata"].update(threshold=12), ("keda",))
        self.assert_found("'Maybe' is not one of", "base", "PodDisruptionBudget",
                          lambda item: item["spec"].update(unhealthyPodEvictionPolicy="Maybe"))

    def test_a_field_that_is_missing(self):
        self.pod("'name' is a required property", lambda spec: spec["containers"][0].pop("name"))
        self.assert_found("'selector' is a required property", "base", "Deployment",
                          lambda item: item["spec"].pop("selector"))
        self.assert_found("'scaleTargetRef' is a required property", "base", "HorizontalPodAutoscaler",
                          lambda item: item["spec"].pop("scaleTargetRef"), ("autoscaling",))

    def test_a_kind_or_version_that_does_not_exist(self):
        self.assert_found("autoscaling/v2beta1/HorizontalPodAutoscaler is not known", "base", "HorizontalPodAutoscaler",
                          lambda item: item.update(apiVersion="autoscaling/v2beta1"), ("autoscaling",))

    def test_names_that_lead_nowhere(self):
        self.assert_found("have no port gprc", "base", "Service",
                          lambda item: item["spec"]["ports"][0].update(targetPort="gprc"))
        self.assert_found("selects no pod", "base", "PodDisruptionBudget",
                          lambda item: item["spec"]["selector"]["matchLabels"].update(a="b"))
        self.assert_found("have no port metrics", "base", "NetworkPolicy",
                          lambda item: item["spec"]["ingress"][1]["ports"][0].update(port="metrics"),
                          ("network-policy",))
        self.assert_found("no such Deployment", "base", "ScaledObject",
                          lambda item: item["spec"]["scaleTargetRef"].update(name="hold"), ("keda",))
        self.assert_found("no Service holdfast has port 80", "base", "GRPCRoute",
                          lambda item: item["spec"]["rules"][0]["backendRefs"][0].update(port=80), ("gateway",))
        self.assert_found("no service holdfast.v1.Tracking", "base", "GRPCRoute",
                          lambda item: item["spec"]["rules"][0]["matches"][0]["method"].update(
                              service="holdfast.v1.Tracking"), ("gateway",))
        self.pod("volume tmp", lambda spec: spec["volumes"].clear())
        self.pod("TMPDIR is not mounted", lambda spec: spec["containers"][0]["env"].pop(), "batch", "Job")
        self.pod("no claim", lambda spec: spec["volumes"][0]["persistentVolumeClaim"].update(claimName="c"),
                 "training/job", "Job")
        self.pod("there is no port metrics", lambda spec: spec["containers"][0]["readinessProbe"]["httpGet"].update(
            port="metrics"))

    def test_a_probe_that_tls_or_tokens_would_fail(self):
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            self.pod(f"{probe}: by gRPC",
                     lambda spec, probe=probe: spec["containers"][0].update({probe: {"grpc": {"port": 50051}}}))

    def test_numbers_flags_and_metrics_that_do_not_fit(self):
        self.pod("killed before it has ended", lambda spec: spec.update(terminationGracePeriodSeconds=44))
        self.pod("no preStop", lambda spec: spec["containers"][0].pop("lifecycle"))
        self.pod("there is no flag --grace", lambda spec: spec["containers"][0]["env"].append(
            {"name": "HOLDFAST_GRACE", "value": "30s"}))
        self.pod("WORLD_SIZE is not 4", lambda spec: spec["containers"][0]["env"][1].update(value="3"),
                 "training/job", "Job")
        self.assert_found("not told of 9 shards", "batch", "Job", lambda item: item["spec"].update(completions=9))
        self.assert_found("says too how many", "base", "Deployment", lambda item: item["spec"].update(replicas=2),
                          ("autoscaling",))
        self.assert_found("nobody exports holdfast_sessions", "base", "HorizontalPodAutoscaler",
                          lambda item: item["spec"]["metrics"][0]["pods"]["metric"].update(name="holdfast_sessions"),
                          ("autoscaling",))
        self.assert_found("16.0 sessions a server", "base", "HorizontalPodAutoscaler",
                          lambda item: item["spec"]["metrics"][0]["pods"]["target"].update(averageValue="16"),
                          ("autoscaling",))

    def test_pods_that_may_too_much(self):
        self.pod("variables HOLDFAST_", lambda spec: spec.pop("enableServiceLinks"))
        self.pod("token of the cluster", lambda spec: spec.pop("automountServiceAccountToken"))
        self.pod("as root", lambda spec: spec["securityContext"].pop("runAsNonRoot"))
        self.pod("more than it must", lambda spec: spec["containers"][0]["securityContext"].pop("capabilities"))
        self.pod("no limit of memory", lambda spec: spec["containers"][0]["resources"].pop("limits"))
        self.pod("every core of its node", lambda spec: spec["containers"][0]["env"].pop())
        self.pod("every core of its node", lambda spec: spec["containers"][0]["env"].pop(), "training/job", "Job")

    def test_a_patch_of_what_is_not_there(self):
        with tempfile.TemporaryDirectory(prefix="holdfast-kustomize-") as scratch:
            component = pathlib.Path(scratch)
            (component / "kustomization.yaml").write_text("patches: [{path: p.yaml}]\n")
            (component / "p.yaml").write_text("{apiVersion: apps/v1, kind: Deployment, metadata: {name: other}}\n")
            with self.assertRaises(ValueError):
                render(KUBERNETES / "base", [component])

    def test_two_autoscalers_at_once(self):
        found = findings(rendered("base", tuple(sorted(EXCLUSIVE))))
        self.assertIn("two objects say how many servers there are", found)


if __name__ == "__main__":
    unittest.main(verbosity=2)
