# SPDX-License-Identifier: Apache-2.0
"""The way to a server: addresses, encryption and gRPC's options, for both kinds of channels."""
from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Union

import grpc

# gRPC takes "min_reconnect_backoff" for the time that one attempt to connect has: with encryption, a distant server's
# takes several round trips. Without "max_pings_without_data" it asks a silent peer twice whether it lives, and no more.
_OPTIONS: tuple[tuple[str, Any], ...] = (
    ("grpc.max_receive_message_length", 64 << 20), ("grpc.max_send_message_length", -1),
    ("grpc.use_local_subchannel_pool", 1), ("grpc.keepalive_time_ms", 30_000),
    ("grpc.keepalive_timeout_ms", 10_000), ("grpc.http2.max_pings_without_data", 0),
    ("grpc.initial_reconnect_backoff_ms", 100), ("grpc.min_reconnect_backoff_ms", 5000),
    ("grpc.max_reconnect_backoff_ms", 1000))

_HERE = re.compile(r"(dns:///)?(localhost|127(\.\d+){3}|\[::1\]):\d+")  # addresses of this machine


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


def addresses_of(address: Union[str, Sequence[str]]) -> list[str]:
    addresses = [one.strip() for one in (address.split(",") if isinstance(address, str) else address)]
    if not addresses or not all(":" in one and not one.startswith(("http:", "https:")) for one in addresses):
        raise ValueError(f"address is {address!r}, expected host:port")
    return addresses


def metadata_of(token: str | None) -> tuple[tuple[str, str], ...]:
    """The error does not tell the token, as logs would."""
    if token and not (token.isascii() and token.isprintable()):
        raise ValueError("token has a line break or another character that cannot be sent, expected printable ASCII")
    return (("authorization", f"Bearer {token}"),) if token else ()


def open_channel(kind: Any, address: str, tls: Union[bool, Tls]) -> Any:
    """`kind`: the module whose channel it is, grpc or grpc.aio."""
    options = list(_OPTIONS)
    if _HERE.fullmatch(address):
        options.append(("grpc.enable_http_proxy", 0))  # the environment's proxy is for other machines
    if not tls:
        return kind.insecure_channel(address, options)
    tls = Tls() if tls is True else tls
    if tls.server_name is not None:
        options.append(("grpc.ssl_target_name_override", tls.server_name))
    return kind.secure_channel(address, tls.credentials(), options)
