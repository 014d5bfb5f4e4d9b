#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws the validation curve of one or more trainings as an SVG picture. Needs nothing but Python.

  training/tools/training_curve.py out/train-small --baseline LK=41.2 --out curve.svg

Each directory has the log.jsonl that holdfast-train writes; a horizontal line stands for every --baseline NAME=VALUE.
"""
import argparse
import json
import math
import sys
from pathlib import Path
from xml.sax.saxutils import escape

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 760, 420, 60, 20, 20, 50
COLOURS = ("#1f6feb", "#d1242f", "#1a7f37", "#8250df", "#bf8700")


def read_curve(directory, metric):
    """[(minutes of training, value)] of a log; a validation done again after a resume counts once, the last time."""
    minutes, points = 0.0, {}
    for line in (Path(directory) / "log.jsonl").read_text(encoding="utf-8").splitlines():
        event = json.loads(line)
        if event["event"] == "step":
            minutes = event["elapsed_s"] / 60
        elif event["event"] == "validation" and metric in event:
            points[event["step"]] = (minutes if event["step"] else 0.0, event[metric])
    return [points[step] for step in sorted(points)]


def round_ticks(longest):
    """Multiples of a round number from 0 to 'longest', at most eleven."""
    unit = 10.0 ** math.floor(math.log10(longest)) / 10
    step = next(unit * factor for factor in (1, 2, 5, 10) if longest / (unit * factor) <= 10)
    return [step * i for i in range(int(longest / step) + 1)]


def draw(curves, baselines, metric):
    """curves: {name: [(minutes, value)]}, baselines: {name: value} -> SVG text."""
    longest = max((x for points in curves.values() for x, _ in points), default=0) or 1
    highest = max([y for points in curves.values() for _, y in points] + list(baselines.values()), default=0)
    top = 10 * (int(highest) // 10 + 1)

    def at(x, y):
        return (LEFT + x / longest * (WIDTH - LEFT - RIGHT), HEIGHT - BOTTOM - y / top * (HEIGHT - TOP - BOTTOM))

    parts = []
    for y in range(0, top + 1, 10):
        (x0, py), (x1, _) = at(0, y), at(longest, y)
        parts.append(f'<line x1="{x0:.1f}" y1="{py:.1f}" x2="{x1:.1f}" y2="{py:.1f}" stroke="#ddd"/>'
                     f'<text x="{x0 - 8:.1f}" y="{py + 4:.1f}" text-anchor="end">{y}</text>')
    for minutes in round_ticks(longest):
        px, py = at(minutes, 0)
        parts.append(f'<text x="{px:.1f}" y="{py + 18:.1f}" text-anchor="middle">{minutes:g}</text>')
    for name, value in baselines.items():
        (x0, py), (x1, _) = at(0, value), at(longest, value)
        parts.append(f'<line x1="{x0:.1f}" y1="{py:.1f}" x2="{x1:.1f}" y2="{py:.1f}" stroke="#666" '
                     f'stroke-dasharray="6 4"/><text x="{x1:.1f}" y="{py - 5:.1f}" text-anchor="end">'
                     f'{escape(name)} {value:.1f}</text>')
    for i, (name, points) in enumerate(curves.items()):
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in (at(*point) for point in points))
        colour = COLOURS[i % len(COLOURS)]
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>'
                     f'<text x="{LEFT + 10}" y="{TOP + 14 + 16 * i}" fill="{colour}">{escape(name)}: '
                     f'{points[0][1]:.1f} to {points[-1][1]:.1f}</text>')
    parts.append(f'<text x="{WIDTH / 2}" y="{HEIGHT - 10}" text-anchor="middle">minutes of training '
                 f'(vertical: validation {escape(metric)})</text>')
    body = "\n".join(parts)
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{HEIGHT}" font-family="sans-serif" '
            f'font-size="12">\n<rect width="100%" height="100%" fill="white"/>\n{body}\n</svg>\n')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directories", nargs="+")
    parser.add_argument("--metric", default="delta_vis")
    parser.add_argument("--baseline", action="append", default=[], metavar="NAME=VALUE")
    parser.add_argument("--out", required=True)
    flags = parser.parse_args()
    curves = {directory: read_curve(directory, flags.metric) for directory in flags.directories}
    empty = [directory for directory, points in curves.items() if not points]
    if empty:
        sys.exit(f"training_curve: no validation with {flags.metric} in {', '.join(empty)}")
    baselines = {name: float(value) for name, _, value in (text.partition("=") for text in flags.baseline)}
    Path(flags.out).write_text(draw(curves, baselines, flags.metric), encoding="utf-8")


if __name__ == "__main__":
    main()
