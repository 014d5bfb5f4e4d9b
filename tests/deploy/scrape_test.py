# SPDX-License-Identifier: Apache-2.0
"""What Prometheus scrapes in a cluster, by deploy/kubernetes/scrape.yaml and by the PodMonitor, as promtool sees it.

The pods of the kustomizations are told to promtool as Kubernetes' service discovery would tell them to Prometheus.
"""
import itertools
import json
import re
import subprocess
import tempfile
import unittest

from kubernetes_test import pod_templates, rendered, selects
from kustomize import read_yaml
from tools import DEPLOY, tool

INDEX = "batch.kubernetes.io/job-completion-index"
REPLICA_TYPE = "training.kubeflow.org/replica-type"


def pods_of(item):
    """Name, labels and template of each pod that the object starts, with the labels that its controller gives them."""
    name, spec = item["metadata"]["name"], item.get("spec", {})
    if item["kind"] == "PyTorchJob":
        for kind, replica in spec["pytorchReplicaSpecs"].items():
            for index in range(replica["replicas"]):
                yield f"{name}-{kind.lower()}-{index}", {REPLICA_TYPE: kind.lower()}, replica["template"]
    else:
        for template in pod_templates(item):
            for index in range(spec.get("completions", spec.get("replicas"))):
                yield f"{name}-{index}", {INDEX: str(index)} if item["kind"] == "Job" else {}, template


def discovered(kustomization, phase="Running"):
    """The labels of each target that service discovery of role pod finds."""
    for item in rendered(kustomization):
        for name, labels, template in pods_of(item):
            labels = {**template["metadata"]["labels"], **labels}
            for port in template["spec"]["containers"][0].get("ports", []):
                meta = {"namespace": "tracking", "pod_name": name, "pod_phase": phase,
                        "pod_container_port_name": port["name"],
                        **{"pod_label_" + re.sub(r"\W", "_", key): value for key, value in labels.items()}}
                yield f"{name}:{port['containerPort']}", {f"__meta_kubernetes_{key}": meta[key] for key in meta}, labels


def scraped(targets, relabel_configs):
    """Labels of what is left of the targets, by address."""
    job = {"job_name": "pods", "relabel_configs": relabel_configs,
           "static_configs": [{"targets": [address], "labels": meta} for address, meta, _ in targets]}
    with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
        json.dump({"scrape_configs": [job]}, file)
        file.flush()
        done = subprocess.run([tool("promtool"), "check", "service-discovery", "--timeout=3s", file.name, "pods"],
                              capture_output=True, text=True, check=True)
    found = [target["labels"] for target in json.loads(done.stdout)]
    return {labels["instance"]: labels for labels in found if labels}


def snake_case(rule):
    return {re.sub("[A-Z]", lambda letter: "_" + letter[0].lower(), key): value for key, value in rule.items()}


class ScrapeTest(unittest.TestCase):
    kustomizations = ["base", "training/job", "training/pytorchjob", "batch"]
    wanted = {"holdfast-0:9464": "holdfast", "holdfast-1:9464": "holdfast",
              "holdfast-training-0:9464": "holdfast-training",
              "holdfast-training-master-0:9464": "holdfast-training"}

    def test_servers_and_rank_0_of_trainings_are_scraped_under_the_names_of_the_rules(self):
        (job,) = read_yaml(DEPLOY / "kubernetes" / "scrape.yaml")["scrape_configs"]
        self.assertEqual(job["kubernetes_sd_configs"], [{"role": "pod"}])
        targets = list(itertools.chain.from_iterable(map(discovered, self.kustomizations)))
        self.assertGreater(len(targets), 2 * len(self.wanted))
        found = scraped(targets, job["relabel_configs"])
        self.assertEqual({instance: labels["job"] for instance, labels in found.items()}, self.wanted)
        for instance, labels in found.items():  # by which autoscalers find the pod
            self.assertEqual((labels["namespace"], labels["pod"]), ("tracking", instance.split(":")[0]))
        self.assertEqual(scraped(list(discovered("training/job", "Succeeded")), job["relabel_configs"]), {})

    def test_the_pod_monitor_chooses_the_same(self):
        spec = next(item for item in rendered("base", ("pod-monitor",)) if item["kind"] == "PodMonitor")["spec"]
        (endpoint,) = spec["podMetricsEndpoints"]
        self.assertEqual(spec["jobLabel"], "app.kubernetes.io/name")
        targets = [target for name in self.kustomizations for target in discovered(name)
                   if selects(spec["selector"], target[2])
                   and target[1]["__meta_kubernetes_pod_container_port_name"] == endpoint["port"]]
        self.assertEqual(set(scraped(targets, [snake_case(rule) for rule in endpoint["relabelings"]])),
                         set(self.wanted))

    def test_no_pod_asks_to_be_scraped_that_serves_nothing(self):
        """The usual annotation stands in the template of all ranks, of which one alone serves metrics."""
        for name in self.kustomizations:
            for template in itertools.chain.from_iterable(map(pod_templates, rendered(name))):
                asks = "prometheus.io/scrape" in template["metadata"].get("annotations", {})
                self.assertEqual(asks, name == "base")


if __name__ == "__main__":
    unittest.main(verbosity=2)
