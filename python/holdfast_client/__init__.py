# SPDX-License-Identifier: Apache-2.0
"""Tracks points through video with a Holdfast server.

    from holdfast_client import Client

    with Client("localhost:50051") as client:
        tracks = client.track(frames, points)  # uint8 [H, W, 3] or JPEG bytes; [N, 2]
    tracks.xy  # float32 [N, T, 2]
"""
from ._objects import ObjectRun, ObjectTrack
from ._picture import Picture
from ._session import Run, Update
from .client import Client, Reconnect, Tls
from .errors import (HoldfastError, InvalidRequest, NotAllowed, NotResumable, Overloaded, Unavailable, Violation)
from .session import Session
from .tracks import Tracks

__all__ = ["Client", "HoldfastError", "InvalidRequest", "NotAllowed", "NotResumable", "ObjectRun", "ObjectTrack",
           "Overloaded", "Picture", "Reconnect", "Run", "Session", "Tls", "Tracks", "Unavailable", "Update",
           "Violation"]
