# SPDX-License-Identifier: Apache-2.0
"""Includes go the way that README's codemap says, and no two types of one namespace share a name.

The codemap is a Markdown table. The first column names the folders of a layer (`server/`) or single headers of it
(`api/types.h`); a file belongs to the longest name that fits. "may include" names other layers' folders or single
files, or says "everything"; behind the word "never" it names prefixes that no include of the layer has, of libraries
too (`torch/`). A layer always includes itself. A generated header belongs where its .proto file is.
"""
import pathlib
import posixpath
import re
import tempfile
import unittest

from source_tree import ROOT, source_files

SOURCES = (".cc", ".h")
INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*(["<])([^">]+)[">]', re.MULTILINE)
GENERATED = re.compile(r"(\.grpc)?\.pb\.h$")


class Layer:
    """A row of the codemap."""

    def __init__(self, line):
        names, self.purpose, may = (cell.strip() for cell in line.strip().strip("|").split("|"))
        self.names = re.findall(r"`([^`]+)`", names)
        allowed, _, never = may.partition("never")
        self.everything = "everything" in allowed
        self.allowed = re.findall(r"`([^`]+)`", allowed)
        self.never = re.findall(r"`([^`]+)`", never)

    def __str__(self):
        return self.names[0]


def read_codemap(readme):
    """The layers of the table whose header has a column "may include"."""
    table = re.search(r"^\|[^\n]*\| may include \|\n\|[-|]+\|\n((?:\|[^\n]*\n?)+)", readme, re.MULTILINE)
    if not table:
        raise ValueError('README has no table with a last column "may include"')
    return [Layer(line) for line in table.group(1).splitlines()]


def covers(name, path):
    return path.startswith(name) if name.endswith("/") else path == name


def layer_of(path, layers):
    fits = [(len(name), layer) for layer in layers for name in layer.names if covers(name, path)]
    return max(fits, key=lambda fit: fit[0])[1] if fits else None


def included_file(include, including, files):
    """The file of the tree that an include means; None for a library's header."""
    if GENERATED.search(include):
        proto = GENERATED.sub(".proto", include)
        return next((file for file in files if file == proto or file.endswith("/" + proto)), None)
    beside = posixpath.normpath(posixpath.join(posixpath.dirname(including), include))
    return next((file for file in (include, beside) if file in files), None)


def include_violations(root, files, layers):
    known, folders = set(files), {file.split("/")[0] for file in files if "/" in file}
    found = []
    for path in (file for file in files if file.endswith(SOURCES)):
        layer = layer_of(path, layers)
        if layer is None:
            found.append(f"{path}: in no row of the codemap")
            continue
        for quote, include in INCLUDE.findall((root / path).read_text(encoding="utf-8")):
            if any(include.startswith(prefix) for prefix in layer.never):
                found.append(f"{path}: {layer} never includes {include}")
            target = included_file(include, path, known)
            if target is None:
                if quote == '"' and include.split("/")[0] in folders:
                    found.append(f"{path}: there is no {include}")
            elif not (layer.everything or layer_of(target, layers) is layer
                      or any(covers(name, target) and is_closest(name, target, layers) for name in layer.allowed)):
                found.append(f"{path}: {layer} may not include {target}")
    return found


def is_closest(name, path, layers):
    """Whether 'name' allows 'path' itself, and not a layer around the one that has it."""
    return not name.endswith("/") or name in layer_of(path, layers).names


def table_violations(layers, files):
    """Names that stand for nothing, and cycles."""
    found = [f"codemap: there is no {name}" for layer in layers for name in layer.names + layer.allowed
             if not any(covers(name, file) for file in files)]
    edges = {layer: {layer_of(name, layers) for name in layer.allowed} - {layer, None} for layer in layers}
    while edges:  # a layer that includes nothing of those left is in no cycle
        bottom = [layer for layer, below in edges.items() if not below & edges.keys()]
        if not bottom:
            return found + ["codemap: a cycle among " + ", ".join(sorted(map(str, edges)))]
        for layer in bottom:
            del edges[layer]
    return found


TOKEN = re.compile(r"""
    //[^\n]* | /\*.*?\*/ | R"(?P<end>[^(\s]*)\(.*?\)(?P=end)" | "(?:\\.|[^"\\\n])*" | '(?:\\.|[^'\\\n])+'
  | ^[ \t]*\#(?:[^\\\n]|\\.|\\\n)* | (?P<word>[A-Za-z_]\w*) | (?P<number>[0-9](?:[\w.']|(?<=[eEpP])[+-])*)
  | (?P<sign>::|\S)""", re.VERBOSE | re.MULTILINE | re.DOTALL)


def tokens_of(text):
    return [match.group() for match in TOKEN.finditer(text) if match.lastgroup in ("word", "number", "sign")]


def without_brackets(statement):
    """The tokens outside of template arguments, attributes, alignas(...) and arguments of macros."""
    kept, depth = [], 0
    for token in statement:
        if token in "<([":
            depth += 1
        if depth == 0:
            kept.append(token)
        if token in ">)]":
            depth -= 1
    return kept


def defined_name(statement, end):
    """The type that a statement of a namespace defines, where 'end' is what stands behind it: { or ;"""
    words = without_brackets(statement)
    if words[:1] == ["template"]:
        words = words[1:]
    if end == ";":
        if words[:1] == ["using"] and words[2:3] == ["="]:
            return words[1]
        return words[-1] if words[:1] == ["typedef"] else None
    if words[:1] not in (["class"], ["struct"], ["union"], ["enum"]):
        return None
    head = words[:words.index(":")] if ":" in words else words
    names = [word for word in head if word not in ("class", "struct", "union", "enum", "final")]
    specialization = names and "<" in statement[statement.index(names[-1]):][1:2]
    is_function = statement[-1] == ")" or "=" in words
    return None if not names or specialization or is_function or "::" in head else names[-1]


class Definitions:
    """Reads a file's tokens and keeps the types that its named namespaces define, as 'holdfast::Name'."""

    def __init__(self, tokens):
        self.types = []
        scopes, statement = [], []  # of each open brace: a namespace's name, "" if it has none, None for other braces
        for token in tokens:
            if token in "{;" and None not in scopes:
                self._end_statement(statement, token, scopes)
                if token == "{":
                    scopes.append(self._scope(statement))
                statement = []
            elif token == "{":
                scopes.append(None)
            elif token == "}" and scopes:
                scopes.pop()
            elif None not in scopes:
                statement.append(token)

    @staticmethod
    def _scope(statement):
        if "namespace" in statement:
            return "".join(statement[statement.index("namespace") + 1:])
        return "extern" if statement == ["extern"] else None  # extern "C": its string is no token

    def _end_statement(self, statement, end, scopes):
        name = defined_name(statement, end) if statement else None
        if name and "" not in scopes:
            self.types.append("::".join([scope for scope in scopes if scope != "extern"] + [name]))


def type_violations(root, files, namespace="holdfast"):
    places = {}
    for path in (file for file in files if file.endswith(SOURCES)):
        for name in set(Definitions(tokens_of((root / path).read_text(encoding="utf-8"))).types):
            if name.startswith(namespace + "::"):
                places.setdefault(name, []).append(path)
    return [f"{name} is defined in {' and '.join(paths)}" for name, paths in sorted(places.items()) if len(paths) > 1]


class TreeTest(unittest.TestCase):
    """What is shipped."""

    maxDiff = None

    def setUp(self):
        self.files = source_files()
        self.layers = read_codemap((ROOT / "README.md").read_text(encoding="utf-8"))

    def test_includes_follow_the_codemap(self):
        self.assertGreater(len([file for file in self.files if file.endswith(SOURCES)]), 100)
        self.assertEqual(include_violations(ROOT, self.files, self.layers), [])

    def test_the_codemap_speaks_of_what_exists_and_has_no_cycle(self):
        self.assertEqual(table_violations(self.layers, self.files), [])

    def test_no_type_is_defined_twice(self):
        self.assertEqual(type_violations(ROOT, self.files), [])


CODEMAP = """
| directory | what it is | may include |
|---|---|---|
| `api/`, `wire/plain.h` | plain types | |
| `wire/` | the protocol | `api/` |
| `core/` | the work | `wire/plain.h`, `api/`; never `net/`, `wire/v1/` |
| `core/inner/` | its inner part | |
| `tests/` | tests | everything |
"""
TREE = {
    "README.md": CODEMAP,
    "api/types.h": "namespace holdfast { struct Size; struct Size { int w; }; enum class Kind : int { kA }; }",
    "wire/plain.h": "namespace holdfast { using Names = std::vector<std::string>; }",
    "wire/v1/track.proto": "",
    "wire/convert.h": '#include "api/types.h"\n#include "v1/track.pb.h"\n#include "net/grpc.h"\n',
    "core/work.h": '#include <vector>\n#include "absl/time/time.h"\n#include "wire/plain.h"\n#include "core/work.h"\n',
    "core/inner/part.h": "namespace holdfast::inner { class Part final : public Base<int> { class Size {}; }; }",
    "tests/work_test.cc": '#include "core/work.h"\n#include "helper.h"\n',
    "tests/helper.h": "namespace holdfast { namespace { struct Size {}; } struct Size Grow(Size s) { return s; } }",
}


class SeededTest(unittest.TestCase):
    """A violation of each kind, sown into a small tree that has none."""

    def violations(self, **changed_files):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name, text in {**TREE, **changed_files}.items():
                (root / name).parent.mkdir(parents=True, exist_ok=True)
                (root / name).write_text(text, encoding="utf-8")
            files, layers = source_files(root), read_codemap((root / "README.md").read_text(encoding="utf-8"))
            return (include_violations(root, files, layers) + table_violations(layers, files)
                    + type_violations(root, files))

    def with_include(self, path, include):
        return self.violations(**{path: TREE[path] + f"\n#include {include}\n"})

    def test_the_small_tree_is_clean(self):
        self.assertEqual(self.violations(), [])

    def test_an_include_against_the_table_is_found(self):
        self.assertEqual(self.with_include("api/types.h", '"wire/convert.h"'),
                         ["api/types.h: api/ may not include wire/convert.h"])
        self.assertEqual(self.with_include("core/work.h", '"wire/convert.h"'),
                         ["core/work.h: core/ may not include wire/convert.h"])
        self.assertEqual(self.with_include("api/types.h", '"tests/helper.h"'),
                         ["api/types.h: api/ may not include tests/helper.h"])

    def test_a_layer_inside_of_a_folder_is_a_layer_of_its_own(self):
        self.assertEqual(self.with_include("core/inner/part.h", '"core/work.h"'),
                         ["core/inner/part.h: core/inner/ may not include core/work.h"])
        self.assertEqual(self.with_include("core/work.h", '"core/inner/part.h"'),
                         ["core/work.h: core/ may not include core/inner/part.h"])

    def test_a_path_from_the_including_folder_is_followed(self):
        self.assertEqual(self.with_include("core/work.h", '"../wire/convert.h"'),
                         ["core/work.h: core/ may not include wire/convert.h"])
        self.assertEqual(self.with_include("core/work.h", '"inner/part.h"'),
                         ["core/work.h: core/ may not include core/inner/part.h"])

    def test_a_generated_header_belongs_where_its_protocol_is(self):
        self.assertEqual(self.with_include("api/types.h", '"v1/track.grpc.pb.h"'),
                         ["api/types.h: api/ may not include wire/v1/track.proto"])

    def test_a_library_that_a_layer_never_includes_is_found(self):
        self.assertEqual(self.with_include("core/work.h", "<net/socket.h>"),
                         ["core/work.h: core/ never includes net/socket.h"])

    def test_an_include_of_nothing_is_found(self):
        self.assertEqual(self.with_include("core/work.h", '"core/gone.h"'), ["core/work.h: there is no core/gone.h"])

    def test_a_file_outside_of_the_table_is_found(self):
        self.assertEqual(self.violations(**{"extra/x.cc": "int x;\n"}), ["extra/x.cc: in no row of the codemap"])

    def test_a_row_about_nothing_is_found(self):
        readme = CODEMAP + "| `gone/` | nothing | `lost/x.h` |\n"
        self.assertEqual(self.violations(**{"README.md": readme}),
                         ["codemap: there is no gone/", "codemap: there is no lost/x.h"])

    def test_a_cycle_of_the_table_is_found(self):
        readme = CODEMAP.replace("| plain types | |", "| plain types | `core/` |")
        self.assertEqual(self.violations(**{"README.md": readme}), ["codemap: a cycle among api/, core/, wire/"])

    def test_a_readme_without_the_table_is_an_error(self):
        with self.assertRaises(ValueError):
            self.violations(**{"README.md": "| directory | what it is |\n|---|---|\n"})

    def test_a_second_type_of_a_name_is_found(self):
        for definition in ("class Size { int h; };", "struct Size final : Base { };", "union Size { int h; };",
                           "enum class Size : int { kBig };", "enum Size { kBig };", "using Size = int;",
                           "template <typename T> class Size { T h; };", "typedef int Size;",
                           "class LOCKABLE(x) alignas(8) [[nodiscard]] Size { };"):
            with self.subTest(definition):
                text = f"int before() {{ return 1; }}\nnamespace holdfast {{ {definition} }}\n"
                self.assertEqual(self.violations(**{"core/size.cc": text}),
                                 ["holdfast::Size is defined in api/types.h and core/size.cc"])

    def test_what_defines_no_type_of_the_namespace_is_let_be(self):
        for text in ("class Size;", "namespace other { class Size {}; }", "namespace { class Size {}; }",
                     "template <> struct Size<int> {};", "struct Size MakeSize() { return {}; }",
                     "class Box { struct Size {}; using Kind = int; };", "void F() { struct Size { int h; }; }",
                     "// class Size {};\n/* class Size {}; */", 'const char* s = "class Size {};";',
                     "#define SIZE \\\n  class Size {};\n", 'const char* s = R"x(class Size {)";)x";',
                     "struct Size size = {1};", "const char c = '{'; const int i = 1'000;", "using std::Size;",
                     "struct Outer::Size { int h; };"):
            with self.subTest(text):
                self.assertEqual(self.violations(**{"core/size.cc": f"namespace holdfast {{\n{text}\n}}\n"}), [])
        self.assertEqual(self.violations(**{"core/size.cc": "class Size { };\n"}), [])


if __name__ == "__main__":
    unittest.main(verbosity=2)
