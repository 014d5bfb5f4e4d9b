#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws how far confidence is to be trusted, as an SVG picture. Needs nothing but Python.

  training/tools/reliability_curve.py before.json calibrated=after.json --out reliability.svg

Each file is what holdfast-eval --json=FILE wrote. Estimates are sorted into tenths by their confidence: a curve goes
through mean confidence and share of right estimates of each tenth, bars below show the tenths' shares of all estimates.
Confidence that means what it says lies on the dashed diagonal. A file with several reports that have confidence (data
sets of a suite) gives a curve for each; reports without it (Lucas-Kanade has none) are left out.
"""
import argparse
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import svg

WIDTH, LEFT, SIDE = 520, 60, 440  # SIDE: of the square in which the curves are
LEGEND_TOP, LEGEND_ROW = 46, 16
GAP, BARS, FOOT = 34, 60, 44  # between square and bars, the bars' height, below them
TITLE_CHARACTERS = 70  # that fit into the width


class BadFile(Exception):
    """A file that cannot be drawn, or written; the text names it."""


@dataclass(frozen=True)
class Bin:
    """The estimates of one tenth. share: of all estimates; confidence: their mean; right: share that is right."""

    share: float
    confidence: float
    right: float


@dataclass(frozen=True)
class Curve:
    label: str
    method: str
    ece: float
    brier: float
    auc: float | None
    bins: list

    def legend(self):
        auc = "–" if self.auc is None else f"{self.auc:.3f}"
        return f"{self.label}: ECE {self.ece:.3f}, Brier {self.brier:.3f}, AUC {auc}"


def first_words(method):
    """A method's name without what it says in brackets."""
    return re.sub(r"\s*\([^()]*\)", "", method).strip() or method


def share(value):
    """A number from 0 to 1, as everything in a reliability is but its counts."""
    if not 0 <= value <= 1:
        raise ValueError(f"{value} is not between 0 and 1")
    return float(value)


def to_curve(label, report):
    reliability = report["reliability"]
    claims = [entry["claims"] for entry in reliability["bins"]]
    if min(claims) < 0 or sum(claims) <= 0:
        raise ValueError("the bins hold no estimates")
    bins = [Bin(share(count / sum(claims)), share(entry["confidence"]), share(entry["right"]))
            for count, entry in zip(claims, reliability["bins"])]
    auc = reliability["auc"]
    return Curve(label, first_words(report["method"]), share(reliability["ece"]), share(reliability["brier"]),
                 None if auc is None else share(auc), bins)


def read_curves(label, path):
    """The curves of a file, one for each report that has a reliability; at least one."""
    try:
        reports = json.loads(Path(path).read_text(encoding="utf-8"))["reports"]
        reports = [report for report in reports if report.get("reliability") is not None]
        if len(reports) == 1:
            curves = [to_curve(label, reports[0])]
        else:
            curves = [to_curve(f"{label}, {first_words(report['method'])}", report) for report in reports]
    except OSError as error:
        raise BadFile(f"cannot read {path}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:  # no JSON, or of another shape
        raise BadFile(f"{path} is no report of holdfast-eval: {type(error).__name__} {error}") from error
    if not curves:
        raise BadFile(f"{path}: no report has a reliability; was it written by an older holdfast-eval, or does the "
                      "method have no confidence?")
    return curves


def title_of(curves):
    title = "Reliability of confidence: " + ", ".join(dict.fromkeys(curve.method for curve in curves))
    return title if len(title) <= TITLE_CHARACTERS else title[: TITLE_CHARACTERS - 1] + "…"


def draw_axes(panel):
    """The square: a grid of fifths, the diagonal, what the axes are."""
    parts = []
    for fifth in range(6):
        value = fifth / 5
        px, py = panel.at(0, value)
        parts += [panel.across(value), svg.text((px - 8, py + 4), f"{value:.1f}", anchor="end")]
        px, py = panel.at(value, 0)
        parts += [svg.line((px, py), panel.at(value, 1)), svg.text((px, py + 18), f"{value:.1f}", anchor="middle")]
    parts.append(svg.line(panel.at(0, 0), panel.at(1, 1), stroke="#666", dashed=True))
    return parts


def draw_curve(panel, curve, colour):
    points = [panel.at(entry.confidence, entry.right) for entry in curve.bins if entry.share > 0]
    return [svg.polyline(points, colour)] + [svg.circle(point, 3, colour) for point in points]


def draw_bars(panel, curves):
    """Of each tenth a bar for each curve, side by side."""
    parts = [panel.across(0), panel.across(panel.y_end)]
    for value in (0, panel.y_end):
        px, py = panel.at(0, value)
        parts.append(svg.text((px - 8, py + 4), f"{100 * value:.0f} %", anchor="end"))
    for i, curve in enumerate(curves):
        for tenth, entry in enumerate(curve.bins):
            width = 0.8 / len(curve.bins) / len(curves)
            x = (tenth + 0.1) / len(curve.bins) + i * width
            if entry.share > 0:
                parts.append(svg.bar(panel.at(x, entry.share), panel.at(x + width, 0), svg.colour(i)))
    return parts


def draw(curves):
    top = LEGEND_TOP + LEGEND_ROW * len(curves)
    square = svg.Panel(LEFT, top, SIDE, SIDE, 1, 1)
    most = max(entry.share for curve in curves for entry in curve.bins)
    bars = svg.Panel(LEFT, top + SIDE + GAP, SIDE, BARS, 1, most)
    height = top + SIDE + GAP + BARS + FOOT
    parts = [svg.text((WIDTH / 2, 22), title_of(curves), anchor="middle")]
    for i, curve in enumerate(curves):
        parts.append(svg.text((LEFT, LEGEND_TOP + LEGEND_ROW * i), curve.legend(), fill=svg.colour(i)))
    parts += draw_axes(square)
    for i, curve in enumerate(curves):
        parts += draw_curve(square, curve, svg.colour(i))
    parts += draw_bars(bars, curves)
    for above_foot, words in ((24, "across: mean confidence; up: share that is right;"),
                              (8, "bars: share of all estimates, by tenths of confidence")):
        parts.append(svg.text((WIDTH / 2, height - above_foot), words, anchor="middle"))
    return svg.document(WIDTH, height, parts)


def labelled(text):
    """[LABEL=]PATH -> (label, path). A file whose own name has a "=" is no label."""
    label, equals, path = text.partition("=")
    if not equals or Path(text).is_file():
        return Path(text).stem, text
    if not label or not path:
        raise argparse.ArgumentTypeError(f"{text!r} is not [LABEL=]PATH")
    return label, path


def parse(argv):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=labelled, metavar="[LABEL=]FILE",
                        help="without a label the curve has the name of the file")
    parser.add_argument("--out", required=True, type=Path)
    args = parser.parse_args(argv)
    labels = [label for label, _ in args.files]
    twice = [label for label in dict.fromkeys(labels) if labels.count(label) > 1]
    if twice:
        parser.error(f"several files are called {', '.join(twice)}: name them, as in LABEL=FILE")
    return args


def main(argv):
    args = parse(argv)
    try:
        picture = draw([curve for label, path in args.files for curve in read_curves(label, path)])
        try:
            args.out.write_text(picture, encoding="utf-8")
        except OSError as error:
            raise BadFile(f"cannot write {args.out}: {error.strerror}") from error
    except BadFile as error:
        sys.exit(f"reliability_curve: {error}")


if __name__ == "__main__":
    main(sys.argv[1:])
