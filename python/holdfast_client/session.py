# SPDX-License-Identifier: Apache-2.0
"""A live session of the blocking client."""
from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from datetime import datetime
from typing import Any

import grpc

from ._base import BaseClient, BaseSession
from ._frames import Frame, Points
from ._objects import Objects, Placement
from ._plan import Attempt, CallFailed, broken, judge, late
from ._proto import point_tracking_pb2 as pb
from ._session import Update
from .tracks import Tracks


class Session(BaseSession):
    """One video, frame by frame. It opens with its first frame. One thread at a time may push; a session that is left
    by an exception is cancelled, otherwise finished.

    `on_reconnecting` is called with the error that a server was lost by, `on_resumed` with the address of the one that
    goes on; both by the session's own thread, which everything else waits for. They may call cancel(); an error that
    they raise ends the session.
    """

    def __init__(self, client: BaseClient[Session], config: pb.SessionConfig, encoding: str,
                 placement: Placement) -> None:
        super().__init__(client, config, encoding, placement)
        self._changed = threading.Condition()
        # Guarded by _changed, as is what the base class has but the frames' encoding and count.
        self._call: Any = None
        self._generation = 0  # of calls: the requests of an older one end
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Session:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is None:
            self.finish()
        else:
            self.cancel()

    def push(self, frame: Frame, points: Points = (), capture_time: datetime | None = None,
             objects: Objects | None = None) -> list[Update]:
        """Sends the next frame, and points and objects that are queried at it. Waits while the server is behind.
        Returns what has come since the last call; raises what ended the session."""
        if self._codec is None:
            self._settle(frame)
        message = self._frame_message(frame, points, capture_time, objects)
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="holdfast-session", daemon=True)
            self._thread.start()
        self._send(message)
        self._frames += 1
        return self.updates()

    def add(self, points: Points) -> None:
        """Queries points at the newest frame: {id: (x, y)}, of which ids in use begin anew there, or positions [N, 2],
        which get the next ids that the session has not had."""
        message = self._add_message(points)
        if message is not None:
            self._send(message)

    def remove(self, ids: Iterable[int]) -> None:
        """Ids that are not known are ignored."""
        message = self._remove_message(ids)
        if message is not None:
            self._send(message)

    def updates(self, timeout: float = 0.0) -> list[Update]:
        """What has come since the last call; where nothing has, waits for it so many seconds. Raises what ended the
        session."""
        with self._changed:
            self._changed.wait_for(lambda: self._updates or self._ended, timeout)
            if not self._updates and self._error is not None:
                raise self._error
            return self._take_updates()

    def finish(self) -> Tracks:
        """Nothing follows: waits until everything is final. Raises what ended the session otherwise; tracks() has what
        came before. Ctrl-C cancels it. RuntimeError on the session's own thread, which it would wait for."""
        if self._is_own_thread():
            raise RuntimeError("finish() waits for the thread that calls on_reconnecting and on_resumed: cancel()")
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            try:
                self._changed.wait_for(lambda: self._ended or self._thread is None)
            except BaseException:  # Ctrl-C: nobody waits for the rest
                self.cancel()
                raise
            if self._error is not None:
                raise self._error
        return self.tracks()

    def tracks(self) -> Tracks:
        """All that is known so far."""
        with self._changed:
            return self._tracks()

    def cancel(self) -> None:
        """Ends the session at once; what has come stays. Waits for that, unless it is called by the session's own
        thread, which ends when the callback returns."""
        with self._changed:
            self._cancelled = True
            if self._call is not None:
                self._call.cancel()
            self._changed.notify_all()
            if not self._is_own_thread():
                self._changed.wait_for(lambda: self._ended or self._thread is None)

    def _is_own_thread(self) -> bool:
        return threading.current_thread() is self._thread

    def _send(self, message: pb.TrackRequest) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._can_send(message))
            self._append(message)
            self._changed.notify_all()

    # --- gRPC's thread of a call.

    def _requests(self, generation: int, begun: threading.Event) -> Iterator[pb.TrackRequest]:
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
            if self._call is not None:  # that a callback's error has left open
                self._end_call()
        with self._changed:
            self._error = None if self._cancelled else error
            self._ended = True
            self._changed.notify_all()

    def _run_calls(self) -> None:
        attempt = self._route.first()
        while True:
            try:
                self._begin(attempt)
                if self._route.accepted():
                    self.on_resumed(self._client.addresses[attempt.server])
                self._follow(self._client.addresses[attempt.server])
                return
            except CallFailed as failed:
                if self._cancelled:
                    return
                lost = self._route.following
                attempt = self._route.after(attempt, failed)
                if lost:
                    self.on_reconnecting(failed.error)
            with self._changed:
                if self._changed.wait_for(lambda: self._cancelled, attempt.pause):
                    return

    def _begin(self, attempt: Attempt) -> None:
        """Opens a call and waits until the server has accepted the session."""
        address, begun = self._client.addresses[attempt.server], threading.Event()
        with self._changed:
            self._generation += 1
            self._call = self._client._track_call(attempt.server, self._requests(self._generation, begun))
            if self._cancelled:
                self._call.cancel()
        try:
            response = self._first_response(address, attempt.timeout)
            with self._changed:
                if not self._state.begin(response.accepted, address):
                    raise broken(address, "begins at a frame that is gone")
        except CallFailed:
            self._end_call()
            raise
        finally:
            begun.set()

    def _first_response(self, address: str, timeout: float) -> pb.TrackResponse:
        timer = threading.Timer(timeout, self._call.cancel)
        timer.start()
        try:
            return next(self._call)
        except StopIteration:
            raise broken(address, "ended the session without accepting it") from None
        except grpc.RpcError:
            if timer.finished.is_set() and self._call.code() == grpc.StatusCode.CANCELLED:
                raise late(address, timeout) from None
            raise judge(self._call, address, accepted=False) from None
        finally:
            timer.cancel()

    def _follow(self, address: str) -> None:
        """Takes answers until the call is over."""
        try:
            for response in self._call:
                with self._changed:
                    self._take(response)
                    self._changed.notify_all()
        except grpc.RpcError:
            failed = judge(self._call, address, accepted=True)
            if not self._is_told_all(failed):
                raise failed from None
        finally:
            self._end_call()
        if self._state.summary is None:
            raise broken(address, "ended the session without a summary")

    def _end_call(self) -> None:
        """Its requests end."""
        self._call.cancel()
        with self._changed:
            self._generation += 1
            self._changed.notify_all()
