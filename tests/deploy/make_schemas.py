# SPDX-License-Identifier: Apache-2.0
"""Makes the schemas that the tests of deploy/ judge by, from npm packages that have them.

kubernetes_schemas.json: which fields the manifests' kinds have, from npm packages that hold them as types.

Run by hand when a manifest takes a kind that is not in KINDS, or for a newer Kubernetes; tests read the result and need
no npm. DIRECTORY holds the packages of PACKAGES (MIT licence), each unpacked into the folder of that name:

    npm pack kubernetes-models@5.1.0 @kubernetes-models/apimachinery@3.0.2 @kubernetes-models/gateway-api@2.0.0 \\
      @kubernetes-models/keda@2.0.0 @kubernetes-models/prometheus-operator@6.0.0
    make_schemas.py DIRECTORY > kubernetes_schemas.json

The packages are generated from the definitions that Kubernetes and the makers of the other kinds publish (Apache
License 2.0). Kept are names, types, the values of enumerations, and which fields must be there; a field that is not
known is an error. The format is that of JSON schemas, with a definition "GROUP/VERSION/KIND" for each of KINDS.

cyclonedx_schema.json: CycloneDX 1.4, without what explains it, from the package of that standard (Apache License 2.0):

    npm pack @cyclonedx/cyclonedx-library@10.3.0
    make_schemas.py --cyclonedx DIRECTORY > cyclonedx_schema.json
"""
import json
import pathlib
import re
import sys

PACKAGES = {  # their folder in DIRECTORY: the name by which others import them
    "kubernetes-models": "kubernetes-models",
    "kubernetes-models-apimachinery": "@kubernetes-models/apimachinery",
    "kubernetes-models-gateway-api": "@kubernetes-models/gateway-api",
    "kubernetes-models-keda": "@kubernetes-models/keda",
    "kubernetes-models-prometheus-operator": "@kubernetes-models/prometheus-operator",
}
KINDS = [  # files of types
    "kubernetes-models/apps/v1/Deployment",
    "kubernetes-models/autoscaling/v2/HorizontalPodAutoscaler",
    "kubernetes-models/batch/v1/Job",
    "kubernetes-models/networking.k8s.io/v1/NetworkPolicy",
    "kubernetes-models/policy/v1/PodDisruptionBudget",
    "kubernetes-models/v1/ConfigMap",
    "kubernetes-models/v1/PersistentVolumeClaim",
    "kubernetes-models/v1/Service",
    "kubernetes-models-gateway-api/gateway.networking.k8s.io/v1/GRPCRoute",
    "kubernetes-models-keda/keda.sh/v1alpha1/ScaledObject",
    "kubernetes-models-prometheus-operator/monitoring.coreos.com/v1/PodMonitor",
]
# Of Kubeflow's trainer, which has no such package: its fields by hand, around Kubernetes' own templates of pods.
POD_TEMPLATE = "kubernetes-models/v1/PodTemplateSpec"
PYTORCH_REPLICAS = {
    "type": "object", "additionalProperties": False, "required": ["template"],
    "properties": {"replicas": {"type": "integer", "minimum": 0},
                   "restartPolicy": {"enum": ["Always", "OnFailure", "Never", "ExitCode"]},
                   "template": {"$ref": "#/definitions/PodTemplateSpec"}}}
PYTORCH_JOB = {
    "type": "object", "additionalProperties": False, "required": ["apiVersion", "kind", "spec"],
    "properties": {
        "apiVersion": {"const": "kubeflow.org/v1"}, "kind": {"const": "PyTorchJob"},
        "metadata": {"$ref": "#/definitions/ObjectMeta"},
        "spec": {
            "type": "object", "additionalProperties": False, "required": ["pytorchReplicaSpecs"],
            "properties": {
                "nprocPerNode": {"type": "string"},
                "runPolicy": {
                    "type": "object", "additionalProperties": False,
                    "properties": {"activeDeadlineSeconds": {"type": "integer"}, "backoffLimit": {"type": "integer"},
                                   "cleanPodPolicy": {"enum": ["All", "Running", "None"]},
                                   "suspend": {"type": "boolean"},
                                   "ttlSecondsAfterFinished": {"type": "integer"}}},
                "pytorchReplicaSpecs": {
                    "type": "object", "additionalProperties": False,
                    "properties": {"Master": PYTORCH_REPLICAS, "Worker": PYTORCH_REPLICAS}}}}}}

TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[A-Za-z_]\w*|[{}\[\]()<>?:;|,&]')
SIMPLE = {"string": {"type": "string"}, "number": {"type": "integer"}, "boolean": {"type": "boolean"}, "any": {},
          "unknown": {}, "null": {"type": "null"}}


class Types:
    """Reads files of types and collects a definition for each that another one needs."""

    def __init__(self, directory):
        self.directory = directory
        self.definitions = {}
        self.names = {}  # definition -> the file it is of

    def define(self, path):
        """The name of the definition that the file 'path' (without its ending) becomes."""
        name = path.rsplit("/", 1)[1]
        while self.names.setdefault(name, path) != path:  # two packages or versions with the same name
            name += "_"
        if name not in self.definitions:
            self.definitions[name] = None  # types may hold themselves
            self.definitions[name] = self.read(path)
        return name

    def read(self, path):
        text = (self.directory / f"{path}.d.ts").read_text(encoding="utf-8")
        text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        imports = {name.strip(): self.resolve(path, source)
                   for names, source in re.findall(r'import \{([^}]*)\} from "([^"]+)"', text)
                   for name in names.split(",")}
        alias = re.search(r"export type I\w+ = ([^;]+);", text)
        if alias:
            schema = Parser(alias[1], imports, self).type()
            if "anyOf" in schema:  # quantities, such as 0.5 of a processor
                schema = json.loads(json.dumps(schema).replace('"integer"', '"number"'))
            return schema
        head = re.search(r"export interface I\w+(?: extends ([\w, ]+))? (?=\{)", text)
        schema = Parser(text[head.end():], imports, self).type()
        for base in (head[1] or "TypeMeta").split(", "):
            if base != "TypeMeta":
                inherited = self.definitions[self.define(imports[base])]
                schema["properties"] = {**inherited["properties"], **schema.get("properties", {})}
                schema["required"] = inherited.get("required", []) + schema.get("required", [])
        return schema

    @staticmethod
    def resolve(path, source):
        source = source.removesuffix(".js")
        if source.startswith("."):
            parts = path.split("/")[:-1]
            for part in source.split("/"):
                if part == "..":
                    parts.pop()
                elif part != ".":
                    parts.append(part)
            return "/".join(parts)
        for folder, name in PACKAGES.items():
            if source.startswith(name + "/"):
                return folder + source[len(name):]
        return None


class Parser:
    """Types as the packages write them: objects, maps, arrays, unions, names."""

    def __init__(self, text, imports, types):
        self.tokens = TOKEN.findall(text)
        self.next = 0
        self.imports = imports
        self.types = types

    def take(self, expected=None):
        token = self.tokens[self.next]
        if expected and token != expected:
            raise ValueError(f"{expected} expected, not {self.tokens[self.next:self.next + 8]}")
        self.next += 1
        return token

    def sees(self, token):
        return self.next < len(self.tokens) and self.tokens[self.next] == token

    def type(self):
        choices = [self.single()]
        while self.sees("|"):
            self.take()
            choices.append(self.single())
        if all("const" in choice for choice in choices) and len(choices) > 1:
            return {"enum": [choice["const"] for choice in choices]}
        return choices[0] if len(choices) == 1 else {"anyOf": choices}

    def single(self):
        token = self.take()
        if token == "{":
            return self.object()
        if token == "(":
            inner = self.type()
            self.take(")")
            return inner
        if token == "Array":
            self.take("<")
            items = self.type()
            self.take(">")
            return {"type": "array", "items": items}
        if token.startswith('"'):
            return {"const": json.loads(token)}
        if token in SIMPLE:
            return SIMPLE[token]
        return {"$ref": "#/definitions/" + self.types.define(self.imports[token])}

    def object(self):
        properties, required, rest = {}, [], False
        while not self.sees("}"):
            if self.sees("["):
                while self.take() != "]":
                    pass
                self.take(":")
                rest = self.type()
            else:
                name = json.loads(self.take())
                if self.sees("?"):
                    self.take()
                else:
                    required.append(name)
                self.take(":")
                value = self.type()
                if name != "status" or "spec" not in properties:  # what a cluster writes
                    properties[name] = value
            self.take(";")
        self.take("}")
        schema = {"type": "object", "additionalProperties": rest}
        if properties:
            schema["properties"] = properties
        if required:
            schema["required"] = required
        return schema


def needed(definitions, roots):
    """Those definitions that the roots refer to, themselves included."""
    found, todo = set(), list(roots)
    while todo:
        name = todo.pop()
        if name not in found:
            found.add(name)
            todo += re.findall(r'"#/definitions/([^"]+)"', json.dumps(definitions[name]))
    return {name: definitions[name] for name in sorted(found)}


EXPLANATIONS = {"$comment", "title", "description", "examples", "meta:enum"}


def without_explanations(value):
    """A schema's JSON with what is for readers left out; what it has from other files is taken for good."""
    if isinstance(value, list):
        return [without_explanations(item) for item in value]
    if not isinstance(value, dict):
        return value
    if isinstance(value.get("$ref"), str) and not value["$ref"].startswith("#"):
        return {}
    return {key: without_explanations(item) for key, item in value.items()
            if key not in EXPLANATIONS or not isinstance(item, (str, list))}


def make_cyclonedx(directory):
    file = directory / "package" / "res" / "schema" / "bom-1.4.SNAPSHOT.schema.json"
    schema = without_explanations(json.loads(file.read_text(encoding="utf-8")))
    for part in ("definitions", "properties"):
        schema[part] = {name: schema[part][name] for name in sorted(schema[part])}
    print(json.dumps(schema, separators=(",", ":")).replace('},"', '},\n"'))


def main(directory):
    types = Types(directory)
    definitions = types.definitions
    roots = []
    for path in [*KINDS, POD_TEMPLATE]:
        name = types.define(path)
        if path == POD_TEMPLATE:
            continue
        kind = definitions.pop(name)
        version = kind["properties"]["apiVersion"]["const"]
        roots.append(f"{version}/{kind['properties']['kind']['const']}")
        definitions[roots[-1]] = kind
    roots.append("kubeflow.org/v1/PyTorchJob")
    definitions[roots[-1]] = PYTORCH_JOB
    kept = needed(definitions, roots)
    lines = [f"{json.dumps(name)}: {json.dumps(kept[name], separators=(',', ':'), sort_keys=True)}" for name in kept]
    print('{"definitions": {\n' + ",\n".join(lines) + "\n}}")


if __name__ == "__main__":
    if sys.argv[1] == "--cyclonedx":
        make_cyclonedx(pathlib.Path(sys.argv[2]))
    else:
        main(pathlib.Path(sys.argv[1]))
