# SPDX-License-Identifier: Apache-2.0
"""Tracks as files of other programs. Positions are written as they are: (0, 0) is the centre of the first pixel."""
from __future__ import annotations

import csv
import os
import xml.etree.ElementTree as xml
from collections.abc import Mapping
from typing import TYPE_CHECKING, Union

import numpy as np

if TYPE_CHECKING:
    from .tracks import Tracks

Path = Union[str, "os.PathLike[str]"]


def write_dlc_csv(tracks: Tracks, path: Path, scorer: str, names: Mapping[int, str]) -> None:
    """DeepLabCut's table of one animal: a row a frame, and of each point x, y and likelihood."""
    points = [names.get(int(point), f"point{point}") for point in tracks.ids]
    if len(set(points)) < len(points):
        raise ValueError(f"names are {points}, expected no name twice")
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["scorer"] + [scorer] * 3 * len(points))
        writer.writerow(["bodyparts"] + [point for point in points for _ in range(3)])
        writer.writerow(["coords"] + ["x", "y", "likelihood"] * len(points))
        for frame in range(tracks.frames):
            row: list[object] = [frame]
            for (x, y), confidence in zip(tracks.xy[:, frame], tracks.confidence[:, frame]):
                row += ["", ""] if np.isnan(x) else [f"{x:.3f}", f"{y:.3f}"]
                row.append(f"{confidence:.4f}")
            writer.writerow(row)


def write_cvat_xml(tracks: Tracks, path: Path, names: Mapping[int, str], size: tuple[int, int] | None) -> None:
    """CVAT for video 1.1: a track a point, with a shape for each frame on which it is known."""
    labels = [names.get(int(point), "point") for point in tracks.ids]
    root = xml.Element("annotations")
    xml.SubElement(root, "version").text = "1.1"
    root.append(_cvat_task(sorted(set(labels)), tracks.frames, size))
    for row, label in enumerate(labels):
        root.append(_cvat_track(tracks, row, label, size))
    xml.indent(root)
    xml.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _cvat_task(labels: list[str], frames: int, size: tuple[int, int] | None) -> xml.Element:
    meta = xml.Element("meta")
    task = xml.SubElement(meta, "task")
    for name, text in (("size", frames), ("mode", "interpolation"), ("start_frame", 0), ("stop_frame", frames - 1)):
        xml.SubElement(task, name).text = str(text)
    all_labels = xml.SubElement(task, "labels")
    for text in labels:
        label = xml.SubElement(all_labels, "label")
        xml.SubElement(label, "name").text = text
        xml.SubElement(label, "type").text = "points"
    if size is not None:
        original = xml.SubElement(task, "original_size")
        for name, length in zip(("width", "height"), size):
            xml.SubElement(original, name).text = str(length)
    return meta


def _cvat_track(tracks: Tracks, row: int, label: str, size: tuple[int, int] | None) -> xml.Element:
    """A shape holds until the next one: where nothing is known any more, the last one is repeated as being outside."""
    track = xml.Element("track", id=str(row), label=label, source="auto")
    known = ~np.isnan(tracks.xy[row, :, 0])
    for frame in np.flatnonzero(known):
        x, y = tracks.xy[row, frame]
        outside = size is not None and not (-0.5 <= x < size[0] - 0.5 and -0.5 <= y < size[1] - 0.5)
        _cvat_shape(track, frame, x, y, outside, not tracks.visible[row, frame])
        if frame + 1 < tracks.frames and not known[frame + 1]:
            _cvat_shape(track, frame + 1, x, y, True, False)
    return track


def _cvat_shape(track: xml.Element, frame: int, x: float, y: float, outside: bool, occluded: bool) -> None:
    xml.SubElement(track, "points", frame=str(frame), keyframe="1", outside=str(int(outside)),
                   occluded=str(int(occluded)), points=f"{x:.3f},{y:.3f}", z_order="0")
