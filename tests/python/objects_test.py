# SPDX-License-Identifier: Apache-2.0
"""Objects as they are asked for; no server takes part."""
import unittest

import numpy as np

import support
from holdfast_client._objects import to_objects

CORNERS = [(20, 30), (60, 30), (60, 70)]


class ObjectsTest(unittest.TestCase):
    def sent(self, shape):
        (sent,) = to_objects({1: shape})
        return sent

    def test_corners_are_a_polygon_whatever_their_type(self):
        for corners in (CORNERS, *(np.array(CORNERS, kind) for kind in (np.uint8, np.int64, np.float32))):
            with self.subTest(corners=corners):
                polygon = self.sent(corners).polygon
                self.assertEqual(list(zip(polygon.x, polygon.y)), CORNERS)

    def test_a_mask_is_a_picture(self):
        for mask in (np.ones((4, 6), np.uint8), np.ones((4, 6), bool), np.ones((4, 2), bool)):
            with self.subTest(mask=mask):
                self.assertTrue(self.sent(mask).mask_png.startswith(b"\x89PNG"))


if __name__ == "__main__":
    support.main()
