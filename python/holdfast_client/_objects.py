# SPDX-License-Identifier: Apache-2.0
"""Objects: what is asked for, and what has come of them so far."""
from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Union

import numpy as np

from ._proto import point_tracking_pb2 as pb

# A mask: bool or uint8 [H, W], not zero where the object is, or the bytes of such a PNG. Or the corners of a polygon,
# which is what uint8 [N, 2] is taken for: a mask of a frame two pixels wide has to be bool.
Shape = Union[bytes, np.ndarray, Sequence[Sequence[float]]]
Objects = Mapping[int, Shape]

_FIRST_POINT = 1 << 63
_LAST_ID = (1 << 31) - 1
_PLACES = 256  # of an object: indices that are the same modulo it share a place


def object_of(point: int) -> int | None:
    """The object that a point's id belongs to; None: to none."""
    return (point >> 32) & 0x7FFFFFFF if point >= _FIRST_POINT else None


def replaced_by(point: int) -> int | None:
    """The id of the point in whose place this one was placed anew; None: it was not."""
    return point - _PLACES if point >= _FIRST_POINT and point & 0xFFFFFFFF >= _PLACES else None


def _png(mask: np.ndarray) -> bytes:
    """Of 8 bits a pixel, grey."""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    height, width = mask.shape
    rows = np.zeros((height, width + 1), np.uint8)  # each begins with its filter: none
    rows[:, 1:] = np.where(mask != 0, 255, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows.tobytes())) + chunk(b"IEND", b""))


@dataclass(frozen=True)
class Placement:
    """Of objects' points: how many on each, 0 leaves it to the server, and whether those that leave are placed anew."""

    points: int = 0
    reseed: bool = True


def _to_object(key: int, shape: Shape, placement: Placement) -> pb.Object:
    if not isinstance(key, (int, np.integer)) or not 0 <= key <= _LAST_ID:
        raise ValueError(f"an object's id is {key!r}, expected 0 .. {_LAST_ID}")
    made = pb.Object(id=key, points=placement.points, reseed=placement.reseed)
    if isinstance(shape, bytes):
        made.mask_png = shape
        return made
    expected = "expected a mask, bool or uint8 [H, W], or the bytes of such a PNG, or the corners of a polygon, [N, 2]"
    try:
        array = np.asarray(shape)
    except ValueError:
        raise ValueError(f"object {key} is {shape!r:.80}, {expected}") from None
    if array.ndim == 2 and (array.dtype == np.bool_ or (array.dtype == np.uint8 and array.shape[1] != 2)):
        made.mask_png = _png(array)
        return made
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"object {key} is {array.dtype} {list(array.shape)}, {expected}")
    made.polygon.CopyFrom(pb.Polygon(x=array[:, 0], y=array[:, 1]))
    return made


def to_objects(objects: Objects | None, placement: Placement = Placement()) -> list[pb.Object]:
    if objects is None:
        return []
    if not isinstance(objects, Mapping):
        raise TypeError(f"objects are a {type(objects).__name__}, expected a mask or a polygon by id: {{1: mask}}")
    return [_to_object(key, shape, placement) for key, shape in objects.items()]


@dataclass(frozen=True)
class ObjectRun:
    """One object on consecutive frames: element i belongs to frame first_frame + i. As ObjectTrack has them."""

    id: int
    first_frame: int
    centre: np.ndarray  # float32 [n, 2]
    scale: np.ndarray  # float32 [n]
    rotation: np.ndarray  # float32 [n]
    visible: np.ndarray  # float32 [n]
    outline: tuple[np.ndarray, ...]  # n times float32 [corners, 2]
    left: tuple[frozenset[int], ...]  # n times ids of points
    joined: tuple[frozenset[int], ...]  # n times ids of points
    final_count: int  # the first so many will never be revised


@dataclass
class ObjectTrack:
    """An object over T frames. Positions are pixels of the video's own frames.

    centre    float32 [T, 2]: where the centre of gravity of its mask has come to; NaN where nothing is known
    scale     float32 [T]: since the frame it was queried at
    rotation  float32 [T]: radians since then, from x towards y
    visible   float32 [T], 0 .. 1: the share of the points that it still has which are visible
    outline   for each frame float32 [corners, 2], convex; None where nothing is known
    left      for each frame the ids of its points that do not move with it any more
    joined    for each frame the ids of its points that were placed anew just before it: id - 256 is the point in whose
              place one was, which ends within a window
    final     bool [T]; True: this will never be revised
    """

    centre: np.ndarray = field(default_factory=lambda: np.full((0, 2), np.nan, np.float32))
    scale: np.ndarray = field(default_factory=lambda: np.full(0, np.nan, np.float32))
    rotation: np.ndarray = field(default_factory=lambda: np.full(0, np.nan, np.float32))
    visible: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    outline: list[np.ndarray | None] = field(default_factory=list)
    left: list[frozenset[int]] = field(default_factory=list)
    joined: list[frozenset[int]] = field(default_factory=list)
    final: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))


_NO_IDS: frozenset[int] = frozenset()  # one for the many frames that have none


def to_run(run: pb.ObjectRun) -> ObjectRun:
    samples = run.samples

    def floats(name: str) -> np.ndarray:
        return np.array([getattr(sample, name) for sample in samples], np.float32)
    outlines = (np.stack([sample.outline_x, sample.outline_y], axis=1) for sample in samples)
    return ObjectRun(run.id, run.first_frame, np.stack([floats("x"), floats("y")], axis=1), floats("scale"),
                     floats("rotation"), floats("visible"), tuple(outline.astype(np.float32) for outline in outlines),
                     tuple(frozenset(sample.left) or _NO_IDS for sample in samples),
                     tuple(frozenset(sample.joined) or _NO_IDS for sample in samples), run.final_count)
