# SPDX-License-Identifier: Apache-2.0
"""Tracks of `holdfast track --out=tracks.3de.txt` as tracking markers of a Blender movie clip.

Usage: blender --background --python blender_import.py -- TRACKS.3de.txt VIDEO [SCENE.blend]

The scene is saved where one is named; without --background the markers are there to be looked at. The file has pixels
from the lower left corner of the picture, where Blender counts from too, in parts of its width and height; frame 1 is
the first of both. Where a point was hidden its marker is disabled, so that a camera solve does not count on it.
"""
import itertools
import os
import sys

import bpy


def read_curves(path):
    """Yields each point's name and its keys {frame: (x, y)}."""
    with open(path, encoding="utf-8") as file:
        lines = (line.rstrip("\n") for line in file)
        for _ in range(int(next(lines))):
            name = next(lines)
            next(lines)  # a colour
            keys = map(str.split, list(itertools.islice(lines, int(next(lines)))))
            yield name, {int(frame): (float(x), float(y)) for frame, x, y in keys}


def add_track(clip, name, keys):
    """One track whose markers lie where the keys say."""
    width, height = clip.size
    track = clip.tracking.tracks.new(name=name, frame=min(keys))
    for frame, (x, y) in keys.items():
        track.markers.insert_frame(frame, co=(x / width, y / height))
    # A marker holds until the next one: the first frame of a gap says that there is none.
    for frame in (frame + 1 for frame in keys if frame + 1 not in keys and frame < clip.frame_duration):
        x, y = keys[frame - 1]
        track.markers.insert_frame(frame, co=(x / width, y / height)).mute = True


def import_tracks(path, video):
    """The clip with its tracks."""
    clip = bpy.data.movieclips.load(os.path.abspath(video))
    bpy.context.scene.active_clip = clip  # what nothing uses is not saved
    for name, keys in read_curves(path):
        if keys:
            add_track(clip, name, keys)
    return clip


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1:]
    imported = import_tracks(*arguments[:2])
    print(f"{len(imported.tracking.tracks)} tracks on {imported.frame_duration} frames")
    if len(arguments) > 2:
        bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath(arguments[2]))
