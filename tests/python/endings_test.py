# SPDX-License-Identifier: Apache-2.0
"""How a session ends at a server whose call ends otherwise than it should."""
import asyncio
import unittest
from concurrent.futures import ThreadPoolExecutor

import grpc

import support
from support import PICTURES, POINTS

import holdfast_client
from holdfast_client import aio
from holdfast_client._proto import point_tracking_pb2 as pb


class SummaryThenStatus(grpc.GenericRpcHandler):
    """Takes a session whole, sends its summary, and ends the call with `code`."""

    def __init__(self, code):
        self.code = code
        self.calls = 0
        self.server = grpc.server(ThreadPoolExecutor(2), handlers=[self])
        self.address = f"127.0.0.1:{self.server.add_insecure_port('127.0.0.1:0')}"
        self.server.start()

    def service(self, handler_call_details):
        return grpc.stream_stream_rpc_method_handler(self.track, pb.TrackRequest.FromString,
                                                     pb.TrackResponse.SerializeToString)

    def track(self, requests, context):
        self.calls += 1
        next(requests)
        yield pb.TrackResponse(accepted=pb.SessionAccepted(session_id="f00d", window_frames=24, hop_frames=8,
                                                           replay_frames=24, checkpoint_interval_frames=16))
        for _ in requests:
            pass
        yield pb.TrackResponse(summary=pb.SessionSummary())
        context.abort(self.code, "after the summary")


def track(address):
    with holdfast_client.Client(address) as client:
        return client.track(PICTURES[:3], POINTS, encoding="raw")


async def track_by_tasks(address):
    async with aio.Client(address) as client:
        return await client.track(PICTURES[:3], POINTS, encoding="raw")


CLIENTS = (track, lambda address: asyncio.run(track_by_tasks(address)))


class EndingsTest(unittest.TestCase):
    def serve(self, code):
        server = SummaryThenStatus(code)
        self.addCleanup(lambda: server.server.stop(None).wait())
        return server

    def test_a_connection_that_is_lost_after_the_summary_takes_nothing(self):
        for track_at in CLIENTS:
            server = self.serve(grpc.StatusCode.UNAVAILABLE)
            self.assertTrue(track_at(server.address).complete)
            self.assertEqual(server.calls, 1)

    def test_what_the_server_says_after_the_summary_counts(self):
        for track_at in CLIENTS:
            server = self.serve(grpc.StatusCode.DATA_LOSS)
            with self.assertRaisesRegex(holdfast_client.HoldfastError, "after the summary"):
                track_at(server.address)


if __name__ == "__main__":
    support.main()
