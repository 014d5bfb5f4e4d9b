# SPDX-License-Identifier: Apache-2.0
"""What the blocking client and the one of asyncio have in common: what they are told and what they send, without
threads and without waiting."""
from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from typing import Any, Generic, TypeVar, Union

import numpy as np

from . import errors
from ._channel import Tls, addresses_of, metadata_of, open_channel
from ._frames import Frame, FrameCodec, Points, size_of, to_points
from ._objects import Objects, Placement, to_objects
from ._plan import CallFailed, Reconnect, Route
from ._proto import point_tracking_pb2 as pb
from ._session import SessionState, Update
from .tracks import Tracks

_SERVICE = "/holdfast.v1.PointTracking/"
_UNSENT = 4  # messages that wait before push() does: so a slow server slows its client


class BaseSession:
    """One video: the messages of its frames and points, what came back, and how it ended."""

    def __init__(self, client: BaseClient[Any], config: pb.SessionConfig, encoding: str, placement: Placement) -> None:
        self._client = client
        self._placement = placement
        self._encoding = encoding
        self._codec: FrameCodec | None = None  # the first frame settles it, and opens the session
        self._frames = 0  # sent
        self._next_id = 1 + max((point.id for point in config.points), default=-1)  # of positions without ids
        reconnect = client.reconnect
        self._state = SessionState(config, reconnect is not None, reconnect.buffer_bytes if reconnect else 0)
        self._route = Route(self._state, len(client.addresses), client.timeout, reconnect)
        self._updates: deque[Update] = deque()
        self._closed = False  # nothing more is pushed
        self._cancelled = False
        self._ended = False
        self._error: BaseException | None = None
        self.on_reconnecting: Callable[[errors.HoldfastError], None] = lambda error: None
        self.on_resumed: Callable[[str], None] = lambda server: None

    @property
    def accepted(self) -> pb.SessionAccepted | None:
        """What the server made of the options, once it has answered."""
        return self._state.accepted

    def _settle(self, first: Frame) -> None:
        """The first frame says how all are sent."""
        self._codec = FrameCodec(first, self._encoding)
        config = self._state.config
        config.encoding = self._codec.encoding
        if self._codec.raw_size is not None:
            config.raw_size.width, config.raw_size.height = self._codec.raw_size
        if (size := size_of(first)) is not None:
            config.frame_size.width, config.frame_size.height = size

    def _frame_message(self, frame: Frame, points: Points, capture_time: datetime | None,
                       objects: Objects | None) -> pb.TrackRequest:
        assert self._codec is not None
        self._client.check_process()
        message = pb.TrackRequest()
        message.frame.index = self._frames
        message.frame.data = self._codec.data(frame)
        message.frame.objects.extend(to_objects(objects, self._placement))
        if capture_time is not None:
            if not isinstance(capture_time, datetime):
                raise TypeError(f"capture_time is {capture_time!r}, expected a datetime")
            if capture_time.utcoffset() is None:
                raise ValueError(f"capture_time is {capture_time!r}, expected a datetime with its time zone, such as "
                                 "datetime.now(timezone.utc)")
            message.frame.capture_time.FromDatetime(capture_time)
        message.frame.points.extend(self._to_points(points))
        return message

    def _to_points(self, points: Points) -> list[pb.Point]:
        """Positions without ids get the next ones that this session has not had."""
        made = to_points(points, self._next_id)
        self._next_id = max([self._next_id, *(point.id + 1 for point in made)])
        return made

    def _add_message(self, points: Points) -> pb.TrackRequest | None:
        """None: the session is not open yet, and begins with them."""
        if self._codec is None:
            self._state.config.points.extend(self._to_points(points))
            return None
        return pb.TrackRequest(add_points=pb.AddPoints(points=self._to_points(points)))

    def _remove_message(self, ids: Iterable[int]) -> pb.TrackRequest | None:
        """None: the session is not open yet, and begins without them."""
        gone = set(ids)
        if self._codec is not None:
            return pb.TrackRequest(remove_points=pb.RemovePoints(ids=gone))
        kept = [point for point in self._state.config.points if point.id not in gone]
        del self._state.config.points[:]
        self._state.config.points.extend(kept)
        return None

    def _can_send(self, message: pb.TrackRequest) -> bool:
        """False: the caller waits."""
        return self._ended or self._cancelled or (self._state.unsent < _UNSENT and self._state.room_for(message))

    def _append(self, message: pb.TrackRequest) -> None:
        """To what is sent. Raises what ended the session."""
        if self._error is not None:
            raise self._error
        if self._ended or self._cancelled or self._closed:
            raise ValueError("the session has ended")
        self._state.append(message)

    def _take(self, response: pb.TrackResponse) -> None:
        known = self._state.processed
        update = self._state.take(response)
        if update is not None and (update.runs or update.objects or update.frames_processed > known):
            self._updates.append(update)

    def _is_told_all(self, failed: CallFailed) -> bool:
        """Whether only the end of the call was lost: the summary, which comes last, is there."""
        return failed.lost and self._state.summary is not None

    def _take_updates(self) -> list[Update]:
        updates = list(self._updates)
        self._updates.clear()
        return updates

    def _tracks(self) -> Tracks:
        return self._state.table.tracks(self._frames, complete=self._state.summary is not None)


def _whole(name: str, value: int) -> int:
    """Of an option that protobuf would refuse without its name."""
    if not isinstance(value, (int, np.integer)) or value < 0:
        raise ValueError(f"{name} is {value!r}, expected a whole number from 0 on")
    return int(value)


def _size(size: tuple[int, int]) -> pb.ImageSize:
    try:
        width, height = size
    except (TypeError, ValueError):
        raise ValueError(f"size is {size!r}, expected (width, height)") from None
    return pb.ImageSize(width=_whole("size's width", width), height=_whole("size's height", height))


SessionType = TypeVar("SessionType", bound=BaseSession)


class BaseClient(Generic[SessionType]):
    """The servers, and what they are told of every session."""

    _grpc: Any  # grpc or grpc.aio: whose channels these are
    _session_type: Callable[[Any, pb.SessionConfig, str, Placement], SessionType]

    def __init__(self, address: Union[str, Sequence[str]] = "localhost:50051", *, tls: Union[bool, Tls] = False,
                 token: str | None = None, reconnect: Reconnect | None = Reconnect(), timeout: float = 30.0) -> None:
        self._prepare()
        self._process = os.getpid()
        self.addresses = addresses_of(address)
        if reconnect is not None and not isinstance(reconnect, Reconnect):
            raise TypeError(f"reconnect is {reconnect!r}, expected a Reconnect or None: sessions end with their server")
        self.reconnect = reconnect
        self.timeout = timeout
        self._metadata = metadata_of(token)
        self._channels = [open_channel(self._grpc, one, tls) for one in self.addresses]

    def _prepare(self) -> None:
        """Before there are channels."""

    def check_process(self) -> None:
        """RuntimeError in a fork of the client's process, where gRPC's threads, and those of sessions, are not."""
        if os.getpid() != self._process:
            raise RuntimeError(f"this client belongs to process {self._process}, and a fork cannot use it: make one in "
                               "each process, and start processes by spawn or before the first client")

    def session(self, points: Points = (), *, objects: Objects | None = None, object_points: int = 0,
                reseed: bool = True, size: tuple[int, int] | None = None, hop: int | tuple[int, int] = 0,
                iterations: int = 0, every_frame: bool = False, final_only: bool = False, encoding: str = "auto",
                label: str = "", frames_per_second: float = 0.0) -> SessionType:
        """A live session; `points` are queried at its first frame, and so are `objects`: masks (bool or uint8 [H, W],
        or PNG bytes) or polygons ([N, 2]) by id, on each of which the server places `object_points` points (0: 64);
        `reseed`: those that have left their object are placed anew while it is in sight.

        `size`: of processing, (width, height); `hop`, `iterations`: 0 leaves them to the server; `hop=(least, most)`:
        the least one at which the server would take the session when it begins; `every_frame`: an estimate at once for
        each frame; `final_only`: no estimates that may still be revised; `encoding`: of arrays, 'auto' (JPEG where
        OpenCV or Pillow is), 'jpeg', 'raw'; `label`: for the server's logs; `frames_per_second`: the pace that the
        server has to promise, 0 for none.
        """
        self.check_process()
        least_hop, most_hop = hop if isinstance(hop, tuple) else (hop, 0)
        config = pb.SessionConfig(points=to_points(points), hop_frames=_whole("hop", least_hop),
                                  max_hop_frames=_whole("hop", most_hop), label=label,
                                  iterations=_whole("iterations", iterations), final_only=final_only,
                                  frames_per_second=frames_per_second,
                                  emit=pb.EMIT_EVERY_FRAME if every_frame else pb.EMIT_WINDOWS)
        if size is not None:
            config.processing_size.CopyFrom(_size(size))
        if self.reconnect is not None:
            config.checkpoint_interval_frames = self.reconnect.checkpoint_interval
        placement = Placement(_whole("object_points", object_points), reseed)
        config.objects.extend(to_objects(objects, placement))
        return self._session_type(self, config, encoding, placement)

    def _info_call(self, server: int) -> Any:
        self.check_process()
        ask = self._channels[server].unary_unary(_SERVICE + "GetServerInfo", pb.GetServerInfoRequest.SerializeToString,
                                                 pb.GetServerInfoResponse.FromString)
        return ask(pb.GetServerInfoRequest(), timeout=self.timeout, metadata=self._metadata)

    def _ask_another(self, server: int, failed: Any) -> None:
        """One has not said what it runs: raises why, unless the next one may do instead."""
        error = errors.to_error(failed, self.addresses[server])
        if server + 1 == len(self.addresses) or not isinstance(error, errors.Unavailable):
            raise error from None

    def _track_call(self, server: int, *requests: Any) -> Any:
        track = self._channels[server].stream_stream(_SERVICE + "Track", pb.TrackRequest.SerializeToString,
                                                     pb.TrackResponse.FromString)
        return track(*requests, metadata=self._metadata)
