# SPDX-License-Identifier: Apache-2.0
"""What examples/blender_import.py makes of real tracks, read back from Blender (Debian's package "blender").

Usage: blender_test.py HOLDFAST_SERVER HOLDFAST
"""
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

from server_process import SOURCE, VIDEO, ServerProcess

FRAMES = 30
WIDTH, HEIGHT = 768, 576
READ_BACK = """
import json, sys
import bpy
clip = bpy.data.movieclips[0]
markers = {track.name: {m.frame: [*m.co] for m in track.markers if not m.mute} for track in clip.tracking.tracks}
disabled = {track.name: [m.frame for m in track.markers if m.mute] for track in clip.tracking.tracks}
json.dump([[*clip.size], markers, disabled], open(sys.argv[-1], "w"))
"""


@unittest.skipUnless(shutil.which("blender"), "there is no blender: the import of tracks is not tested")
class BlenderTest(unittest.TestCase):
    server_program = client_program = None

    def test_markers_lie_where_the_points_are(self):
        server = ServerProcess(self.server_program, "--processing_size=256x192", "--iterations=2",
                               "--compute_threads=1", "--precision=float32")
        self.addCleanup(server.stop)
        with tempfile.TemporaryDirectory(prefix="holdfast-blender-") as name:
            directory = pathlib.Path(name)
            (directory / "points.json").write_text(json.dumps(
                [{"id": 1, "x": 268, "y": 224, "name": "head"}, {"id": 2, "x": 0, "y": 575},
                 {"id": 3, "x": 767, "y": 0}, {"id": 4, "x": 513, "y": 162, "frame": 4}]))
            for file in ("t.json", "t.3de.txt"):
                subprocess.run([self.client_program, "track", VIDEO, f"--server={server.address}",
                                f"--points={directory / 'points.json'}", f"--max_frames={FRAMES}",
                                f"--out={directory / file}"], check=True, stderr=subprocess.DEVNULL)
            size, markers, disabled = self.read_back(directory)
            points = json.loads((directory / "t.json").read_text())["points"]
        self.assertEqual(size, [WIDTH, HEIGHT])
        self.assertEqual(sorted(markers), ["2", "3", "4", "head"])
        for point in points:
            # The centre of the first pixel lies half a pixel from the corner; y goes up; the first frame is number 1.
            wanted = {frame + 1: ((x + 0.5) / WIDTH, 1 - (y + 0.5) / HEIGHT)
                      for frame, (x, y), visible in zip(point["frames"], point["xy"], point["visible"]) if visible}
            got = {int(frame): co for frame, co in markers[point["name"]].items()}
            self.assertEqual(sorted(got), sorted(wanted), point["name"])
            for frame, (x, y) in wanted.items():
                # The .json is rounded to thousandths of a pixel.
                self.assertAlmostEqual(got[frame][0] * WIDTH, x * WIDTH, delta=6e-4)
                self.assertAlmostEqual(got[frame][1] * HEIGHT, y * HEIGHT, delta=6e-4)
                self.assertAlmostEqual(got[frame][0], x, delta=1e-4)
                self.assertAlmostEqual(got[frame][1], y, delta=1e-4)
            self.assertEqual(disabled[point["name"]], [f + 1 for f in sorted(wanted) if f + 1 not in wanted])

    @staticmethod
    def read_back(directory):
        (directory / "read_back.py").write_text(READ_BACK)
        subprocess.run(["blender", "--background", "--factory-startup", "--python-exit-code", "1",
                        "--python", SOURCE / "examples" / "blender_import.py", "--",
                        directory / "t.3de.txt", VIDEO, directory / "scene.blend"],
                       check=True, stdout=subprocess.DEVNULL)
        subprocess.run(["blender", "--background", directory / "scene.blend", "--python-exit-code", "1",
                        "--python", directory / "read_back.py", "--", directory / "markers.json"],
                       check=True, stdout=subprocess.DEVNULL)
        return json.loads((directory / "markers.json").read_text())


if __name__ == "__main__":
    BlenderTest.server_program, BlenderTest.client_program = sys.argv[1:3]
    unittest.main(argv=[sys.argv[0], *sys.argv[3:]], verbosity=2)
