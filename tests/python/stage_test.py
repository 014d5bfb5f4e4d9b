# SPDX-License-Identifier: Apache-2.0
"""The package in a process that has the protocol from elsewhere too; no server takes part."""
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import support

OURS = "from holdfast_client._proto import point_tracking_pb2 as ours"
THEIRS = "from holdfast.v1 import point_tracking_pb2 as theirs"
# What one writes the other one reads.
USE = """
sent = ours.TrackRequest(config=ours.SessionConfig(label="a", points=[ours.Point(id=3, x=1, y=2)]))
read = theirs.TrackRequest.FromString(sent.SerializeToString())
assert read.config.points[0].id == 3
assert ours.TrackRequest.FromString(read.SerializeToString()) == sent
"""


class StageTest(unittest.TestCase):
    def setUp(self):
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.generated = pathlib.Path(directory.name)
        subprocess.run([support.PROTOC, f"--proto_path={support.ROOT / 'proto'}", f"--python_out={self.generated}",
                        "holdfast/v1/point_tracking.proto"], check=True)

    def run_program(self, lines, implementation):
        """What it says on standard error; `implementation` is protobuf's, "" the one of its own choice."""
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(support.STAGED), str(self.generated)])}
        if implementation:
            environment["PROTOCOL_BUFFERS_PYTHON_IMPLEMENTATION"] = implementation
        return subprocess.run([sys.executable, "-c", "\n".join(lines)], env=environment, stderr=subprocess.PIPE,
                              text=True, check=False).stderr

    def test_who_has_generated_the_protocol_too_is_not_disturbed(self):
        for implementation in ("", "python"):
            for first, second in ((OURS, THEIRS), (THEIRS, OURS)):
                with self.subTest(implementation=implementation, first=first):
                    self.assertEqual(self.run_program([first, second, USE], implementation), "")


if __name__ == "__main__":
    support.main()
