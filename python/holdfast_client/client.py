# SPDX-License-Identifier: Apache-2.0
"""The blocking client."""
from __future__ import annotations

import random
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Callable, Union

import grpc
import numpy as np

from . import errors
from ._frames import Frame, FrameCodec, Points, to_points
from ._proto import point_tracking_pb2 as pb
from ._session import SessionState, Update
from .tracks import Tracks

_SERVICE = "/holdfast.v1.PointTracking/"
_UNSENT = 4  # messages that wait before push() does: so a slow server slows its client
_FIRST_WAIT, _LONGEST_WAIT, _FACTOR, _JITTER = 0.1, 5.0, 1.6, 0.2  # seconds between attempts to reconnect


@dataclass(frozen=True)
class Tls:
    """How client and server know each other: PEM files; `ca` None: the system's authorities."""

    ca: str | None = None
    cert: str | None = None
    key: str | None = None
    server_name: str | None = None  # expected in the server's certificate; None: the host of the address

    def credentials(self) -> grpc.ChannelCredentials:
        def read(path: str | None) -> bytes | None:
            if path is None:
                return None
            with open(path, "rb") as file:
                return file.read()
        return grpc.ssl_channel_credentials(read(self.ca), read(self.key), read(self.cert))


@dataclass(frozen=True)
class Reconnect:
    """How a session outlives its server."""

    seconds: float = 120.0  # for another server to take over
    buffer_bytes: int = 256 << 20  # of messages kept for that; push() waits while they are full
    checkpoint_interval: int = 24  # frames


class Client:
    """A tracking server, or several of which any will do: "host:port", "a:1,b:2" or a list. Thread-safe.

    `tls`: True, or a Tls; `token`: of the caller; `reconnect`: None ends sessions with their server; `timeout`: seconds
    for a server to answer.
    """

    def __init__(self, address: Union[str, Sequence[str]] = "localhost:50051", *, tls: Union[bool, Tls] = False,
                 token: str | None = None, reconnect: Reconnect | None = Reconnect(), timeout: float = 30.0) -> None:
        self._addresses = address.split(",") if isinstance(address, str) else list(address)
        if not self._addresses or not all(":" in one for one in self._addresses):
            raise ValueError(f"address is {address!r}, expected host:port")
        self.reconnect = reconnect
        self.timeout = timeout
        self._metadata = (("authorization", f"Bearer {token}"),) if token else ()
        self._channels = [self._channel(one, tls) for one in self._addresses]

    @staticmethod
    def _channel(address: str, tls: Union[bool, Tls]) -> grpc.Channel:
        options: list[tuple[str, Any]] = [
            ("grpc.max_receive_message_length", 64 << 20), ("grpc.max_send_message_length", -1),
            ("grpc.use_local_subchannel_pool", 1), ("grpc.keepalive_time_ms", 30_000),
            ("grpc.keepalive_timeout_ms", 10_000), ("grpc.initial_reconnect_backoff_ms", 100),
            ("grpc.min_reconnect_backoff_ms", 100), ("grpc.max_reconnect_backoff_ms", 1000)]
        if not tls:
            return grpc.insecure_channel(address, options)
        tls = Tls() if tls is True else tls
        if tls.server_name is not None:
            options.append(("grpc.ssl_target_name_override", tls.server_name))
        return grpc.secure_channel(address, tls.credentials(), options)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        for channel in self._channels:
            channel.close()

    def info(self) -> pb.GetServerInfoResponse:
        """What the first server that is there runs, and its limits."""
        error: errors.HoldfastError | None = None
        for address, channel in zip(self._addresses, self._channels):
            ask = channel.unary_unary(_SERVICE + "GetServerInfo", pb.GetServerInfoRequest.SerializeToString,
                                      pb.GetServerInfoResponse.FromString)
            try:
                return ask(pb.GetServerInfoRequest(), timeout=self.timeout, metadata=self._metadata)
            except grpc.RpcError as failed:
                error = errors.to_error(failed, address)
                if not isinstance(error, errors.Unavailable):
                    break
        assert error is not None
        raise error

    def session(self, points: Points = (), *, size: tuple[int, int] | None = None, hop: int = 0, iterations: int = 0,
                every_frame: bool = False, final_only: bool = False, encoding: str = "auto", label: str = "",
                frames_per_second: float = 0.0) -> Session:
        """A live session; `points` are queried at its first frame.

        `size`: of processing, (width, height); `hop`, `iterations`: 0 leaves them to the server; `every_frame`: an
        estimate at once for each frame; `encoding`: of arrays, 'auto' (JPEG where OpenCV or Pillow is), 'jpeg', 'raw'.
        """
        config = pb.SessionConfig(points=to_points(points), hop_frames=hop, iterations=iterations, label=label,
                                  final_only=final_only, frames_per_second=frames_per_second,
                                  emit=pb.EMIT_EVERY_FRAME if every_frame else pb.EMIT_WINDOWS)
        if size is not None:
            config.processing_size.width, config.processing_size.height = size
        if self.reconnect is not None:
            config.checkpoint_interval_frames = self.reconnect.checkpoint_interval
        return Session(self, config, encoding)

    def track(self, frames: Iterable[Frame], points: Points, **options: Any) -> Tracks:
        """Tracks points through a whole video: `points` as {id: (x, y)} or [N, 2] of the first frame, or [N, 3]: frame,
        x and y of each. `options` as of session(). Frames are read as they are sent."""
        later: dict[int, dict[int, tuple[float, float]]] = {}
        if isinstance(points, np.ndarray) and points.ndim == 2 and points.shape[1] == 3:
            for point, (frame, x, y) in enumerate(points):
                later.setdefault(int(frame), {})[point] = (float(x), float(y))
            points = later.pop(0, {})
        with self.session(points, **options) as session:
            count = 0
            for frame in frames:
                session.push(frame, points=later.pop(count, ()))
                count += 1
            if later:
                raise ValueError(f"there are points of frame {min(later)}, but {count} frames")
            return session.finish()

    # --- For sessions.

    def _call(self, server: int, requests: Iterator[pb.TrackRequest]) -> Any:
        track = self._channels[server].stream_stream(_SERVICE + "Track", pb.TrackRequest.SerializeToString,
                                                     pb.TrackResponse.FromString)
        return track(requests, metadata=self._metadata)


class _Lost(Exception):
    """The server of a call is gone."""

    def __init__(self, error: errors.HoldfastError) -> None:
        super().__init__(error)
        self.error = error


class Session:
    """One video, frame by frame. It opens with its first frame. One thread at a time may push; a session that is left
    by an exception is cancelled, otherwise finished."""

    def __init__(self, client: Client, config: pb.SessionConfig, encoding: str) -> None:
        self._client = client
        self._config = config
        self._encoding = encoding
        self._codec: FrameCodec | None = None
        self._frames = 0
        self._state: SessionState | None = None
        self._changed = threading.Condition()
        # Guarded by _changed.
        self._updates: list[Update] = []
        self._closed = False  # nothing more is pushed
        self._cancelled = False
        self._ended = False
        self._error: BaseException | None = None
        self._call: Any = None
        self._generation = 0  # of calls: the requests of an older one end
        self._thread: threading.Thread | None = None
        self.on_reconnecting: Callable[[errors.HoldfastError], None] = lambda error: None
        self.on_resumed: Callable[[str], None] = lambda server: None

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.finish()
        else:
            self.cancel()

    def push(self, frame: Frame, points: Points = (), capture_time: datetime | None = None) -> list[Update]:
        """Sends the next frame, and points that are queried at it. Waits while the server is behind. Returns what has
        come since the last call; raises what ended the session."""
        if self._codec is None:
            self._open(frame)
        assert self._codec is not None
        message = pb.TrackRequest()
        message.frame.index = self._frames
        message.frame.data = self._codec.data(frame)
        message.frame.points.extend(to_points(points))
        if capture_time is not None:
            message.frame.capture_time.FromDatetime(capture_time)
        self._send(message)
        self._frames += 1
        return self.updates()

    def add(self, points: Points) -> None:
        """Queries points at the newest frame; ids in use begin anew there."""
        if self._state is None:
            self._config.points.extend(to_points(points))
        else:
            self._send(pb.TrackRequest(add_points=pb.AddPoints(points=to_points(points))))

    def remove(self, ids: Iterable[int]) -> None:
        """Ids that are not known are ignored."""
        if self._state is not None:
            self._send(pb.TrackRequest(remove_points=pb.RemovePoints(ids=ids)))

    def updates(self) -> list[Update]:
        """What has come since the last call, without waiting."""
        with self._changed:
            updates, self._updates = self._updates, []
            return updates

    def finish(self) -> Tracks:
        """Nothing follows: waits until everything is final. Raises what ended the session otherwise; tracks() has what
        came before."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._ended or self._thread is None)
            if self._error is not None:
                raise self._error
        return self.tracks()

    def tracks(self) -> Tracks:
        """All that is known so far."""
        with self._changed:
            return self._state.table.tracks() if self._state is not None else Tracks(
                np.zeros(0, np.uint64), np.zeros((0, 0, 2), np.float32), np.zeros((0, 0), bool),
                np.zeros((0, 0), np.float32), np.zeros((0, 0), bool))

    def cancel(self) -> None:
        """Ends the session at once; what has come stays."""
        with self._changed:
            self._cancelled = True
            if self._call is not None:
                self._call.cancel()
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._ended or self._thread is None)

    @property
    def accepted(self) -> pb.SessionAccepted | None:
        """What the server made of the options, once it has answered."""
        return self._state.accepted if self._state is not None else None

    # --- The caller's thread.

    def _open(self, first: Frame) -> None:
        self._codec = FrameCodec(first, self._encoding)
        self._config.encoding = self._codec.encoding
        if self._codec.raw_size is not None:
            self._config.raw_size.width, self._config.raw_size.height = self._codec.raw_size
        reconnect = self._client.reconnect
        self._state = SessionState(self._config, reconnect is not None, reconnect.buffer_bytes if reconnect else 0)
        self._thread = threading.Thread(target=self._run, name="holdfast-session", daemon=True)
        self._thread.start()

    def _send(self, message: pb.TrackRequest) -> None:
        state = self._state
        assert state is not None
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._cancelled or
                                   (state.unsent < _UNSENT and state.room_for(message)))
            if self._error is not None:
                raise self._error
            if self._ended or self._cancelled or self._closed:
                raise ValueError("the session has ended")
            state.append(message)
            self._changed.notify_all()

    # --- gRPC's thread of a call.

    def _requests(self, generation: int, begun: threading.Event) -> Iterator[pb.TrackRequest]:
        assert self._state is not None
        with self._changed:
            first = self._state.first_message()
        yield first
        begun.wait()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: generation != self._generation or self._state.unsent > 0 or self._closed)
                message = self._state.next_message() if generation == self._generation else None
                self._changed.notify_all()
            if message is None:
                return
            yield message

    # --- The session's thread.

    def _run(self) -> None:
        error: BaseException | None = None
        try:
            self._run_calls()
        except BaseException as failed:  # whatever it is, the caller gets it
            error = failed
        with self._changed:
            self._error = None if self._cancelled else error
            self._ended = True
            self._changed.notify_all()

    def _run_calls(self) -> None:
        state, servers = self._state, len(self._client._addresses)
        assert state is not None
        server = self._open_first()
        while True:
            try:
                self._follow(server)
                return
            except _Lost as lost:
                if not state.keeps or self._cancelled:
                    raise lost.error from None
                self.on_reconnecting(lost.error)
                order = [(server + i) % servers for i in range(servers)]
                first_choice = order if state.token and not state.resumable else order[1:] + order[:1]
                server = self._reopen(first_choice, lost.error)
                self.on_resumed(self._client._addresses[server])

    def _open_first(self) -> int:
        error: errors.HoldfastError | None = None
        for server in range(len(self._client._addresses)):
            try:
                self._begin(server, self._client.timeout)
                return server
            except _Lost as lost:
                error = lost.error
            except (errors.Overloaded, errors.NotResumable) as refused:
                error = refused
            if self._cancelled:
                break
        assert error is not None
        raise error

    def _reopen(self, order: list[int], lost: errors.HoldfastError) -> int:
        assert self._client.reconnect is not None
        deadline = time.monotonic() + self._client.reconnect.seconds
        wait, refused = _FIRST_WAIT, set()
        for attempt in range(1 << 30):
            server = order[attempt % len(order)]
            if server in refused:
                continue
            pause = wait * random.uniform(1 - _JITTER, 1 + _JITTER)
            wait = min(wait * _FACTOR, _LONGEST_WAIT)
            if isinstance(lost, errors.Overloaded):
                pause = max(pause, lost.retry_after or 0)
            left = deadline - time.monotonic()
            if pause >= left:
                raise lost
            with self._changed:
                if self._changed.wait_for(lambda: self._cancelled, pause):
                    raise lost
            try:
                self._begin(server, min(self._client.timeout, left))
                return server
            except _Lost as again:
                lost = again.error
            except errors.Overloaded as full:
                lost = full
                if full.retry_after is None:
                    raise
            except errors.NotResumable as other:
                refused.add(server)
                lost = other
                if len(refused) == len(order):
                    raise
        raise lost

    def _begin(self, server: int, timeout: float) -> None:
        """Opens a call and waits until the server has accepted the session."""
        begun = threading.Event()
        with self._changed:
            self._generation += 1
            generation = self._generation
        call = self._client._call(server, self._requests(generation, begun))
        with self._changed:
            self._call = call
            if self._cancelled:
                call.cancel()
        timer = threading.Timer(timeout, call.cancel)
        timer.start()
        try:
            response = next(call)
            timer.cancel()
        except StopIteration:
            self._end_call(begun)
            raise errors.HoldfastError(grpc.StatusCode.INTERNAL, "the server ended the session without accepting it",
                                       self._client._addresses[server]) from None
        except grpc.RpcError:
            late = timer.finished.is_set() and call.code() == grpc.StatusCode.CANCELLED
            timer.cancel()
            self._end_call(begun)
            error = self._error_of(call, server)
            if late and not self._cancelled:
                error = errors.Unavailable(grpc.StatusCode.DEADLINE_EXCEEDED, f"no answer within {timeout:.0f} s",
                                           self._client._addresses[server])
            if isinstance(error, errors.Unavailable) or errors.is_lost_server(call):
                raise _Lost(error) from None
            raise error from None
        assert self._state is not None
        with self._changed:
            whole = self._state.begin(response.accepted)
        if not whole:
            call.cancel()
            self._end_call(begun)
            raise errors.HoldfastError(grpc.StatusCode.INTERNAL, "the server begins at a frame that is gone",
                                       self._client._addresses[server])
        begun.set()

    def _follow(self, server: int) -> None:
        """Takes answers until the call is over."""
        assert self._state is not None
        try:
            for response in self._call:
                with self._changed:
                    update = self._state.take(response)
                    if update is not None and update.runs:
                        self._updates.append(update)
                    self._changed.notify_all()
        except grpc.RpcError:
            error = self._error_of(self._call, server)
            if errors.is_lost_server(self._call):
                raise _Lost(error) from None
            raise error from None
        finally:
            self._end_call()
        if self._state.summary is None:
            raise errors.HoldfastError(grpc.StatusCode.INTERNAL, "the server ended the session without a summary",
                                       self._client._addresses[server])

    def _end_call(self, begun: threading.Event | None = None) -> None:
        """The requests of this call end."""
        with self._changed:
            self._generation += 1
            self._changed.notify_all()
        if begun is not None:
            begun.set()

    def _error_of(self, call: Any, server: int) -> errors.HoldfastError:
        return errors.to_error(call, self._client._addresses[server])
