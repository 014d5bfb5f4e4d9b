# SPDX-License-Identifier: Apache-2.0
"""`holdfast track --show` on a display of its own (Debian's packages "xvfb" and "xdotool").

Usage: show_test.py HOLDFAST_SERVER HOLDFAST
"""
import math
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

from server_process import ServerProcess

WIDTH, HEIGHT, FRAMES = 128, 96, 56


def picture():
    grey = bytes(int(128 + 60 * math.sin(x * 0.35) * math.cos(y * 0.3)) for y in range(HEIGHT) for x in range(WIDTH))
    return grey + bytes([128]) * (WIDTH * HEIGHT // 2)


@unittest.skipUnless(shutil.which("Xvfb") and shutil.which("xdotool"),
                     "there is no Xvfb or no xdotool: the window is not tested")
class ShowTest(unittest.TestCase):
    server_program = client_program = None

    def setUp(self):
        read, write = os.pipe()
        self.display = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", "640x480x24"],
                                        pass_fds=[write], stderr=subprocess.DEVNULL)
        self.addCleanup(self.display.wait)
        self.addCleanup(self.display.terminate)
        os.close(write)
        with os.fdopen(read) as number:
            self.environment = {**os.environ, "DISPLAY": f":{number.readline().strip()}", "QT_LOGGING_RULES": "*=false"}

    def xdotool(self, *args):
        return subprocess.run(["xdotool", *args], env=self.environment, check=True, stdout=subprocess.PIPE, timeout=60,
                              text=True).stdout.split()

    def test_a_key_in_the_window_ends_the_run_as_an_interrupt_does(self):
        server = ServerProcess(self.server_program, "--processing_size=128x96", "--iterations=1", "--compute_threads=1",
                               "--precision=float32")
        self.addCleanup(server.stop)
        with tempfile.TemporaryDirectory(prefix="holdfast-show-") as directory:
            pipe, out = os.path.join(directory, "endless.y4m"), os.path.join(directory, "t.csv")
            os.mkfifo(pipe)
            client = subprocess.Popen(
                [self.client_program, "track", pipe, f"--server={server.address}", "--grid=9", "--show",
                 f"--out={out}"], env=self.environment, stderr=subprocess.PIPE, text=True)
            with open(pipe, "wb", buffering=0) as stream:
                stream.write(b"YUV4MPEG2 W%d H%d F10:1 Ip C420jpeg\n" % (WIDTH, HEIGHT))
                stream.write((b"FRAME\n" + picture()) * FRAMES)
                window = self.xdotool("search", "--sync", "--onlyvisible", "--name", "Holdfast")[0]
                server.wait_for_metric("holdfast_final_latency_seconds_count", 8)
                self.xdotool("key", "--window", window, "Escape")
                errors = client.communicate(timeout=60)[1]  # the input is still open
            self.assertEqual(client.returncode, 130, errors)
            self.assertIn(f"kept in {out}: frames 0..", errors)

    def test_without_a_display_the_flag_is_named(self):
        del self.environment["DISPLAY"]
        self.environment.pop("WAYLAND_DISPLAY", None)
        done = subprocess.run([self.client_program, "track", "x.mp4", "--grid=9", "--show"], env=self.environment,
                              stderr=subprocess.PIPE, text=True, timeout=60, check=False)
        self.assertEqual(done.returncode, 1)
        self.assertIn("holdfast: --show: there is no display", done.stderr)


if __name__ == "__main__":
    ShowTest.server_program, ShowTest.client_program = sys.argv[1:3]
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)
