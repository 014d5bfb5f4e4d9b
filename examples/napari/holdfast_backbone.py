# SPDX-License-Identifier: Apache-2.0
"""Holdfast among the trackers of napari-deeplabcut: import it in napari's console, then choose "Holdfast" in the
plugin's tracking widget. The server is HOLDFAST_SERVER, or localhost:50051.

Written against the interface of napari_deeplabcut.tracking.core as published (models.py and data.py). The plugin needs
a desktop: this project tests the backbone against a stand-in with the same signatures, not in napari.
"""
import os
from collections.abc import Sequence

import numpy as np
from holdfast_client import Client
from napari_deeplabcut.tracking.core.data import (RawModelOutputs, TrackingModelInputs, TrackingWorkerOutput,
                                                  expand_query_features_over_time)
from napari_deeplabcut.tracking.core.models import TrackingModel, register_backbone

NAME = "Holdfast"


class Stopped(Exception):
    """The user has had enough."""


def picture(frame):
    """uint8 [H, W] or [H, W, 3] of a frame that may have one channel, or opacity for a fourth."""
    if frame.ndim == 3:
        frame = frame[..., 0] if frame.shape[2] == 1 else frame[..., :3]
    return np.ascontiguousarray(frame)


class Watched(Sequence):
    """A video [T, H, W] or [T, H, W, C] whose user sees how far it was read, and may stop that."""

    def __init__(self, video, progress, stopped):
        self.video, self.progress, self.stopped = video, progress, stopped

    def __len__(self):
        return len(self.video)

    def __getitem__(self, index):
        if self.stopped():
            raise Stopped
        self.progress(index, len(self.video))
        return picture(self.video[index])


@register_backbone(NAME)
class Holdfast(TrackingModel):
    name = NAME
    info_text = "Point tracking by a Holdfast server, forward and backward, on CPU cores."

    def auto_set_device(self):
        return "server"  # the plugin's own would ask torch

    def load_model(self, device):
        return Client(os.environ.get("HOLDFAST_SERVER", "localhost:50051"))

    def prepare_inputs(self, cfg, **kwargs):
        """Key points come as napari has them, frame and then rows before columns; a server takes x before y. What is
        black and what is white in a video of another type than uint8, only its user knows."""
        video = np.asarray(cfg.video)
        if video.dtype != np.uint8:
            raise ValueError(f"the video is {video.dtype}, expected uint8: scale it to 0 .. 255")
        keypoints = np.asarray(cfg.keypoints, float)[:, [0, 2, 1]]
        return TrackingModelInputs(video=video, keypoints=keypoints,
                                   metadata={"keypoint_range": cfg.keypoint_range})

    def run(self, inputs, progress_callback, stop_callback, **kwargs):
        frames = Watched(inputs.video, progress_callback, stop_callback)
        try:
            tracks = self.model.track(frames, inputs.keypoints, both=True, label="napari-deeplabcut")
        except Stopped:
            return None
        progress_callback(len(frames), len(frames))
        return RawModelOutputs(keypoints=tracks.xy.transpose(1, 0, 2),
                               keypoint_features={"visibility": tracks.visible.T})

    def prepare_outputs(self, model_outputs, worker_inputs=None, **kwargs):
        """A row of frame, row and column for each point of each frame, in the order of the queries."""
        frames = np.arange(*map(int, worker_inputs.keypoint_range))
        order = -1 if worker_inputs.backward_tracking else 1  # then the video came in reverse
        tracks = model_outputs.keypoints[::order]
        features = expand_query_features_over_time(
            worker_inputs.keypoint_features, frame_ids=frames,
            visibility=model_outputs.keypoint_features["visibility"][::order], tracker_name=self.name)
        rows = np.column_stack([np.repeat(frames, tracks.shape[1]), tracks.reshape(-1, 2)[:, ::-1]])
        return TrackingWorkerOutput(keypoints=rows, keypoint_features=features)

    def validate_outputs(self, inputs, outputs):
        first, end = map(int, inputs.metadata["keypoint_range"])
        expected = ((end - first) * len(inputs.keypoints), 3)
        if outputs.keypoints.shape != expected:
            return False, f"key points are {list(outputs.keypoints.shape)}, expected {list(expected)}"
        return True, ""
