# SPDX-License-Identifier: Apache-2.0
"""What has come of a session's points so far."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime

import numpy as np

from ._objects import ObjectRun, ObjectTrack, replaced_by
from ._proto import point_tracking_pb2 as pb
from .tracks import Tracks


class _Row:
    """Values of one point or object for each frame, from the first that was told of. It grows by doubling, so that long
    videos are not copied at every frame."""

    def __init__(self, **nothing: np.ndarray) -> None:
        """`nothing`: what each column has where nothing is known."""
        self.first = 0
        self.columns = {name: np.empty((0, *value.shape), value.dtype) for name, value in nothing.items()}
        self._nothing = nothing
        self._length = 0

    def write(self, first: int, final_count: int, **values: Sequence[float] | np.ndarray) -> None:
        count = len(next(iter(values.values())))
        self._cover(first, first + count)
        begin = first - self.first
        for name, column in values.items():
            self.columns[name][begin:begin + count] = column
        self.columns["final"][begin:begin + final_count] = True

    def _cover(self, first: int, end: int) -> None:
        if self._length == 0:
            self.first = first
        before, after = max(self.first - first, 0), max(end - self.first - self._length, 0)
        if before + after == 0:
            return
        if after > 0:
            after = max(after, self._length)
        self.columns = {name: np.concatenate([self._unknown(name, before), column, self._unknown(name, after)])
                        for name, column in self.columns.items()}
        self.first -= before
        self._length += before + after

    def _unknown(self, name: str, count: int) -> np.ndarray:
        value = self._nothing[name]
        return np.full((count, *value.shape), value, value.dtype)

    def drop_void(self) -> None:
        """Estimates that are not final."""
        void = ~self.columns["final"]
        for name, column in self.columns.items():
            column[void] = self._nothing[name]

    def over(self, name: str, frames: int) -> np.ndarray:
        """A column from frame 0 on."""
        column = self._unknown(name, frames)
        known = self.columns[name][:max(frames - self.first, 0)]
        column[self.first:self.first + len(known)] = known
        return column


def _of_point() -> _Row:
    return _Row(xy=np.full(2, np.nan, np.float32), visible=np.array(False), confidence=np.array(0, np.float32),
                final=np.array(False))


class _Object:
    """What has come of one object."""

    def __init__(self) -> None:
        unknown = np.array(np.nan, np.float32)
        self._row = _Row(centre=np.full(2, np.nan, np.float32), scale=unknown, rotation=unknown,
                         visible=np.array(0, np.float32), final=np.array(False))
        self._outline: dict[int, np.ndarray] = {}  # by frame, as are those below
        self._left: dict[int, frozenset[int]] = {}
        self._joined: dict[int, frozenset[int]] = {}

    def add(self, run: ObjectRun) -> None:
        self._row.write(run.first_frame, run.final_count, centre=run.centre, scale=run.scale, rotation=run.rotation,
                        visible=run.visible)
        self._outline.update(enumerate(run.outline, run.first_frame))
        self._left.update(enumerate(run.left, run.first_frame))
        self._joined.update(enumerate(run.joined, run.first_frame))

    def track(self, frames: int) -> ObjectTrack:
        arrays = {name: self._row.over(name, frames) for name in self._row.columns}
        outlines = (self._outline.get(frame) for frame in range(frames))
        return ObjectTrack(**arrays, outline=[None if corners is None else corners.copy() for corners in outlines],
                           left=[self._left.get(frame, frozenset()) for frame in range(frames)],
                           joined=[self._joined.get(frame, frozenset()) for frame in range(frames)])


class TrackTable:
    """Collects updates; the newest estimate of a sample stands. Not thread-safe."""

    def __init__(self) -> None:
        self._rows: dict[int, _Row] = {}
        self._objects: dict[int, _Object] = {}
        self._replaced: set[int] = set()  # points in whose place others are: what is not final of them is void
        self._capture_times: dict[int, datetime] = {}
        self._frames = 0

    def add(self, run: pb.PointRun) -> None:
        row = self._rows.setdefault(run.id, _of_point())
        row.write(run.first_frame, run.final_count, xy=np.stack([run.x, run.y], axis=1), visible=run.visible,
                  confidence=run.confidence)
        self._frames = max(self._frames, run.first_frame + len(run.x))

    def add_object(self, run: ObjectRun) -> None:
        self._objects.setdefault(run.id, _Object()).add(run)
        self._replaced.update(replaced for point in frozenset().union(*run.joined)
                              if (replaced := replaced_by(point)) is not None)

    def add_capture_times(self, times: Mapping[int, datetime]) -> None:
        self._capture_times.update(times)

    def tracks(self, sent: int = 0, complete: bool = False) -> Tracks:
        """All of it, of a session that was given so many frames; `complete`: that has come to its end."""
        frames, ids = self._frames, sorted(self._rows)
        for point in self._replaced & self._rows.keys():
            self._rows[point].drop_void()

        def stack(name: str, empty: np.ndarray) -> np.ndarray:
            return np.stack([self._rows[point].over(name, frames) for point in ids]) if ids else empty
        return Tracks(np.array(ids, np.uint64), stack("xy", np.zeros((0, frames, 2), np.float32)),
                      stack("visible", np.zeros((0, frames), bool)),
                      stack("confidence", np.zeros((0, frames), np.float32)),
                      stack("final", np.zeros((0, frames), bool)),
                      {key: made.track(frames) for key, made in self._objects.items()},
                      np.array([self._rows[point].first for point in ids], np.int64), dict(self._capture_times), sent,
                      complete)
