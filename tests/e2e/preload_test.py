# SPDX-License-Identifier: Apache-2.0
"""The server beside libraries that have large thread-local variables.

Usage: preload_test.py HOLDFAST_SERVER LARGE_THREAD_LOCAL_LIBRARY
"""
import sys
import unittest

from server_process import ServerProcess

SMALL = ["--processing_size=64x64", "--precision=float32"]


class PreloadTest(unittest.TestCase):
    server_program = large_thread_local = None

    def serve(self, library):
        return ServerProcess(self.server_program, *SMALL, prefix=("env", f"LD_PRELOAD={library}"))

    def test_metrics_are_served_where_threads_have_much_of_their_own(self):
        server = self.serve(self.large_thread_local)
        try:
            self.assertEqual(server.metric("holdfast_sessions_active"), 0)
        finally:
            self.assertEqual(server.stop(), 0)


if __name__ == "__main__":
    PreloadTest.server_program, PreloadTest.large_thread_local = sys.argv[1:3]
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)
