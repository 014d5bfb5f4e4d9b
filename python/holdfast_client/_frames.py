# SPDX-License-Identifier: Apache-2.0
"""Frames and points in the forms that callers have them, for the protocol."""
from __future__ import annotations

import functools
import importlib
import io
import struct
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Union

import numpy as np

from ._proto import point_tracking_pb2 as pb

Frame = Union[bytes, np.ndarray]  # of a file (JPEG, PNG), or uint8 [H, W, 3] in RGB, or uint8 [H, W]
Points = Union[np.ndarray, Mapping[int, tuple[float, float]], Iterable[tuple[float, float]]]

_JPEG, _PNG = b"\xff\xd8", b"\x89PNG"
_JPEG_SCAN = 0xda
_QUALITY = 95


@functools.lru_cache(maxsize=None)
def _optional(name: str) -> Any:
    """None where it is not installed or does not load, which Python would try anew at every frame."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def _encode_jpeg(picture: np.ndarray) -> bytes | None:
    """None where neither OpenCV nor Pillow is installed."""
    if (cv2 := _optional("cv2")) is not None:
        bgr = picture if picture.ndim == 2 else np.ascontiguousarray(picture[:, :, ::-1])
        return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
    if (image := _optional("PIL.Image")) is not None:
        file = io.BytesIO()
        image.fromarray(picture).save(file, "JPEG", quality=_QUALITY)
        return file.getvalue()
    return None


def check_picture(picture: Any) -> np.ndarray:
    if not isinstance(picture, np.ndarray):
        raise TypeError(f"a frame is {type(picture).__name__} {picture!r:.80}, expected an array, uint8 [H, W, 3] in "
                        "RGB or uint8 [H, W], or the bytes of a JPEG or PNG file")
    shape = picture.shape
    if picture.dtype != np.uint8 or not (len(shape) == 2 or (len(shape) == 3 and shape[2] == 3)) or picture.size == 0:
        raise ValueError(f"a frame is {picture.dtype} {list(shape)}, expected uint8 [H, W, 3] in RGB or uint8 [H, W]")
    return picture


def size_of(frame: Frame) -> tuple[int, int] | None:
    """Its (width, height); None where a file does not say."""
    if not isinstance(frame, bytes):
        height, width = check_picture(frame).shape[:2]
        return width, height
    return _jpeg_size(frame) if frame.startswith(_JPEG) else _png_size(frame)


def _png_size(file: bytes) -> tuple[int, int] | None:
    if not file.startswith(_PNG) or len(file) < 24:
        return None
    width, height = struct.unpack_from(">II", file, 16)
    return (width, height) if width and height else None


def jpeg_segments(file: bytes) -> Iterator[tuple[int, int, int]]:
    """The marker's second byte, the beginning and the end of each segment before the coded picture."""
    at = 2
    while at + 4 <= len(file) and file[at] == 0xff:
        marker = file[at + 1]
        if marker == 0xff:  # fills up
            at += 1
            continue
        if marker == _JPEG_SCAN:
            return
        end = at + 2 + struct.unpack_from(">H", file, at + 2)[0]
        yield marker, at, end
        at = end


def _jpeg_size(file: bytes) -> tuple[int, int] | None:
    """As the frame header says, the segment whose marker is one of ff c0 .. ff cf but those of tables. It comes before
    the coded picture."""
    for marker, at, _ in jpeg_segments(file):
        if 0xc0 <= marker <= 0xcf and marker not in (0xc4, 0xc8, 0xcc) and at + 9 <= len(file):
            height, width = struct.unpack_from(">HH", file, at + 5)
            return (width, height) if width and height else None
    return None


_KINDS = {pb.FRAME_ENCODING_JPEG: "a JPEG file", pb.FRAME_ENCODING_PNG: "a PNG file",
          pb.FRAME_ENCODING_RGB24: "an array [H, W, 3]", pb.FRAME_ENCODING_GRAY8: "an array [H, W]"}
_NO_ENCODER = "an array can be sent as JPEG only where OpenCV (cv2) or Pillow is installed"


def _file_encoding(file: bytes) -> pb.FrameEncoding:
    if not file.startswith((_JPEG, _PNG)):
        raise ValueError(f"a frame's bytes are neither JPEG nor PNG: they begin with {file[:8]!r}")
    return pb.FRAME_ENCODING_JPEG if file.startswith(_JPEG) else pb.FRAME_ENCODING_PNG


def _raw_encoding(picture: np.ndarray) -> pb.FrameEncoding:
    return pb.FRAME_ENCODING_GRAY8 if picture.ndim == 2 else pb.FRAME_ENCODING_RGB24


class FrameCodec:
    """How all frames of a session are sent, as the first one decides: files as they are, arrays as JPEG or raw."""

    def __init__(self, first: Frame, encoding: str = "auto") -> None:
        if encoding not in ("auto", "jpeg", "raw"):
            raise ValueError(f"encoding is {encoding!r}, expected 'auto', 'jpeg' or 'raw'")
        self.raw_size: tuple[int, int] | None = None
        if isinstance(first, bytes):
            self.encoding = _file_encoding(first)
            return
        picture = check_picture(first)
        if encoding != "raw" and _encode_jpeg(picture[:1, :1]) is not None:
            self.encoding = pb.FRAME_ENCODING_JPEG
            return
        if encoding == "jpeg":
            raise ImportError(f"encoding is 'jpeg': {_NO_ENCODER}")
        self.encoding = _raw_encoding(picture)
        self.raw_size = (picture.shape[1], picture.shape[0])

    def data(self, frame: Frame) -> bytes:
        """ValueError where a frame cannot be sent as the first one was."""
        if isinstance(frame, bytes):
            self._check(_file_encoding(frame))
            return frame
        picture = check_picture(frame)
        if self.encoding == pb.FRAME_ENCODING_JPEG:
            encoded = _encode_jpeg(picture)
            if encoded is None:
                raise ImportError(_NO_ENCODER)
            return encoded
        self._check(_raw_encoding(picture))
        assert self.raw_size is not None
        if picture.shape[1::-1] != self.raw_size:
            raise ValueError(f"a frame is {picture.shape[1]}x{picture.shape[0]}, the first one was "
                             f"{self.raw_size[0]}x{self.raw_size[1]}")
        return picture.tobytes()

    def _check(self, encoding: pb.FrameEncoding) -> None:
        if encoding != self.encoding:
            raise ValueError(f"a frame is {_KINDS[encoding]}, the first one was sent as {_KINDS[self.encoding]}")


def to_points(points: Points, first_id: int = 0) -> list[pb.Point]:
    """{id: (x, y)}, or positions whose ids are `first_id` and those after it."""
    if isinstance(points, Mapping):
        return [_to_point(point, position) for point, position in points.items()]
    try:
        positions = np.asarray(points if isinstance(points, np.ndarray) else list(points), np.float32)
    except (TypeError, ValueError):
        raise ValueError(f"points are {points!r:.80}, expected x and y of each, or {{id: (x, y)}}") from None
    if positions.size == 0:
        return []
    if positions.ndim != 2 or positions.shape[1] != 2:
        raise ValueError(f"points are {list(positions.shape)}, expected [N, 2]: x and y of each")
    return [pb.Point(id=i, x=x, y=y) for i, (x, y) in enumerate(positions, first_id)]


def _to_point(point: int, position: tuple[float, float]) -> pb.Point:
    try:
        x, y = position
        return pb.Point(id=point, x=x, y=y)
    except (TypeError, ValueError):
        raise ValueError(f"point {point!r} is {position!r:.80}, expected an id from 0 on, and x and y") from None
