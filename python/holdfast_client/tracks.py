# SPDX-License-Identifier: Apache-2.0
"""What is known of a session's points, as arrays."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from ._export import Path, track_arrays, write_csv, write_cvat_xml, write_dlc_csv
from ._frames import Frame
from ._object_export import object_arrays, write_objects_csv
from ._objects import ObjectTrack, object_of
from ._picture import Picture, draw

_SHOWN_POINTS, _SHOWN_FRAMES = 100, 200  # by a notebook that is not asked to


@dataclass
class Tracks:
    """N points over T frames. Positions are pixels of the video's own frames; (0, 0) is the centre of the first one.

    ids           uint64 [N]
    xy            float32 [N, T, 2]; NaN where nothing is known: before a point was added, and after it was removed
    visible       bool [N, T]; False: hidden, lost or outside the frame
    confidence    float32 [N, T], 0 .. 1: with calibrated weights the probability that the point is visible and less
                  than 8 pixels of a frame of 256x256 from here, unless `every_frame` had it carried on by optical flow:
                  then it is no fitted probability; 0 where nothing is known
    final         bool [N, T]; True: this will never be revised
    objects       ObjectTrack by object id; its points are among the others, by ids that object_points() tells
    query_frames  int64 [N]: where each point starts; if they are not given, where it is known first
    capture_times in UTC, by frame, of those that push() gave one
    sent          frames that the session was given; if it is not given, T
    complete      True: the session went to its end
    """

    ids: np.ndarray
    xy: np.ndarray
    visible: np.ndarray
    confidence: np.ndarray
    final: np.ndarray
    objects: Mapping[int, ObjectTrack] = field(default_factory=dict)
    query_frames: np.ndarray = None  # type: ignore[assignment]  # until __post_init__
    capture_times: Mapping[int, datetime] = field(default_factory=dict)
    sent: int = 0
    complete: bool = False

    def __post_init__(self) -> None:
        self.sent = max(self.sent, self.frames)
        if self.query_frames is None:
            known = ~np.isnan(self.xy[:, :, 0])
            self.query_frames = known.argmax(axis=1) if self.frames else np.zeros(len(self), np.int64)

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

    def object_points(self, key: int) -> np.ndarray:
        """uint64: ids of the points that the server placed on an object."""
        return np.array([point for point in self.ids if object_of(int(point)) == key], np.uint64)

    def to_npz(self, path: Path, names: Mapping[int, str] | None = None, size: tuple[int, int] | None = None,
               fps: float | None = None) -> None:
        """Writes all of it for numpy.load, under the names of the .npz of `holdfast track`: tracks [N, T, 2] (which is
        xy, there under both names), visible and confidence [N, T], ids (int64; uint64 where there are objects' points)
        and names [N] (`names` by id, otherwise the id), query_frames [N], frames [T], complete, final_frames,
        expected_frames; size [2] (width, height) and fps if they are given, and capture_times [T] (seconds since 1970,
        NaN: not known) where there are some. Besides final [N, T], which the command line does not write.

        Of O objects, where there are any: object_ids int64 [O]; object_centre [O, T, 2], object_scale, object_rotation
        and object_visible [O, T] and object_outline [O, T, C, 2] float32, NaN where nothing is known and behind an
        outline's last corner. Of their points, then: of_object int64 [N] (the object's id, -1: none), replaces int64
        [N] (the row of the point in whose place it was placed anew, -1: none) and left bool [N, T]."""
        np.savez_compressed(path, **track_arrays(self, names or {}, size, fps), **object_arrays(self))

    def to_csv(self, path: Path) -> None:
        """Writes a line for each known sample: id,frame,x,y,visible,confidence. As `holdfast track --out=x.csv`."""
        write_csv(self, path)

    def to_objects_csv(self, path: Path) -> None:
        """Writes a line for each frame of an object: object,frame,x,y,scale,rotation,visible,outline,left,joined, where
        outline is "x y;x y;..." and the last two are ids with spaces between. As `holdfast track --out=x.csv` writes
        x.objects.csv beside x.csv."""
        write_objects_csv(self, path)

    def to_dlc_csv(self, path: Path, scorer: str = "holdfast", names: Mapping[int, str] | None = None) -> None:
        """Writes DeepLabCut's CSV of one animal, which napari, movement, SLEAP's tools and pandas read: rows scorer,
        bodyparts and coords above, then a row a frame. `names`: of points by id, otherwise the id; a name that came
        before gets the id behind it. Likelihood is confidence; all three are empty where nothing is known. (0, 0) stays
        the centre of the first pixel. `holdfast track --out=x.dlc.csv` writes the same file."""
        write_dlc_csv(self, path, scorer, names or {})

    def to_cvat_xml(self, path: Path, size: tuple[int, int] | None = None,
                    names: Mapping[int, str] | None = None, frames: int | None = None) -> None:
        """Writes annotations of the format CVAT for video 1.1. `names`: the label of points by id, otherwise "point";
        the task has to have these labels. Every frame is a keyframe; hidden points are occluded; a point is outside
        where nothing is known any more, and beyond `size` (width, height of the video) if that is given. `frames`: of
        the video, where only its first ones were tracked; CVAT would keep the last shapes on the others. (0, 0) stays
        the centre of the first pixel. `holdfast track --out=x.xml` writes the same file."""
        write_cvat_xml(self, path, names or {}, size, self.frames if frames is None else frames)

    def show(self, frame: Frame | None = None, at: int = -1, trail: int = 30) -> Picture:
        """A picture for notebooks: positions at frame number `at` (negative: from the end), with trails of so many
        frames behind them, over `frame`. Visible points are filled, hidden ones hollow."""
        if not -self.frames <= at < self.frames:
            raise IndexError(f"at is {at}, but there are {self.frames} frames")
        return draw(self, frame, at % self.frames, trail)

    def _repr_html_(self) -> str:
        """What a notebook shows of a cell that ends in tracks."""
        size = f"{len(self)} points, {self.frames} frames"
        if self.frames == 0:
            return f"<p>{size}</p>"
        shown = self._thinned()
        if (len(shown), shown.frames) != (len(self), self.frames):
            size += f"; {len(shown)} points at {shown.frames} frames are shown"
        return f"<p>{size}</p>{shown.show(trail=shown.frames).svg}"

    def _thinned(self) -> Tracks:
        """Some of many points at some of many frames, evenly spread, the last frame among them."""
        rows, frames = _spread(len(self), _SHOWN_POINTS), _spread(self.frames, _SHOWN_FRAMES)
        arrays = (values[rows][:, frames] for values in (self.xy, self.visible, self.confidence, self.final))
        return Tracks(self.ids[rows], *arrays)


def _spread(count: int, most: int) -> np.ndarray:
    """Indices of `count` things, the first and the last among them."""
    return np.linspace(0, count - 1, min(count, most)).astype(int)
