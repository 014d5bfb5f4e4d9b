# SPDX-License-Identifier: Apache-2.0
"""The client for asyncio against real servers: the same arrays as the blocking one, and what only tasks can do."""
import asyncio
import threading
import time
import unittest
from unittest import mock

import numpy as np

import support
from support import FRAMES, PICTURES, POINTS

import holdfast_client
from holdfast_client import aio
from holdfast_client._frames import FrameCodec
from holdfast_client._proto import point_tracking_pb2 as pb


async def camera(pictures=PICTURES):
    for frame in pictures:
        await asyncio.sleep(0)
        yield frame


async def soon(condition, seconds=60):
    """Whether it comes true in time."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        await asyncio.sleep(0.02)
    return True


async def no_task_is_left():
    """Whether all tasks of sessions come to their end."""
    return await soon(lambda: not [task for task in asyncio.all_tasks()
                                   if task.get_coro().__qualname__.startswith("Session.")], 5)


class AioTest(support.ServedTest, unittest.IsolatedAsyncioTestCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        with holdfast_client.Client(cls.server.address) as client:
            cls.blocking = client.track(PICTURES, POINTS, encoding="raw")

    def client(self, *addresses, **options):
        client = aio.Client(list(addresses) or self.server.address, **options)
        self.addAsyncCleanup(client.close)
        return client

    async def idle(self):
        """Whether the server comes to have no session."""
        return await soon(lambda: self.server.metric("holdfast_sessions_active") == 0, 120)

    async def test_a_video_becomes_the_arrays_of_the_blocking_client(self):
        for frames in (PICTURES, camera()):
            tracks = await self.client().track(frames, POINTS, encoding="raw")
            self.assertEqual(tracks.xy.shape, (3, FRAMES, 2))
            np.testing.assert_array_equal(tracks.xy, self.blocking.xy)
            np.testing.assert_array_equal(tracks.visible, self.blocking.visible)
            self.assertTrue(tracks.final.all())

    async def test_updates_come_to_one_task_while_another_one_pushes(self):
        async with self.client().session(POINTS, every_frame=True, encoding="raw") as session:
            async def push():
                for frame in PICTURES:
                    await session.push(frame)
                await session.add({77: (40, 40)})
                await session.remove([0])
                return await session.finish()
            pushing = asyncio.create_task(push())
            updates = [update async for update in session]
            tracks = await pushing
        self.assertLess(updates[0].frames_received, FRAMES)
        self.assertEqual(updates[-1].frames_processed, FRAMES)
        self.assertEqual(list(tracks.ids), [0, 1, 2, 77])
        self.assertEqual(session.accepted.window_frames, 24)

    async def test_updates_that_nobody_takes_are_bounded(self):
        def answer(frame):
            run = pb.PointRun(id=1, first_frame=frame, x=[1], y=[2], visible=[True], confidence=[0.5])
            return pb.TrackResponse(tracks=pb.Tracks(runs=[run]))
        session = self.client().session(POINTS)
        for frame in range(1000):
            session._take(answer(frame))
        updates = session.__aiter__()
        first = await updates.__anext__()
        self.assertEqual(first.runs[0].first_frame, 1000 - 256)
        for frame in range(1000, 2000):
            session._take(answer(frame))
        for frame in range(first.runs[0].first_frame + 1, 2000):
            self.assertEqual((await updates.__anext__()).runs[0].first_frame, frame)
        for frame in range(2000, 7000):
            session._take(answer(frame))
        self.assertEqual((await updates.__anext__()).runs[0].first_frame, 7000 - 4096)
        self.assertEqual(session.tracks().frames, 7000)
        await updates.aclose()
        session._take(answer(7000))
        self.assertEqual([update.runs[0].first_frame for update in session.updates()], list(range(7001 - 256, 7001)))

    async def test_a_session_without_points_says_how_far_it_is(self):
        async with self.client().session(encoding="raw") as session:
            updates = session.__aiter__()
            for i, frame in enumerate(PICTURES[:6]):
                await session.push(frame)
                update = await asyncio.wait_for(updates.__anext__(), 30)
                while update.frames_processed <= i:
                    update = await asyncio.wait_for(updates.__anext__(), 30)
                self.assertEqual((update.frames_processed, update.runs), (i + 1, ()))
        self.assertEqual(session.tracks().xy.shape, (0, 0, 2))

    async def test_an_object_is_followed_as_a_group(self):
        polygon, objects = {5: [(20, 30), (60, 30), (60, 70), (20, 70)]}, []
        async with self.client().session(object_points=12, encoding="raw") as session:
            async def push():
                for i, frame in enumerate(PICTURES):
                    await session.push(frame, objects=polygon if i == 4 else None)
                return await session.finish()
            pushing = asyncio.create_task(push())
            async for update in session:
                objects += update.objects
            tracks = await pushing
        self.assertEqual({run.id for run in objects}, {5})
        self.assertEqual(len(tracks.object_points(5)), 12)
        np.testing.assert_allclose(tracks.objects[5].centre[[4, 24]], [[40, 50], [60, 50]], atol=1.5)

    async def test_many_sessions_share_a_client(self):
        client = self.client()
        results = await asyncio.gather(*(client.track(camera(), POINTS, encoding="raw") for _ in range(3)))
        for tracks in results:
            self.assert_same(tracks, self.blocking)

    async def test_a_killed_server_changes_nothing(self):
        first, second = self.start_server(), self.start_server()
        self.addCleanup(first.stop)
        self.addCleanup(second.stop)
        async with self.client(first.address, second.address).session(POINTS, encoding="raw") as session:
            resumed, lost = [], []
            session.on_resumed, session.on_reconnecting = resumed.append, lost.append
            for i, frame in enumerate(PICTURES):
                await session.push(frame)
                if i == 36:
                    first.kill()
            tracks = await session.finish()
        self.assertEqual(resumed, [second.address])
        self.assertIsInstance(lost[0], holdfast_client.Unavailable)
        self.assert_same(tracks, self.blocking)

    async def test_without_reconnect_a_lost_server_ends_the_session_and_keeps_what_came(self):
        server = self.start_server()
        self.addCleanup(server.stop)
        session = self.client(server.address, reconnect=None).session(POINTS, encoding="raw")
        with self.assertRaises(holdfast_client.Unavailable):
            for frame in PICTURES * 100:
                await session.push(frame)
                if session.updates():
                    server.kill()
        self.assertGreater(session.tracks().frames, 0)
        with self.assertRaises(holdfast_client.Unavailable):
            async for _ in session:
                pass

    async def test_a_server_that_takes_its_session_along_says_so_before(self):
        server = self.start_server("--grace_period=1s")
        self.addCleanup(server.stop)
        session = self.client(server.address, reconnect=None).session(POINTS, encoding="raw")
        await session.push(PICTURES[0])
        self.assertTrue(await soon(lambda: session.accepted is not None))
        with self.assertWarnsRegex(holdfast_client.HoldfastWarning, f"{server.address}: session .* goes away"):
            server.process.terminate()
            with self.assertRaises(holdfast_client.Unavailable):
                async for _ in session:
                    pass

    async def test_a_cancelled_task_cancels_its_call(self):
        client, begun = self.client(), asyncio.Event()

        async def endless():
            while True:
                for frame in PICTURES:
                    yield frame
                begun.set()
        task = asyncio.create_task(client.track(endless(), POINTS, encoding="raw"))
        await asyncio.wait_for(begun.wait(), 60)
        self.assertEqual(self.server.metric("holdfast_sessions_active"), 1)
        cancelled = 'holdfast_sessions_total{outcome="cancelled"}'
        before = self.server.metric(cancelled)
        task.cancel()
        with self.assertRaises(asyncio.CancelledError):
            await task
        self.assertTrue(await self.idle())
        self.assertEqual(self.server.metric(cancelled), before + 1)
        self.assert_same(await client.track(PICTURES, POINTS, encoding="raw"), self.blocking)

    async def test_a_task_that_is_cancelled_while_it_finishes_cancels_its_call(self):
        async def follow():
            async with self.client().session(POINTS, encoding="raw") as session:
                for frame in PICTURES:
                    await session.push(frame)
                finishing.set()
        finishing = asyncio.Event()
        task = asyncio.create_task(follow())
        await asyncio.wait_for(finishing.wait(), 60)
        with support.frozen(self.server):  # it cannot finish before it is cancelled
            await asyncio.sleep(0.1)
            task.cancel()
            with self.assertRaises(asyncio.CancelledError):
                await asyncio.wait_for(task, 60)
            self.assertTrue(await no_task_is_left())
        self.assertTrue(await self.idle())

    async def test_sessions_leave_no_task_behind(self):
        await self.client().track(PICTURES, POINTS, encoding="raw")
        session = self.client().session(POINTS, encoding="raw")
        await session.push(PICTURES[0])
        await session.cancel()
        with self.assertRaisesRegex(ValueError, "has ended"):
            await session.push(PICTURES[1])
        self.assertTrue(await no_task_is_left())

    async def test_a_server_that_stands_still_slows_its_client(self):
        server = self.start_server()
        self.addCleanup(server.stop)
        session = self.client(server.address).session(POINTS, encoding="raw")
        await session.push(PICTURES[0])
        self.assertTrue(await soon(lambda: session.accepted is not None))

        async def push():
            while True:
                await session.push(PICTURES[0])
        with support.frozen(server):
            pushing, sent = asyncio.create_task(push()), -1
            while sent < session._frames < 20000:
                sent = session._frames
                await asyncio.sleep(1)
            self.assertLess(session._frames, 2000)  # of 12 kB: what gRPC's windows take
            pushing.cancel()
            with self.assertRaises(asyncio.CancelledError):
                await pushing
            await session.cancel()

    async def test_frames_are_encoded_beside_the_loop(self):
        threads, data = set(), FrameCodec.data

        def note(codec, frame):
            threads.add(threading.current_thread())
            return data(codec, frame)
        with mock.patch.object(FrameCodec, "data", note):
            await self.client().track(PICTURES[:4], POINTS)
        self.assertTrue(threads)
        self.assertNotIn(threading.main_thread(), threads)

    async def test_errors_say_what_was_wrong(self):
        with self.assertRaises(holdfast_client.InvalidRequest) as caught:
            await self.client().track(PICTURES, {1: (1000, 1000)}, encoding="raw")
        self.assertIn("points", caught.exception.violations[0].field)
        with self.assertRaises(holdfast_client.Unavailable):
            await self.client("127.0.0.1:1", timeout=5).info()
        self.assertEqual((await self.client("127.0.0.1:1", self.server.address, timeout=5).info()).window_frames, 24)

        async def failing():
            yield PICTURES[0]
            raise KeyError("mine")
        with self.assertRaisesRegex(KeyError, "mine"):
            await self.client().track(failing(), POINTS, encoding="raw")

    async def test_a_server_that_does_not_answer_is_late(self):
        client = self.client(timeout=3)
        await client.info()  # there is a connection
        with support.frozen(self.server):
            with self.assertRaisesRegex(holdfast_client.Unavailable, "no answer within 3 s"):
                await client.track(PICTURES, POINTS, encoding="raw")
        self.assertTrue(await self.idle())


class NoLoopTest(unittest.TestCase):
    def test_a_client_belongs_to_a_loop(self):
        with self.assertRaisesRegex(RuntimeError, "no running event loop"):
            aio.Client("localhost:1")


if __name__ == "__main__":
    support.main()
