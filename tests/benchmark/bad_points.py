#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How holdfast-server takes messages of a million points that are none.

Usage: bad_points.py HOLDFAST_SERVER [FLAGS]

Prints for each message how long the answer takes, and what it costs the server in processor time (steps of 10 ms) and
resident memory.
"""
import pathlib
import sys
import threading
import time

import grpc
from process_usage import memory_kb, processor_ms

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "e2e"))
from server_process import ServerProcess  # noqa: E402

POINTS, MESSAGES = 1_000_000, 6


def field(number, content):
    """A length-delimited field of protobuf's wire format."""
    length, rest = b"", len(content)
    while rest >= 128:
        length += bytes([rest & 127 | 128])
        rest >>= 7
    return bytes([number << 3 | 2]) + length + bytes([rest]) + content


# TrackRequest.add_points.points: id 1, x and y NaN.
MESSAGE = field(3, field(1, b"\x08\x01\x15\x00\x00\xc0\x7f\x1d\x00\x00\xc0\x7f") * POINTS)


def usage(pid):
    return processor_ms(pid), memory_kb(pid)


def refusal(channel):
    """The seconds that it takes to be told why."""
    told = threading.Event()

    def requests():
        yield MESSAGE
        told.wait()  # a stream that stays open

    begin = time.monotonic()
    call = channel.stream_stream("/holdfast.v1.PointTracking/Track", bytes, bytes)(requests())
    code = call.code()
    told.set()
    assert code in (grpc.StatusCode.RESOURCE_EXHAUSTED, grpc.StatusCode.INVALID_ARGUMENT), call.details()
    return time.monotonic() - begin


def main():
    server = ServerProcess(sys.argv[1], "--processing_size=128x96", "--compute_threads=1", *sys.argv[2:])
    print(f"{POINTS} points, {len(MESSAGE)} bytes")
    with grpc.insecure_channel(server.address, [("grpc.max_send_message_length", -1)]) as channel:
        for _ in range(MESSAGES):
            before = usage(server.process.pid)
            seconds = refusal(channel)
            cpu, memory = (now - then for now, then in zip(usage(server.process.pid), before))
            print(f"answered in {seconds * 1000:.0f} ms; server: {cpu} ms, {memory:+} kB")
    server.stop()


if __name__ == "__main__":
    main()
