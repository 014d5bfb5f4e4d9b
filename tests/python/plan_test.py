# SPDX-License-Identifier: Apache-2.0
"""Where a session turns to, by a clock that the test moves; no server takes part."""
import types
import unittest

import grpc

import support
from holdfast_client import HoldfastError, NotResumable, Overloaded, Reconnect, Unavailable
from holdfast_client._plan import CallFailed, Route, judge
from holdfast_client._queries import Queries

CODE = grpc.StatusCode
LOST = CallFailed(Unavailable(CODE.UNAVAILABLE, "gone"), lost=True)
FULL = CallFailed(Overloaded(CODE.RESOURCE_EXHAUSTED, "full"))
OTHER_KEYS = CallFailed(NotResumable(CODE.FAILED_PRECONDITION, "other keys"))


class RouteTest(unittest.TestCase):
    def setUp(self):
        self.now = 0.0
        self.state = types.SimpleNamespace(keeps=True, token=b"t", resumable=True, processed=0)

    def route(self, servers=3, seconds=10.0, timeout=5.0):
        return Route(self.state, servers, timeout, Reconnect(seconds=seconds), lambda: self.now)

    def lose(self, route):
        """The first server takes the session and is lost."""
        first = route.first()
        self.assertFalse(route.accepted())
        return route.after(first, LOST)

    def test_each_server_is_asked_once_to_begin(self):
        route = self.route()
        attempt = route.first()
        for failed, server in ((LOST, 1), (FULL, 2)):
            attempt = route.after(attempt, failed)
            self.assertEqual((attempt.server, attempt.pause), (server, 0.0))
        with self.assertRaises(NotResumable):
            route.after(attempt, OTHER_KEYS)

    def test_a_request_that_is_wrong_is_wrong_everywhere(self):
        route = self.route()
        with self.assertRaises(HoldfastError):
            route.after(route.first(), CallFailed(HoldfastError(CODE.INVALID_ARGUMENT, "no")))

    def test_the_lost_server_is_asked_last_and_pauses_grow(self):
        route, servers, pauses = self.route(seconds=100), [], []
        attempt = self.lose(route)
        for _ in range(12):
            servers.append(attempt.server)
            pauses.append(attempt.pause)
            self.assertFalse(route.following)
            attempt = route.after(attempt, LOST)
        self.assertEqual(servers, [1, 2, 0] * 4)
        self.assertLess(pauses[0], 0.13)
        self.assertGreater(pauses[-1], 3.9)
        self.assertLess(max(pauses), 6.1)
        self.assertTrue(route.accepted())
        self.assertTrue(route.following)

    def test_a_session_that_only_its_own_server_can_resume_goes_there_first(self):
        self.state.resumable = False
        self.assertEqual(self.lose(self.route()).server, 0)

    def test_servers_that_refuse_are_not_asked_again(self):
        route = self.route()
        attempt = self.lose(route)
        attempt = route.after(attempt, OTHER_KEYS)
        self.assertEqual(attempt.server, 2)
        attempt = route.after(attempt, OTHER_KEYS)
        attempt = route.after(attempt, LOST)
        self.assertEqual(attempt.server, 0)
        with self.assertRaises(NotResumable):
            route.after(attempt, OTHER_KEYS)

    def test_a_full_server_says_when_to_come_again(self):
        route = self.route()
        attempt = self.lose(route)
        full = Overloaded(CODE.RESOURCE_EXHAUSTED, "full")
        full.retry_after = 2.5
        self.assertEqual(route.after(attempt, CallFailed(full)).pause, 2.5)
        with self.assertRaises(Overloaded):  # it never will have room
            route.after(attempt, FULL)

    def test_the_search_ends_with_its_time(self):
        route = self.route(seconds=10, timeout=5)
        attempt = self.lose(route)
        self.assertEqual(attempt.timeout, 5)
        self.now = 7.0
        attempt = route.after(attempt, LOST)
        self.assertLess(attempt.timeout, 3)
        self.now = 10.0
        with self.assertRaises(Unavailable):
            route.after(attempt, LOST)

    def lose_again(self, route, attempt, after):
        """A server takes the session and is lost so many seconds later."""
        self.now += attempt.pause
        self.assertTrue(route.accepted())
        self.now += after
        return route.after(attempt, LOST)

    def test_a_session_that_kills_every_server_ends(self):
        route = self.route(seconds=10)
        attempt = self.lose(route)
        with self.assertRaises(Unavailable):
            for _ in range(1000):
                attempt = self.lose_again(route, attempt, after=0.1)
        self.assertLess(self.now, 11)

    def test_progress_or_a_long_time_gives_a_session_all_its_time_again(self):
        for after, frames in ((0.1, 1), (10.1, 0)):
            route = self.route(seconds=10)
            attempt = self.lose(route)
            for _ in range(100):
                self.state.processed += frames
                attempt = self.lose_again(route, attempt, after)
                self.assertLess(attempt.pause, 0.13)

    def test_a_large_checkpoint_has_time_to_go_up(self):
        self.state.token = bytes(640 << 10)
        self.assertEqual(self.lose(self.route(seconds=60, timeout=5)).timeout, 15)

    def test_a_session_that_keeps_nothing_ends_with_its_server(self):
        self.state.keeps = False
        with self.assertRaises(Unavailable):
            self.lose(self.route())


class JudgeTest(unittest.TestCase):
    def call(self, code, trailers=()):
        return types.SimpleNamespace(code=lambda: code, details=lambda: "text", trailing_metadata=lambda: trailers)

    def test_an_error_without_details_was_made_on_the_way(self):
        details = (("grpc-status-details-bin", b""),)
        for code, trailers, lost in ((CODE.UNAVAILABLE, details, True), (CODE.INTERNAL, (), True),
                                     (CODE.INTERNAL, details, False), (CODE.INVALID_ARGUMENT, (), False),
                                     (CODE.DEADLINE_EXCEEDED, details, False)):
            with self.subTest(code=code, trailers=trailers):
                self.assertEqual(judge(self.call(code, trailers), "a:1", accepted=True).lost, lost)

    def test_a_server_that_is_too_slow_to_begin_is_lost(self):
        self.assertTrue(judge(self.call(CODE.DEADLINE_EXCEEDED), "a:1", accepted=False).lost)


class QueriesTest(unittest.TestCase):
    def test_points_come_with_frames_or_without(self):
        for points in ([(1, 2), (3, 4)], {0: (1, 2), 1: (3, 4)}, [(0, 1, 2), (0, 3, 4)]):
            self.assertEqual(Queries(points).at(0), {0: (1, 2), 1: (3, 4)})
        queries = Queries({7: (1, 2), 9: (5, 3, 4)})
        self.assertEqual((queries.at(0), queries.at(5), queries.last), ({7: (1, 2)}, {9: (3, 4)}, 5))
        self.assertEqual(Queries(support.POINTS).at(0)[1], (80, 30))

    def test_wrong_ones_are_named(self):
        for points, said in (([(1,)], "expected x, y"), ([(-1, 2, 3)], "frame -1"), ([(0.5, 2, 3)], "frame 0.5")):
            with self.assertRaisesRegex(ValueError, said):
                Queries(points)


if __name__ == "__main__":
    support.main()
