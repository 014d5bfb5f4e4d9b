# SPDX-License-Identifier: Apache-2.0
"""What callers can make the server hold, by calls of gRPC whose messages do not end.

Usage: memory_test.py HOLDFAST_SERVER
"""
import pathlib
import sys
import tempfile
import unittest

from http2 import Connection
from server_process import ServerProcess

MIB = 1 << 20
TOKEN = "token-of-anne-0123456789"
TRACK, INFO = "/holdfast.v1.PointTracking/Track", "/holdfast.v1.PointTracking/GetServerInfo"
CHECK, WATCH = "/grpc.health.v1.Health/Check", "/grpc.health.v1.Health/Watch"


class MemoryTest(unittest.TestCase):
    server_program = None

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="holdfast-memory-")
        self.addCleanup(folder.cleanup)
        tokens = pathlib.Path(folder.name) / "tokens"
        tokens.write_text(f"anne:{TOKEN}\n")
        self.server = ServerProcess(self.server_program, "--compute_threads=1", "--max_sessions=1",
                                    f"--token_file={tokens}")
        self.addCleanup(self.server.stop)
        self.at_first = self.held()

    def held(self):
        lines = pathlib.Path(f"/proc/{self.server.process.pid}/status").read_text().splitlines()
        return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmRSS:"))

    def connect(self):
        connection = Connection(self.server.address)
        self.addCleanup(connection.close)
        return connection

    def test_of_strangers_messages_no_more_than_windows(self):
        for path in [TRACK, INFO, CHECK, WATCH]:
            connection = self.connect()
            for _ in range(8):
                stream = connection.open(path)
                connection.announce(stream, 64 * MIB)
                self.assertTrue(path == WATCH or connection.wait_for_end(stream), path)
        self.assertLess(self.held() - self.at_first, 100 * MIB)

    def test_of_a_callers_message_no_more_than_of_all_streams(self):
        connection = self.connect()
        stream = connection.open(TRACK, authorization=f"Bearer {TOKEN}")
        self.assertLess(connection.announce(stream, 2000 * MIB), 700 * MIB)
        self.assertTrue(connection.wait_for_end(stream))
        self.assertLess(self.held() - self.at_first, 700 * MIB)
        again = self.connect()
        self.assertTrue(again.wait_for_end(again.open(CHECK)), "the server goes on")


if __name__ == "__main__":
    MemoryTest.server_program = sys.argv.pop()
    unittest.main(verbosity=2)
