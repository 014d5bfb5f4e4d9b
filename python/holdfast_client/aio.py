# SPDX-License-Identifier: Apache-2.0
"""The client for asyncio: the names and the rules of the blocking one.

    async with aio.Client("localhost:50051") as client:
        tracks = await client.track(frames, points)  # frames: also an async iterable
"""
from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, AsyncIterator, Callable, Iterable
from datetime import datetime
from typing import Any, Union

import grpc
import grpc.aio

from ._base import BaseClient, BaseSession
from ._both import Backward
from ._channel import Tls
from ._frames import Frame, Points
from ._objects import Objects, Placement
from ._plan import Attempt, CallFailed, Reconnect, broken, judge, late
from ._proto import point_tracking_pb2 as pb
from ._queries import Queried, Queries
from ._session import Update
from .tracks import Tracks

_WAITING = 256  # updates, while no task iterates
_BEHIND = 4096  # while one does, and is slower than they come

__all__ = ["Client", "Reconnect", "Session", "Tls"]


class Session(BaseSession):
    """One video, frame by frame. It opens with its first frame. One task at a time may push, while another one takes
    updates; a session that is left by an exception, a task's cancellation among them, is cancelled, otherwise finished.

    `on_reconnecting` is called with the error that a server was lost by, `on_resumed` with the address of the one that
    goes on.
    """

    def __init__(self, client: BaseClient[Session], config: pb.SessionConfig, encoding: str,
                 placement: Placement) -> None:
        super().__init__(client, config, encoding, placement)
        self._changed = asyncio.Event()  # another one after each change
        self._call: Any = None  # the one that messages are for
        self._runner: asyncio.Task[None] | None = None
        self._listeners = 0  # tasks that iterate

    async def __aenter__(self) -> Session:
        return self

    async def __aexit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            await self.cancel()
            return
        try:
            await self.finish()
        except asyncio.CancelledError:
            await self.cancel()
            raise

    async def push(self, frame: Frame, points: Points = (), capture_time: datetime | None = None,
                   objects: Objects | None = None) -> None:
        """Sends the next frame, and points and objects that are queried at it. Waits while the server is behind. Raises
        what ended the session. Unlike the blocking client's it returns no updates: they are for the task that
        iterates."""
        if self._codec is None:
            self._settle(frame)
        # Encoding takes its time.
        message = await asyncio.to_thread(self._frame_message, frame, points, capture_time, objects)
        if self._runner is None:
            self._runner = asyncio.create_task(self._run())
        await self._send(message)
        self._frames += 1

    async def add(self, points: Points) -> None:
        """Queries points at the newest frame: {id: (x, y)}, of which ids in use begin anew there, or positions [N, 2],
        which get the next ids that the session has not had."""
        message = self._add_message(points)
        if message is not None:
            await self._send(message)

    async def remove(self, ids: Iterable[int]) -> None:
        """Ids that are not known are ignored."""
        message = self._remove_message(ids)
        if message is not None:
            await self._send(message)

    def updates(self) -> list[Update]:
        """What has come since the last call, without waiting: the newest 256 where no task iterates."""
        return self._take_updates()

    async def __aiter__(self) -> AsyncIterator[Update]:
        """Updates as they come, until the session is over; raises what ended it, unless that was finish() or cancel().
        Waits for what another task pushes. Of what came while no task iterates, the newest 256; for a task that takes
        them too slowly, the newest 4096."""
        self._listeners += 1
        try:
            while True:
                await self._until(lambda: bool(self._updates) or self._ended)
                if not self._updates:
                    break
                yield self._updates.popleft()
        finally:
            self._listeners -= 1
        if self._error is not None:
            raise self._error

    async def finish(self) -> Tracks:
        """Nothing follows: waits until everything is final. Raises what ended the session otherwise; tracks() has what
        came before."""
        self._closed = True
        if self._runner is None:
            self._ended = True
        self._notify()
        await self._until(lambda: self._ended)
        if self._error is not None:
            raise self._error
        return self.tracks()

    def tracks(self) -> Tracks:
        """All that is known so far."""
        return self._tracks()

    async def cancel(self) -> None:
        """Ends the session at once; what has come stays."""
        self._cancelled = True
        if self._runner is not None:
            self._runner.cancel()
            await asyncio.wait([self._runner])
        self._ended = True
        self._notify()

    async def _send(self, message: pb.TrackRequest) -> None:
        await self._until(lambda: self._can_send(message))
        self._append(message)
        self._notify()

    def _take(self, response: pb.TrackResponse) -> None:
        super()._take(response)
        most = _BEHIND if self._listeners else _WAITING
        while len(self._updates) > most:
            self._updates.popleft()

    async def _until(self, ready: Callable[[], bool]) -> None:
        while not ready():
            await self._changed.wait()

    def _notify(self) -> None:
        """Wakes all that wait."""
        self._changed.set()
        self._changed = asyncio.Event()

    # --- The session's task, which ends when it is cancelled.

    async def _run(self) -> None:
        try:
            await self._run_calls()
        except asyncio.CancelledError:
            self._cancelled = True
            raise
        except Exception as failed:  # whatever it is, the caller gets it
            self._error = None if self._cancelled else failed
        finally:
            self._ended = True
            self._notify()

    async def _run_calls(self) -> None:
        attempt = self._route.first()
        while True:
            try:
                await self._run_call(attempt)
                return
            except CallFailed as failed:
                if self._cancelled:  # gRPC may tell how the call ended in place of the task's cancellation
                    return
                lost = self._route.following
                attempt = self._route.after(attempt, failed)
                if lost:
                    self.on_reconnecting(failed.error)
            await asyncio.sleep(attempt.pause)

    async def _run_call(self, attempt: Attempt) -> None:
        address = self._client.addresses[attempt.server]
        self._call = call = self._client._track_call(attempt.server)
        begun = asyncio.Event()
        writer = asyncio.create_task(self._write(call, begun))
        try:
            responses = call.__aiter__()
            await self._begin(responses, address, attempt.timeout)
            begun.set()
            if self._route.accepted():
                self.on_resumed(address)
            await self._follow(responses, address)
        except grpc.RpcError as error:
            failed = judge(error, address, accepted=self._route.following)
            if not self._is_told_all(failed):
                raise failed from None
        finally:
            self._call = None
            call.cancel()
            writer.cancel()
            self._notify()  # the writer too, whose cancellation gRPC may have swallowed

    async def _write(self, call: Any, begun: asyncio.Event) -> None:
        """Sends what there is. Whatever ends a write ends its call too, whose status says why."""
        try:
            await call.write(self._state.first_message())
            await begun.wait()
            while True:
                await self._until(lambda: self._call is not call or self._state.unsent > 0 or self._closed)
                message = self._state.next_message() if self._call is call else None
                self._notify()
                if message is None:
                    await call.done_writing()
                    return
                await call.write(message)
        except Exception:
            return

    async def _begin(self, responses: AsyncIterator[pb.TrackResponse], address: str, timeout: float) -> None:
        """Waits until the server has accepted the session."""
        try:
            response = await asyncio.wait_for(responses.__anext__(), timeout)
        except asyncio.TimeoutError:
            raise late(address, timeout) from None
        except StopAsyncIteration:
            raise broken(address, "ended the session without accepting it") from None
        if not self._state.begin(response.accepted, address):
            raise broken(address, "begins at a frame that is gone")

    async def _follow(self, responses: AsyncIterator[pb.TrackResponse], address: str) -> None:
        """Takes answers until the call is over."""
        async for response in responses:
            self._take(response)
            self._notify()
        if self._state.summary is None:
            raise broken(address, "ended the session without a summary")


class Client(BaseClient[Session]):
    """As the blocking Client; it belongs to the event loop that runs when it is made."""

    _grpc = grpc.aio
    _session_type = Session

    def _prepare(self) -> None:
        asyncio.get_running_loop()  # says that there is none, where gRPC would take another one

    async def __aenter__(self) -> Client:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections to the servers."""
        for channel in self._channels:
            await channel.close()

    async def info(self) -> pb.GetServerInfoResponse:
        """What the first server that is there runs, and its limits."""
        for server in range(len(self.addresses)):
            try:
                return await self._info_call(server)
            except grpc.RpcError as failed:
                self._ask_another(server, failed)
        raise AssertionError("there is a server")

    async def track(self, frames: Union[Iterable[Frame], AsyncIterable[Frame]], points: Queried, *,
                    both: bool = False, **options: Any) -> Tracks:
        """As the blocking client's; without `both`, frames may come from an async iterable."""
        queries = Queries(points)
        backward = Backward(frames, queries) if both else None
        tracks = await self._track(frames, queries, options)
        if backward is None or queries.last == 0:
            return tracks
        return backward.merge(tracks, await self._track(backward, backward.queries, backward.without_objects(options)))

    async def _track(self, frames: Union[Iterable[Frame], AsyncIterable[Frame]], queries: Queries,
                     options: dict[str, Any]) -> Tracks:
        count = 0
        async with self.session(queries.at(0), **options) as session:
            async for frame in _each(frames):
                await session.push(frame, points=queries.at(count) if count else ())
                session.updates()  # nobody else takes them
                count += 1
            queries.check(count)
            return await session.finish()


async def _each(frames: Union[Iterable[Frame], AsyncIterable[Frame]]) -> AsyncIterator[Frame]:
    if isinstance(frames, AsyncIterable):
        async for frame in frames:
            yield frame
    else:
        for frame in frames:
            yield frame
