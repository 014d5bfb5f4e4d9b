# SPDX-License-Identifier: Apache-2.0
"""The blocking client against real servers."""
import contextlib
import os
import signal
import struct
import subprocess
import sys
import threading
import unittest
import unittest.mock
from datetime import datetime, timedelta, timezone

import numpy as np

import support
from support import FRAMES, PICTURES, POINTS

import holdfast_client
from holdfast_client._frames import size_of
from holdfast_client._picture import _png


# Says when its session stands and, once it has read a line, when it waits for the end.
WAITING = """
import sys
import numpy as np
from holdfast_client import Client

with Client(sys.argv[1]) as client, client.session([(8, 8)], encoding="raw") as session:
    while session.accepted is None:
        session.push(np.zeros((96, 128), np.uint8))
    print("accepted", flush=True)
    sys.stdin.readline()
    print("finishing", flush=True)
    session.finish()
"""


class ClientTest(support.ServedTest, unittest.TestCase):
    def client(self, *addresses, **options):
        client = holdfast_client.Client(list(addresses) or self.server.address, **options)
        self.addCleanup(client.close)
        return client

    def uninterrupted(self):
        return self.client().track(PICTURES, POINTS, encoding="raw")

    def test_a_video_becomes_arrays(self):
        tracks = self.uninterrupted()
        self.assertEqual(tracks.xy.shape, (3, FRAMES, 2))
        self.assertEqual(tracks.xy.dtype, np.float32)
        self.assertEqual(list(tracks.ids), [0, 1, 2])
        self.assertTrue(tracks.final.all())
        np.testing.assert_allclose(tracks.xy[:, 0], POINTS, atol=1e-3)
        np.testing.assert_allclose(tracks.of(1)[20], POINTS[1] + [20, 0], atol=1.5)

    def test_points_that_come_later_have_no_past(self):
        tracks = self.client().track(PICTURES, np.array([[0, 40, 50], [10, 70, 30]], np.float32), encoding="raw")
        self.assertTrue(np.isnan(tracks.xy[1, :10]).all())
        self.assertFalse(np.isnan(tracks.xy[1, 10:]).any())
        with self.assertRaisesRegex(ValueError, "points of frame 99"):
            self.client().track(PICTURES[:3], np.array([[99, 40, 50]], np.float32), encoding="raw")

    def test_positions_without_ids_are_new_points(self):
        with self.client().session(POINTS[:2], encoding="raw") as session:
            session.add([(20, 20)])
            for i, frame in enumerate(PICTURES[:8]):
                session.push(frame, points={1: (50, 50), 7: (90, 60)} if i == 2 else POINTS[2:] if i == 4 else ())
            session.add(np.array([(30, 30), (35, 30)]))
            tracks = session.finish()
        self.assertEqual(list(tracks.ids), [0, 1, 2, 7, 8, 9, 10])
        np.testing.assert_allclose(tracks.of(0)[:8], POINTS[0] + [[i, 0] for i in range(8)], atol=1.5)
        np.testing.assert_allclose(tracks.of(1)[2], [50, 50], atol=1e-3)  # anew, by its id
        np.testing.assert_allclose(tracks.of(8)[4], POINTS[2], atol=1e-3)
        np.testing.assert_allclose(tracks.of(10)[7], [35, 30], atol=1e-3)

    def test_live_updates_come_while_frames_are_pushed(self):
        updates = []
        with self.client().session(POINTS, hop=(4, 12), every_frame=True, encoding="raw") as session:
            for frame in PICTURES:
                updates += session.push(frame) or session.updates(timeout=30)
            self.assertEqual(session.accepted.hop_frames, 4, "there is time for it")
            session.add({77: (40, 40)})
            session.remove([0])
            session.finish()
            self.assertTrue(updates)
            self.assertLess(updates[0].frames_received, FRAMES)
        self.assertIn(77, session.tracks().ids)

    def test_upright_frames_are_processed_upright(self):
        upright = np.zeros((support.WIDTH, support.HEIGHT), np.uint8)
        for first, encoding, size, expected in ((upright, "jpeg", None, (96, 128)), (upright, "raw", None, (96, 128)),
                                                (upright.T, "jpeg", None, (128, 96)),
                                                (_png(upright), "auto", None, (96, 128)),
                                                (upright, "jpeg", (128, 64), (128, 64))):
            with self.subTest(shape=getattr(first, "shape", "PNG"), encoding=encoding, size=size):
                with self.client().session(encoding=encoding, size=size) as session:
                    session.push(first)
                    session.updates(timeout=30)
                    processed = session.accepted.processing_size
                    self.assertEqual((processed.width, processed.height), expected)
                    session.cancel()

    def test_files_say_their_size(self):
        jpeg = b"\xff\xd8\xff\xe0" + struct.pack(">H", 2) + b"\xff\xff\xff\xc0" + struct.pack(">HBHH", 11, 8, 480, 854)
        scan = b"\xff\xd8\xff\xda" + struct.pack(">H", 2) + b"\xff\xc0" + struct.pack(">HBHH", 11, 8, 480, 854)
        for file, size in ((jpeg, (854, 480)), (jpeg.replace(b"\x03\x56", b"\0\0"), None), (scan, None),
                           (jpeg[:-3], None), (b"\xff\xd8" + bytes(20), None), (_png(PICTURES[0]), (128, 96)),
                           (_png(PICTURES[0])[:20], None)):
            self.assertEqual(size_of(file), size, file[:24])

    def test_a_session_without_points_says_how_far_it_is(self):
        with self.client().session(encoding="raw") as session:
            for i, frame in enumerate(PICTURES[:6]):
                updates = session.push(frame)
                while not updates or updates[-1].frames_processed <= i:
                    news = session.updates(timeout=30)
                    self.assertTrue(news, f"frame {i}")
                    updates += news
                self.assertFalse(any(update.runs for update in updates))
            session.finish()
        self.assertEqual(session.tracks().xy.shape, (0, 0, 2))

    def test_the_time_of_a_picture_comes_back_with_its_results(self):
        at = {i: datetime(2024, 5, 6, 7, 8, i, tzinfo=timezone(timedelta(hours=2))) for i in range(4)}
        updates = []
        with self.client().session(POINTS, every_frame=True, encoding="raw") as session:
            for i, frame in enumerate(PICTURES[:8]):
                updates += session.push(frame, capture_time=at.get(i))
            tracks = session.finish()
            updates += session.updates()
        self.assertEqual({frame: time for update in updates for frame, time in update.capture_times.items()}, at)
        self.assertEqual(tracks.capture_times, at)
        self.assertTrue(tracks.complete)
        self.assertEqual(tracks.sent, 8)

    def test_a_killed_server_changes_nothing(self):
        first, second = self.start_server(), self.start_server()
        self.addCleanup(first.stop)
        self.addCleanup(second.stop)
        with self.client(first.address, second.address).session(POINTS, encoding="raw") as session:
            resumed = []
            session.on_resumed = resumed.append
            for i, frame in enumerate(PICTURES):
                session.push(frame)
                if i == 36:
                    first.kill()
            tracks = session.finish()
        self.assertEqual(resumed, [second.address])
        self.assert_same(tracks, self.uninterrupted())

    def lose_a_server(self, name, callback):
        """Pushes frames until the session has ended, whose first server is lost meanwhile. The session, and what ended
        it."""
        first, second = self.start_server(), self.start_server()
        self.addCleanup(first.stop)
        self.addCleanup(second.stop)
        session = self.client(first.address, second.address).session(POINTS, encoding="raw")
        setattr(session, name, lambda _: callback(session))
        while session.accepted is None:
            session.push(PICTURES[0])
        first.kill()
        with self.assertRaises((ValueError, RuntimeError)) as caught:
            while True:
                session.push(PICTURES[0])
        return session, str(caught.exception)

    def test_a_callback_may_cancel_its_session(self):
        for name in ("on_reconnecting", "on_resumed"):
            with self.subTest(callback=name):
                returned = threading.Event()

                def cancel(session, returned=returned):
                    session.cancel()
                    returned.set()
                session, error = self.lose_a_server(name, cancel)
                self.assertTrue(returned.wait(10))
                self.assertRegex(error, "has ended")
                session.cancel()  # the thread comes to its end

    def test_a_callback_that_would_wait_for_itself_is_told_so(self):
        _, error = self.lose_a_server("on_resumed", lambda session: session.finish())
        self.assertRegex(error, r"finish\(\) waits for the thread that calls on_reconnecting")

    def test_an_object_is_followed_as_a_group(self):
        mask = np.zeros((support.HEIGHT, support.WIDTH), bool)
        mask[30:70, 20:60] = True
        polygon = [(80, 20), (110, 20), (110, 50), (80, 50)]
        with self.client().session(POINTS, objects={5: mask}, object_points=12, encoding="raw") as session:
            updates = []
            for i, frame in enumerate(PICTURES):
                updates += session.push(frame, objects={9: polygon} if i == 4 else {})
            tracks = session.finish()
            updates += session.updates()
        np.testing.assert_allclose(tracks.xy[:3], self.uninterrupted().xy, atol=1e-3)
        self.assertEqual(list(tracks.object_points(5)), [(1 << 63) + (5 << 32) + i for i in range(12)])
        self.assertEqual(sorted(tracks.objects), [5, 9])
        track, later = tracks.objects[5], tracks.objects[9]
        np.testing.assert_allclose(track.centre[0], [39.5, 49.5], atol=1e-3)
        np.testing.assert_allclose(track.centre[20], [59.5, 49.5], atol=1.5)
        self.assertEqual(track.outline[0].shape, (4, 2))
        self.assertTrue(track.final.all())
        self.assertTrue(np.isnan(later.centre[:4]).all())
        self.assertIsNone(later.outline[3])
        np.testing.assert_allclose(later.centre[4], [95, 35], atol=1e-3)
        self.assertEqual({run.id for update in updates for run in update.objects}, {5, 9})

    def test_a_killed_server_changes_nothing_about_objects(self):
        polygon = {1: [(30, 30), (90, 30), (90, 70), (30, 70)]}
        expected = self.client().track(PICTURES, [], objects=polygon, object_points=9, encoding="raw")
        first, second = self.start_server(), self.start_server()
        self.addCleanup(first.stop)
        self.addCleanup(second.stop)
        with self.client(first.address, second.address).session(objects=polygon, object_points=9,
                                                                encoding="raw") as session:
            for i, frame in enumerate(PICTURES):
                session.push(frame)
                if i == 36:
                    first.kill()
            tracks = session.finish()
        self.assert_same(tracks, expected)
        self.assertTrue(tracks.objects[1].final.all())
        np.testing.assert_allclose(tracks.objects[1].centre, expected.objects[1].centre, atol=1e-3)
        self.assertEqual(tracks.objects[1].left, expected.objects[1].left)

    def test_what_cannot_be_sent_is_named_before_it_is_sent(self):
        client, mask = self.client(), np.ones((4, 4), bool)
        for options, said in (
                ({"objects": {3: np.zeros((4, 4))}}, "object 3 is float64.*expected a mask"),
                ({"objects": {3: [(1, 2), (3,)]}}, "object 3 is .*expected a mask"),
                ({"objects": mask}, "objects are a ndarray, expected .* by id"),
                ({"objects": {-1: mask}}, "id is -1, expected 0"), ({"objects": {"car": mask}}, "id is 'car'"),
                ({"points": {-1: (1, 2)}}, "point -1 is .*expected an id"), ({"points": {4: (1, 2, 3)}}, "point 4 is"),
                ({"points": [(1, 2), (3,)]}, "points are .*expected x and y"), ({"points": None}, "points are None"),
                ({"object_points": -1}, "object_points is -1"), ({"hop": 8.5}, "hop is 8.5, expected a whole number"),
                ({"size": 256}, r"size is 256, expected \(width, height\)"),
                ({"size": (8.5, 4)}, "size's width is 8.5")):
            with self.subTest(options=options), self.assertRaisesRegex((ValueError, TypeError), said):
                client.session(**options)
        for frame in ("video.mp4", None, [[1, 2]], np.zeros((0, 4), np.uint8)):
            with self.subTest(frame=frame), self.assertRaisesRegex((ValueError, TypeError), "a frame is .*expected"):
                client.session().push(frame)
        for time, said in (("now", "capture_time is 'now', expected a datetime"),
                           (datetime(2024, 5, 6), r"capture_time is datetime.datetime\(2024.*expected .* time zone")):
            with self.subTest(time=time), self.assertRaisesRegex((ValueError, TypeError), said):
                client.session(encoding="raw").push(PICTURES[0], capture_time=time)
        for client_options, said in (({"reconnect": True}, "reconnect is True, expected a Reconnect"),
                                     ({"token": "secret\n"}, "token has a line break")):
            with self.subTest(options=client_options), self.assertRaisesRegex((ValueError, TypeError), said):
                holdfast_client.Client(**client_options)
        for address in ("localhost", "http://localhost:50051", []):
            with self.subTest(address=address), self.assertRaisesRegex(ValueError, "expected host:port"):
                holdfast_client.Client(address)

    def test_without_reconnect_a_lost_server_ends_the_session_and_keeps_what_came(self):
        server = self.start_server()
        self.addCleanup(server.stop)
        session = self.client(server.address, reconnect=None).session(POINTS, encoding="raw")
        with self.assertRaises(holdfast_client.Unavailable):
            for frame in PICTURES * 100:
                if session.push(frame):  # there are results
                    server.kill()
        self.assertGreater(session.tracks().frames, 0)

    def test_a_server_that_takes_its_session_along_says_so_before(self):
        server = self.start_server("--grace_period=1s")
        self.addCleanup(server.stop)
        session = self.client(server.address, reconnect=None).session(POINTS, encoding="raw")
        session.push(PICTURES[0])
        while session.accepted is None:
            session.updates(timeout=0.1)
        with self.assertWarnsRegex(holdfast_client.HoldfastWarning, f"{server.address}: session .* goes away"):
            server.process.terminate()
            with self.assertRaises(holdfast_client.Unavailable):
                while True:
                    session.updates(timeout=60)

    def test_errors_say_what_was_wrong(self):
        with self.assertRaises(holdfast_client.InvalidRequest) as caught:
            self.client().track(PICTURES, {1: (1000, 1000)}, encoding="raw")
        self.assertIn("points", caught.exception.violations[0].field)
        self.assertIn(self.server.address, str(caught.exception))
        with self.assertRaises(holdfast_client.Unavailable):
            self.client("127.0.0.1:1", timeout=5).info()
        for wrong in (PICTURES[0].astype(float), PICTURES[0][None], b"GIF89a"):
            with self.assertRaises(ValueError):
                self.client().track([wrong], POINTS)

    def test_a_fork_cannot_use_its_parents_client(self):
        client = self.client()
        session = client.session(POINTS, encoding="raw")
        self.addCleanup(session.cancel)
        session.push(PICTURES[0])
        with unittest.mock.patch("os.getpid", return_value=os.getpid() + 1):
            for use in (lambda: client.track(PICTURES, POINTS), lambda: session.push(PICTURES[1]), client.info):
                with self.assertRaisesRegex(RuntimeError, f"belongs to process {os.getpid() - 1}, .* spawn"):
                    use()

    def test_an_error_of_the_callers_own_is_the_callers_own(self):
        def frames():
            yield from PICTURES[:5]
            raise KeyError("mine")
        with self.assertRaisesRegex(KeyError, "mine"):
            self.client().track(frames(), POINTS, encoding="raw")

    def test_a_server_that_stands_still_slows_its_client(self):
        server = self.start_server()
        session = self.client(server.address).session(POINTS, encoding="raw")
        self.addCleanup(server.kill)
        session.push(PICTURES[0])
        while session.accepted is None:
            session.push(PICTURES[0])
        os.kill(server.process.pid, signal.SIGSTOP)
        ended = threading.Event()

        def push():
            with contextlib.suppress(ValueError):  # it is cancelled
                while True:
                    session.push(PICTURES[0])
            ended.set()
        thread = threading.Thread(target=push, daemon=True)
        thread.start()
        self.assertFalse(ended.wait(3))
        sent = session._frames
        self.assertLess(sent, 2000)  # of 12 kB: what gRPC's windows take
        self.assertFalse(ended.wait(1))
        self.assertEqual(session._frames, sent)
        os.kill(server.process.pid, signal.SIGCONT)
        session.cancel()
        self.assertTrue(ended.wait(60))
        server.stop()

    def test_a_server_that_stands_still_costs_its_client_no_memory(self):
        server = self.start_server()
        self.addCleanup(server.stop)
        session = self.client(server.address).session(POINTS, encoding="raw")
        session.push(np.zeros((480, 640), np.uint8))
        while session.accepted is None:
            session.push(np.zeros((480, 640), np.uint8))
        ended = threading.Event()

        def push():
            with contextlib.suppress(ValueError):  # it is cancelled
                while True:
                    session.push(np.full((480, 640), session._frames % 256, np.uint8))
            ended.set()
        with support.frozen(server):
            before = support.resident_bytes()
            threading.Thread(target=push, daemon=True).start()
            sent = -1
            while sent < session._frames < 1000:  # 300 MB
                sent = session._frames
                self.assertFalse(ended.wait(1))
            self.assertLess(session._frames, 200)
            self.assertLess(support.resident_bytes() - before, 64 << 20)
            session.cancel()
        self.assertTrue(ended.wait(60))

    def test_a_distant_server_is_reached(self):
        client = self.client(reconnect=None)
        with support.frozen(self.server):
            awake = threading.Timer(0.5, os.kill, (self.server.process.pid, signal.SIGCONT))
            awake.start()
            self.assertTrue(client.info().build)
            awake.join()

    def test_a_server_of_this_machine_is_reached_without_a_proxy(self):
        with unittest.mock.patch.dict(os.environ, {"http_proxy": "http://127.0.0.1:1"}):
            self.assertTrue(self.client(reconnect=None, timeout=10).info().build)

    def test_ctrl_c_ends_a_program_that_waits_for_its_tracks(self):
        server = self.start_server()
        self.addCleanup(server.stop)
        program = subprocess.Popen([sys.executable, "-c", WAITING, server.address], text=True,
                                   stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   env={**os.environ, "PYTHONPATH": str(support.STAGED)})
        self.assertEqual(program.stdout.readline(), "accepted\n")
        with support.frozen(server):
            program.stdin.write("go on\n")
            program.stdin.flush()
            self.assertEqual(program.stdout.readline(), "finishing\n")
            os.kill(program.pid, signal.SIGINT)
            _, err = program.communicate(timeout=10)
        self.assertIn("KeyboardInterrupt", err)
        server.wait_for_metric('holdfast_sessions_total{outcome="cancelled"}', 1)

    def test_arrays_are_sent_as_jpeg_where_that_is_possible(self):
        colour = [np.stack([frame] * 3, axis=2) for frame in PICTURES]
        tracks = self.client().track(colour, POINTS)
        difference = np.abs(tracks.xy - self.uninterrupted().xy)
        self.assertGreater(difference.max(), 0)  # they were
        self.assertLess(np.median(difference), 0.3)


if __name__ == "__main__":
    support.main()
