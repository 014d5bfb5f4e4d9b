# SPDX-License-Identifier: Apache-2.0
"""What a server can say instead of tracks, as exceptions that carry its details, and the warning of what it says beside
them."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import grpc
from google.rpc import error_details_pb2, status_pb2

_DETAILS = "grpc-status-details-bin"


@dataclass(frozen=True)
class Violation:
    """A field of a request and what is wrong with it."""

    field: str
    description: str


class HoldfastWarning(UserWarning):
    """Of a session that goes on: what its server warns of, and that it does not outlive this server."""


class HoldfastError(Exception):
    """A call or a session that failed. `code` is gRPC's, `server` the address that said so."""

    def __init__(self, code: grpc.StatusCode, message: str, server: str = "") -> None:
        super().__init__(f"{server}: {message}" if server else message)
        self.code = code
        self.message = message
        self.server = server

    def __reduce__(self) -> tuple[Any, ...]:
        """Exceptions are pickled as a call with their `args`, which here are one text where three are expected."""
        return type(self), (self.code, self.message, self.server), vars(self)


class InvalidRequest(HoldfastError):
    """The request was wrong; `violations` say which of its fields and why."""

    violations: tuple[Violation, ...] = ()


class Overloaded(HoldfastError):
    """The server has no room; `budget` names what is used up, `retry_after` (seconds, or None) when to ask again."""

    budget: str = ""
    retry_after: float | None = None


class NotAllowed(HoldfastError):
    """The server wants a token, or another one."""


class NotResumable(HoldfastError):
    """No server takes the lost session over: other keys, other weights, or a checkpoint that is too old. A server
    without --checkpoint_keys has keys of its own, which a restart changes."""


class Unavailable(HoldfastError):
    """No server is there, or the one that had the session was lost for good."""


_KINDS: dict[grpc.StatusCode, type[HoldfastError]] = {
    grpc.StatusCode.INVALID_ARGUMENT: InvalidRequest,
    grpc.StatusCode.RESOURCE_EXHAUSTED: Overloaded,
    grpc.StatusCode.UNAUTHENTICATED: NotAllowed,
    grpc.StatusCode.FAILED_PRECONDITION: NotResumable,
    grpc.StatusCode.UNAVAILABLE: Unavailable,
    grpc.StatusCode.DEADLINE_EXCEEDED: Unavailable,
}


def details_of(call: grpc.Call) -> status_pb2.Status | None:
    """What the server said beside code and text; None where it is not a Holdfast server that speaks."""
    for key, value in call.trailing_metadata() or ():
        if key == _DETAILS:
            return status_pb2.Status.FromString(value)
    return None


def is_lost_server(call: grpc.Call) -> bool:
    """Whether the call ended because its server, or the way to it, is gone: other errors of a server have details."""
    if call.code() == grpc.StatusCode.UNAVAILABLE:
        return True
    broken = (grpc.StatusCode.CANCELLED, grpc.StatusCode.INTERNAL, grpc.StatusCode.UNKNOWN)
    return call.code() in broken and details_of(call) is None


def to_error(call: grpc.Call, server: str) -> HoldfastError:
    """The exception for a call that did not end well."""
    error = _KINDS.get(call.code(), HoldfastError)(call.code(), call.details() or call.code().name.lower(), server)
    details = details_of(call)
    for any_message in details.details if details is not None else ():
        _add_detail(error, any_message)
    return error


def _add_detail(error: HoldfastError, packed: Any) -> None:
    bad, quota, retry = error_details_pb2.BadRequest(), error_details_pb2.QuotaFailure(), error_details_pb2.RetryInfo()
    if isinstance(error, InvalidRequest) and packed.Unpack(bad):
        error.violations = tuple(Violation(v.field, v.description) for v in bad.field_violations)
    elif isinstance(error, Overloaded) and packed.Unpack(quota):
        error.budget = ", ".join(violation.subject for violation in quota.violations)
    elif isinstance(error, Overloaded) and packed.Unpack(retry):
        error.retry_after = retry.retry_delay.ToTimedelta().total_seconds()
