# SPDX-License-Identifier: Apache-2.0
"""Objects in files. Equal tracks make the same arrays and lines as the command line writes (client/cli/track_writer.h).
"""
from __future__ import annotations

import os
from typing import TYPE_CHECKING, Union

import numpy as np

from ._objects import ObjectTrack, object_of, replaced_by

if TYPE_CHECKING:
    from .tracks import Tracks

Path = Union[str, "os.PathLike[str]"]


def object_arrays(tracks: Tracks) -> dict[str, np.ndarray]:
    """By name; none where there is no object."""
    if not tracks.objects:
        return {}
    objects = list(tracks.objects.values())
    ids = [int(point) for point in tracks.ids]
    rows = {point: row for row, point in enumerate(ids)}
    left = np.zeros(tracks.visible.shape, bool)
    for one in objects:
        for frame, points in enumerate(one.left):
            left[[rows[point] for point in points if point in rows], frame] = True
    of_object = [object_of(point) for point in ids]
    replaces = [rows.get(before, -1) if (before := replaced_by(point)) is not None else -1 for point in ids]
    arrays = {"of_object": np.array([-1 if key not in tracks.objects else key for key in of_object], np.int64),
              "replaces": np.array(replaces, np.int64), "left": left,
              "object_ids": np.array(list(tracks.objects), np.int64), "object_outline": _outlines(objects)}
    for name in ("centre", "scale", "rotation", "visible"):
        arrays[f"object_{name}"] = np.stack([getattr(one, name) for one in objects])
    return arrays


def _outlines(objects: list[ObjectTrack]) -> np.ndarray:
    corners = max((len(outline) for one in objects for outline in one.outline if outline is not None), default=0)
    outlines = np.full((len(objects), len(objects[0].outline), corners, 2), np.nan, np.float32)
    for row, one in enumerate(objects):
        for frame, outline in enumerate(one.outline):
            if outline is not None:
                outlines[row, frame, :len(outline)] = outline
    return outlines


def write_objects_csv(tracks: Tracks, path: Path) -> None:
    with open(path, "w", newline="\n", encoding="utf-8") as file:
        file.write("object,frame,x,y,scale,rotation,visible,outline,left,joined\n")
        for key, one in tracks.objects.items():
            file.writelines(_line(key, one, frame) for frame, outline in enumerate(one.outline) if outline is not None)


def _line(key: int, one: ObjectTrack, frame: int) -> str:
    centre, outline = one.centre[frame], one.outline[frame]
    corners = "" if outline is None else ";".join(f"{x:.3f} {y:.3f}" for x, y in outline)
    left, joined = (" ".join(map(str, sorted(ids[frame]))) for ids in (one.left, one.joined))
    motion = f"{one.scale[frame]:.4f},{one.rotation[frame]:.4f},{one.visible[frame]:.4f}"
    return f"{key},{frame},{centre[0]:.3f},{centre[1]:.3f},{motion},{corners},{left},{joined}\n"
