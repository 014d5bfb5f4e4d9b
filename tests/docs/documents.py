# SPDX-License-Identifier: Apache-2.0
"""Code blocks of the project's documents."""
import pathlib
import re
from typing import NamedTuple

ROOT = pathlib.Path(__file__).resolve().parents[2]

FENCE = re.compile(r"^```(.*)$", re.MULTILINE)
# Four spaces make code too, unless they go on with a list.
INDENTED = re.compile(r"^(?![ ]*(?:[-*]|\d+\.) ).*\n\n    (?! )(?P<code>.+)$", re.MULTILINE)


class Block(NamedTuple):
    document: str
    line: int  # of the opening fence
    language: str  # "sh"
    kind: str  # what else stands behind the opening fence: "output"
    text: str

    def __str__(self):
        return f"{self.document}:{self.line}"


def read_blocks(document):
    """The fenced blocks of a document, by its path from the root. ValueError: one has no end or no language, or code is
    marked by indenting it."""
    text = (ROOT / document).read_text(encoding="utf-8")
    fences = list(FENCE.finditer(text))
    blocks, outside, end = [], "", 0
    for opening, closing in zip(fences[::2], fences[1::2]):
        line = text.count("\n", 0, opening.start()) + 1
        language, _, kind = opening.group(1).partition(" ")
        if not language or closing.group(1):
            raise ValueError(f"{document}:{line}: a block begins with ``` and its language, and ends with ```")
        blocks.append(Block(document, line, language, kind, text[opening.end() + 1:closing.start()]))
        outside += text[end:opening.start()]
        end = closing.end()
    indented = INDENTED.search(outside + text[end:])
    if len(fences) % 2 or indented:
        what = f"{indented.group('code')!r} is marked as code by indenting" if indented else "a block has no end"
        raise ValueError(f"{document}: {what}")
    return blocks
