# SPDX-License-Identifier: Apache-2.0
"""Prints what an image is made of, as CycloneDX 1.4 in JSON: a program of ours and the Debian packages beside it.

Usage: sbom.py PROGRAM VERSION RELEASE DIRECTORY

RELEASE is the one of the packages, as in debian-12. DIRECTORY has a file of dpkg's status for each package. The same
packages give the same text, so that images stay reproducible: there is no time and no serial number in it.
"""
import json
import pathlib
import sys
import urllib.parse


def read_status(text):
    """The fields of one paragraph of dpkg's status, without those that go on over several lines."""
    fields = (line.split(":", 1) for line in text.splitlines() if ":" in line and not line.startswith(" "))
    return {name: value.strip() for name, value in fields}


def component_of(status, release):
    name, version, architecture = status["Package"], status["Version"], status["Architecture"]
    # Package URLs spell a version's "+", ":" and "~" so: https://github.com/package-url/purl-spec
    purl = f"pkg:deb/debian/{name}@{urllib.parse.quote(version, safe='')}?arch={architecture}&distro={release}"
    component = {"type": "library", "bom-ref": purl, "name": name, "version": version, "purl": purl}
    if "Maintainer" in status:
        component["supplier"] = {"name": status["Maintainer"]}
    source = status.get("Source", name)  # "name" or "name (version)", where advisories look
    component["properties"] = [{"name": "debian:source", "value": source}]
    return component


def make_bom(program, version, release, statuses):
    product = f"pkg:generic/{program}@{urllib.parse.quote(version, safe='')}"
    components = sorted((component_of(status, release) for status in statuses),
                        key=lambda component: component["name"])
    return {
        "bomFormat": "CycloneDX", "specVersion": "1.4", "version": 1,
        "metadata": {"component": {"type": "application", "bom-ref": product, "name": program, "version": version,
                                   "purl": product, "licenses": [{"license": {"id": "Apache-2.0"}}]}},
        "components": components,
        "dependencies": [{"ref": product, "dependsOn": [component["bom-ref"] for component in components]}]}


def main(program, version, release, directory):
    files = sorted(pathlib.Path(directory).iterdir())
    statuses = [read_status(file.read_text(encoding="utf-8")) for file in files]
    print(json.dumps(make_bom(program, version, release, statuses), indent=1))


if __name__ == "__main__":
    main(*sys.argv[1:])
