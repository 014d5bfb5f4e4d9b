# SPDX-License-Identifier: Apache-2.0
"""Prints where a point goes in 0001.jpg, 0002.jpg, … of a directory: follow.py SERVER DIRECTORY X Y"""
import pathlib
import sys

from holdfast_client import Client

server, directory, x, y = sys.argv[1:]
frames = (path.read_bytes() for path in sorted(pathlib.Path(directory).glob("*.jpg")))

with Client(server) as client:
    tracks = client.track(frames, [(float(x), float(y))])

for frame, (x, y) in enumerate(tracks.xy[0]):
    print(frame, f"{x:.2f} {y:.2f}", "visible" if tracks.visible[0, frame] else "hidden")
