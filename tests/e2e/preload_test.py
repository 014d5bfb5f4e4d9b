# SPDX-License-Identifier: Apache-2.0
"""The programs beside libraries that start threads before main, or that have large thread-local variables.

Usage: preload_test.py HOLDFAST_SERVER HOLDFAST EARLY_THREAD_LIBRARY LARGE_THREAD_LOCAL_LIBRARY
"""
import os
import socket
import subprocess
import sys
import unittest

from server_process import ServerProcess

SMALL = ["--processing_size=64x64", "--precision=float32"]


class PreloadTest(unittest.TestCase):
    server_program = client_program = early_thread = large_thread_local = None

    def serve(self, library):
        return ServerProcess(self.server_program, *SMALL, prefix=("env", f"LD_PRELOAD={library}"))

    def test_a_server_drains_whichever_thread_gets_the_signal(self):
        self.assertEqual(self.serve(self.early_thread).stop(), 0)

    def test_a_client_ends_by_itself_whichever_thread_gets_the_signal(self):
        with socket.create_server(("127.0.0.1", 0)) as silent:
            client = subprocess.Popen([self.client_program, "info", "--connect_timeout=1h",
                                       "--server=127.0.0.1:%d" % silent.getsockname()[1]],
                                      env={**os.environ, "LD_PRELOAD": self.early_thread})
            connection = silent.accept()[0]
            client.terminate()
            self.assertEqual(client.wait(60), 143)
            connection.close()

    def test_metrics_are_served_where_threads_have_much_of_their_own(self):
        server = self.serve(self.large_thread_local)
        try:
            self.assertEqual(server.metric("holdfast_sessions_active"), 0)
        finally:
            self.assertEqual(server.stop(), 0)


if __name__ == "__main__":
    PreloadTest.server_program, PreloadTest.client_program = sys.argv[1:3]
    PreloadTest.early_thread, PreloadTest.large_thread_local = sys.argv[3:5]
    unittest.main(argv=[sys.argv[0], *sys.argv[5:]], verbosity=2)
