# SPDX-License-Identifier: Apache-2.0
"""The Python client and the command line see the same: equal tracks of the same frames, and equal files of them.

Usage: command_line_test.py HOLDFAST_SERVER PROTOC HOLDFAST
"""
import json
import os
import pathlib
import re
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

    def command_line(self, name, *points):
        """The file that it writes, and the frames that it sent."""
        tap = Tap(self.server.address)
        self.addCleanup(tap.stop)
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        command = [HOLDFAST, "track", self.folder / "frames", f"--server={tap.address}", f"--out={name}",
                   *(points or ["--points=points.json"])]
        done = subprocess.run(command, cwd=self.folder, env=environment, capture_output=True, text=True, check=False)
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
        tracks.xy, tracks.confidence = expected["tracks"], expected["confidence"]
        tracks.to_csv(self.folder / "p.csv")
        tracks.to_dlc_csv(self.folder / "p.dlc.csv", names=NAMES)
        tracks.to_cvat_xml(self.folder / "p.xml", size=(WIDTH, HEIGHT), names=NAMES)
        for name in ("csv", "dlc.csv", "xml"):
            written, _ = self.command_line(f"t.{name}")
            self.assertEqual((self.folder / f"p.{name}").read_text(), written.read_text())
        self.assertIn('outside="1"', written.read_text())

    def test_who_reads_the_arrays_of_one_reads_those_of_the_other(self):
        arrays, frames = self.command_line("t.npz")
        expected = np.load(arrays)
        with holdfast_client.Client(self.server.address) as client:
            tracks = client.track(frames, {query["id"]: (query["frame"], query["x"], query["y"]) for query in QUERIES})
        tracks.to_npz(self.folder / "p.npz", names=NAMES, size=(WIDTH, HEIGHT), fps=float(expected["fps"]))
        found = np.load(self.folder / "p.npz")
        self.assertEqual(set(found), {*expected, "xy", "final"})
        for name in expected:
            self.assertEqual(found[name].dtype, expected[name].dtype, name)
            if name in ("tracks", "confidence"):
                np.testing.assert_allclose(found[name], expected[name], atol=1e-3, err_msg=name)
            else:
                np.testing.assert_array_equal(found[name], expected[name], name)
        np.testing.assert_array_equal(found["xy"], found["tracks"])

    def test_objects_and_who_was_placed_anew_are_the_same(self):
        still = 84  # columns from here on stand still: points of the object that lie there leave it
        for number, picture in enumerate(PICTURES):
            parts = np.concatenate([picture[:, :still], PICTURES[0][:, still:]], axis=1)
            Image.fromarray(parts).save(self.folder / f"frames/{number:03}.png")
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        mask[20:76, 6:92] = 255
        Image.fromarray(mask).save(self.folder / "mask.png")
        arrays, frames = self.command_line("t.npz", "--mask=mask.png", "--grid=30")
        expected = dict(np.load(arrays))
        with holdfast_client.Client(self.server.address) as client:
            tracks = client.track(frames, [], objects={1: mask}, object_points=30)
            kept = client.track(frames, [], objects={1: mask}, object_points=30, reseed=False)
        tracks.to_npz(self.folder / "p.npz")
        found = dict(np.load(self.folder / "p.npz"))
        first = (1 << 63) + (1 << 32)  # which the command line calls 1
        rows = np.argsort(expected["ids"])
        np.testing.assert_array_equal((found["ids"] - np.uint64(first) + np.uint64(1)).astype(np.int64),
                                      expected["ids"][rows])
        for name in ("left", "of_object"):
            np.testing.assert_array_equal(found[name], expected[name][rows])
        for name in ("ids", "centre", "scale", "rotation", "visible", "outline"):
            self.assertEqual(found[f"object_{name}"].dtype, expected[f"object_{name}"].dtype)
            np.testing.assert_allclose(found[f"object_{name}"], expected[f"object_{name}"], atol=2e-3)
        anew = found["replaces"] >= 0
        self.assertGreater(anew.sum(), 0)
        np.testing.assert_array_equal(found["ids"][found["replaces"][anew]] + np.uint64(256), found["ids"][anew])
        self.assertEqual(sum(len(points) for points in tracks.objects[1].joined), anew.sum())
        self.assertEqual(len(kept), 30)

        tracks.to_objects_csv(self.folder / "p.objects.csv")
        self.command_line("t.csv", "--mask=mask.png", "--grid=30")
        lines, same = ([line.split(",") for line in (self.folder / f"{name}.objects.csv").read_text().splitlines()]
                       for name in ("p", "t"))
        self.assertEqual(len(lines), 1 + len(PICTURES))
        self.assertEqual(lines[0], same[0])
        for line, other in zip(lines[1:], same[1:]):
            self.assertEqual([[int(point) - first + 1 for point in column.split()] for column in line[8:]],
                             [[int(point) for point in column.split()] for column in other[8:]])
            numbers, others = ([float(number) for number in re.split("[,; ]", ",".join(columns[:8]))]
                               for columns in (line, other))
            np.testing.assert_allclose(numbers, others, atol=2e-3)


if __name__ == "__main__":
    support.main()
