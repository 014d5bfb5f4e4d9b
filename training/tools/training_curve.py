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

import svg

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 760, 420, 60, 20, 20, 50


def read_curve(directory, metric):
    """[(minutes of training, value)] of a log; a validation done again after a resume counts once, the last time."""
    minutes, points = 0.0, {}
    for line in (Path(directory) / "log.jsonl").read_text(encoding="utf-8").splitlines():
        try:
            event = json.loads(line)
        except json.JSONDecodeError:  # of a process that was killed while it wrote
            continue
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

    panel = svg.Panel(LEFT, TOP, WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM, longest, top)
    parts = []
    for y in range(0, top + 1, 10):
        px, py = panel.at(0, y)
        parts += [panel.across(y), svg.text((px - 8, py + 4), f"{y}", anchor="end")]
    for minutes in round_ticks(longest):
        px, py = panel.at(minutes, 0)
        parts.append(svg.text((px, py + 18), f"{minutes:g}", anchor="middle"))
    for name, value in baselines.items():
        px, py = panel.at(longest, value)
        parts += [panel.across(value, stroke="#666", dashed=True),
                  svg.text((px, py - 5), f"{name} {value:.1f}", anchor="end")]
    for i, (name, points) in enumerate(curves.items()):
        parts += [svg.polyline([panel.at(*point) for point in points], svg.colour(i)),
                  svg.text((LEFT + 10, TOP + 14 + 16 * i), f"{name}: {points[0][1]:.1f} to {points[-1][1]:.1f}",
                           fill=svg.colour(i))]
    parts.append(svg.text((WIDTH / 2, HEIGHT - 10), f"minutes of training (vertical: validation {metric})",
                          anchor="middle"))
    return svg.document(WIDTH, HEIGHT, parts)


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
