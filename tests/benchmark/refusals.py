#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long a full holdfast-server takes to refuse a stream, while its sessions keep every processor busy.

Usage: refusals.py DIRECTORY_OF_PROGRAMS [--seconds=N]

Prints percentiles from the beginning of a call to its end: on a channel that is connected, and on a new one, whose
connection counts. Each refusal says when to come back.
"""
import argparse
import pathlib
import subprocess
import sys
import threading
import time

import grpc

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "e2e"))
from server_process import VIDEO, ServerProcess  # noqa: E402

PLACES, PAUSE = 4, 0.02  # seconds


def refused_in(channel, begin):
    """The milliseconds since then that it takes to be refused."""
    told = threading.Event()

    def requests():
        told.wait()
        yield from ()  # a stream that says nothing

    call = channel.stream_stream("/holdfast.v1.PointTracking/Track", bytes, bytes)(requests())
    code = call.code()
    took = (time.monotonic() - begin) * 1000
    told.set()
    details = dict(call.trailing_metadata()).get("grpc-status-details-bin", b"")
    assert code == grpc.StatusCode.RESOURCE_EXHAUSTED and b"google.rpc.RetryInfo" in details, call.details()
    return took


def on_new_channel(address):
    begin = time.monotonic()
    with grpc.insecure_channel(address, [("grpc.use_local_subchannel_pool", 1)]) as channel:
        return refused_in(channel, begin)


def describe(name, times):
    times = sorted(times)
    percentiles = " / ".join(f"{times[min(len(times) - 1, int(len(times) * share))]:.1f}" for share in (.5, .95, .99))
    print(f"{name}: {len(times)} refusals, p50 / p95 / p99 {percentiles} ms")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("programs", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=30)
    arguments = parser.parse_args()
    server = ServerProcess(arguments.programs / "holdfast-server", f"--max_sessions={PLACES}")
    load = subprocess.Popen([arguments.programs / "holdfast", "load", VIDEO, f"--server={server.address}",
                             "--points=16", "--fps=1", f"--sessions={PLACES}", f"--seconds={arguments.seconds + 8}"])
    server.wait_for_metric("holdfast_sessions_active", PLACES)
    connected, new = [], []
    end = time.monotonic() + arguments.seconds
    with grpc.insecure_channel(server.address) as channel:
        grpc.channel_ready_future(channel).result()
        while time.monotonic() < end:
            time.sleep(PAUSE)
            connected.append(refused_in(channel, time.monotonic()))
            time.sleep(PAUSE)
            new.append(on_new_channel(server.address))
    describe("on a connected channel", connected)
    describe("on a new one", new)
    load.wait()
    server.stop()


if __name__ == "__main__":
    main()
