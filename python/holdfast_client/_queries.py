# SPDX-License-Identifier: Apache-2.0
"""The points of a whole video, each with the frame that it is queried at."""
from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Union

import numpy as np

# {id: (x, y)} or [N, 2], of the first frame; {id: (frame, x, y)} or [N, 3].
Queried = Union[np.ndarray, Mapping[int, Sequence[float]], Iterable[Sequence[float]]]


class Queries:
    """By frame. Points without ids are 0, 1, 2..."""

    def __init__(self, points: Queried) -> None:
        self.frames: dict[int, int] = {}  # by id
        self._by_frame: dict[int, dict[int, tuple[float, float]]] = {}
        if not isinstance(points, Iterable):
            raise TypeError(f"points are {points!r}, expected x, y or frame, x, y of each, by id or in order")
        by_id = points if isinstance(points, Mapping) else dict(enumerate(points))
        for point, query in by_id.items():
            self._add(point, query)

    def _add(self, point: int, query: Sequence[float]) -> None:
        try:
            numbers = [float(number) for number in query]
        except (TypeError, ValueError):
            numbers = []
        if len(numbers) not in (2, 3):
            raise ValueError(f"point {point} is {query!r:.80}, expected x, y or frame, x, y")
        frame, x, y = numbers if len(numbers) == 3 else (0.0, *numbers)
        if not frame.is_integer() or frame < 0:
            raise ValueError(f"point {point} is queried at frame {frame:g}, expected 0, 1, 2...")
        self.frames[point] = int(frame)
        self._by_frame.setdefault(int(frame), {})[point] = (x, y)

    @property
    def last(self) -> int:
        """The newest frame at which a point is queried."""
        return max(self._by_frame, default=0)

    def at(self, frame: int) -> dict[int, tuple[float, float]]:
        return self._by_frame.get(frame, {})

    def reversed(self) -> Queries:
        """For the video that runs from the last query's frame back to the first frame, of those that have a past."""
        return Queries({point: (self.last - frame, *self._by_frame[frame][point])
                        for point, frame in self.frames.items() if frame > 0})

    def check(self, count: int) -> None:
        """Whether a video of so many frames has them all."""
        if self._by_frame and self.last >= count:
            missing = min(frame for frame in self._by_frame if frame >= count)
            raise ValueError(f"there are points of frame {missing}, but {count} frames")
