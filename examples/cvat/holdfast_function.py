# SPDX-License-Identifier: Apache-2.0
"""Holdfast as an AI tracker of CVAT, for shapes of the type "points": an auto-annotation function for an agent.

  cvat-cli function create-native Holdfast --function-file=holdfast_function.py
  cvat-cli function run-agent ID --function-file=holdfast_function.py

The server is HOLDFAST_SERVER, or localhost:50051; each shape that is tracked is a session of it (--max_sessions).
Written against the TrackingFunction interface of cvat_sdk.auto_annotation as published. Agents need CVAT Online or
Enterprise: this project tests the function against a stand-in with the same signatures, not in CVAT.
"""
import os

import cvat_sdk.auto_annotation as cvataa
import numpy as np
from holdfast_client import Client, HoldfastError

PATIENCE = 30  # seconds for an estimate to come

spec = cvataa.TrackingFunctionSpec(supported_shape_types=["points"])
client = Client(os.environ.get("HOLDFAST_SERVER", "localhost:50051"))


class Followed:
    """The points of a shape, followed from one image to the next."""

    def __init__(self, image, points):
        self.image = image  # the newest one
        self.points = points.clip(0, np.array(image.shape[1::-1]) - 1)  # a click may lie on the picture's very edge
        self.begin()

    def __del__(self):
        self.session.cancel()

    def begin(self):
        """On the newest image, with the points that are in it: the server takes no others, which stay hidden where they
        were."""
        inside = ((self.points >= 0) & (self.points <= np.array(self.image.shape[1::-1]) - 1)).all(axis=1)
        self.followed = {int(i): tuple(self.points[i]) for i in np.flatnonzero(inside)}
        self.session = client.session(self.followed, every_frame=True, label="cvat")
        self.session.push(self.image)
        self.frame = 0

    def go_on(self, image):
        """Whether each point is visible on the image that follows; self.points, [N, 2], are where."""
        try:
            visible = self.step(image)
        except HoldfastError:  # the user has paused for longer than the server waits
            self.session.cancel()
            self.begin()
            visible = self.step(image)
        self.image = image
        return visible

    def step(self, image):
        self.frame += 1
        updates = self.session.push(image)
        newest = {}  # (position, visible) by point
        while True:
            for run in (run for update in updates for run in update.runs):
                if run.first_frame + len(run.xy) > self.frame:
                    newest[run.id] = run.xy[-1], run.visible[-1]
            if len(newest) == len(self.followed):
                break
            updates = self.session.updates(timeout=PATIENCE)
            if not updates:
                raise TimeoutError(f"no estimate of the newest image within {PATIENCE} s")
        visible = [False] * len(self.points)
        for i, (position, seen) in newest.items():
            self.points[i], visible[i] = position, seen
        return visible


def preprocess_image(context, image):
    return np.asarray(image.convert("RGB"))


def init_tracking_state(context, pp_image, shape):
    return Followed(pp_image, np.reshape(shape.points, (-1, 2)).astype(np.float32))


def track(context, pp_image, state):
    visible = state.go_on(pp_image)
    return cvataa.TrackableShape(type="points", points=state.points.ravel().tolist()) if any(visible) else None
