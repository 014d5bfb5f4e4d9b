# SPDX-License-Identifier: Apache-2.0
"""The blocking client."""
from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import grpc

from ._base import BaseClient
from ._both import Backward
from ._channel import Tls
from ._frames import Frame
from ._plan import Reconnect
from ._proto import point_tracking_pb2 as pb
from ._queries import Queried, Queries
from .session import Session
from .tracks import Tracks

__all__ = ["Client", "Reconnect", "Tls"]


class Client(BaseClient[Session]):
    """A tracking server, or several of which any will do: "host:port", "a:1,b:2" or a list. Thread-safe.

    `tls`: True, or a Tls; `token`: of the caller; `reconnect`: None ends sessions with their server; `timeout`: seconds
    for a server to answer; a session that goes on elsewhere has one more for each 64 KiB of its checkpoint.
    """

    _grpc = grpc
    _session_type = Session

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections to the servers."""
        for channel in self._channels:
            channel.close()

    def info(self) -> pb.GetServerInfoResponse:
        """What the first server that is there runs, and its limits."""
        for server in range(len(self.addresses)):
            try:
                return self._info_call(server)
            except grpc.RpcError as failed:
                self._ask_another(server, failed)
        raise AssertionError("there is a server")

    def track(self, frames: Iterable[Frame], points: Queried, *, both: bool = False, **options: Any) -> Tracks:
        """Tracks points through a whole video: `points` as {id: (x, y)} or [N, 2] of the first frame, or with the frame
        of each as {id: (frame, x, y)} or [N, 3]. `options` as of session(), `objects` among them. Frames are read as
        they are sent.

        `both`: also before each point's query, by a second session, over the frames up to the last query in reverse
        order. For that `frames` has to be a sequence, whose first frames are indexed again after the last one was sent.
        What is tracked after the queries is the same as without.
        """
        queries = Queries(points)
        backward = Backward(frames, queries) if both else None
        tracks = self._track(frames, queries, options)
        if backward is None or queries.last == 0:
            return tracks
        return backward.merge(tracks, self._track(backward, backward.queries, backward.without_objects(options)))

    def _track(self, frames: Iterable[Frame], queries: Queries, options: dict[str, Any]) -> Tracks:
        count = 0
        with self.session(queries.at(0), **options) as session:
            for frame in frames:
                session.push(frame, points=queries.at(count) if count else ())
                count += 1
            queries.check(count)
            return session.finish()
