# SPDX-License-Identifier: Apache-2.0
"""Tracks as files of other programs. Positions are written as they are: (0, 0) is the centre of the first pixel. Equal
tracks make the very files that the command line writes (client/cli/track_exports.h)."""
from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Union

import numpy as np

if TYPE_CHECKING:
    from .tracks import Tracks

Path = Union[str, "os.PathLike[str]"]


def track_arrays(tracks: Tracks, names: Mapping[int, str], size: tuple[int, int] | None,
                 fps: float | None) -> dict[str, np.ndarray]:
    """By name, as the command line has them (client/cli/track_writer.h), and xy and final besides."""
    ids = [int(point) for point in tracks.ids]
    provisional = (~np.isnan(tracks.xy[:, :, 0]) & ~tracks.final).any(axis=0)
    final_frames = int(provisional.argmax()) if provisional.any() else tracks.frames
    arrays = {"tracks": tracks.xy, "visible": tracks.visible, "confidence": tracks.confidence,
              "ids": tracks.ids.astype(np.int64 if max(ids, default=0) < 1 << 63 else np.uint64),
              "names": np.array([names.get(point) or str(point) for point in ids], np.str_),
              "query_frames": tracks.query_frames, "frames": np.arange(tracks.frames, dtype=np.int64),
              "complete": np.array(tracks.complete), "final_frames": np.array(final_frames, np.int64),
              "expected_frames": np.array(tracks.sent, np.int64), "xy": tracks.xy, "final": tracks.final}
    if size is not None:
        arrays["size"] = np.array(size, np.int64)
    if fps is not None:
        arrays["fps"] = np.array(fps, np.float64)
    if tracks.capture_times:
        times = (tracks.capture_times.get(frame) for frame in range(tracks.frames))
        arrays["capture_times"] = np.array([np.nan if time is None else time.timestamp() for time in times])
    return arrays


def write_csv(tracks: Tracks, path: Path) -> None:
    """A line for each known sample."""
    with open(path, "w", newline="\n", encoding="utf-8") as file:
        file.write("id,frame,x,y,visible,confidence\n")
        for row, frame in np.argwhere(~np.isnan(tracks.xy[:, :, 0])):
            x, y = tracks.xy[row, frame]
            file.write(f"{tracks.ids[row]},{frame},{x:.3f},{y:.3f},{int(tracks.visible[row, frame])},"
                       f"{tracks.confidence[row, frame]:.3f}\n")


def write_dlc_csv(tracks: Tracks, path: Path, scorer: str, names: Mapping[int, str]) -> None:
    """DeepLabCut's table of one animal: a row a frame, and of each point x, y and likelihood."""
    parts = _body_parts(tracks, names)
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["scorer"] + [scorer] * 3 * len(parts))
        writer.writerow(["bodyparts"] + [part for part in parts for _ in range(3)])
        writer.writerow(["coords"] + ["x", "y", "likelihood"] * len(parts))
        for frame in range(tracks.frames):
            row = [str(frame)]
            for (x, y), confidence in zip(tracks.xy[:, frame], tracks.confidence[:, frame]):
                row += ["", "", ""] if np.isnan(x) else [f"{x:.3f}", f"{y:.3f}", f"{confidence:.3f}"]
            writer.writerow(row)


def _body_parts(tracks: Tracks, names: Mapping[int, str]) -> list[str]:
    """A point without a name is called by its id; a name that came before gets the id behind it."""
    parts: list[str] = []
    for point in map(int, tracks.ids):
        part = names.get(point) or str(point)
        while part in parts:
            part += f"_{point}"
        parts.append(part)
    return parts


def write_cvat_xml(tracks: Tracks, path: Path, names: Mapping[int, str], size: tuple[int, int] | None,
                   frames: int) -> None:
    """CVAT for video 1.1: a track a point, with a shape for each frame on which it is known. CVAT does not import a
    file with a track that has no shape: a point that is known on none is left out, with its label. `frames`: of the
    video."""
    if frames < tracks.frames:
        raise ValueError(f"frames is {frames}, but {tracks.frames} were tracked")
    labels = {row: _label(names.get(int(point), ""), int(point))
              for row, point in enumerate(tracks.ids) if not np.isnan(tracks.xy[row, :, 0]).all()}
    with open(path, "w", newline="\n", encoding="utf-8") as file:
        file.write('<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n<version>1.1</version>\n')
        file.write(_cvat_meta(sorted(set(labels.values())), frames, size))
        for row, label in labels.items():
            file.write(f'<track id="{tracks.ids[row]}" label="{label}" source="auto">\n')
            file.writelines(_cvat_shapes(tracks, row, size, frames))
            file.write("</track>\n")
        file.write("</annotations>\n")


def _label(name: str, point: int) -> str:
    """A name that is only the point's id is none."""
    return _escaped(name) if name not in ("", str(point)) else "point"


def _cvat_meta(labels: list[str], frames: int, size: tuple[int, int] | None) -> str:
    original = "" if size is None else (f"<original_size><width>{size[0]}</width><height>{size[1]}</height>"
                                        "</original_size>")
    described = "".join(f"<label><name>{label}</name><type>points</type><attributes></attributes></label>\n"
                        for label in labels)
    return (f"<meta><task><size>{frames}</size><mode>interpolation</mode>{original}\n<labels>\n{described}"
            "</labels></task></meta>\n")


def _cvat_shapes(tracks: Tracks, row: int, size: tuple[int, int] | None, frames: int) -> Iterator[str]:
    """A shape holds until the next one: where nothing is known any more, the last one is repeated as being outside."""
    before = None
    for frame, (x, y) in enumerate(tracks.xy[row]):
        if not np.isnan(x):
            hidden = int(not tracks.visible[row, frame])
            before = f'occluded="{hidden}" points="{x:.3f},{y:.3f}" z_order="0"></points>\n'
            outside = size is not None and not (-0.5 <= x < size[0] - 0.5 and -0.5 <= y < size[1] - 0.5)
            yield f'  <points frame="{frame}" keyframe="1" outside="{int(outside)}" {before}'
        elif before is not None:
            yield f'  <points frame="{frame}" keyframe="1" outside="1" {before}'
            before = None
    if before is not None and frames > tracks.frames:
        yield f'  <points frame="{tracks.frames}" keyframe="1" outside="1" {before}'


def _escaped(text: str) -> str:
    """XML knows no character below a space but three, not even escaped."""
    known = re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f]", " ", text)
    for character, name in (("&", "amp"), ("<", "lt"), (">", "gt"), ('"', "quot")):
        known = known.replace(character, f"&{name};")
    return known
