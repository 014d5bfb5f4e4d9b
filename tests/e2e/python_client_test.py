# SPDX-License-Identifier: Apache-2.0
"""A client in another language, made from the .proto file alone, talks to the real server.

Usage: python_client_test.py HOLDFAST_SERVER PROTOC
"""
import sys
import tempfile
import threading
import unittest

import grpc

from protocol import METHOD, generate, picture
from server_process import ServerProcess

WIDTH, HEIGHT, FRAMES = 128, 96, 32


def finals(responses, point):
    """What is final of a point, by frame."""
    return {run.first_frame + i: (run.x[i], run.y[i], run.confidence[i])
            for response in responses for run in response.tracks.runs if run.id == point
            for i in range(run.final_count)}


class PythonClientTest(unittest.TestCase):
    server_program = protoc = None

    @classmethod
    def setUpClass(cls):
        cls.directory = tempfile.TemporaryDirectory(prefix="holdfast-proto-")
        cls.pb, cls.status_pb, cls.details_pb = generate(cls.protoc, cls.directory.name)
        cls.server = ServerProcess(cls.server_program, f"--processing_size={WIDTH}x{HEIGHT}", "--iterations=2",
                                   "--precision=float32", "--compute_threads=1")
        cls.channel = grpc.insecure_channel(cls.server.address)
        cls.pictures = [picture(i, WIDTH, HEIGHT) for i in range(FRAMES)]

    @classmethod
    def tearDownClass(cls):
        cls.channel.close()
        code = cls.server.stop()
        cls.directory.cleanup()
        assert code == 0, f"the server ended with {code} after SIGTERM"

    def track(self, requests):
        call = self.channel.stream_stream(METHOD + "Track",
                                          request_serializer=self.pb.TrackRequest.SerializeToString,
                                          response_deserializer=self.pb.TrackResponse.FromString)
        return call(iter(requests), timeout=60)

    def requests(self, points, frames=FRAMES, until=None, **config):
        """'until': of which event the stream waits before it ends."""
        config = self.pb.SessionConfig(encoding=self.pb.FRAME_ENCODING_GRAY8, points=points,
                                       raw_size=self.pb.ImageSize(width=WIDTH, height=HEIGHT), **config)
        yield self.pb.TrackRequest(config=config)
        for index in range(frames):
            frame = self.pb.Frame(index=index, data=self.pictures[index])
            if index == 6:
                frame.points.add(id=77, x=40, y=40)
            yield self.pb.TrackRequest(frame=frame)
        if until is not None:
            until.wait(60)

    def info(self):
        ask = self.channel.unary_unary(METHOD + "GetServerInfo",
                                       request_serializer=self.pb.GetServerInfoRequest.SerializeToString,
                                       response_deserializer=self.pb.GetServerInfoResponse.FromString)
        return ask(self.pb.GetServerInfoRequest(), timeout=20)

    def test_server_says_what_it_runs(self):
        info = self.info()
        self.assertEqual(info.window_frames, 24)
        self.assertEqual(len(info.weights_sha256), 64)
        self.assertRegex(info.build, r"^\d+\.\d+\.\d+$")
        self.assertEqual(info.default_processing_size.width, WIDTH)
        self.assertGreater(info.limits.max_points, 0)

    def test_tracks_come_in_order_and_everything_becomes_final_once(self):
        points = [self.pb.Point(id=5, x=30, y=30), self.pb.Point(id=6, x=60.5, y=48.25)]
        responses = list(self.track(self.requests(points, hop_frames=4)))
        self.assertEqual(responses[0].WhichOneof("response"), "accepted")
        self.assertEqual(responses[0].accepted.hop_frames, 4)
        self.assertEqual(responses[-1].WhichOneof("response"), "summary")
        self.assertEqual(responses[-1].summary.frames, FRAMES)
        received = processed = 0
        final = {5: {}, 6: {}, 77: {}}
        for response in responses[1:-1]:
            self.assertEqual(response.WhichOneof("response"), "tracks")
            tracks = response.tracks
            self.assertGreaterEqual(tracks.frames_received, received)
            self.assertGreaterEqual(tracks.frames_processed, processed)
            self.assertLessEqual(tracks.frames_processed, tracks.frames_received)
            received, processed = tracks.frames_received, tracks.frames_processed
            for run in tracks.runs:
                self.assertEqual(len(run.x), len(run.y))
                self.assertEqual(len(run.x), len(run.visible))
                self.assertEqual(len(run.x), len(run.confidence))
                self.assertLessEqual(run.first_frame + len(run.x), received)
                for i in range(run.final_count):
                    self.assertNotIn(run.first_frame + i, final[run.id], "a final estimate is never sent twice")
                    final[run.id][run.first_frame + i] = (run.x[i], run.y[i])
                    self.assertTrue(0 <= run.confidence[i] <= 1)
        self.assertEqual((received, processed), (FRAMES, FRAMES))
        self.assertEqual(sorted(final[5]), list(range(FRAMES)))
        self.assertEqual(sorted(final[77]), list(range(6, FRAMES)))
        self.assertEqual(sum(len(samples) for samples in final.values()), responses[-1].summary.final_samples)
        self.assertAlmostEqual(final[6][0][0], 60.5, places=3)
        self.assertAlmostEqual(final[6][0][1], 48.25, places=3)
        # The whole picture moves to the right, and so does a point on it.
        self.assertGreater(final[5][FRAMES - 1][0] - final[5][0][0], FRAMES / 2)

    def test_a_loaded_server_takes_a_larger_hop_whose_tracks_are_those_of_a_session_that_asks_for_it(self):
        points, expected = [self.pb.Point(id=5, x=30, y=30)], 1000
        bounds = dict(hop_frames=8, max_hop_frames=16, expected_points=expected)

        def pace(share):
            """Frames a second that take half of the budget, where the points' work is this share of that with hop 8.
            Every batch moves the budget: what is asked for before one is of no use behind it."""
            load = self.info().load
            return load.work_budget / 2 / (load.frame_work + share * expected)

        alone, *_ = self.track(self.requests(points, frames=1, frames_per_second=pace(0.75), **bounds))
        self.assertEqual(alone.accepted.hop_frames, 8)
        ended = threading.Event()
        other = self.track(self.requests(points, frames=0, expected_points=expected, until=ended,
                                         frames_per_second=pace(1)))
        self.assertEqual(next(other).accepted.hop_frames, 8)
        chosen, *responses = self.track(self.requests(points, frames_per_second=pace(0.75), **bounds))
        ended.set()
        hop = chosen.accepted.hop_frames
        self.assertGreater(hop, 8)
        self.assertLessEqual(hop, 13)  # what is left is enough for 8 / 0.75, and the budget moves little
        accepted, *asked = self.track(self.requests(points, hop_frames=hop))
        self.assertEqual(accepted.accepted.hop_frames, hop)
        self.assertEqual(finals(responses, 5), finals(asked, 5))
        self.assertEqual(len(finals(asked, 5)), FRAMES)

    def test_a_client_that_wants_final_estimates_gets_no_others(self):
        for response in self.track(self.requests([self.pb.Point(id=1, x=9, y=9)], final_only=True)):
            for run in response.tracks.runs:
                self.assertEqual(run.final_count, len(run.x))

    def test_a_wrong_point_is_named_in_the_details(self):
        with self.assertRaises(grpc.RpcError) as caught:
            list(self.track(self.requests([self.pb.Point(id=1, x=9, y=9), self.pb.Point(id=2, x=WIDTH, y=9)])))
        self.assertEqual(caught.exception.code(), grpc.StatusCode.INVALID_ARGUMENT)
        trailers = dict(caught.exception.trailing_metadata())
        status = self.status_pb.Status.FromString(trailers["grpc-status-details-bin"])
        bad_request = self.details_pb.BadRequest()
        self.assertTrue(status.details[0].Unpack(bad_request))
        self.assertEqual(bad_request.field_violations[0].field, "config.points[1].x")

    def test_a_wrong_frame_ends_its_own_stream_after_its_results(self):
        def requests():
            yield from self.requests([self.pb.Point(id=1, x=9, y=9)], frames=28)
            yield self.pb.TrackRequest(frame=self.pb.Frame(index=28, data=b"too short"))

        final = 0
        with self.assertRaises(grpc.RpcError) as caught:
            for response in self.track(requests()):
                final += sum(run.final_count for run in response.tracks.runs if run.id == 1)
        self.assertEqual(caught.exception.code(), grpc.StatusCode.INVALID_ARGUMENT)
        self.assertIn("28", caught.exception.details())
        self.assertEqual(final, 28)


if __name__ == "__main__":
    PythonClientTest.server_program, PythonClientTest.protoc = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1], verbosity=2)
