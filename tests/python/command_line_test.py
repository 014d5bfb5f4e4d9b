# SPDX-License-Identifier: Apache-2.0
"""The Python client and the command line see the same: equal tracks of the same frames, and equal files of them.

Usage: command_line_test.py HOLDFAST_SERVER PROTOC HOLDFAST
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
from concurrent.futures import ThreadPoolExecutor

HOLDFAST = sys.argv.pop(3)

import grpc  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

import support  # noqa: E402
from support import HEIGHT, PICTURES, WIDTH  # noqa: E402

import holdfast_client  # noqa: E402
from holdfast_client._proto import point_tracking_pb2 as pb  # noqa: E402

# The last one leaves the picture to the right.
QUERIES = [{"id": 3, "x": 40.5, "y": 50.25, "frame": 0, "name": 'a "b", <c>'}, {"id": 5, "x": 60, "y": 40, "frame": 7},
           {"id": 8, "x": 110, "y": 30, "frame": 0, "name": "right"}]
NAMES = {query["id"]: query["name"] for query in QUERIES if "name" in query}


class Tap(grpc.GenericRpcHandler):
    """Hands streams on to a server, and keeps the frames that went through."""

    def __init__(self, address):
        self.frames = []
        self.channel = grpc.insecure_channel(address)
        self.server = grpc.server(ThreadPoolExecutor(4), handlers=[self])
        self.address = f"127.0.0.1:{self.server.add_insecure_port('127.0.0.1:0')}"
        self.server.start()

    def service(self, handler_call_details):
        onward = self.channel.stream_stream(handler_call_details.method)

        def kept(requests):
            for request in requests:
                frame = pb.TrackRequest.FromString(request).frame
                if frame.data:
                    self.frames.append(frame.data)
                yield request
        return grpc.stream_stream_rpc_method_handler(lambda requests, _: onward(kept(requests)))

    def stop(self):
        self.server.stop(None).wait()
        self.channel.close()


class CommandLineTest(support.ServedTest, unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory(prefix="holdfast-command-line-")
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)
        (self.folder / "frames").mkdir()
        for number, picture in enumerate(PICTURES):
            Image.fromarray(picture).save(self.folder / f"frames/{number:03}.png")
        (self.folder / "points.json").write_text(json.dumps(QUERIES), encoding="utf-8")

    def command_line(self, name):
        """The file that it writes, and the frames that it sent."""
        tap = Tap(self.server.address)
        self.addCleanup(tap.stop)
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        done = subprocess.run([HOLDFAST, "track", self.folder / "frames", f"--server={tap.address}", f"--out={name}",
                               "--points=points.json"], cwd=self.folder, env=environment, capture_output=True,
                              text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(len(tap.frames), len(PICTURES))
        return self.folder / name, tap.frames

    def test_tracks_and_files_are_the_same(self):
        arrays, frames = self.command_line("t.npz")
        expected = np.load(arrays)
        with holdfast_client.Client(self.server.address) as client:
            tracks = client.track(frames, {query["id"]: (query["frame"], query["x"], query["y"]) for query in QUERIES})
        np.testing.assert_array_equal(tracks.ids, expected["ids"])
        np.testing.assert_array_equal(np.isnan(tracks.xy), np.isnan(expected["tracks"]))
        np.testing.assert_allclose(tracks.xy, expected["tracks"], atol=1e-3)
        np.testing.assert_array_equal(tracks.visible, expected["visible"])
        np.testing.assert_allclose(tracks.confidence, expected["confidence"], atol=1e-3)

        # Rounded to three digits, so of the very same numbers.
        tracks.xy, tracks.confidence = expected["tracks"], np.nan_to_num(expected["confidence"])
        tracks.to_dlc_csv(self.folder / "p.dlc.csv", names=NAMES)
        tracks.to_cvat_xml(self.folder / "p.xml", size=(WIDTH, HEIGHT), names=NAMES)
        for name in ("dlc.csv", "xml"):
            written, _ = self.command_line(f"t.{name}")
            self.assertEqual((self.folder / f"p.{name}").read_text(), written.read_text())
        self.assertIn('outside="1"', written.read_text())


if __name__ == "__main__":
    support.main()
