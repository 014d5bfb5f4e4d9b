# SPDX-License-Identifier: Apache-2.0
"""Two servers behind a real HAProxy and a real nginx, as deploy/ configures them, and a client that verifies TLS.

Usage: proxy_test.py HOLDFAST_SERVER PROTOC HOLDFAST
"""
import json
import os
import pathlib
import secrets
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from concurrent.futures import ThreadPoolExecutor

import grpc

from fake_server import FakeServer
from proxy_process import Haproxy, Nginx
from tools import DEPLOY, SOURCE

sys.path.insert(0, str(SOURCE / "tests" / "e2e"))
from certificates import Authority  # noqa: E402
from protocol import generate  # noqa: E402
from server_process import VIDEO, ServerProcess  # noqa: E402
from track_client import HEIGHT, WIDTH, Client, FinalTracks  # noqa: E402

FRAMES = 40  # of a whole run: more than 1 MiB of RGB24, which is the longest request that nginx takes by default
DEADLINE_SECONDS = 120  # for what takes a moment on a quiet machine
CUT_SECONDS = 2  # an idle limit that is to be run into
# How long a stream is silent and has to live; longer than the shortest limit above. The environment may ask for more.
PAUSE_SECONDS = float(os.environ.get("HOLDFAST_PROXY_TEST_PAUSE", 3 * CUT_SECONDS))
LONGEST_PAUSE = 180  # seconds of silence that the shipped files must bear


class Workbench:
    """What all tests share: programs, the protocol, keys, certificates, and the tracks of an undisturbed run."""

    def __init__(self, server_program, protoc, client_program):
        self.server_program, self.client_program = server_program, client_program
        self.temporary = tempfile.TemporaryDirectory(prefix="holdfast-proxies-")
        directory = self.directory = pathlib.Path(self.temporary.name)
        self.protocol = generate(protoc, directory)[0]
        self.keys = directory / "keys"
        self.keys.write_text(f"test:{secrets.token_hex(32)}\n")
        self.authority, self.stranger = Authority(directory, "authority"), Authority(directory, "stranger")
        self.certificate, self.key = self.authority.issue("server")
        self.points = [self.protocol.Point(id=1, x=30, y=30), self.protocol.Point(id=2, x=60.5, y=48.25)]

    def start_servers(self, *flags):
        """Two servers that take up each other's sessions, and compute the same to the last bit."""
        def start(_):
            return ServerProcess(self.server_program, f"--processing_size={WIDTH}x{HEIGHT}", "--iterations=2",
                                 "--precision=float32", "--compute_threads=1", "--idle_timeout=inf",
                                 f"--checkpoint_keys={self.keys}", *flags)

        with ThreadPoolExecutor(2) as executor:
            return list(executor.map(start, range(2)))

    def client(self, address, authority=None, **options):
        return Client(self.protocol, address, (authority or self.authority).certificate, **options)

    def run_holdfast(self, address, *flags):
        """The command line as it tracks the demo's video; its tracks and what it says, when it is asked to wait."""
        out = self.directory / f"{secrets.token_hex(8)}.json"
        process = subprocess.Popen([self.client_program, "track", str(VIDEO), f"--server={address}", "--grid=6",
                                    f"--out={out}", *flags], stderr=subprocess.PIPE, text=True)

        def wait():
            words = process.communicate(timeout=DEADLINE_SECONDS)[1]
            return process.returncode, json.loads(out.read_text()) if out.exists() else None, words

        return wait

    def track_directly(self, server):
        """The final tracks of a run that no proxy is part of."""
        with Client(self.protocol, server.address) as client:
            session = client.session(points=self.points)
            session.send_frames(range(FRAMES))
            session.finish()
            return read_to_end(session, FinalTracks())


def read_to_end(session, tracks):
    """Adds what becomes final to 'tracks' and returns its positions."""
    for response in session:
        if response.WhichOneof("response") == "tracks":
            tracks.add(response.tracks)
    return tracks.positions


def wait_until(condition, words):
    """Asks again and again until the deadline."""
    deadline = time.monotonic() + DEADLINE_SECONDS
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(words)
        time.sleep(0.05)


def sessions(server):
    return int(server.metric("holdfast_sessions_active"))


class ProxyBehaviour:
    """What holds behind either proxy; the tests of a class with a 'Proxy'."""

    Proxy = None
    LIMITS_OF_A_PAUSE = ()  # those of Proxy.IDLE_LIMITS that a client runs into which sends nothing and reads
    bench = None

    @classmethod
    def setUpClass(cls):
        cls.servers = cls.bench.start_servers()
        for server in cls.servers:
            cls.addClassCleanup(server.stop)
        cls.proxy = cls.Proxy(cls.servers, cls.bench.certificate, cls.bench.key)
        cls.addClassCleanup(cls.proxy.stop)
        cls.undisturbed = cls.bench.track_directly(cls.servers[0])

    def started(self, thing):
        self.addCleanup(thing.stop)
        return thing

    def start_proxy(self, servers, **options):
        return self.started(self.Proxy(servers, self.bench.certificate, self.bench.key, **options))

    def start_all(self, *flags):
        """A proxy and two servers of the test's own."""
        servers = [self.started(server) for server in self.bench.start_servers(*flags)]
        for server in servers:
            self.addCleanup(server.kill)  # which comes first, and takes less time than stopping
        return self.start_proxy(servers), servers

    def client(self, proxy, **options):
        client = self.bench.client(proxy.address, **options)
        self.addCleanup(client.close)
        return client

    def open_session(self, proxy, **config):
        """A session that has been accepted, of a client of its own."""
        session = self.client(proxy).session(points=self.bench.points, **config)
        session.accepted()
        self.addCleanup(session.cancel)
        return session

    def holder(self, servers):
        """Which of the servers has the only session there is."""
        counts = [sessions(server) for server in servers]
        self.assertEqual(sorted(counts), [0, 1])
        return counts.index(1)

    def resume(self, client, token):
        """A session that goes on from the token, and its first frame; tries again while the old server still answers.

        It says UNAVAILABLE, or CANCELLED in the moment in which it closes its connections.
        """
        passing = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED)
        deadline = time.monotonic() + DEADLINE_SECONDS
        while True:
            session = client.session(resume_token=token)
            self.addCleanup(session.cancel)
            try:
                return session, session.accepted().first_frame
            except grpc.RpcError as error:
                if error.code() not in passing or time.monotonic() > deadline:
                    raise

    def test_a_server_says_what_it_is_and_tracks_a_video(self):
        client = self.client(self.proxy)
        self.assertRegex(client.info().build, r"^\d+\.\d+\.\d+$")
        session = client.session(points=self.bench.points)
        session.send_frames(range(FRAMES))
        session.finish()
        self.assertEqual(read_to_end(session, FinalTracks()), self.undisturbed)
        self.assertEqual({point: sorted(frames) for point, frames in self.undisturbed.items()},
                         {1: list(range(FRAMES)), 2: list(range(FRAMES))})

    def test_each_frame_is_answered_before_the_next_one_is_sent(self):
        session = self.open_session(self.proxy, emit=self.bench.protocol.EMIT_EVERY_FRAME)
        for index in range(4):
            session.send_frames([index])
            while next(session.call).tracks.frames_received <= index:
                pass

    def test_sessions_spread_over_both_servers(self):
        wait_until(lambda: not any(map(sessions, self.servers)), "sessions of other tests have not ended")
        completed = 'holdfast_sessions_total{outcome="completed"}'
        before = self.servers[0].metric(completed)
        held = [[], []]
        for _ in range(4):
            session = self.open_session(self.proxy)
            held[[len(some) < sessions(server) for some, server in zip(held, self.servers)].index(True)].append(session)
        self.assertEqual([len(some) for some in held], [2, 2])
        ended = self.proxy.ended()
        for session in held[0]:
            session.finish()
            read_to_end(session, FinalTracks())
            session.client.close()
        wait_until(lambda: self.proxy.ended() >= ended + 2, "the proxy has not logged the ends of two sessions")
        # Who took turns would open one at each server.
        for _ in range(2):
            self.open_session(self.proxy)
        self.assertEqual([sessions(server) for server in self.servers], [2, 2])
        self.servers[0].wait_for_metric(completed, before + 2)

    def test_a_servers_own_words_reach_the_client(self):
        """A status that comes before the client has finished is easily lost on the way."""
        client = self.client(self.proxy)
        for _ in range(5):
            session = client.session(points=[self.bench.protocol.Point(id=1, x=WIDTH, y=0)])
            with self.assertRaises(grpc.RpcError) as caught:
                session.accepted()
            self.assertEqual(caught.exception.code(), grpc.StatusCode.INVALID_ARGUMENT)
            self.assertIn("grpc-status-details-bin", dict(caught.exception.trailing_metadata()))
            session.finish()

    def test_a_bearers_token_reaches_the_server(self):
        server = self.started(FakeServer())
        proxy = self.start_proxy([server, server])
        self.client(proxy, metadata=[("authorization", "Bearer of-a-test")]).info()
        self.assertEqual(server.metadata["authorization"], "Bearer of-a-test")

    def test_only_the_right_authority_is_trusted_and_only_tls_is_spoken(self):
        self.client(self.proxy).info()
        untrusted = [self.client(self.proxy, authority=self.bench.stranger),
                     Client(self.bench.protocol, self.proxy.address)]
        for client in untrusted:
            with self.assertRaises(grpc.RpcError) as caught:
                client.info()
            self.assertEqual(caught.exception.code(), grpc.StatusCode.UNAVAILABLE)
            client.close()

    def test_the_shipped_limits_lie_behind_the_longest_pause(self):
        limits = self.Proxy.idle_limits((DEPLOY / self.Proxy.CONFIG).read_text())
        self.assertEqual(sorted(limits), sorted(self.Proxy.IDLE_LIMITS))
        self.assertGreater(min(limits.values()), LONGEST_PAUSE, limits)

    def test_a_silent_stream_lives_and_would_not_with_any_shorter_limit(self):
        def end_of(session):
            ended = threading.Event()
            if not session.call.add_callback(ended.set):
                ended.set()
            return ended

        patient = self.open_session(self.proxy)
        cut = {}
        for name in self.LIMITS_OF_A_PAUSE:
            proxy = self.start_proxy(self.servers,
                                     change=lambda text: self.Proxy.with_idle_limit(text, name, CUT_SECONDS))
            cut[name] = end_of(self.open_session(proxy))
        self.assertFalse(end_of(patient).wait(PAUSE_SECONDS))
        for name, ended in cut.items():
            self.assertTrue(ended.wait(DEADLINE_SECONDS), name)
        patient.send_frames(range(FRAMES))
        patient.finish()
        self.assertEqual(read_to_end(patient, FinalTracks()), self.undisturbed)

    def test_a_drain_moves_a_session_to_the_other_server(self):
        proxy, servers = self.start_all("--grace_period=1s")
        session = self.open_session(proxy)
        first = self.holder(servers)
        session.send_frames(range(FRAMES // 2))
        tracks, kinds, checkpoint = FinalTracks(), [], None
        servers[first].process.terminate()
        with self.assertRaises(grpc.RpcError) as caught:
            for response in session:
                kinds.append(response.WhichOneof("response"))
                tracks.add(response.tracks)
                checkpoint = response.checkpoint
        session.finish()
        self.assertEqual(caught.exception.code(), grpc.StatusCode.UNAVAILABLE)
        self.assertEqual(caught.exception.details(), "the server is shutting down")
        self.assertIn("going_away", kinds)
        self.assertEqual(kinds[-1], "checkpoint")
        self.assertTrue(checkpoint.resumable)
        resumed, first_frame = self.resume(session.client, checkpoint.token)
        self.assertEqual(first_frame, checkpoint.next_frame)
        self.assertEqual(servers[1 - first].metric('holdfast_resumes_total{result="resumed"}'), 1)
        resumed.send_frames(range(first_frame, FRAMES))
        resumed.finish()
        self.assertEqual(read_to_end(resumed, tracks), self.undisturbed)
        self.assertEqual(servers[first].process.wait(DEADLINE_SECONDS), 0)

    def test_a_server_that_is_taken_out_gets_no_sessions_and_finishes_those_it_has(self):
        proxy, servers = self.start_all(f"--grace_period={DEADLINE_SECONDS}s")
        session = self.open_session(proxy)
        first = self.holder(servers)
        self.take_out(proxy, servers, first)
        for _ in range(3):
            self.open_session(proxy)
        self.assertEqual(sessions(servers[first]), 1)
        self.assertEqual(sessions(servers[1 - first]), 3)
        self.assertEqual(servers[first].metric('holdfast_admission_rejected_total{reason="draining"}'), 0)
        session.send_frames(range(FRAMES))
        session.finish()
        self.assertEqual(read_to_end(session, FinalTracks()), self.undisturbed)
        self.assertEqual(servers[first].process.wait(DEADLINE_SECONDS), 0)

    def test_the_command_line_goes_on_when_its_server_is_killed(self):
        proxy, servers = self.start_all("--processing_size=256x192")
        code, undisturbed, words = self.bench.run_holdfast(servers[0].address)()
        self.assertEqual(code, 0, words)
        checkpoints = "holdfast_checkpoints_total"
        before = [server.metric(checkpoints) for server in servers]
        wait = self.bench.run_holdfast(proxy.address, f"--tls_ca={self.bench.authority.certificate}")
        wait_until(lambda: any(map(sessions, servers)), "there is no session")
        first = self.holder(servers)
        servers[first].wait_for_metric(checkpoints, before[first] + 1)
        servers[first].kill()
        code, tracks, words = wait()
        self.assertEqual(code, 0, words)
        self.assertTrue(tracks["complete"])
        self.assertEqual(servers[1 - first].metric('holdfast_resumes_total{result="resumed"}'), 1)
        self.assertEqual(tracks["points"], undisturbed["points"])

    def test_a_dead_server_is_passed_over(self):
        proxy, servers = self.start_all()
        session = self.open_session(proxy)
        first = self.holder(servers)
        servers[first].kill()
        with self.assertRaises(grpc.RpcError) as caught:
            read_to_end(session, FinalTracks())
        self.assertEqual(caught.exception.code(), self.CODE_OF_A_DEAD_SERVER)
        for _ in range(3):
            self.open_session(proxy)
        self.assertEqual(sessions(servers[1 - first]), 3)


class HaproxyTest(ProxyBehaviour, unittest.TestCase):
    Proxy = Haproxy
    LIMITS_OF_A_PAUSE = Haproxy.IDLE_LIMITS
    CODE_OF_A_DEAD_SERVER = grpc.StatusCode.UNAVAILABLE

    def take_out(self, proxy, servers, index):
        """A server that is asked to stop is not ready, which HAProxy finds out by itself."""
        servers[index].process.terminate()
        wait_until(lambda: f"Server holdfast/server-{index + 1} is DOWN" in proxy.words(), "the server is not out")


class NginxTest(ProxyBehaviour, unittest.TestCase):
    Proxy = Nginx
    LIMITS_OF_A_PAUSE = ("client_body_timeout", "grpc_read_timeout")
    CODE_OF_A_DEAD_SERVER = grpc.StatusCode.INTERNAL

    def take_out(self, proxy, servers, index):
        """nginx has to be told, and then the server."""
        before = proxy.workers()
        config = proxy.config.read_text()
        proxy.config.write_text(config.replace(f"server {servers[index].address} ",
                                               f"server {servers[index].address} down "))
        self.assertNotEqual(proxy.config.read_text(), config)
        proxy.process.send_signal(signal.SIGHUP)
        wait_until(lambda: not before & proxy.workers() and proxy.workers(), "nginx has not read its file again")
        servers[index].process.terminate()


if __name__ == "__main__":
    ProxyBehaviour.bench = Workbench(*(str(pathlib.Path(argument).resolve()) for argument in sys.argv[1:4]))
    unittest.main(argv=sys.argv[:1], verbosity=2)
