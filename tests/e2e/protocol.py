# SPDX-License-Identifier: Apache-2.0
"""The protocol in Python, made from the .proto files alone, and pictures to send."""
import math
import subprocess
import sys

from server_process import SOURCE

METHOD = "/holdfast.v1.PointTracking/"


def generate(protoc, directory):
    """Compiles the protocol to Python and imports it: the modules of the service, of Status and of its details."""
    subprocess.run([protoc, f"--proto_path={SOURCE / 'proto'}", f"--python_out={directory}",
                    "google/rpc/status.proto", "google/rpc/error_details.proto",
                    "holdfast/v1/point_tracking.proto"], check=True)
    sys.path.insert(0, str(directory))
    from google.rpc import error_details_pb2, status_pb2
    from holdfast.v1 import point_tracking_pb2
    return point_tracking_pb2, status_pb2, error_details_pb2


def picture(index, width, height):
    """A grey texture that moves one pixel to the right each frame, GRAY8."""
    rows = []
    for y in range(height):
        rows.append(bytes(int(128 + 60 * math.sin((x - index) * 0.35) * math.cos(y * 0.3) +
                              40 * math.sin((x - index) * 0.11 + y * 0.17)) for x in range(width)))
    return b"".join(rows)
