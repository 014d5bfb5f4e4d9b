# SPDX-License-Identifier: Apache-2.0
"""The command line client against the real server on real video.

Usage: cli_test.py HOLDFAST_SERVER HOLDFAST
"""
import csv
import http.server
import io
import json
import math
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import unittest
import zipfile
from xml.etree import ElementTree

from PIL import Image
from server_process import VIDEO, ServerProcess

FRAMES = 30
FEW_FRAMES = 12
RESTING = (338, 458)  # a bag on the lawn
SMALL = ["--processing_size=256x192", "--iterations=2", "--compute_threads=1", "--precision=float32"]
WIDTH, HEIGHT = 128, 96
SENT = 56  # frames of a run that is broken off
WHOLE = 72  # frames of the run it is compared with


def moving_picture(frames):
    """A YUV4MPEG2 video, grey, whose texture moves one pixel to the right each frame; at most WHOLE frames."""
    texture = [bytes(int(128 + 60 * math.sin(x * 0.35) * math.cos(y * 0.3) + 40 * math.sin(x * 0.11 + y * 0.17))
                     for x in range(WIDTH + WHOLE)) for y in range(HEIGHT)]
    grey = bytes([128]) * (WIDTH * HEIGHT // 2)
    pictures = (b"".join(row[WHOLE - i:WHOLE - i + WIDTH] for row in texture) for i in range(frames))
    return b"YUV4MPEG2 W%d H%d F10:1 Ip C420jpeg\n" % (WIDTH, HEIGHT) + b"".join(
        b"FRAME\n" + picture + grey for picture in pictures)


def jpegs(video):
    """The frames of a moving_picture."""
    for frame in video.split(b"FRAME\n")[1:]:
        file = io.BytesIO()
        Image.frombytes("L", (WIDTH, HEIGHT), frame[:WIDTH * HEIGHT]).save(file, "JPEG", quality=95)
        yield file.getvalue()


class NetworkCamera(http.server.BaseHTTPRequestHandler):
    """Shows these JPEGs at /camera, one after the other in one answer, as network cameras do."""
    pictures = ()

    def do_GET(self):
        if self.path != "/camera":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
        self.end_headers()
        for picture in self.pictures:
            self.wfile.write(b"--next\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(picture))
            self.wfile.write(picture + b"\r\n")

    def log_message(self, *_):
        pass


def npy(content):
    """Header and data of a .npy file."""
    length = struct.unpack("<H", content[8:10])[0]
    return content[10:10 + length].decode(), content[10 + length:]


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

    def test_load_of_all_kinds_of_clients(self):
        done = self.holdfast("load", str(VIDEO), f"--server={self.server.address}", "--sessions=4", "--points=6",
                             "--fps=4", "--seconds=4", "--bad=25", "--cancel=25", f"--out={self.path('load.json')}")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        totals = {total["kind"]: total for total in json.loads(self.path("load.json").read_text())["totals"]}
        self.assertEqual(totals["healthy"]["sessions"], 2)
        self.assertGreaterEqual(totals["healthy"]["frames"], 24)
        self.assertEqual(totals["healthy"]["final_ms"]["count"], totals["healthy"]["frames"])
        for kind in ("bad", "cancel"):
            self.assertGreaterEqual(totals[kind]["sessions"], 1)
            self.assertEqual(totals[kind]["errors"], [])
        self.assertIn("healthy", done.stdout)

    def test_load_of_a_server_that_is_not_there_fails(self):
        done = self.holdfast("load", str(VIDEO), "--server=127.0.0.1:1", "--connect_timeout=1s", "--sessions=2",
                             "--seconds=2")
        self.assertEqual(done.returncode, 1)
        self.assertIn("2 of 2 healthy clients saw errors", done.stderr)

    def test_tracks_in_the_formats_of_other_programs_are_the_same(self):
        points = [{"id": 11, "x": 268, "y": 224, "name": "head"}, {"id": 12, "x": 513, "y": 162, "frame": 4}]
        self.path("points.json").write_text(json.dumps(points), encoding="utf-8")
        common = ["track", str(VIDEO), f"--server={self.server.address}", f"--points={self.path('points.json')}",
                  f"--max_frames={FEW_FRAMES}"]
        for name in ("t.json", "t.dlc.csv", "t.xml", "t.3de.txt"):
            done = self.holdfast(*common, f"--out={self.path(name)}")
            self.assertEqual(done.returncode, 0, done.stderr)
        expected = {(point["id"], frame): xy for point in json.loads(self.path("t.json").read_text())["points"]
                    for frame, xy in zip(point["frames"], point["xy"])}

        rows = list(csv.reader(self.path("t.dlc.csv").read_text(encoding="utf-8").splitlines()))
        self.assertEqual(rows[1][1::3], ["head", "12"])
        table = {(point, int(row[0])): [float(row[at]), float(row[at + 1])] for row in rows[3:]
                 for point, at in ((11, 1), (12, 4)) if row[at]}
        self.assertEqual(table, expected)

        tracks = list(ElementTree.parse(self.path("t.xml")).iter("track"))
        self.assertEqual([track.get("label") for track in tracks], ["head", "point"])
        shown = {(int(track.get("id")), int(points.get("frame"))): list(map(float, points.get("points").split(",")))
                 for track in tracks for points in track if points.get("outside") == "0"}
        self.assertEqual(shown, expected)

        lines = iter(self.path("t.3de.txt").read_text(encoding="utf-8").splitlines())
        curves = {}
        for _ in range(int(next(lines))):
            name, _, keys = next(lines), next(lines), int(next(lines))
            curves[name] = {int(frame) - 1: [float(x) - 0.5, 576 - float(y) - 0.5]
                            for frame, x, y in (next(lines).split() for _ in range(keys))}
        self.assertEqual(list(curves), ["head", "12"])
        measured = {(point["id"], frame): xy for point in json.loads(self.path("t.json").read_text())["points"]
                    for frame, xy, visible in zip(point["frames"], point["xy"], point["visible"]) if visible}
        self.assertEqual({(point, frame) for point, name in ((11, "head"), (12, "12")) for frame in curves[name]},
                         set(measured))
        for (point, frame), position in measured.items():
            for got, wanted in zip(curves["head" if point == 11 else "12"][frame], position):
                self.assertAlmostEqual(got, wanted, delta=0.0006)

    def test_a_stream_goes_in_and_lines_come_out_while_it_runs(self):
        # JPEGs one after the other, as cameras send them; the input stays open until there are estimates.
        self.path("points.csv").write_text("id,x,y\n1,40.5,50.25\n", encoding="utf-8")
        client = subprocess.Popen(**{**self.command(
            "track", "-", f"--server={self.server.address}", f"--points={self.path('points.csv')}", "--out=-"),
            "stdin": subprocess.PIPE, "text": False})
        client.stdin.write(b"".join(jpegs(moving_picture(SENT))))
        client.stdin.flush()
        first = json.loads(client.stdout.readline())
        self.assertEqual((first["id"], first["frame"]), (1, 0))
        out, err = client.communicate(timeout=60)
        self.assertEqual(client.returncode, 0, err)
        lines = [first, *map(json.loads, out.splitlines())]
        self.assertEqual(lines[-1], {"complete": True, "frames": SENT, "final_frames": SENT, "expected_frames": SENT})
        final = [line["frame"] for line in lines[:-1] if line["final"]]
        self.assertEqual(final, list(range(SENT)))
        # A pipe may be a camera's: each line says when its frame was read.
        times = [line["capture_time"] for line in lines[:-1] if line["final"]]
        self.assertEqual(times, sorted(times))

    def pictures(self, name, frames):
        """A directory with these frames of a moving picture, in this order."""
        self.path(name).mkdir()
        for i, frame in enumerate(frames):
            self.path(name).joinpath(f"{i:03}.jpg").write_bytes(frame)
        return self.path(name)

    def track(self, input_path, points, *flags):
        """What the .json says of each point: {frame: [x, y]}, in the order of the points."""
        self.path("points.csv").write_text("id,x,y,frame\n" + points, encoding="utf-8")
        done = self.holdfast("track", str(input_path), f"--server={self.server.address}",
                             f"--points={self.path('points.csv')}", f"--out={self.path('t.json')}", *flags)
        self.assertEqual(done.returncode, 0, done.stderr)
        tracks = json.loads(self.path("t.json").read_text())
        self.assertTrue(tracks["complete"])
        return [dict(zip(point["frames"], point["xy"])) for point in tracks["points"]]

    def assert_same_tracks(self, got, wanted, delta=0.0021):
        self.assertEqual(sorted(got), sorted(wanted))
        for frame, position in wanted.items():
            for a, b in zip(got[frame], position):
                self.assertAlmostEqual(a, b, delta=delta, msg=f"frame {frame}")

    def test_a_camera_of_the_network_is_read_as_its_pictures_are(self):
        pictures = list(jpegs(moving_picture(FEW_FRAMES)))
        handler = type("Camera", (NetworkCamera,), {"pictures": pictures})
        camera = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self.addCleanup(camera.server_close)
        self.addCleanup(camera.shutdown)
        threading.Thread(target=camera.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{camera.server_address[1]}"
        followed = self.track(f"{address}/camera", "1,40.5,50.25,0\n")
        same = self.track(self.pictures("same", pictures), "1,40.5,50.25,0\n")
        self.assert_same_tracks(followed[0], same[0], delta=0.05)  # another decoder reads them
        missing = self.holdfast("track", f"{address}/no-camera", f"--server={self.server.address}", "--grid=2",
                                f"--out={self.path('none.json')}")
        self.assertEqual(missing.returncode, 1)
        self.assertIn(f"{address}/no-camera: is not a video that can be read: Server returned 404", missing.stderr)

    def test_both_follows_a_point_as_if_the_video_ran_backwards_from_its_query(self):
        frames = list(jpegs(moving_picture(40)))
        there = self.pictures("there", frames)
        back = self.pictures("back", frames[30::-1])
        points = "1,60,50,12\n2,40,30,30\n"
        early, late = self.track(there, points, "--both")
        after_early, after_late = self.track(there, points)
        before_late, before_early = self.track(back, "2,40,30,0\n1,60,50,18\n")
        for got, after, before, query in ((early, after_early, before_early, 12), (late, after_late, before_late, 30)):
            past = {30 - frame: position for frame, position in before.items() if 30 - frame < query}
            self.assert_same_tracks(got, {**after, **past})
            self.assertEqual(sorted(got), list(range(40)))
        self.assertGreater(late[30][0] - late[0][0], 25, "the texture moves a pixel a frame to the right")

    def test_chosen_frames_are_tracked_as_a_video_of_these_alone(self):
        frames = list(jpegs(moving_picture(40)))
        whole = self.pictures("whole", frames)
        numbers = sorted({*range(3, 40, 4), 9})
        few = self.pictures("few", [frames[number] for number in numbers])
        regular, on_its_own_frame = self.track(whole, "1,60,50,3\n2,40,30,9\n", "--start_frame=3", "--every=4")
        first, second = self.track(few, f"1,60,50,0\n2,40,30,{numbers.index(9)}\n")
        self.assert_same_tracks(regular, {numbers[i]: position for i, position in first.items()})
        self.assert_same_tracks(on_its_own_frame, {numbers[i]: position for i, position in second.items()})
        self.assertEqual(sorted(on_its_own_frame), [9, *range(11, 40, 4)])

    def test_a_mask_is_an_object_on_its_frame_of_the_input(self):
        mask = Image.new("L", (WIDTH, HEIGHT))
        mask.paste(255, (30, 30, 60, 60))
        mask.save(self.path("mask.png"))
        done = self.holdfast("track", str(self.pictures("frames", jpegs(moving_picture(40)))), "--start_frame=3",
                             "--every=2", "--query_frame=10", "--both", f"--server={self.server.address}",
                             f"--mask={self.path('mask.png')}", "--grid=12", f"--out={self.path('t.json')}",
                             f"--overlay={self.path('o.mp4')}")
        self.assertEqual(done.returncode, 0, done.stderr)
        tracks = json.loads(self.path("t.json").read_text())
        self.assertTrue(tracks["complete"])
        found, = tracks["objects"]
        self.assertEqual(found["frames"], [10, *range(11, 40, 2)], "the input's numbers, and its own frame besides")
        self.assertEqual(found["points"], [point["id"] for point in tracks["points"]])
        self.assertEqual(found["points"], list(range(1, 13)))
        # The texture moves a pixel a frame to the right, the object with it.
        self.assertAlmostEqual(found["xy"][0][0], 44.5, delta=0.6)
        moved = [b - a for a, b in zip(found["xy"][0], found["xy"][-1])]
        self.assertAlmostEqual(moved[0], 29, delta=3)
        self.assertAlmostEqual(moved[1], 0, delta=3)
        for point in tracks["points"]:
            self.assertEqual(point["frames"], sorted({10, *range(3, 40, 2)}), "a past, too")
            x, y = point["xy"][point["frames"].index(10)]
            self.assertTrue(30 <= x < 60 and 30 <= y < 60, f"on the mask: {x}, {y}")
        self.assertGreater(self.path("o.mp4").stat().st_size, 1000)

    def test_points_that_leave_the_mask_are_placed_anew_unless_told_otherwise(self):
        still = 84  # columns from here on stand still
        pictures = [Image.open(io.BytesIO(jpeg)) for jpeg in jpegs(moving_picture(40))]
        for picture in pictures[1:]:
            picture.paste(pictures[0].crop((still, 0, WIDTH, HEIGHT)), (still, 0))
        mask = Image.new("L", (WIDTH, HEIGHT))
        mask.paste(255, (6, 20, 92, 76))
        mask.save(self.path("mask.png"))
        files = [io.BytesIO() for _ in pictures]
        for file, picture in zip(files, pictures):
            picture.save(file, "JPEG", quality=95)
        command = ["track", str(self.pictures("frames", [file.getvalue() for file in files])),
                   f"--server={self.server.address}", f"--mask={self.path('mask.png')}", "--grid=30"]
        done = self.holdfast(*command, f"--out={self.path('t.json')}", f"--overlay={self.path('o.mp4')}")
        self.assertEqual(done.returncode, 0, done.stderr)
        tracks = json.loads(self.path("t.json").read_text())
        found, = tracks["objects"]
        joined = {point: number for number, points in zip(found["frames"], found["joined"]) for point in points}
        self.assertGreater(len(joined), 0)
        anew = len(joined)
        self.assertIn(f"{30 + anew} points, {anew} of them placed anew, final on all 40 frames", done.stderr)
        frames = {point["id"]: point["frames"] for point in tracks["points"]}
        for point, number in joined.items():
            self.assertEqual(frames[point][0], number - 1)
            self.assertEqual(frames[point - 256][-1], min(number + 14, 39), "with its window")
        done = self.holdfast(*command, "--reseed=false", f"--out={self.path('t.json')}")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(len(json.loads(self.path("t.json").read_text())["points"]), 30)

    def test_live_frames_that_come_too_fast_are_left_out_and_counted(self):
        self.path("points.csv").write_text("id,x,y\n1,40.5,50.25\n", encoding="utf-8")
        every = b"".join(jpegs(moving_picture(WHOLE))) * 6
        done = subprocess.run(**{**self.command(
            "track", "-", "--live", f"--server={self.server.address}", f"--points={self.path('points.csv')}",
            f"--out={self.path('t.json')}"), "text": False}, input=every, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        left_out = int(re.search(rb"\n(\d+) frames came faster than answers and were left out\n", done.stderr)[1])
        tracks = json.loads(self.path("t.json").read_text())
        self.assertGreater(left_out, 0)
        self.assertEqual(tracks["frames"] + left_out, 6 * WHOLE)
        self.assertEqual(tracks["points"][0]["frames"][-1], 6 * WHOLE - 1, "the newest frame is never left out")

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
            self.assertIn(f"'shape': (6, {FEW_FRAMES}, 2)", npy(archive.read("tracks.npy"))[0])
            self.assertEqual(npy(archive.read("complete.npy"))[1], b"\1")
            self.assertEqual(sorted(archive.namelist()),
                             ["complete.npy", "confidence.npy", "expected_frames.npy", "final_frames.npy", "fps.npy",
                              "frames.npy", "ids.npy", "names.npy", "query_frames.npy", "size.npy", "tracks.npy",
                              "visible.npy"])

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

    def whole_run(self):
        """The tracks of more frames than the runs that are broken off were given."""
        self.path("whole.y4m").write_bytes(moving_picture(WHOLE))
        done = self.holdfast("track", self.path("whole.y4m"), f"--server={self.server.address}", "--grid=9",
                             f"--out={self.path('whole.json')}")
        self.assertEqual(done.returncode, 0, done.stderr)
        tracks = json.loads(self.path("whole.json").read_text())
        self.assertTrue(tracks["complete"])
        self.assertEqual(tracks["final_frames"], WHOLE)
        return tracks

    def break_off(self, server, out, stop):
        """Feeds frames until the server has answered for many, keeps the input open and calls stop(client)."""
        pipe = self.path("endless.y4m")
        os.mkfifo(pipe)
        tracked, final = 'holdfast_frames_total{result="tracked"}', "holdfast_final_latency_seconds_count"
        tracked_before, final_before = server.metric(tracked), server.metric(final)
        client = subprocess.Popen(**self.command("track", pipe, f"--server={server.address}", "--grid=9",
                                                 "--reconnect_timeout=1s", f"--out={self.path(out)}",
                                                 f"--overlay={self.path('o.mp4')}"))
        with open(pipe, "wb", buffering=0) as stream:
            stream.write(moving_picture(SENT))
            server.wait_for_metric(tracked, tracked_before + SENT - 8)
            server.wait_for_metric(final, final_before + 16)
            stop(client)
            errors = client.communicate(timeout=120)[1]  # the input is still open
        match = re.search(r"kept in (\S+), (\S+): frames 0\.\.(\d+) of (\d+) \(0\.\.(\d+) are final\)", errors)
        self.assertIsNotNone(match, errors)
        self.assertEqual(match.groups()[:2], (str(self.path(out)), str(self.path("o.mp4"))))
        last, sent, last_final = map(int, match.groups()[2:])
        self.assertLess(last, sent)
        self.assertGreaterEqual(last_final, 7)
        self.assert_video_has(self.path("o.mp4"), last + 1)
        self.assertEqual([name for name in os.listdir(self.directory.name) if name[0] == "."], [])
        return client.returncode, errors, last + 1, last_final + 1

    def assert_video_has(self, video, frames):
        done = self.holdfast("track", video, f"--server={self.server.address}", "--grid=1",
                             f"--out={self.path('again.json')}")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(json.loads(self.path("again.json").read_text())["frames"], frames)

    def assert_final_as_in(self, whole, final_frames, position):
        """position(point index, frame): x and y of the run that was broken off."""
        for index, point in enumerate(whole["points"]):
            for frame in range(final_frames):
                for got, wanted in zip(position(index, frame), point["xy"][frame]):
                    self.assertAlmostEqual(got, wanted, delta=0.0011, msg=f"point {index}, frame {frame}")

    def test_the_death_of_the_server_keeps_what_came_and_says_what_is_missing(self):
        server = ServerProcess(self.server_program, *SMALL)
        self.addCleanup(server.stop)
        code, errors, frames, final = self.break_off(server, "t.json", lambda client: server.kill())
        self.assertEqual(code, 1)
        self.assertRegex(errors, f"holdfast: server at {server.address} is unavailable: .*the last frame sent is")
        tracks = json.loads(self.path("t.json").read_text())
        self.assertEqual((tracks["complete"], tracks["frames"], tracks["final_frames"]), (False, frames, final))
        for point in tracks["points"]:
            self.assertEqual(point["frames"], list(range(frames)))
        self.assert_final_as_in(self.whole_run(), final, lambda index, frame: tracks["points"][index]["xy"][frame])

    def test_an_interrupt_keeps_what_came_in_a_csv(self):
        code, errors, frames, final = self.break_off(self.server, "t.csv",
                                                     lambda client: client.send_signal(signal.SIGINT))
        self.assertEqual(code, 130)
        self.assertIn("holdfast: interrupted\n", errors)
        rows = list(csv.DictReader(io.StringIO(self.path("t.csv").read_text())))
        self.assertEqual(len(rows), 9 * frames)
        positions = [(float(row["x"]), float(row["y"])) for row in rows]
        self.assert_final_as_in(self.whole_run(), final, lambda index, frame: positions[index * frames + frame])

    def test_a_termination_keeps_what_came_in_an_npz(self):
        code, errors, frames, final = self.break_off(self.server, "t.npz", lambda client: client.terminate())
        self.assertEqual(code, 143)
        self.assertIn("holdfast: interrupted\n", errors)
        with zipfile.ZipFile(self.path("t.npz")) as archive:
            header, data = npy(archive.read("tracks.npy"))
            self.assertIn(f"'shape': (9, {frames}, 2)", header)
            self.assertEqual(npy(archive.read("complete.npy"))[1], b"\0")
            self.assertEqual(npy(archive.read("final_frames.npy"))[1], struct.pack("<q", final))
        xy = struct.unpack(f"<{9 * frames * 2}f", data)
        self.assert_final_as_in(self.whole_run(), final,
                                lambda index, frame: xy[2 * (index * frames + frame):][:2])

    def test_a_reader_that_goes_away_leaves_the_overlay(self):
        client = subprocess.Popen(**self.command("track", VIDEO, f"--server={self.server.address}", "--grid=4",
                                                 "--max_frames=40", "--out=-", f"--overlay={self.path('o.mp4')}"))
        client.stdout.readline()
        client.stdout.close()
        errors = client.stderr.read()
        client.stderr.close()
        self.assertEqual(client.wait(60), 1)
        self.assertIn("standard output takes no more lines", errors)
        self.assertEqual(os.listdir(self.directory.name), ["o.mp4"])

    def test_an_interrupt_before_a_session_ends_at_once(self):
        with socket.create_server(("127.0.0.1", 0)) as silent:
            client = subprocess.Popen(**self.command("info", "--server=127.0.0.1:%d" % silent.getsockname()[1],
                                                     "--connect_timeout=1h"))
            connection = silent.accept()[0]
            client.send_signal(signal.SIGINT)
            client.communicate(timeout=60)
            connection.close()
        self.assertEqual(client.returncode, 130)


if __name__ == "__main__":
    CliTest.server_program, CliTest.client_program = sys.argv[1:3]
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)
