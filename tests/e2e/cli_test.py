# SPDX-License-Identifier: Apache-2.0
"""The command line client against the real server on real video.

Usage: cli_test.py HOLDFAST_SERVER HOLDFAST
"""
import csv
import io
import json
import os
import pathlib
import signal
import struct
import subprocess
import sys
import tempfile
import unittest
import zipfile

from server_process import VIDEO, ServerProcess

FRAMES = 30
FEW_FRAMES = 12
RESTING = (338, 458)  # a bag on the lawn
SMALL = ["--processing_size=256x192", "--iterations=2", "--compute_threads=1"]


class CliTest(unittest.TestCase):
    server_program = client_program = None

    @classmethod
    def setUpClass(cls):
        cls.server = ServerProcess(cls.server_program, *SMALL, "--max_points=60")
        cls.addClassCleanup(cls.server.stop)

    def setUp(self):
        self.directory = tempfile.TemporaryDirectory(prefix="holdfast-cli-")
        self.addCleanup(self.directory.cleanup)

    def path(self, name):
        return pathlib.Path(self.directory.name) / name

    def command(self, *args):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        return dict(args=[self.client_program, *args], env=environment, stderr=subprocess.PIPE,
                    stdout=subprocess.PIPE, text=True)

    def holdfast(self, *args):
        return subprocess.run(**self.command(*args), timeout=120)

    def test_every_output_of_a_real_video(self):
        common = ["track", str(VIDEO), f"--server={self.server.address}"]
        self.path("points.csv").write_text("id,x,y,frame\n11,268,224,0\n12,513,162,4\n13,%d,%d,0\n" % RESTING)
        done = self.holdfast(*common, f"--max_frames={FRAMES}", f"--points={self.path('points.csv')}", "--grid=12",
                             f"--out={self.path('t.json')}", f"--overlay={self.path('o.mp4')}",
                             f"--still={self.path('s.png')}")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn(f"{FRAMES}/{FRAMES} frames", done.stderr)
        tracks = json.loads(self.path("t.json").read_text())
        self.assertEqual((tracks["width"], tracks["height"], tracks["fps"]), (768, 576, 10))
        self.assertEqual(len(tracks["points"]), 15)
        self.assertEqual(tracks["points"][0]["frames"], list(range(FRAMES)))
        self.assertEqual(tracks["points"][1]["frames"], list(range(4, FRAMES)))
        self.assertEqual(tracks["points"][0]["xy"][0], [268, 224])
        self.assertGreater(self.path("o.mp4").stat().st_size, 10000)
        self.assertEqual(self.path("s.png").read_bytes()[1:4], b"PNG")

        common.append(f"--max_frames={FEW_FRAMES}")
        done = self.holdfast(*common, f"--points={self.path('points.csv')}", f"--out={self.path('t.csv')}",
                             "--max_side=384")
        self.assertEqual(done.returncode, 0, done.stderr)
        rows = list(csv.DictReader(io.StringIO(self.path("t.csv").read_text())))
        self.assertEqual(len(rows), 3 * FEW_FRAMES - 4)
        # A smaller picture was sent; positions are in the video's own pixels all the same.
        last = [row for row in rows if row["id"] == "13"][-1]
        for position in (tracks["points"][2]["xy"][FEW_FRAMES - 1], (float(last["x"]), float(last["y"]))):
            self.assertAlmostEqual(position[0], RESTING[0], delta=4)
            self.assertAlmostEqual(position[1], RESTING[1], delta=4)

        done = self.holdfast(*common, "--grid=6", f"--out={self.path('t.npz')}")
        self.assertEqual(done.returncode, 0, done.stderr)
        with zipfile.ZipFile(self.path("t.npz")) as archive:
            self.assertIsNone(archive.testzip())
            array = archive.read("tracks.npy")
            header = array[10:10 + struct.unpack("<H", array[8:10])[0]].decode()
            self.assertIn(f"'shape': (6, {FEW_FRAMES}, 2)", header)
            self.assertEqual(sorted(archive.namelist()),
                             ["confidence.npy", "ids.npy", "tracks.npy", "visible.npy"])

    def test_info_says_what_the_server_runs(self):
        done = self.holdfast("info", f"--server={self.server.address}")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("256x192", done.stdout)
        done = self.holdfast("info", f"--server={self.server.address}", "--json")
        self.assertEqual(json.loads(done.stdout)["window_frames"], 24)

    def test_a_refusal_by_the_server_is_told_and_writes_nothing(self):
        done = self.holdfast("track", str(VIDEO), f"--server={self.server.address}", "--grid=100",
                             f"--out={self.path('t.json')}")
        self.assertEqual(done.returncode, 1)
        self.assertIn(f"holdfast: server at {self.server.address}: ", done.stderr)
        self.assertFalse(self.path("t.json").exists())

    def interrupted(self, server, stop):
        """Runs until the first frames are final, then calls stop(client); returns code, errors and tracks."""
        client = subprocess.Popen(**self.command("track", str(VIDEO), f"--server={server.address}", "--grid=30",
                                                 f"--out={self.path('t.json')}", f"--overlay={self.path('o.mp4')}"))
        overlay = self.path(f".o.{client.pid}.mp4")  # is there from the first final frame on
        while not overlay.exists():
            try:
                client.wait(0.02)
                self.fail("ended too early: " + client.communicate()[1])
            except subprocess.TimeoutExpired:
                pass
        stop(client)
        errors = client.communicate(timeout=60)[1]
        return client.returncode, errors, json.loads(self.path("t.json").read_text())

    def assert_partial(self, tracks):
        frames = tracks["points"][0]["frames"]
        self.assertGreater(len(frames), 0)
        self.assertLess(len(frames), 160)
        self.assertEqual(frames, list(range(len(frames))))
        self.assertTrue(self.path("o.mp4").exists())

    def test_an_interrupt_keeps_what_is_final(self):
        code, errors, tracks = self.interrupted(self.server, lambda client: client.send_signal(signal.SIGINT))
        self.assertEqual(code, 1)
        self.assertIn("holdfast: interrupted", errors)
        self.assert_partial(tracks)

    def test_the_death_of_the_server_is_told_and_keeps_what_is_final(self):
        server = ServerProcess(self.server_program, *SMALL)
        self.addCleanup(server.stop)
        code, errors, tracks = self.interrupted(server, lambda client: server.kill())
        self.assertEqual(code, 1)
        self.assertIn(f"holdfast: server at {server.address} is unavailable", errors)
        self.assert_partial(tracks)


if __name__ == "__main__":
    CliTest.server_program, CliTest.client_program = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1], verbosity=2)
