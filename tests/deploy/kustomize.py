# SPDX-License-Identifier: Apache-2.0
"""What the kustomizations of deploy/kubernetes/ become.

The kubectl of Debian 12 has a kustomize that knows neither components nor directories as resources. So a kustomization
and all that it names is laid flat first, one list of files and one of patches in the order in which they would be
taken, and that is given to kubectl. Only what these kustomizations use is understood; anything else is an error.
"""
import pathlib
import shutil
import subprocess
import tempfile

import yaml

from tools import tool

UNDERSTOOD = {"apiVersion", "kind", "resources", "components", "patches", "configMapGenerator", "generatorOptions"}


def read_yaml(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


class Flat:
    """Collects files under names of their own in a directory, and the kustomization that names them."""

    def __init__(self, directory):
        self.directory = directory
        self.content = {"resources": [], "patchesStrategicMerge": [], "configMapGenerator": []}

    def copy(self, path):
        name = f"{len(list(self.directory.iterdir()))}-{path.name}"
        shutil.copy(path, self.directory / name)
        return name

    def add(self, directory):
        content = read_yaml(directory / "kustomization.yaml")
        unknown = set(content) - UNDERSTOOD
        if unknown:
            raise ValueError(f"{directory}/kustomization.yaml: {sorted(unknown)} is not understood here")
        for name in content.get("resources", []):
            if (directory / name).is_dir():
                self.add((directory / name).resolve())
            else:
                self.content["resources"].append(self.copy(directory / name))
        for name in content.get("components", []):
            self.add((directory / name).resolve())
        for patch in content.get("patches", []):
            if set(patch) != {"path"}:
                raise ValueError(f"{directory}/kustomization.yaml: a patch that is not a path is not understood here")
            self.content["patchesStrategicMerge"].append(self.copy(directory / patch["path"]))
        for generator in content.get("configMapGenerator", []):
            files = [f"{name}={self.copy(directory / name)}" for name in generator["files"]]
            self.content["configMapGenerator"].append({**generator, "files": files})
        if "generatorOptions" in content:
            self.content["generatorOptions"] = content["generatorOptions"]


def documents(kubectl, directory):
    done = subprocess.run([kubectl, "kustomize", str(directory)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise ValueError(done.stderr)
    return [document for document in yaml.safe_load_all(done.stdout) if document is not None]


def render(directory, components=()):
    """The objects of the kustomization in 'directory', with these components' directories added."""
    with tempfile.TemporaryDirectory(prefix="holdfast-kustomize-") as scratch:
        flat = Flat(pathlib.Path(scratch))
        flat.add(directory)
        for component in components:
            flat.add(component)
        (flat.directory / "kustomization.yaml").write_text(yaml.safe_dump(flat.content), encoding="utf-8")
        return documents(tool("kubectl"), flat.directory)
