# SPDX-License-Identifier: Apache-2.0
"""Trackers for other programs, against stand-ins for these: modules with the names and signatures that
napari_deeplabcut.tracking.core and cvat_sdk.auto_annotation publish. Neither program runs here."""
import dataclasses
import importlib.util
import os
import sys
import types
import unittest
from typing import Any
from unittest import mock

import grpc
import numpy as np
from PIL import Image

import support
from support import FRAMES, PICTURES, POINTS, ROOT

import holdfast_client

COLOUR = np.stack([np.stack([picture] * 3, axis=2) for picture in PICTURES])


def module(name, **names):
    made = types.ModuleType(name)
    made.__dict__.update(names)
    return made


@dataclasses.dataclass
class TrackingWorkerData:
    tracker_name: str
    video: np.ndarray
    keypoints: np.ndarray
    keypoint_features: Any
    keypoint_range: tuple
    backward_tracking: bool
    reference_frame_index: int = None


TrackingModelInputs = dataclasses.make_dataclass("TrackingModelInputs", ["video", "keypoints", "metadata"], frozen=True)
RawModelOutputs = dataclasses.make_dataclass("RawModelOutputs", ["keypoints", "keypoint_features"])
TrackingWorkerOutput = dataclasses.make_dataclass("TrackingWorkerOutput", ["keypoints", "keypoint_features"],
                                                  frozen=True)


class TrackingModel:
    def __init__(self, cfg):
        self.cfg = cfg
        self.device = self.auto_set_device()
        self.model = self.load_model(self.device)


def expand_query_features_over_time(seed_features, *, frame_ids, visibility, tracker_name):
    assert visibility.shape == (len(frame_ids), len(seed_features))
    return {"label": list(seed_features) * len(frame_ids), "visibility": visibility.ravel(), "tracker": tracker_name}


def napari(trackers):
    def register_backbone(name):
        return lambda tracker: trackers.setdefault(name, tracker)
    data = module("data", RawModelOutputs=RawModelOutputs, TrackingModelInputs=TrackingModelInputs,
                  TrackingWorkerOutput=TrackingWorkerOutput,
                  expand_query_features_over_time=expand_query_features_over_time)
    package = "napari_deeplabcut.tracking.core"
    return {f"{package}.data": data,
            f"{package}.models": module("models", TrackingModel=TrackingModel, register_backbone=register_backbone),
            **{name: module(name) for name in ("napari_deeplabcut", "napari_deeplabcut.tracking", package)}}


class TrackableShape(types.SimpleNamespace):
    def __init__(self, *, type, points):  # pylint: disable=redefined-builtin
        super().__init__(type=type, points=list(points))


class TrackingFunctionSpec(types.SimpleNamespace):
    def __init__(self, *, supported_shape_types):
        super().__init__(supported_shape_types=frozenset(supported_shape_types))


def cvat():
    functions = module("cvat_sdk.auto_annotation", TrackableShape=TrackableShape,
                       TrackingFunctionSpec=TrackingFunctionSpec)
    return {"cvat_sdk": module("cvat_sdk", auto_annotation=functions), "cvat_sdk.auto_annotation": functions}


class ExamplesTest(support.ServedTest, unittest.TestCase):
    def load(self, path, modules):
        """Imports an example beside 'modules'; its server is this test's."""
        spec = importlib.util.spec_from_file_location("example", ROOT / "examples" / path)
        example = importlib.util.module_from_spec(spec)
        with mock.patch.dict(sys.modules, modules), mock.patch.dict(os.environ, HOLDFAST_SERVER=self.server.address):
            spec.loader.exec_module(example)
            if hasattr(example, "client"):
                self.addCleanup(example.client.close)
        return example

    def run_in_napari(self, backward, queried=0, stop=lambda: False, video=COLOUR):
        trackers, progress = {}, []
        self.load("napari/holdfast_backbone.py", napari(trackers))
        keypoints = np.column_stack([np.full(len(POINTS), queried), POINTS[:, ::-1]])  # frame, row, column
        worker = TrackingWorkerData("Holdfast", video[::-1] if backward else video, keypoints, ["a", "b", "c"],
                                    (100, 100 + FRAMES), backward)
        with mock.patch.dict(os.environ, HOLDFAST_SERVER=self.server.address):
            tracker = trackers["Holdfast"](worker)
        self.addCleanup(tracker.model.close)
        inputs = tracker.prepare_inputs(worker)
        raw = tracker.run(inputs, lambda *done: progress.append(done), stop)
        if raw is None:
            return None
        self.assertEqual(progress[-1], (FRAMES, FRAMES))
        outputs = tracker.prepare_outputs(raw, worker_inputs=worker)
        self.assertEqual(tracker.validate_outputs(inputs, outputs), (True, ""))
        self.assertEqual(outputs.keypoint_features["label"][:4], ["a", "b", "c", "a"])
        np.testing.assert_array_equal(outputs.keypoints[:, 0], np.repeat(np.arange(100, 100 + FRAMES), 3))
        return outputs.keypoints.reshape(FRAMES, 3, 3)

    def test_napari_tracks_forward(self):
        rows = self.run_in_napari(backward=False)
        np.testing.assert_allclose(rows[20, :, 1:], POINTS[:, ::-1] + [0, 20], atol=1.5)

    def test_napari_tracks_backward(self):
        rows = self.run_in_napari(backward=True)
        np.testing.assert_allclose(rows[-1, :, 1:], POINTS[:, ::-1], atol=1e-3)
        np.testing.assert_allclose(rows[-21, :, 1:], POINTS[:, ::-1] - [0, 20], atol=1.5)

    def test_napari_queries_in_the_middle(self):
        rows = self.run_in_napari(backward=False, queried=10)
        np.testing.assert_allclose(rows[10, :, 1:], POINTS[:, ::-1], atol=1e-3)
        self.assertFalse(np.isnan(rows).any())

    def test_napari_has_grey_videos_too(self):
        grey = np.stack(PICTURES)
        opaque = np.concatenate([COLOUR, np.full_like(COLOUR[..., :1], 255)], axis=3)
        for video in (grey, grey[..., None], opaque):
            rows = self.run_in_napari(backward=False, video=video)
            np.testing.assert_allclose(rows[20, :, 1:], POINTS[:, ::-1] + [0, 20], atol=1.5)

    def test_napari_says_that_a_video_has_to_be_scaled(self):
        for video in (COLOUR / 255, COLOUR.astype(np.uint16) * 256):
            with self.assertRaisesRegex(ValueError, f"the video is {video.dtype}, expected uint8: scale it"):
                self.run_in_napari(backward=False, video=video)

    def test_a_user_of_napari_may_stop(self):
        answers = iter([False] * 5)
        self.assertIsNone(self.run_in_napari(backward=False, stop=lambda: next(answers, True)))

    def test_cvat_follows_shapes_from_image_to_image(self):
        cancelled = self.server.metric('holdfast_sessions_total{outcome="cancelled"}')
        function = self.load("cvat/holdfast_function.py", cvat())
        self.assertEqual(function.spec.supported_shape_types, {"points"})
        images = [function.preprocess_image(None, Image.fromarray(picture)) for picture in PICTURES[:30]]
        context = types.SimpleNamespace(original_shape_type="points")
        states = [function.init_tracking_state(context, images[0], TrackableShape(type="points", points=points))
                  for points in (POINTS[:2].ravel(), POINTS[2])]
        for count, image in enumerate(images[1:], 1):
            if count == 10:  # a server that has waited for too long has ended it
                states[0].session.push = self.late
            shapes = [function.track(context, image, state) for state in states]
            for shape, points in zip(shapes, (POINTS[:2], POINTS[2:])):
                self.assertEqual(shape.type, "points")
                moved = np.reshape(shape.points, (-1, 2)) - points
                np.testing.assert_allclose(moved, [[count, 0]] * len(points), atol=2)
        del states  # and with them their sessions
        self.server.wait_for_metric('holdfast_sessions_total{outcome="cancelled"}', cancelled + 3)

    def test_cvat_goes_on_after_a_pause_without_points_that_have_left(self):
        function = self.load("cvat/holdfast_function.py", cvat())
        images = [function.preprocess_image(None, Image.fromarray(picture)) for picture in PICTURES[:4]]
        context = types.SimpleNamespace(original_shape_type="points")
        clicked = [*POINTS[0], support.WIDTH - 0.4, 40]
        state = function.init_tracking_state(context, images[0], TrackableShape(type="points", points=clicked))
        np.testing.assert_array_equal(state.points[1], [support.WIDTH - 1, 40])
        function.track(context, images[1], state)
        state.points[1] = [support.WIDTH + 5, 40]
        state.session.push = self.late
        for count, image in enumerate(images[2:], 2):
            shape = function.track(context, image, state)
            np.testing.assert_allclose(shape.points[:2], POINTS[0] + [count, 0], atol=2)
            self.assertEqual(shape.points[2:], [support.WIDTH + 5, 40])
        self.assertEqual(state.go_on(images[3])[1], False)

    @staticmethod
    def late(image):
        raise holdfast_client.HoldfastError(grpc.StatusCode.DEADLINE_EXCEEDED, "nothing came")


if __name__ == "__main__":
    support.main()
