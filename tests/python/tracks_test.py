# SPDX-License-Identifier: Apache-2.0
"""What becomes of tracks: both directions, files that others read, pictures."""
import asyncio
import base64
import csv
import dataclasses
import io
import pathlib
import tempfile
import unittest
import xml.etree.ElementTree as xml
from datetime import datetime, timezone

import numpy as np
from PIL import Image

import support
from support import FRAMES, PICTURES

import holdfast_client
from holdfast_client import aio

EXPORTS = support.ROOT / "tests" / "data" / "exports"
QUERIES = np.array([[24, 64, 50], [10, 50.5, 30.25], [0, 40, 60]], np.float32)


class BothDirectionsTest(support.ServedTest, unittest.TestCase):
    """Of points that are queried in the middle of a video."""

    def setUp(self):
        client = holdfast_client.Client(self.server.address)
        self.addCleanup(client.close)
        self.track = lambda frames, points, **options: client.track(frames, points, encoding="raw", **options)

    def test_the_past_is_tracked_and_the_future_stays_what_it_was(self):
        forward, tracks = self.track(PICTURES, QUERIES), self.track(PICTURES, QUERIES, both=True)
        self.assertEqual(tracks.xy.shape, (3, FRAMES, 2))
        self.assertFalse(np.isnan(tracks.xy).any())
        self.assertTrue(tracks.final.all())
        for row, (queried, x, y) in enumerate(QUERIES):
            queried = int(queried)
            self.assertTrue(np.isnan(forward.xy[row, :queried]).all())
            for name in ("xy", "visible", "confidence", "final"):
                np.testing.assert_array_equal(getattr(tracks, name)[row, queried:],
                                              getattr(forward, name)[row, queried:])
            truth = np.stack([x + np.arange(queried) - queried, np.full(queried, y)], axis=1)
            np.testing.assert_allclose(tracks.xy[row, :queried], truth, atol=1.5)

    def test_asyncio_does_the_same(self):
        async def track():
            async with aio.Client(self.server.address) as client:
                return await client.track(PICTURES, QUERIES, both=True, encoding="raw")
        np.testing.assert_array_equal(asyncio.run(track()).xy, self.track(PICTURES, QUERIES, both=True).xy)

    def test_frames_that_can_be_read_only_once_are_refused_at_once(self):
        frames = iter(PICTURES)
        with self.assertRaisesRegex(TypeError, r"both=True .* list\(frames\), not list_iterator"):
            self.track(frames, QUERIES, both=True)
        self.assertIs(next(frames), PICTURES[0])

    def test_points_of_the_first_frame_need_no_second_session(self):
        completed = 'holdfast_sessions_total{outcome="completed"}'
        before = self.server.metric(completed)
        self.track(PICTURES, support.POINTS, both=True)
        self.assertEqual(self.server.metric(completed), before + 1)


def made_up():
    """Two points over five frames: 7 comes on frame 1 and hides on 2; 9 goes after 2, beyond the right edge."""
    xy = np.full((2, 5, 2), np.nan, np.float32)
    xy[0, 1:] = [[1.25, 2], [2, 2.5], [3, 3], [4, 3.5]]
    xy[1, :3] = [[60, 40], [63.4, 41], [66, 42]]
    visible = ~np.isnan(xy[:, :, 0])
    visible[0, 2] = False
    confidence = np.where(np.isnan(xy[:, :, 0]), 0, 0.75).astype(np.float32)
    return holdfast_client.Tracks(np.array([7, 9], np.uint64), xy, visible, confidence, visible.copy())


def of_the_command_lines_test():
    """The tracks of tests/client/cli/track_exports_test.cc."""
    xy = np.full((3, 5, 2), np.nan, np.float32)
    xy[0, :2] = [[1.25, 10], [2.0004, 20]]
    xy[1, [0, 1, 3, 4]] = [[5, -0.5], [6, 30], [8, 31], [9, 32]]
    xy[2, 1:] = [[61, 40], [62, 41], [63.4, 42], [63.5, 43]]
    visible = ~np.isnan(xy[:, :, 0])
    visible[1:, 1] = False
    confidence = np.where(visible, 1, 0).astype(np.float32)
    confidence[:, :2] = [[0.5, 0.25], [0.75, 0.0625], [0, 0.125]]
    return holdfast_client.Tracks(np.array([4, 7, 9], np.uint64), xy, visible, confidence, visible.copy())


class FilesTest(unittest.TestCase):
    def setUp(self):
        self.tracks = made_up()
        directory = tempfile.TemporaryDirectory()
        self.addCleanup(directory.cleanup)
        self.path = pathlib.Path(directory.name) / "file"

    def test_arrays_come_back_from_npz(self):
        self.tracks.to_npz(self.path.with_suffix(".npz"))
        read = np.load(self.path.with_suffix(".npz"))
        for name in ("ids", "xy", "visible", "confidence", "final"):
            np.testing.assert_array_equal(read[name], getattr(self.tracks, name))
        np.testing.assert_array_equal(read["query_frames"], [1, 0])
        self.assertNotIn("size", read)
        self.assertNotIn("capture_times", read)

    def test_what_is_not_final_is_told_in_npz(self):
        self.tracks.final[0, 2:] = False
        tracks = dataclasses.replace(self.tracks, sent=8, capture_times={1: datetime.fromtimestamp(2.5, timezone.utc)})
        tracks.to_npz(self.path.with_suffix(".npz"))
        read = np.load(self.path.with_suffix(".npz"))
        self.assertFalse(read["complete"])
        self.assertEqual((read["final_frames"], read["expected_frames"]), (2, 8))
        np.testing.assert_array_equal(read["capture_times"], [np.nan, 2.5, np.nan, np.nan, np.nan])

    def test_csv_has_a_line_for_each_known_sample(self):
        self.tracks.to_csv(self.path)
        lines = self.path.read_text(encoding="utf-8").splitlines()
        self.assertEqual(lines[:2], ["id,frame,x,y,visible,confidence", "7,1,1.250,2.000,1,0.750"])
        self.assertEqual(len(lines), 1 + 4 + 3)

    def test_other_programs_get_the_files_of_the_command_line(self):
        tracks, names = of_the_command_lines_test(), {4: 'nose, "left" <1>', 7: "paw"}
        tracks.to_dlc_csv(self.path, names=names)
        self.assertEqual(self.path.read_bytes(), (EXPORTS / "tracks.dlc.csv").read_bytes())
        tracks.to_cvat_xml(self.path, size=(64, 48), names=names)
        self.assertEqual(self.path.read_bytes(), (EXPORTS / "tracks.xml").read_bytes())

    def test_body_parts_are_told_apart(self):
        tracks = holdfast_client.Tracks(np.arange(1, 5, dtype=np.uint64), np.zeros((4, 0, 2)), *[np.zeros((4, 0))] * 3)
        tracks.to_dlc_csv(self.path, scorer="me", names={1: "paw", 2: "paw", 4: "paw_2"})
        with open(self.path, newline="", encoding="utf-8") as file:
            scorer, bodyparts, _ = csv.reader(file)
        self.assertEqual(scorer, ["scorer"] + ["me"] * 12)
        self.assertEqual(bodyparts[1::3], ["paw", "paw_2", "3", "paw_2_4"])

    def test_characters_that_xml_has_not_are_left_out(self):
        self.tracks.to_cvat_xml(self.path, names={7: "a\x01b\0c", 9: "9"})
        root = xml.parse(self.path).getroot()
        self.assertEqual([track.get("label") for track in root.iter("track")], ["a b c", "point"])
        self.assertEqual([name.text for name in root.findall("meta/task/labels/label/name")], ["a b c", "point"])

    def test_cvat_gets_no_track_without_a_shape(self):
        self.tracks.xy[1] = np.nan
        self.tracks.to_cvat_xml(self.path, names={7: "nose", 9: "late"})
        root = xml.parse(self.path).getroot()
        self.assertEqual([track.get("label") for track in root.iter("track")], ["nose"])
        self.assertEqual([name.text for name in root.findall("meta/task/labels/label/name")], ["nose"])

    def test_without_a_size_no_position_is_beyond_it(self):
        self.tracks.to_cvat_xml(self.path)
        root = xml.parse(self.path).getroot()
        self.assertIsNone(root.find("meta/task/original_size"))
        self.assertEqual([shape.get("outside") for shape in root.findall("track/points")], list("0000" + "0001"))

    def test_shapes_end_where_only_the_first_frames_of_a_video_were_tracked(self):
        self.tracks.to_cvat_xml(self.path, frames=8)
        root = xml.parse(self.path).getroot()
        self.assertEqual(root.find("meta/task/size").text, "8")
        nose, tail = [[(shape.get("frame"), shape.get("outside")) for shape in track.iter("points")]
                      for track in root.iter("track")]
        self.assertEqual(nose, [("1", "0"), ("2", "0"), ("3", "0"), ("4", "0"), ("5", "1")])
        self.assertEqual(tail, [("0", "0"), ("1", "0"), ("2", "0"), ("3", "1")])
        with self.assertRaisesRegex(ValueError, "frames is 4, but 5 were tracked"):
            self.tracks.to_cvat_xml(self.path, frames=4)


class PictureTest(unittest.TestCase):
    def setUp(self):
        self.tracks = made_up()

    def parse(self, picture):
        return xml.fromstring(picture.svg)

    def shapes(self, picture, name):
        return self.parse(picture).findall(f"{{http://www.w3.org/2000/svg}}{name}")

    def test_a_picture_has_trails_and_positions(self):
        picture = self.tracks.show(at=2)
        self.assertEqual([line.get("points") for line in self.shapes(picture, "polyline")],
                         ["1.75,2.50 2.50,3.00", "60.50,40.50 63.90,41.50 66.50,42.50"])
        hidden, visible = self.shapes(picture, "circle")
        self.assertEqual((hidden.get("cx"), hidden.get("fill")), ("2.50", "none"))
        self.assertEqual(visible.get("fill"), visible.get("stroke"))
        self.assertNotEqual(visible.get("stroke"), hidden.get("stroke"))
        self.assertEqual(len(self.shapes(self.tracks.show(), "circle")), 1)  # 9 is gone
        self.assertEqual([line.get("points") for line in self.shapes(self.tracks.show(at=3, trail=0), "polyline")],
                         ["3.50,3.50"])
        with self.assertRaises(IndexError):
            self.tracks.show(at=5)

    def test_a_frame_lies_under_them(self):
        file = io.BytesIO()
        Image.fromarray(PICTURES[3]).save(file, "JPEG", quality=95)
        colour = np.stack([PICTURES[3], PICTURES[4], PICTURES[5]], axis=2)
        for frame, tolerance in ((PICTURES[3], 0), (colour, 0), (file.getvalue(), 8)):
            (image,) = self.shapes(self.tracks.show(frame), "image")
            self.assertEqual((image.get("width"), image.get("height")), ("128", "96"))
            shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(image.get("href").split(",")[1]))))
            expected = PICTURES[3] if isinstance(frame, bytes) else frame
            self.assertEqual(shown.shape, expected.shape)
            self.assertLessEqual(np.abs(shown.astype(int) - expected).max(), tolerance)
        with self.assertRaisesRegex(ValueError, "neither JPEG nor PNG"):
            self.tracks.show(b"GIF89a")

    def test_a_frame_is_shown_as_it_is_stored(self):
        file, turned = io.BytesIO(), Image.Exif()
        turned[0x0112] = 6  # of ways to be turned, by a quarter
        Image.fromarray(PICTURES[3]).save(file, "JPEG", exif=turned, icc_profile=b"a profile")
        (image,) = self.shapes(self.tracks.show(file.getvalue()), "image")
        shown = Image.open(io.BytesIO(base64.b64decode(image.get("href").split(",")[1])))
        self.assertEqual((dict(shown.getexif()), shown.info["icc_profile"]), ({}, b"a profile"))
        np.testing.assert_array_equal(np.asarray(shown), np.asarray(Image.open(file)))

    def test_a_notebook_shows_tracks_by_themselves(self):
        html = self.tracks._repr_html_()
        self.assertIn("2 points, 5 frames", html)
        self.assertIn("<polyline", html)
        xy = np.random.default_rng(1).uniform(100, 1000, (250, 10_000, 2)).astype(np.float32)
        known = np.ones(xy.shape[:2], bool)
        html = holdfast_client.Tracks(np.arange(250, dtype=np.uint64), xy, known, known, known)._repr_html_()
        self.assertIn("250 points, 10000 frames; 100 points at 200 frames are shown", html)
        self.assertEqual(html.count("<circle"), 100)
        self.assertLess(len(html), 500_000)
        none = self.tracks
        none.ids, none.xy, none.visible = none.ids[:0], none.xy[:0, :0], none.visible[:0, :0]
        self.assertEqual(none._repr_html_(), "<p>0 points, 0 frames</p>")


if __name__ == "__main__":
    support.main()
