# SPDX-License-Identifier: Apache-2.0
"""Trails of tracks as SVG, for notebooks and documents; it takes nothing but numpy."""
from __future__ import annotations

import base64
import colorsys
import os
import struct
import zlib
from typing import TYPE_CHECKING, Union

import numpy as np

from ._frames import Frame, check_picture, jpeg_segments, size_of

if TYPE_CHECKING:
    from .tracks import Tracks

_APP1 = 0xe1  # of JPEG's segments, the one that Exif is in


class Picture:
    """An SVG that notebooks show by themselves; `svg` is its text."""

    def __init__(self, svg: str) -> None:
        self.svg = svg

    def _repr_svg_(self) -> str:
        return self.svg

    def save(self, path: Union[str, os.PathLike[str]]) -> None:
        with open(path, "w", encoding="utf-8") as file:
            file.write(self.svg)


def draw(tracks: Tracks, frame: Frame | None, at: int, trail: int) -> Picture:
    """Where points are on frame `at`, filled where visible and hollow where hidden, and where they were on the `trail`
    frames before. Pixels of the video are units of the SVG; (0, 0), the centre of the first one, lies at (0.5, 0.5)."""
    href, (width, height) = ("", _extent(tracks)) if frame is None else _embed(frame)
    shapes = [f'<image href="{href}" width="{width}" height="{height}"/>'] if href else []
    stroke = max(width, height) / 400
    for row in range(len(tracks)):
        shapes += _trail(tracks, row, at, max(at - trail, 0), stroke)
    return Picture(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{max(width, 480)}">'
                   + "".join(shapes) + "</svg>")


def _trail(tracks: Tracks, row: int, at: int, first: int, stroke: float) -> list[str]:
    red, green, blue = colorsys.hsv_to_rgb(row * 0.618 % 1, 0.85, 0.95)  # far apart for neighbours
    colour = f"#{int(red * 255):02x}{int(green * 255):02x}{int(blue * 255):02x}"
    path = tracks.xy[row, first:at + 1] + 0.5
    path = path[~np.isnan(path[:, 0])]
    if len(path) == 0:
        return []
    points = " ".join(f"{x:.2f},{y:.2f}" for x, y in path)
    shapes = [f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{stroke:.2f}" opacity="0.7"/>']
    if not np.isnan(tracks.xy[row, at, 0]):
        x, y = tracks.xy[row, at] + 0.5
        fill = colour if tracks.visible[row, at] else "none"
        shapes.append(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="{2.5 * stroke:.2f}" fill="{fill}" stroke="{colour}" '
                      f'stroke-width="{stroke:.2f}"><title>{tracks.ids[row]}</title></circle>')
    return shapes


def _extent(tracks: Tracks) -> tuple[int, int]:
    """What holds all positions, where there is no frame to tell."""
    if len(tracks) == 0 or np.isnan(tracks.xy).all():
        return 1, 1
    width, height = np.ceil(np.nanmax(tracks.xy, axis=(0, 1)) + 1).clip(1)
    return int(width), int(height)


def _embed(frame: Frame) -> tuple[str, tuple[int, int]]:
    """A frame as an address that has it inside, and its size."""
    if isinstance(frame, bytes):
        kind, data = ("jpeg", _without_exif(frame)) if frame.startswith(b"\xff\xd8") else ("png", frame)
    else:
        kind, data = "png", _png(check_picture(frame))
    if (size := size_of(frame)) is None:
        raise ValueError("a frame's bytes are neither JPEG nor PNG, or say no size")
    return f"data:image/{kind};base64," + base64.b64encode(data).decode(), size


def _without_exif(jpeg: bytes) -> bytes:
    """A viewer would turn the picture as its Exif says. Positions are those of the pixels as they are stored."""
    kept, begin = [], 0
    for marker, at, end in jpeg_segments(jpeg):
        if marker == _APP1 and jpeg.startswith(b"Exif", at + 4):
            kept.append(jpeg[begin:at])
            begin = end
    return b"".join([*kept, jpeg[begin:]])


def _png(picture: np.ndarray) -> bytes:
    """The simplest file that the format knows: 8 bits, rows without a filter."""
    height, width = picture.shape[:2]

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = np.zeros((height, 1 + picture[0].size), np.uint8)
    rows[:, 1:] = picture.reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 0 if picture.ndim == 2 else 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes()))
            + chunk(b"IEND", b""))
