# SPDX-License-Identifier: Apache-2.0
"""Which server a session turns to, and when. Both clients follow it; it neither waits nor calls."""
from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import grpc

from . import errors
from ._session import SessionState

_FIRST_WAIT, _LONGEST_WAIT, _FACTOR, _JITTER = 0.1, 5.0, 1.6, 0.2  # seconds between attempts to reconnect
_THIN_LINE = 64 << 10  # bytes a second, at which a checkpoint goes up to the next server


@dataclass(frozen=True)
class Reconnect:
    """How a session outlives its server."""

    seconds: float = 120.0  # for another server to take over
    buffer_bytes: int = 256 << 20  # of messages kept for that; push() waits while they are full
    checkpoint_interval: int = 24  # frames; 0: the session keeps nothing, and ends with its server


@dataclass(frozen=True)
class Attempt:
    """To open a session at a server."""

    server: int  # its place among the client's
    pause: float  # seconds to wait before
    timeout: float  # seconds for the server to accept the session


class CallFailed(Exception):
    """A call that did not end well. `lost`: its server, or the way to it, is gone."""

    def __init__(self, error: errors.HoldfastError, lost: bool = False) -> None:
        super().__init__(error)
        self.error = error
        self.lost = lost


def judge(call: Any, server: str, accepted: bool) -> CallFailed:
    """What gRPC's error of a call means. A server that is too slow to accept a session counts as lost."""
    error = errors.to_error(call, server)
    return CallFailed(error, errors.is_lost_server(call) or (not accepted and isinstance(error, errors.Unavailable)))


def late(server: str, seconds: float) -> CallFailed:
    """A server that has not answered in time."""
    code = grpc.StatusCode.DEADLINE_EXCEEDED
    return CallFailed(errors.Unavailable(code, f"no answer within {seconds:.0f} s", server), lost=True)


def broken(server: str, what: str) -> CallFailed:
    """A server that breaks the protocol; `what` it did."""
    return CallFailed(errors.HoldfastError(grpc.StatusCode.INTERNAL, f"the server {what}", server))


class _Search:
    """For a server that takes a lost session over, of those in `order`."""

    def __init__(self, order: list[int], seconds: float, timeout: float, now: Callable[[], float]) -> None:
        self.order = order
        self._timeout = timeout
        self._now = now
        self._deadline = now() + seconds
        self._wait = _FIRST_WAIT
        self._refused: set[int] = set()

    def refuse(self, server: int, failed: CallFailed) -> None:
        """A server did not take it. Raises the error when that is the last word."""
        error = failed.error
        if failed.lost or (isinstance(error, errors.Overloaded) and error.retry_after is not None):
            return
        self._refused.add(server)
        if not isinstance(error, errors.NotResumable) or len(self._refused) == len(self.order):
            raise error from None

    def next(self, error: errors.HoldfastError) -> Attempt:
        while self.order[0] in self._refused:
            self.order.append(self.order.pop(0))
        pause = self._wait * random.uniform(1 - _JITTER, 1 + _JITTER)
        self._wait = min(self._wait * _FACTOR, _LONGEST_WAIT)
        if isinstance(error, errors.Overloaded):
            pause = max(pause, error.retry_after or 0)
        left = self._deadline - self._now() - pause
        if left <= 0:
            raise error from None
        self.order.append(self.order.pop(0))
        return Attempt(self.order[-1], pause, min(self._timeout, left))


class Route:
    """A session begins at the first server that takes it, each being asked once. When that one is lost, the others are
    asked in turn until one goes on or the time for it is over. One that takes it and is lost before it got further is
    part of the same search, so that a session that kills every server comes to an end. Not thread-safe."""

    def __init__(self, state: SessionState, servers: int, timeout: float, reconnect: Reconnect | None,
                 now: Callable[[], float] = time.monotonic) -> None:
        self._state = state
        self._servers = servers
        self._timeout = timeout
        self._seconds = reconnect.seconds if reconnect is not None else 0.0
        self._now = now
        self._begun = False
        self._taken_at = 0.0
        self._processed = 0  # frames, when a server was last lost
        self._search: _Search | None = None  # the newest
        self.following = False  # whether a server has the session

    def first(self) -> Attempt:
        return Attempt(0, 0.0, self._timeout)

    def accepted(self) -> bool:
        """A server has taken the session. True: in place of one that was lost."""
        resumed, self._begun, self.following = self._begun, True, True
        self._taken_at = self._now()
        return resumed

    def after(self, attempt: Attempt, failed: CallFailed) -> Attempt:
        """Where to turn when an attempt, or the call that came of it, has failed. Raises its error if nowhere."""
        if not self._begun:
            return self._another_first(attempt, failed)
        if self.following:
            self._lose(attempt.server, failed)
        elif self._search is not None:
            self._search.refuse(attempt.server, failed)
        assert self._search is not None
        return self._search.next(failed.error)

    def _lose(self, server: int, failed: CallFailed) -> None:
        self.following = False
        if not failed.lost or not self._state.keeps:
            raise failed.error from None
        order, now = self._order_after(server), self._now()
        recovered = self._state.processed > self._processed or now - self._taken_at > self._seconds
        if self._search is None or recovered:
            timeout = self._timeout + len(self._state.token) // _THIN_LINE
            self._search = _Search(order, self._seconds, timeout, self._now)
        self._search.order = order
        self._processed = self._state.processed

    def _another_first(self, attempt: Attempt, failed: CallFailed) -> Attempt:
        elsewhere = failed.lost or isinstance(failed.error, (errors.Overloaded, errors.NotResumable))
        if not elsewhere or attempt.server + 1 == self._servers:
            raise failed.error from None
        return Attempt(attempt.server + 1, 0.0, self._timeout)

    def _order_after(self, server: int) -> list[int]:
        """The lost server comes last, unless only that very one can go on."""
        order = [(server + i) % self._servers for i in range(self._servers)]
        return order if self._state.token and not self._state.resumable else order[1:] + order[:1]
