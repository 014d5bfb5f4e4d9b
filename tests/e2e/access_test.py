# SPDX-License-Identifier: Apache-2.0
"""Who is let in: TLS, certificates of both sides and tokens, with openssl, the real server and the real client.

Usage: access_test.py HOLDFAST_SERVER HOLDFAST
"""
import itertools
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import grpc

from certificates import Authority, put
from server_process import VIDEO, ServerProcess

SMALL = ["--processing_size=128x96", "--iterations=1", "--compute_threads=1", "--precision=float32"]
ANNES_TOKEN, BOBS_TOKEN = "token-of-anne-0123456789", "token-of-bob-0123456789"
PATIENCE_S = 60  # for a change to be noticed on a busy machine
HEALTH, SERVING = "/grpc.health.v1.Health/Check", b"\x08\x01"
REFLECTION = "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo"
INFO = "/holdfast.v1.PointTracking/GetServerInfo"


class AccessTest(unittest.TestCase):
    """A folder for the tests of a class, and the client. A server takes seconds to start: tests share what they can."""

    server_program = client_program = None

    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="holdfast-access-")
        cls.addClassCleanup(folder.cleanup)
        cls.folder = pathlib.Path(folder.name)

    @classmethod
    def serve(cls, *flags):
        server = ServerProcess(cls.server_program, *SMALL, *flags)
        cls.addClassCleanup(server.stop)
        return server

    def holdfast(self, command, server, *flags, host=None):
        environment = {name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")}
        address = server.address if host is None else f"{host}:{server.address.rsplit(':')[-1]}"
        return subprocess.run([self.client_program, *command, f"--server={address}", *map(str, flags)],
                              capture_output=True, text=True, timeout=180, env=environment)

    def info(self, server, *flags, **where):
        return self.holdfast(["info"], server, *flags, **where)

    def refused_info(self, server, *flags):
        """Where there will be no connection: does not wait for one as long."""
        return self.info(server, *flags, "--connect_timeout=500ms")

    def assert_let_in(self, result):
        self.assertEqual(result.returncode, 0, result.stderr)

    def assert_kept_out(self, result, *says):
        self.assertEqual(result.returncode, 1, result.stdout + result.stderr)
        for text in says:
            self.assertIn(text, result.stderr)

    def eventually(self, succeeds, ask):
        """Asks until the exit status is as wanted; the last answer."""
        end = time.monotonic() + PATIENCE_S
        while True:
            result = ask()
            if (result.returncode == 0) == succeeds or time.monotonic() > end:
                return result


class TlsTest(AccessTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.authority = Authority(cls.folder, "authority")
        cls.stranger = Authority(cls.folder, "stranger")
        cls.identity = cls.folder / "served.pem", cls.folder / "served.key"
        put(cls.authority.issue("server"), cls.identity)
        cls.flags = [f"--tls_cert={cls.identity[0]}", f"--tls_key={cls.identity[1]}"]
        cls.trust = f"--tls_ca={cls.authority.certificate}"
        cls.server = cls.serve(*cls.flags)

    def test_tracks_for_whom_trusts_the_authority_and_for_nobody_else(self):
        server = self.server
        tracks = self.folder / "tracks.json"
        self.assert_let_in(self.holdfast(["track", str(VIDEO)], server, self.trust, "--grid=4", "--max_frames=4",
                                         f"--out={tracks}"))
        self.assertEqual(len(json.loads(tracks.read_text())["points"]), 4)
        self.assert_let_in(self.info(server, self.trust, host="localhost"))
        self.assert_kept_out(self.refused_info(server, f"--tls_ca={self.stranger.certificate}"), server.address)
        self.assert_kept_out(self.refused_info(server, "--tls"), server.address)  # the system trusts other authorities
        self.assert_kept_out(self.refused_info(server), server.address)  # plain text

    def test_a_certificate_of_another_name_or_time_is_refused_and_a_new_one_needs_no_restart(self):
        server = self.server
        self.assert_let_in(self.info(server, self.trust))
        put(self.authority.issue("elsewhere", "DNS:elsewhere.example"), self.identity)
        self.assert_kept_out(self.eventually(False, lambda: self.refused_info(server, self.trust)))
        self.assert_let_in(self.info(server, self.trust, "--tls_server_name=elsewhere.example"))
        put(self.authority.issue("late", days=-1), self.identity)
        self.assert_kept_out(self.eventually(
            False, lambda: self.refused_info(server, self.trust, "--tls_server_name=elsewhere.example")))
        self.assert_kept_out(self.refused_info(server, self.trust))
        put(self.authority.issue("server"), self.identity)
        self.assert_let_in(self.eventually(True, lambda: self.info(server, self.trust)))

    def test_clients_show_a_certificate_of_an_authority_that_can_be_exchanged(self):
        clients = Authority(self.folder, "clients")
        believed = self.folder / "believed.pem"
        put([clients.certificate], [believed])
        server = self.serve(*self.flags, f"--tls_client_ca={believed}")

        def ask(authority):
            cert, key = authority.issue("client")
            return lambda: self.info(server, self.trust, f"--tls_cert={cert}", f"--tls_key={key}",
                                     "--connect_timeout=2s")

        ours, strangers = ask(clients), ask(self.stranger)
        self.assert_let_in(ours())
        self.assert_kept_out(self.refused_info(server, self.trust))
        self.assert_kept_out(strangers())
        put([self.stranger.certificate], [believed])
        self.assert_kept_out(self.eventually(False, ours))
        self.assert_let_in(self.eventually(True, strangers))

    def test_speaks_tls_1_2_or_newer(self):
        def handshake(version):
            return subprocess.run(["openssl", "s_client", "-connect", self.server.address, f"-{version}", "-alpn", "h2",
                                   "-cipher", "ALL:@SECLEVEL=0", "-CAfile", self.authority.certificate],
                                  stdin=subprocess.DEVNULL, capture_output=True, timeout=60)

        for version in ("tls1", "tls1_1"):
            self.assertNotEqual(handshake(version).returncode, 0, version)
        for version in ("tls1_2", "tls1_3"):
            done = handshake(version)
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertIn(b"Verify return code: 0", done.stdout)

    def test_a_server_does_not_start_with_files_that_do_not_fit(self):
        other_key = self.stranger.issue("server")[1]
        for flags, says in (
                ([self.flags[0]], "tls_key is empty"),
                ([f"--tls_client_ca={self.authority.certificate}"], "tls_client_ca"),
                (["--tls_cert=/nowhere.pem", self.flags[1]], "--tls_cert=/nowhere.pem"),
                ([self.flags[0], f"--tls_key={other_key}"], f"--tls_key={other_key}"),
                ([*self.flags, f"--tls_client_ca={other_key}"], f"--tls_client_ca={other_key}")):
            with self.assertRaises(RuntimeError) as raised:
                ServerProcess(self.server_program, *SMALL, *flags)
            self.assertIn(says, str(raised.exception))

    def test_a_client_says_which_file_is_wrong(self):
        result = self.holdfast(["info"], self.server, "--tls_ca=/nowhere.pem")
        self.assertEqual(result.returncode, 2)
        self.assertIn("/nowhere.pem", result.stderr)


class TokenTest(AccessTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.access = cls.folder / "access"
        cls.access.write_text(f"anne:{ANNES_TOKEN}\nbob:{BOBS_TOKEN} max_sessions=1 max_points=5\n")
        cls.server = cls.serve(f"--token_file={cls.access}")
        cls.channel = grpc.insecure_channel(cls.server.address)
        cls.addClassCleanup(cls.channel.close)

    def token(self, text):
        path = self.folder / "token"
        path.write_text(text + "\n")
        return f"--token_file={path}"

    def call(self, method, *metadata):
        return self.channel.unary_unary(method)(b"", metadata=metadata, timeout=PATIENCE_S)

    def log(self):
        return pathlib.Path(self.server.log.name).read_text()

    def track(self, *flags, points=3):
        return self.holdfast(["track", str(VIDEO)], self.server, f"--grid={points}", "--max_frames=3",
                             f"--out={self.folder / 'tracks.csv'}", *flags)

    def test_lets_in_by_token_and_logs_the_name_but_never_the_token(self):
        self.assert_let_in(self.track(self.token(ANNES_TOKEN)))
        self.assertIn("by anne", self.log())
        self.assert_let_in(self.info(self.server, self.token(BOBS_TOKEN)))
        self.assert_kept_out(self.track(), "expected a token")
        wrong = "token-of-carol-123456789"
        self.assert_kept_out(self.track(self.token(wrong)), "not one that this server knows")
        self.assert_kept_out(self.info(self.server, self.token(wrong)), "not one that this server knows")
        self.assertGreaterEqual(self.server.metric('holdfast_admission_rejected_total{reason="token"}'), 2)
        for token in (ANNES_TOKEN, BOBS_TOKEN, wrong):
            self.assertNotIn(token, self.log())

    def test_a_name_has_limits_of_its_own(self):
        refused = self.track(self.token(BOBS_TOKEN), points=16)
        self.assert_kept_out(refused, "at most 5")
        with self.hold_session(BOBS_TOKEN):
            self.assert_kept_out(self.track(self.token(BOBS_TOKEN), "--reconnect_timeout=0s"), "of bob are open")
            self.assert_let_in(self.track(self.token(ANNES_TOKEN), points=16))
        self.assert_let_in(self.eventually(True, lambda: self.track(self.token(BOBS_TOKEN))))

    def hold_session(self, token):
        """A stream that says nothing, once the server has it; ends with the context."""
        release = threading.Event()

        def silence():
            release.wait()
            yield from ()

        call = self.channel.stream_stream("/holdfast.v1.PointTracking/Track")(
            silence(), metadata=[("authorization", f"Bearer {token}")])

        class Held:
            def __enter__(held):
                # The server takes streams of a connection in order: this call is behind the silent one.
                self.call(INFO, ("authorization", f"Bearer {token}"))

            def __exit__(held, *_):
                call.cancel()
                release.set()

        return Held()

    def test_a_changed_file_is_read_again(self):
        access, dans, carols = self.folder / "changed", "token-of-dan-123456789", "token-of-carol-123456789"
        access.write_text(f"dan:{dans}\n")
        server = self.serve(f"--token_file={access}")
        self.assert_let_in(self.info(server, self.token(dans)))
        access.write_text(f"carol:{carols}\n")
        self.assert_let_in(self.eventually(True, lambda: self.info(server, self.token(carols))))
        self.assert_kept_out(self.info(server, self.token(dans)))
        access.write_text("nonsense")
        self.assert_let_in(self.info(server, self.token(carols)))

    def test_health_is_open_and_reflection_is_not(self):
        self.assertEqual(self.call(HEALTH), SERVING)
        with self.assertRaises(grpc.RpcError) as raised:
            self.call(INFO)
        self.assertEqual(raised.exception.code(), grpc.StatusCode.UNAUTHENTICATED)
        self.assertEqual(self.reflection(self.channel), grpc.StatusCode.UNIMPLEMENTED)
        other = self.serve(f"--token_file={self.access}", "--open_reflection", "--noopen_health")
        with grpc.insecure_channel(other.address) as channel:
            self.assertEqual(self.reflection(channel), grpc.StatusCode.OK)
            with self.assertRaises(grpc.RpcError) as raised:
                channel.unary_unary(HEALTH)(b"", timeout=PATIENCE_S)
            self.assertEqual(raised.exception.code(), grpc.StatusCode.UNIMPLEMENTED)

    @staticmethod
    def reflection(channel):
        """How a question for the list of services ends."""
        call = channel.stream_stream(REFLECTION)(iter([b"\x3a\x00"]), timeout=PATIENCE_S)
        try:
            list(call)
        except grpc.RpcError:
            pass
        return call.code()

    def test_wrong_tokens_do_not_slow_a_running_session(self):
        load = ["load", str(VIDEO)]
        flags = [self.token(ANNES_TOKEN), "--sessions=1", "--points=4", "--fps=5", "--seconds=6",
                 f"--out={self.folder / 'load.json'}"]
        over, refused = threading.Event(), []
        flood = threading.Thread(target=self.flood, args=(over, refused))
        flood.start()
        begin = time.monotonic()
        try:
            result = self.holdfast(load, self.server, *flags)
        finally:
            over.set()
            flood.join()
        self.assert_let_in(result)
        healthy = json.loads((self.folder / "load.json").read_text())["totals"][0]
        rate = len(refused) / (time.monotonic() - begin)
        print(f"{rate:.0f} wrong tokens a second beside {healthy['frames']} frames at 5 a second, first estimate p95 "
              f"{healthy['first_estimate_ms']['p95']:.0f} ms", file=sys.stderr)
        self.assertGreaterEqual(healthy["frames"], 28)
        self.assertGreater(rate, 200)  # of 1,000 that are sent; a busy machine sends fewer
        self.assertEqual(set(refused), {grpc.StatusCode.UNAUTHENTICATED})

    def flood(self, over, refused):
        """A thousand calls a second, in bursts of ten."""
        call = self.channel.unary_unary(INFO)
        begin = time.monotonic()
        for burst in itertools.count():
            if over.wait(max(0, begin + burst / 100 - time.monotonic())):
                return
            waiting = [call.future(b"", metadata=[("authorization", f"Bearer wrong-token-{burst}-{i:06}")])
                       for i in range(10)]
            refused.extend(future.code() for future in waiting)


if __name__ == "__main__":
    AccessTest.server_program, AccessTest.client_program = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1])
