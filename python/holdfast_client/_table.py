# SPDX-License-Identifier: Apache-2.0
"""What has come of a session's points so far."""
from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from ._objects import ObjectRun, ObjectTrack, replaced_by
from ._proto import point_tracking_pb2 as pb
from .tracks import Tracks


@dataclass
class _Row:
    """One point, grown as frames come."""

    query_frame: int
    xy: np.ndarray = field(default_factory=lambda: np.full((0, 2), np.nan, np.float32))
    visible: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    confidence: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))
    final: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    def grow(self, frames: int) -> None:
        missing = frames - len(self.xy)
        if missing <= 0:
            return
        missing = max(missing, len(self.xy))  # by doubling: long videos are not copied at every frame
        self.xy = np.concatenate([self.xy, np.full((missing, 2), np.nan, np.float32)])
        self.visible = np.concatenate([self.visible, np.zeros(missing, bool)])
        self.confidence = np.concatenate([self.confidence, np.zeros(missing, np.float32)])
        self.final = np.concatenate([self.final, np.zeros(missing, bool)])

    def drop_void(self) -> None:
        """Estimates that are not final."""
        void = ~self.final
        self.xy[void], self.visible[void], self.confidence[void] = np.nan, False, 0


class TrackTable:
    """Collects updates; the newest estimate of a sample stands. Not thread-safe."""

    def __init__(self) -> None:
        self._rows: dict[int, _Row] = {}
        self._objects: dict[int, ObjectTrack] = {}
        self._replaced: set[int] = set()  # points in whose place others are: what is not final of them is void
        self._capture_times: dict[int, datetime] = {}
        self._frames = 0

    def add(self, run: pb.PointRun) -> None:
        first, count = run.first_frame, len(run.x)
        row = self._rows.setdefault(run.id, _Row(first))
        row.grow(first + count)
        span = slice(first, first + count)
        row.xy[span, 0] = run.x
        row.xy[span, 1] = run.y
        row.visible[span] = run.visible
        row.confidence[span] = run.confidence
        row.final[first:first + run.final_count] = True
        self._frames = max(self._frames, first + count)

    def add_object(self, run: ObjectRun) -> None:
        self._objects.setdefault(run.id, ObjectTrack()).add(run)
        self._replaced.update(replaced for point in frozenset().union(*run.joined)
                              if (replaced := replaced_by(point)) is not None)

    def add_capture_times(self, times: Mapping[int, datetime]) -> None:
        self._capture_times.update(times)

    def tracks(self, sent: int = 0, complete: bool = False) -> Tracks:
        """All of it, of a session that was given so many frames; `complete`: that has come to its end."""
        frames, ids = self._frames, sorted(self._rows)
        for point, row in self._rows.items():
            row.grow(frames)
            if point in self._replaced:
                row.drop_void()
        rows = [self._rows[point] for point in ids]

        def stack(name: str, empty: np.ndarray) -> np.ndarray:
            return np.stack([getattr(row, name)[:frames] for row in rows]) if rows else empty
        return Tracks(np.array(ids, np.uint64), stack("xy", np.zeros((0, frames, 2), np.float32)),
                      stack("visible", np.zeros((0, frames), bool)),
                      stack("confidence", np.zeros((0, frames), np.float32)),
                      stack("final", np.zeros((0, frames), bool)), self._copies(frames),
                      np.array([row.query_frame for row in rows], np.int64), dict(self._capture_times), sent, complete)

    def _copies(self, frames: int) -> dict[int, ObjectTrack]:
        copies = copy.deepcopy(self._objects)
        for track in copies.values():
            track.grow(frames)
        return copies
