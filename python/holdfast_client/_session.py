# SPDX-License-Identifier: Apache-2.0
"""A session as its client sees it, without threads and without a network: what may have to be sent again, and what came
back. The rules are those of the C++ client (client/replay_buffer.h, client/final_filter.h)."""
from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone

import numpy as np

from ._objects import ObjectRun, to_run
from ._proto import point_tracking_pb2 as pb
from ._table import TrackTable
from .errors import HoldfastWarning

_OVERHEAD = 256  # bytes of a message's objects: many small ones are bounded too


@dataclass(frozen=True)
class Run:
    """One point on consecutive frames: element i belongs to frame first_frame + i."""

    id: int
    first_frame: int
    xy: np.ndarray  # float32 [n, 2]
    visible: np.ndarray  # bool [n]
    confidence: np.ndarray  # float32 [n]
    final_count: int  # the first so many will never be revised


@dataclass(frozen=True)
class Update:
    """Estimates that are new or revised, and how far the server is."""

    runs: tuple[Run, ...]
    frames_received: int  # of the video, by the server
    frames_processed: int  # whose features it has computed
    capture_times: Mapping[int, datetime]  # by frame, in UTC: of those that the runs speak of and push() gave one
    objects: tuple[ObjectRun, ...] = ()


def _cut(run: pb.PointRun | pb.ObjectRun, known: int, *columns: str) -> None:
    """Takes the frames before `known` out of a run; `columns` are its fields of a value for each frame."""
    drop = min(max(known - run.first_frame, 0), len(getattr(run, columns[0])))
    for name in columns:
        del getattr(run, name)[:drop]
    run.first_frame += drop
    run.final_count = max(run.final_count - drop, 0)


class SessionState:
    """Not thread-safe."""

    def __init__(self, config: pb.SessionConfig, keep: bool, buffer_bytes: int) -> None:
        self.config = config
        self.keeps = keep
        self.token = b""
        self.resumable = False  # by other servers too
        self.accepted: pb.SessionAccepted | None = None
        self.summary: pb.SessionSummary | None = None
        self.table = TrackTable()
        self._server = ""  # that has the session
        self._buffer_bytes = buffer_bytes
        self._messages: deque[pb.TrackRequest] = deque()
        self._sent = 0  # of them, at the front
        self._bytes = 0
        self._final: dict[int, int] = {}  # of each point, the frames before this one are final
        self._repeated: dict[int, int] = {}  # as of the last resume: what is before comes again
        self._final_objects: dict[int, int] = {}
        self._repeated_objects: dict[int, int] = {}
        self.processed = 0  # frames that servers have worked off
        self.received = 0  # frames that servers have

    # --- What is sent.

    @property
    def unsent(self) -> int:
        return len(self._messages) - self._sent

    def room_for(self, message: pb.TrackRequest) -> bool:
        """False: a checkpoint has to let older messages go first. Where none can, nothing is kept any more."""
        if not self.keeps or self.accepted is None:
            return True
        if self._bytes + message.ByteSize() + _OVERHEAD <= self._buffer_bytes:
            return True
        frames, needed = sum(kept.HasField("frame") for kept in self._messages), self._frames_needed()
        if frames > needed:
            return False
        self._keep_nothing()
        self._warn(f"{frames} frames fill the {self._buffer_bytes} bytes of buffer_bytes, and up to {needed + 1} have "
                   "to be kept: it ends with its server")
        return True

    def _frames_needed(self) -> int:
        """The newest checkpoint may lie so many frames behind what was sent: it is made when a window has run, up to a
        hop later than the interval says, and up to a hop of frames wait for their window."""
        assert self.accepted is not None
        accepted = self.accepted
        return accepted.replay_frames + accepted.checkpoint_interval_frames + 2 * accepted.hop_frames

    def append(self, message: pb.TrackRequest) -> None:
        self._messages.append(message)
        self._bytes += message.ByteSize() + _OVERHEAD

    def next_message(self) -> pb.TrackRequest | None:
        """The oldest one that was not sent, which counts as sent from now on."""
        if self.unsent == 0:
            return None
        message = self._messages[self._sent]
        self._sent += 1
        if not self.keeps:
            self._drop_first()
        return message

    def first_message(self) -> pb.TrackRequest:
        """What a call begins with."""
        request = pb.TrackRequest(config=self.config)
        request.config.resume_token = self.token
        return request

    # --- What comes back.

    def begin(self, accepted: pb.SessionAccepted, server: str) -> bool:
        """A server has accepted a call; all that is kept is sent again. False: it begins at a frame that is gone."""
        if self.accepted is None:
            self._settle(accepted)
        self.accepted, self._server = accepted, server
        # Without checkpoints no message would ever be let go.
        self.keeps = self.keeps and accepted.replay_frames > 0 and accepted.checkpoint_interval_frames > 0
        self._repeated = dict(self._final)
        self._repeated_objects = dict(self._final_objects)
        self._sent = 0
        frames = (message.frame.index for message in self._messages if message.HasField("frame"))
        first = next(frames, None)
        return first is None or first <= accepted.first_frame

    def _settle(self, accepted: pb.SessionAccepted) -> None:
        """What the first server chose stays, whatever another one's defaults are."""
        config = self.config
        config.processing_size.CopyFrom(accepted.processing_size)
        config.hop_frames, config.iterations = accepted.hop_frames, accepted.iterations
        config.max_hop_frames = 0
        config.motion_prior, config.polish = accepted.motion_prior, accepted.polish

    def take(self, response: pb.TrackResponse) -> Update | None:
        kind = response.WhichOneof("response")
        if kind == "tracks":
            return self._take_tracks(response.tracks)
        if kind == "checkpoint":
            self._take_checkpoint(response.checkpoint)
        elif kind == "summary":
            self.summary = response.summary
        elif kind == "warning":
            self._warn(response.warning.message)
        elif kind == "going_away" and not self.keeps:
            left = response.going_away.time_left.ToTimedelta().total_seconds()
            self._warn(f"its server goes away, and it ends in {left:g} s at the latest")
        return None

    def _warn(self, what: str) -> None:
        """Tells the user what the session cannot show; it is named as in the server's logs."""
        assert self.accepted is not None
        warnings.warn(f"{self._server}: session {self.accepted.session_id}: {what}", HoldfastWarning, stacklevel=3)

    def _take_tracks(self, tracks: pb.Tracks) -> Update:
        runs = []
        for run in tracks.runs:
            _cut(run, self._repeated.get(run.id, 0), "x", "y", "visible", "confidence")
            if len(run.x) == 0:
                continue
            if run.final_count > 0:
                self._final[run.id] = max(self._final.get(run.id, 0), run.first_frame + run.final_count)
            self.table.add(run)
            runs.append(Run(run.id, run.first_frame, np.stack([run.x, run.y], axis=1).astype(np.float32),
                            np.array(run.visible, bool), np.array(run.confidence, np.float32), run.final_count))
        self.processed = max(self.processed, tracks.frames_processed)
        self.received = max(self.received, tracks.frames_received)  # one that takes over begins further back
        times = {time.frame: time.capture_time.ToDatetime(timezone.utc) for time in tracks.capture_times}
        self.table.add_capture_times(times)
        objects = self._take_objects(tracks)
        return Update(tuple(runs), self.received, self.processed, times, objects)

    def _take_objects(self, tracks: pb.Tracks) -> tuple[ObjectRun, ...]:
        runs = []
        for run in tracks.objects:
            _cut(run, self._repeated_objects.get(run.id, 0), "samples")
            if len(run.samples) == 0:
                continue
            if run.final_count > 0:
                end = run.first_frame + run.final_count
                self._final_objects[run.id] = max(self._final_objects.get(run.id, 0), end)
            runs.append(to_run(run))
            self.table.add_object(runs[-1])
        return tuple(runs)

    def _take_checkpoint(self, checkpoint: pb.Checkpoint) -> None:
        if not self.keeps:
            return
        if not checkpoint.token:
            self._keep_nothing()
            self._warn("it has outgrown what a checkpoint can hold: it ends with its server")
            return
        if not self._drop_before(checkpoint.next_frame):
            return
        assert self.accepted is not None
        oldest = checkpoint.next_frame - self.accepted.window_frames
        self._final = {point: end for point, end in self._final.items() if end >= oldest}
        self._final_objects = {key: end for key, end in self._final_objects.items() if end >= oldest}
        self.token, self.resumable = checkpoint.token, checkpoint.resumable

    def _drop_before(self, frame: int) -> bool:
        """The newest frame stays though the session goes on after it: what follows it in the stream belongs to it."""
        keep_from = None
        frames = 0
        for i, message in enumerate(self._messages):
            if not message.HasField("frame"):
                continue
            frames += 1
            if message.frame.index > frame:
                break
            keep_from = i
        if keep_from is None:
            return frames == 0
        for _ in range(min(keep_from, self._sent)):
            self._drop_first()
        return True

    def _keep_nothing(self) -> None:
        self.keeps = False
        while self._sent:
            self._drop_first()

    def _drop_first(self) -> None:
        self._bytes -= self._messages.popleft().ByteSize() + _OVERHEAD
        self._sent -= 1
