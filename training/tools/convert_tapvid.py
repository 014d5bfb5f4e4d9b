#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Converts a TAP-Vid pickle (for example tapvid_davis.pkl) into folders of the neutral format
(training/data/readers/neutral.h).

  convert_tapvid.py PICKLE DIRECTORY [--quality 95]

The pickle holds {name: {video [T, H, W, 3] uint8, points [N, T, 2] in 0..1, occluded [N, T]}} or a list of such values;
videos may also be lists of encoded JPEG frames. Positions become pixels as x * (W - 1), y * (H - 1); where a point is
occluded its position is null, since the set's rules score no position there, whatever stands in the file. Needs numpy
and Pillow.

Pickles can run code when they are read. This reader allows numpy arrays and plain containers and refuses all else.
"""
import argparse
import glob
import io
import json
import os
import pickle
import re
import sys

import numpy as np
from PIL import Image

ALLOWED = {
    ("numpy", "ndarray"), ("numpy", "dtype"),
    ("numpy.core.multiarray", "_reconstruct"), ("numpy.core.multiarray", "scalar"),
    ("numpy._core.multiarray", "_reconstruct"), ("numpy._core.multiarray", "scalar"),
    ("_codecs", "encode"), ("collections", "OrderedDict"),
}


class ArrayUnpickler(pickle.Unpickler):
    """Builds arrays and containers, nothing that could do more."""

    def find_class(self, module, name):
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"the pickle asks for {module}.{name}, which no TAP-Vid file needs")
        if module.startswith("numpy._core"):  # written by a newer numpy than this one
            module = module.replace("numpy._core", "numpy.core")
        return super().find_class(module, name)


def frames_of(video):
    """[T, H, W, 3] uint8, from an array or a list of encoded pictures."""
    if isinstance(video, np.ndarray) and video.ndim == 4:
        frames = video
    else:
        frames = np.stack([np.asarray(Image.open(io.BytesIO(bytes(frame))).convert("RGB")) for frame in video])
    if frames.dtype != np.uint8 or frames.shape[-1] != 3 or len(frames) == 0:
        raise ValueError(f"'video' is {frames.dtype} {frames.shape}, not [T, H, W, 3] uint8")
    return frames


def checked(clip):
    """Frames, positions in pixels [N, T, 2] and occlusion [N, T] of one entry."""
    frames = frames_of(clip["video"])
    points, occluded = np.asarray(clip["points"], dtype=np.float64), np.asarray(clip["occluded"]).astype(bool)
    count, height, width = frames.shape[:3]
    if points.ndim != 3 or points.shape[1:] != (count, 2) or occluded.shape != points.shape[:2]:
        raise ValueError(f"'points' {points.shape} and 'occluded' {occluded.shape} do not fit {count} frames")
    return frames, points * [width - 1, height - 1], occluded


def tracks(frames, points, occluded):
    entries = []
    for number, (xy, hidden) in enumerate(zip(points, occluded)):
        labelled = np.flatnonzero(hidden | np.isfinite(xy).all(axis=1))
        entries.append({
            "name": f"p{number}",
            "frames": labelled.tolist(),
            "xy": [None if hidden[i] else np.round(xy[i], 3).tolist() for i in labelled],
            "visible": (~hidden[labelled]).tolist(),
        })
    height, width = frames.shape[1:3]
    return {"width": width, "height": height, "fps": 0, "points": entries}


def remove_clip(directory):
    """What the format names of an older clip, which may be longer than the new one. Tracks first: they make a clip."""
    for pattern in ("tracks.json", "frames/?????.jpg", "frames/?????.png", "masks/?????.jpg", "masks/?????.png"):
        for path in glob.glob(os.path.join(glob.escape(directory), pattern)):
            if pattern == "tracks.json" or os.path.basename(path)[:5].isdigit():
                os.remove(path)


def write_clip(directory, clip, quality):
    frames, points, occluded = checked(clip)
    remove_clip(directory)
    os.makedirs(os.path.join(directory, "frames"), exist_ok=True)
    for number, frame in enumerate(frames):
        path = os.path.join(directory, "frames", f"{number:05d}.jpg")
        Image.fromarray(frame).save(path, quality=quality, subsampling=0)
    with open(os.path.join(directory, "tracks.json"), "w", encoding="utf-8") as file:
        json.dump(tracks(frames, points, occluded), file)
    return len(frames), len(points)


def folder_name(name):
    return re.sub(r"[^A-Za-z0-9._-]", "_", str(name)).strip(".") or "clip"


def main():
    parser = argparse.ArgumentParser(description="Converts a TAP-Vid pickle into folders of the neutral format.")
    parser.add_argument("pickle")
    parser.add_argument("directory")
    parser.add_argument("--quality", type=int, default=95, help="of the JPEG frames, 1 to 100")
    flags = parser.parse_args()
    try:
        with open(flags.pickle, "rb") as file:
            clips = ArrayUnpickler(file).load()
    except (OSError, EOFError, ValueError, pickle.UnpicklingError) as error:
        sys.exit(f"{flags.pickle}: {error}")
    named = clips.items() if isinstance(clips, dict) else ((f"{i:05d}", clip) for i, clip in enumerate(clips))
    failed = 0
    for name, clip in named:
        try:
            frames, points = write_clip(os.path.join(flags.directory, folder_name(name)), clip, flags.quality)
            print(f"{name}: {frames} frames, {points} points")
        except (KeyError, TypeError, ValueError, OSError) as error:
            failed += 1
            print(f"{name}: skipped: {error}", file=sys.stderr)
    if failed:
        sys.exit(f"{failed} clips were skipped")


if __name__ == "__main__":
    main()
