# SPDX-License-Identifier: Apache-2.0
"""Tracks of both directions: what lies before a point's query is tracked by a session over the reversed video."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ._frames import Frame
from ._queries import Queries
from .tracks import Tracks


class Backward:
    """The video from the last frame with a query down to the first one, as a video of its own."""

    def __init__(self, frames: Any, queries: Queries) -> None:
        """TypeError where frames cannot be indexed: they are read a second time, and nothing keeps them meanwhile."""
        if not isinstance(frames, (Sequence, np.ndarray)):
            raise TypeError(f"both=True reads frames a second time: it takes a sequence, such as list(frames), not "
                            f"{type(frames).__name__}")
        self._queried = queries.frames
        self._frames = frames
        self._last = queries.last
        self.queries = queries.reversed()

    def __iter__(self) -> Iterator[Frame]:
        for frame in range(self._last, -1, -1):
            yield self._frames[frame]

    @staticmethod
    def without_objects(options: dict[str, Any]) -> dict[str, Any]:
        """An object is queried at the first frame of the video, which has no frames before it."""
        return {name: value for name, value in options.items() if name not in ("objects", "object_points", "reseed")}

    def merge(self, after: Tracks, before: Tracks) -> Tracks:
        """`before`, which is of this video, where it speaks of frames before a point's query; otherwise `after`."""
        merged = replace(after, xy=after.xy.copy(), visible=after.visible.copy(), confidence=after.confidence.copy(),
                         final=after.final.copy(), complete=after.complete and before.complete)
        rows = {int(point): row for row, point in enumerate(before.ids)}
        for row, point in enumerate(after.ids):
            queried = self._queried.get(int(point), 0)  # an object's is of the first frame
            if queried == 0:
                continue
            reversed_frames = self._last - np.arange(queried)
            for name in ("xy", "visible", "confidence", "final"):
                getattr(merged, name)[row, :queried] = getattr(before, name)[rows[int(point)], reversed_frames]
        return merged
