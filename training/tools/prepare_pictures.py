#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Chooses and resizes the pictures of one package for synthetic clips.

  prepare_pictures.py objects|backgrounds PACKAGE DIRECTORY < paths

Writes DIRECTORY/objects/*.png or DIRECTORY/backgrounds/*.jpg and adds a line for each to DIRECTORY/LICENCES.txt.
Plain, tiny and doubled pictures are left out: nothing can be learnt from tracking a flat colour.
"""
import hashlib
import os
import sys
import warnings

import numpy as np
from PIL import Image

MAX_OBJECTS = 1200  # of a package, spread over its folders
MAX_BACKGROUNDS = 260
OBJECT_SIDE = 384  # pixels, largest
BACKGROUND_SIDE = 960


def detail(picture, opaque):
    """Mean step between neighbouring pixels (grey levels) where opaque, and the deviation of the colours."""
    grey = np.asarray(picture.convert("L"), dtype=np.float32)
    across = np.abs(np.diff(grey, axis=1))[:, :][opaque[:, 1:] & opaque[:, :-1]]
    colours = np.asarray(picture.convert("RGB"), dtype=np.float32)[opaque]
    return (across.mean() if across.size else 0.0), (colours.std(axis=0).mean() if colours.size else 0.0)


def shrunk(picture, side):
    scale = side / max(picture.size)
    if scale >= 1:
        return picture
    return picture.resize([max(1, round(n * scale)) for n in picture.size], Image.LANCZOS)


def as_object(picture):
    """The picture cut to what is opaque; None if it is not a good object."""
    if picture.mode not in ("RGBA", "LA", "PA", "P"):
        return None
    picture = picture.convert("RGBA")
    box = picture.getchannel("A").point(lambda a: 255 if a > 127 else 0).getbbox()
    if box is None:
        return None
    picture = shrunk(picture.crop(box), OBJECT_SIDE)
    opaque = np.asarray(picture.getchannel("A")) > 127
    if min(picture.size) < 40 or max(picture.size) > 6 * min(picture.size):
        return None
    if not 0.2 < opaque.mean() < 0.995:  # a wire frame, or a whole rectangle
        return None
    steps, spread = detail(picture, opaque)
    return picture if steps > 1.5 and spread > 18 else None


def busy_share(picture):
    """Share of a 4 x 4 grid of cells that have something in them."""
    grey = np.asarray(picture.convert("L"), dtype=np.float32)
    rows, columns = grey.shape[0] // 4 * 4, grey.shape[1] // 4 * 4
    cells = grey[:rows, :columns].reshape(4, rows // 4, 4, columns // 4)
    return (cells.std(axis=(1, 3)) > 4).mean()


def empty_share(picture):
    """Share of the commonest brightness: large in drawings on black and in sheets of parts."""
    grey = np.asarray(picture.convert("L"))
    return np.bincount(grey.ravel() // 4).max() / grey.size


def is_normal_map(picture):
    """Textures of games that hold directions, not colours: bluish all over."""
    red, green, blue = np.asarray(picture, dtype=np.float32).reshape(-1, 3).mean(axis=0)
    return blue > 200 and abs(red - 128) < 25 and abs(green - 128) < 25


def as_background(picture):
    if min(picture.size) < 256:
        return None
    if "A" in picture.getbands() or picture.mode == "P":
        rgba = picture.convert("RGBA")
        if np.asarray(rgba.getchannel("A")).min() < 250:
            return None
    picture = shrunk(picture.convert("RGB"), BACKGROUND_SIDE)
    if min(picture.size) < 200 or is_normal_map(picture):
        return None
    steps, spread = detail(picture, np.ones(picture.size[::-1], dtype=bool))
    full = busy_share(picture) > 0.8 and empty_share(picture) < 0.25
    return picture if steps > 0.8 and spread > 12 and full else None


def chosen_order(paths):
    """Folders in turn, so that no folder fills the quota; inside one in an order that does not follow the names."""
    folders = {}
    for path in sorted(paths, key=lambda p: hashlib.sha1(os.path.basename(p).encode()).digest()):
        folders.setdefault(os.path.dirname(path), []).append(path)
    queues = [folders[name] for name in sorted(folders)]
    while queues:
        for queue in queues:
            yield queue.pop(0)
        queues = [queue for queue in queues if queue]


def open_picture(path):
    """The decoded picture; None if it cannot be read."""
    try:
        with Image.open(path) as picture:
            picture.load()
            return picture.copy()
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None


def save(picture, kind, package, number, directory):
    name = f"{package}-{number:04d}" + (".png" if kind == "objects" else ".jpg")
    path = os.path.join(directory, kind, name)
    if kind == "objects":
        picture.save(path, optimize=True)
    else:
        picture.save(path, quality=92)
    return f"{kind}/{name}"


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in ("objects", "backgrounds"):
        sys.exit(__doc__)
    kind, package, directory = sys.argv[1:]
    warnings.simplefilter("ignore")
    convert, quota = (as_object, MAX_OBJECTS) if kind == "objects" else (as_background, MAX_BACKGROUNDS)
    os.makedirs(os.path.join(directory, kind), exist_ok=True)
    paths = [line.rstrip("\n") for line in sys.stdin]
    seen, kept = set(), 0
    with open(os.path.join(directory, "LICENCES.txt"), "a", encoding="utf-8") as listing:
        for path in chosen_order(paths):
            if kept == quota:
                break
            picture = open_picture(path)
            picture = convert(picture) if picture else None
            if picture is None:
                continue
            look = picture.convert("RGB").resize((8, 8)).tobytes()  # the same picture in several sizes is one
            if look in seen:
                continue
            seen.add(look)
            listing.write(f"{save(picture, kind, package, kept, directory)}\t{path}\tlicences/{package}.txt\n")
            kept += 1
    print(f"{package}: {kept} of {len(paths)} pictures kept as {kind}", file=sys.stderr)


if __name__ == "__main__":
    main()
