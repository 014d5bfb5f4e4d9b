# SPDX-License-Identifier: Apache-2.0
"""What documents link to is there: files of the tree, and headings of documents."""
import pathlib
import posixpath
import re
import tempfile
import unittest

from source_tree import ROOT, source_files

CODE = re.compile(r"^```.*?^```|`[^`\n]*`", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(\s*([^()\s]+)\s*\)")
HEADING = re.compile(r"^#{1,6} +(.+?)\s*$", re.MULTILINE)
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def anchors_of(text):
    """Of each heading, as code hosts name them: small letters, hyphens for spaces, a number where a name repeats."""
    anchors = set()
    for heading in HEADING.findall(FENCED.sub("", text)):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        name = anchor = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        number = 0
        while anchor in anchors:
            number += 1
            anchor = f"{name}-{number}"
        anchors.add(anchor)
    return anchors


def broken_links(root, files):
    folders = {parent.as_posix() for file in files for parent in pathlib.PurePosixPath(file).parents}
    found = []
    for document in (file for file in files if file.endswith(".md")):
        for link in LINK.findall(CODE.sub("", (root / document).read_text(encoding="utf-8"))):
            if re.match(r"[a-z]+:", link):
                continue
            path, _, anchor = link.partition("#")
            target = posixpath.normpath(posixpath.join(posixpath.dirname(document), path)) if path else document
            if target not in files and target not in folders:
                found.append(f"{document}: there is no {link}")
            elif anchor and anchor not in anchors_of((root / target).read_text(encoding="utf-8")):
                found.append(f"{document}: {target} has no heading for #{anchor}")
    return found


class LinksTest(unittest.TestCase):
    def test_links_of_documents_lead_somewhere(self):
        files = source_files()
        self.assertGreater(len([file for file in files if file.endswith(".md")]), 20)
        self.assertEqual(broken_links(ROOT, set(files)), [])

    def violations(self, readme):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            tree = {"README.md": readme, "x.png": "",
                    "docs/a.md": "# A `b`, c\n\n## Twice\n\n## Twice\n\n```\n# none\n```\n"}
            for name, text in tree.items():
                (root / name).parent.mkdir(exist_ok=True)
                (root / name).write_text(text, encoding="utf-8")
            return broken_links(root, set(tree))

    def test_links_that_are_right_are_let_be(self):
        self.assertEqual(self.violations(
            "# Me\n[a](docs/a.md) [b](docs/a.md#a-b-c) [c](docs/a.md#twice-1) [d](docs/) [e](#me) ![f](x.png)\n"
            "[g](https://example.com/h#i) `[j](k)`\n```\n[l](m)\n```\n[over\ntwo lines](docs/a.md)\n"), [])

    def test_links_that_lead_nowhere_are_found(self):
        self.assertEqual(self.violations("[a](docs/b.md)"), ["README.md: there is no docs/b.md"])
        self.assertEqual(self.violations("![a](y.png)"), ["README.md: there is no y.png"])
        self.assertEqual(self.violations("[a](docs/a.md#none)"), ["README.md: docs/a.md has no heading for #none"])
        self.assertEqual(self.violations("[a](#here)"), ["README.md: README.md has no heading for #here"])


if __name__ == "__main__":
    unittest.main(verbosity=2)
