# SPDX-License-Identifier: Apache-2.0
"""What is known of a session's points, as arrays."""
from __future__ import annotations

import csv
import os
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Tracks:
    """N points over T frames. Positions are pixels of the video's own frames; (0, 0) is the centre of the first one.

    ids         uint64 [N]
    xy          float32 [N, T, 2]; NaN where nothing is known: before a point was added, and after it was removed
    visible     bool [N, T]; False: hidden, lost or outside the frame
    confidence  float32 [N, T], 0 .. 1: with calibrated weights the probability that the point is visible and less than
                8 pixels of a frame of 256x256 from here; 0 where nothing is known
    final       bool [N, T]; True: this will never be revised
    """

    ids: np.ndarray
    xy: np.ndarray
    visible: np.ndarray
    confidence: np.ndarray
    final: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def frames(self) -> int:
        """T."""
        return self.xy.shape[1]

    def of(self, point: int) -> np.ndarray:
        """float32 [T, 2]: the positions of one point, by its id. KeyError when there is none."""
        rows = np.flatnonzero(self.ids == point)
        if len(rows) == 0:
            raise KeyError(f"there is no point {point}")
        return self.xy[rows[0]]

    def to_npz(self, path: str | os.PathLike[str]) -> None:
        """Writes all of it, under the names above, for numpy.load."""
        np.savez_compressed(path, ids=self.ids, xy=self.xy, visible=self.visible, confidence=self.confidence,
                            final=self.final)

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Writes a line for each known sample: id,frame,x,y,visible,confidence,final."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(["id", "frame", "x", "y", "visible", "confidence", "final"])
            for row, frame in np.argwhere(~np.isnan(self.xy[:, :, 0])):
                x, y = self.xy[row, frame]
                writer.writerow([self.ids[row], frame, f"{x:.3f}", f"{y:.3f}", int(self.visible[row, frame]),
                                 f"{self.confidence[row, frame]:.4f}", int(self.final[row, frame])])


@dataclass
class _Row:
    """One point, grown as frames come."""

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


class TrackTable:
    """Collects updates; the newest estimate of a sample stands. Not thread-safe."""

    def __init__(self) -> None:
        self._rows: dict[int, _Row] = {}
        self._frames = 0

    def add(self, run) -> None:
        """Takes a PointRun of the protocol."""
        first, count = run.first_frame, len(run.x)
        row = self._rows.setdefault(run.id, _Row())
        row.grow(first + count)
        span = slice(first, first + count)
        row.xy[span, 0] = run.x
        row.xy[span, 1] = run.y
        row.visible[span] = run.visible
        row.confidence[span] = run.confidence
        row.final[first:first + run.final_count] = True
        self._frames = max(self._frames, first + count)

    def tracks(self, frames: int = 0) -> Tracks:
        """All of it, over at least so many frames."""
        frames, ids = max(frames, self._frames), sorted(self._rows)
        for row in self._rows.values():
            row.grow(frames)
        rows = [self._rows[point] for point in ids]

        def stack(name: str, empty: np.ndarray) -> np.ndarray:
            return np.stack([getattr(row, name)[:frames] for row in rows]) if rows else empty
        return Tracks(np.array(ids, np.uint64), stack("xy", np.zeros((0, frames, 2), np.float32)),
                      stack("visible", np.zeros((0, frames), bool)),
                      stack("confidence", np.zeros((0, frames), np.float32)),
                      stack("final", np.zeros((0, frames), bool)))
