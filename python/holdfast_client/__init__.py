# SPDX-License-Identifier: Apache-2.0
"""Tracks points through video with a Holdfast server.

    from holdfast_client import Client

    with Client("localhost:50051") as client:
        tracks = client.track(frames, points)  # uint8 [H, W, 3] or JPEG bytes; [N, 2]
    tracks.xy  # float32 [N, T, 2]

Live, a frame at a time:

    with client.session(points, every_frame=True) as session:
        for frame in camera:
            for update in session.push(frame):
                ...  # update.runs: estimates that are new or revised
        tracks = session.finish()

client.track(frames, [], objects={1: mask}) follows what a mask or a polygon covers, as a group: tracks.objects[1].
holdfast_client.aio has the same names for asyncio.
"""
from ._objects import ObjectRun, ObjectTrack
from ._picture import Picture
from ._session import Run, Update
from .client import Client, Reconnect, Tls
from .errors import (HoldfastError, HoldfastWarning, InvalidRequest, NotAllowed, NotResumable, Overloaded, Unavailable,
                     Violation)
from .session import Session
from .tracks import Tracks

__all__ = ["Client", "HoldfastError", "HoldfastWarning", "InvalidRequest", "NotAllowed", "NotResumable", "ObjectRun",
           "ObjectTrack", "Overloaded", "Picture", "Reconnect", "Run", "Session", "Tls", "Tracks", "Unavailable",
           "Update", "Violation"]
