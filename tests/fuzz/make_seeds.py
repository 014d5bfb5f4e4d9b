# SPDX-License-Identifier: Apache-2.0
"""Writes the first inputs of the fuzz targets: small sound ones, from which libFuzzer finds its way.

Usage: make_seeds.py [CORPUS]    (default: corpus/ beside this file; what lies there already stays)
"""
import io
import json
import pathlib
import struct
import subprocess
import sys
import tempfile
import zipfile
import zlib

import numpy
from PIL import Image

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parent.parent


def generate(directory):
    """The protocol and the tokens' message, compiled to Python."""
    for root, names in (("proto", ["google/rpc/status.proto", "holdfast/v1/point_tracking.proto"]),
                        ("server/checkpoint", ["holdfast/checkpoint/v1/session_state.proto"])):
        subprocess.run(["protoc", f"--proto_path={SOURCE / root}", f"--python_out={directory}", *names], check=True)
    sys.path.insert(0, directory)
    from holdfast.checkpoint.v1 import session_state_pb2
    from holdfast.v1 import point_tracking_pb2
    return point_tracking_pb2, session_state_pb2


def piece(data):
    return struct.pack("<H", len(data)) + data


def picture(kind, size=(8, 8), **options):
    image = Image.new("RGB", size)
    image.putdata([(30 * x % 256, 25 * y % 256, 7 * x * y % 256) for y in range(size[1]) for x in range(size[0])])
    mode = options.pop("mode", "RGB")
    out = io.BytesIO()
    image.convert(mode).save(out, kind, **options)
    return out.getvalue()


def frames():
    """First byte: encoding; then the sides of raw frames."""
    png_text = picture("PNG")
    chunk = b"tEXtkey\0value"
    at = len(png_text) - 12
    png_text = png_text[:at] + struct.pack(">I", 9) + chunk + struct.pack(">I", zlib.crc32(chunk)) + png_text[at:]
    jpeg, png = b"\0\0\0", b"\1\0\0"
    return {
        "jpeg": jpeg + picture("JPEG", quality=60),
        "jpeg_progressive": jpeg + picture("JPEG", (24, 16), quality=40, progressive=True),
        "jpeg_grey": jpeg + picture("JPEG", mode="L", quality=40),
        "jpeg_cmyk": jpeg + picture("JPEG", mode="CMYK", quality=40),
        "png": png + picture("PNG"),
        "png_grey": png + picture("PNG", mode="L"),
        "png_bits": png + picture("PNG", mode="1"),
        "png_palette": png + picture("PNG", mode="P"),
        "png_alpha": png + picture("PNG", mode="RGBA"),
        "png_text": png + png_text,
        "rgb": b"\2\4\2" + bytes(24),
        "bgr": b"\3\2\2" + bytes(12),
        "grey": b"\4\4\4" + bytes(range(16)),
    }


def sessions(v1):
    """First byte: how streams end; then pieces, each a request; an empty piece begins the next stream."""
    def request(**what):
        return piece(v1.TrackRequest(**what).SerializeToString())

    def config(**what):
        return request(config=v1.SessionConfig(**what))

    def grey(first, end, points=()):
        return b"".join(request(frame=v1.Frame(
            index=i, data=bytes((i * 9 + j) % 256 for j in range(64)),
            points=[point for at, point in points if at == i])) for i in range(first, end))

    raw = {"encoding": v1.FRAME_ENCODING_GRAY8, "raw_size": v1.ImageSize(width=8, height=8)}
    one, two, three = (v1.Point(id=n, x=2 + n, y=3) for n in (1, 2, 3))
    plain = config(points=[one, two], motion_prior=False, polish=False, **raw)
    flow = config(points=[one, two], motion_prior=True, polish=True, checkpoint_interval_frames=2, **raw)
    timed = v1.Frame(index=0, data=bytes(64), points=[three])
    drawn = v1.Object(id=4, points=5, polygon=v1.Polygon(x=[1, 6, 6, 1], y=[1, 1, 6, 6]))
    masked = v1.Object(id=5, points=4, mask_png=picture("PNG", mode="L"))
    objects = config(points=[one], objects=[drawn], checkpoint_interval_frames=2, polish=True, **raw)
    with_mask = request(frame=v1.Frame(index=3, data=bytes(range(64)), objects=[masked]))
    gone = request(remove_points=v1.RemovePoints(ids=[(1 << 63) + (4 << 32) + i for i in range(5)]))
    timed.capture_time.seconds = 1000
    return {
        "plain": b"\0" + plain + grey(0, 12),
        "flow": b"\0" + flow + grey(0, 12, [(3, three)]),
        "every_frame": b"\0" + config(points=[one], emit=v1.EMIT_EVERY_FRAME, **raw) + grey(0, 9),
        "final_only": b"\2" + config(points=[one], final_only=True, hop_frames=5, iterations=2, **raw) + grey(0, 9),
        "points": (b"\0" + plain + request(frame=timed) + request(add_points=v1.AddPoints(points=[three, one]))
                   + grey(1, 4) + request(remove_points=v1.RemovePoints(ids=[1, 9])) + grey(4, 8)),
        "objects": b"\0" + objects + grey(0, 3) + with_mask + grey(4, 8) + gone + grey(8, 12),
        "objects_resumed": (b"\1" + objects + grey(0, 3) + with_mask + grey(4, 9) + piece(b"")
                            + config(resume_token=b"0", **raw) + with_mask + grey(4, 14)),
        "jpeg": b"\0" + config(encoding=v1.FRAME_ENCODING_JPEG, points=[one], label="l",
                               processing_size=v1.ImageSize(width=64, height=32))
                + request(frame=v1.Frame(index=0, data=picture("JPEG", quality=20))),
        "png": b"\0" + config(encoding=v1.FRAME_ENCODING_PNG, points=[one])
               + request(frame=v1.Frame(index=0, data=picture("PNG", mode="L"))),
        "resumed": (b"\0" + flow + grey(0, 9, [(2, three)]) + piece(b"") + config(resume_token=b"0", **raw)
                    + grey(4, 12)),
        "suspended_twice": (b"\1" + plain + grey(0, 8) + piece(b"") + config(resume_token=b"0", **raw) + grey(4, 9)
                            + piece(b"") + config(resume_token=b"1", **raw) + grey(4, 12)),
    }


def token_state(pb, polish):
    """A session of one or two points of a window of 6 frames and a hop of 2, behind frame 9."""
    state = pb.SessionState(encoding=5, frame_width=8, frame_height=8, processing_width=32, processing_height=32,
                            hop_frames=2, iterations=1, motion_prior=polish, polish=polish, next_frame=4,
                            taken_frame=9, next_serial=2, summary_frames=10, summary_points=2)
    for serial in range(2):
        track = state.tracks.add(serial=serial, point_id=serial + 7, query_frame=0, next_start=6, covered=9,
                                 final_before=7, reportable_before=7, sent_before=7, first_kept=4, feature=[1, 2])
        for position in (track.query, track.position, track.previous):
            position.x, position.y = 2 + serial, 3
        track.position_x.extend([1.0 + i for i in range(6)])
        track.position_y.extend([2.0] * 6)
        track.visibility_logit.extend([float("nan")] * 6)
        track.similarity.extend([0.5] * 6)
        track.last_step.extend([0.25] * 6)
        track.polish.extend([1, 2, 3, 0, 0, 0] if polish else [0] * 6)
        track.seen.extend([True] * 6)
        track.shown_x.extend([1.5, 2.5] if polish else [])
        track.shown_y.extend([2.0, 2.0] if polish else [])
        if polish and serial == 0:
            track.patch.at.x = track.patch.at.y = 3
            track.patch.code = bytes(40)
    return state


def tokens(pb):
    """First byte 0: a token. Otherwise what one holds."""
    plain, polished, ending = token_state(pb, False), token_state(pb, True), token_state(pb, False)
    ending.tracks[1].ending.last_frame, ending.tracks[1].ending.stop = 9, 10
    empty = token_state(pb, False)
    del empty.tracks[:]
    jpeg = token_state(pb, False)
    jpeg.encoding = 1
    grouped = token_state(pb, True)
    group = grouped.objects.add(id=3, query_frame=0, size=4, next=7, motion_a=1, outline_x=[0, 4, 4],
                                outline_y=[0, 0, 4])
    for index, track in enumerate(grouped.tracks):
        track.point_id = (1 << 63) + (3 << 32) + index
        member = group.members.add(point_id=track.point_id, final_before=8, sample_x=[2], sample_y=[3],
                                   sample_visible=[True])
        member.home.x, member.home.y = 2 + index, 3
    body = zlib.compress(b"content")
    return {
        "garbage": b"\0HFCP\x01\x03one" + struct.pack(">QII", 31536000, 7, len(body)) + body + bytes(32),
        "plain": b"\1" + plain.SerializeToString(),
        "plain_suspended": b"\2" + plain.SerializeToString(),
        "polished": b"\1" + polished.SerializeToString(),
        "polished_suspended": b"\2" + polished.SerializeToString(),
        "ending": b"\1" + ending.SerializeToString(),
        "objects": b"\1" + grouped.SerializeToString(),
        "objects_suspended": b"\2" + grouped.SerializeToString(),
        "no_tracks": b"\1" + empty.SerializeToString(),
        "jpeg": b"\1" + jpeg.SerializeToString(),
    }


def safetensors():
    def file(header, data):
        text = json.dumps(header).encode()
        return struct.pack("<Q", len(text)) + text + data

    entry = {"dtype": "F32", "shape": [2, 1], "data_offsets": [0, 8]}
    kinds = {"F64": 8, "I64": 8, "F32": 4, "I32": 4, "F16": 2, "BF16": 2, "U8": 1, "BOOL": 1}
    header, at = {"__metadata__": {"a": "b"}}, 0
    for kind, size in kinds.items():
        header[kind] = {"dtype": kind, "shape": [1], "data_offsets": [at, at + size]}
        at += size
    return {"one": file({"w": entry}, bytes(8)), "kinds": file(header, bytes([1] * at)),
            "empty": file({"e": {"dtype": "F32", "shape": [0, 3], "data_offsets": [0, 0]}}, b"")}


def text_op(text):
    return b"X" + struct.pack("<I", len(text)) + text


def tensor_op(key, elements, offset, size, stride):
    def long_op(n):
        return b"\x8a\x08" + struct.pack("<q", n)

    storage = b"(" + text_op(b"storage") + b"ctorch\nFloatStorage\n" + text_op(key) + text_op(b"cpu")
    return (b"ctorch._utils\n_rebuild_tensor_v2\n(" + storage + long_op(elements) + b"tQ" + long_op(offset)
            + long_op(size) + b"\x85" + long_op(stride) + b"\x85\x89)tR")


def state_dict(tensor):
    return b"\x80\x02}" + text_op(b"w") + tensor + b"s."


def pickles():
    ordered = (b"\x80\x02}" + text_op(b"model_state_dict") + b"ccollections\nOrderedDict\n)R(" + text_op(b"module.a")
               + tensor_op(b"0", 4, 0, 2, 1) + b"h\0h\0u" + b"sK\x01M\x02\x00J\x03\0\0\0N\x88\x89]K\x01aq\0(lp1\n2e00.")
    kinds = b"\x80\x02(K\x01M\x01\x02J\1\2\3\4N\x88\x89G" + bytes(8) + b"\x8a\x02\1\2]q\0(K\1K\2eh\0t."
    return {"tensor": state_dict(tensor_op(b"0", 2, 0, 2, 1)), "ordered": ordered, "kinds": kinds,
            "names": b"\x80\x02ctorch.optim.adam\nAdam\n)\x81}b."}


def zip_file(entries, method=zipfile.ZIP_STORED):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in entries.items():
            archive.writestr(zipfile.ZipInfo(name), data, method)  # without the time of day
    return out.getvalue()


def torch_archives():
    """First byte 0: a file. Otherwise pieces: the pickle and the storages."""
    whole = zip_file({"a/data.pkl": state_dict(tensor_op(b"0", 2, 0, 2, 1)), "a/byteorder": b"little",
                      "a/data/0": bytes(8)})
    pickle = state_dict(tensor_op(b"0", 4, 1, 2, 1))
    nested = (b"\x80\x02}" + text_op(b"model_state_dict") + b"}(" + text_op(b"module.a") + tensor_op(b"0", 4, 0, 2, 2)
              + text_op(b"b") + tensor_op(b"1", 1, 0, 1, 0) + b"us.")
    return {"whole": b"\0" + whole, "pieces": b"\1" + piece(pickle) + piece(bytes(16)),
            "nested": b"\1" + piece(nested) + piece(bytes(16)) + piece(bytes(4))}


def npz_files():
    """First byte 0: an .npz file. Otherwise a .npy file. Second byte: rows."""
    def npy(array):
        out = io.BytesIO()
        numpy.save(out, array)
        return out.getvalue()

    kinds = ("<f4", "<f8", "|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "|b1")
    seeds = {f"npy_{kind[1:]}": b"\1\5" + npy(numpy.ones((3, 2), kind)) for kind in kinds}
    seeds["npy_scalar"] = b"\1\0" + npy(numpy.float32(1))
    seeds["npy_columns"] = b"\1\0" + npy(numpy.asfortranarray(numpy.ones((2, 2))))
    for name, method in (("stored", zipfile.ZIP_STORED), ("deflated", zipfile.ZIP_DEFLATED)):
        seeds[name] = b"\0\6" + zip_file({"a.npy": npy(numpy.zeros((4, 3), "<f4"))}, method)
    return seeds


def json_texts():
    """First byte: the reader."""
    weights = ("constant", "visibility_logit", "no_logit", "similarity", "last_step", "age", "from_query",
               "from_before", "not_found")
    options = {
        "encoder_channels": [64, 96, 128, 128], "encoder_mid": 256, "feature_channels": 128, "stride": 8,
        "context_blocks": 6, "context_heads": 8, "context_mlp_ratio": 4, "context_patch": 7, "correlation_levels": 4,
        "correlation_radius": 3, "update_base": 128, "visibility_head": False, "window": 24}
    return {
        "kinds": b"\0" + json.dumps({"a": [1, -2, 0.5e3, True, None, "\u00e4\n"], "b": {"c": {}, "d": []}}).encode(),
        "text": b'\0["\\u00e4\\ud83d\\ude00\\"", 1E-9, -0, 18446744073709551615]',
        "calibration": b"\1" + json.dumps({"version": 1, "weights": {name: 0.5 for name in weights}}).encode(),
        "options": b"\2" + json.dumps(options).encode(),
    }


def answers(v1):
    """Pieces, each an answer."""
    def answer(**what):
        return piece(v1.TrackResponse(**what).SerializeToString())

    accepted = answer(accepted=v1.SessionAccepted(session_id="s", window_frames=6, hop_frames=2, iterations=1,
                                                  replay_frames=8, processing_size=v1.ImageSize(width=32, height=32)))
    run = v1.PointRun(id=7, first_frame=1, x=[1, 2], y=[3, 4], visible=[True, False], confidence=[0.5, 1],
                      final_count=1)
    tracks = v1.Tracks(runs=[run], frames_received=3, frames_processed=3)
    tracks.capture_times.add(frame=1).capture_time.seconds = 5
    seen = v1.ObjectSample(x=1, y=2, scale=1, visible=1, outline_x=[0, 4, 4], outline_y=[0, 0, 4], left=[1 << 63])
    objects = v1.Tracks(runs=[run], objects=[v1.ObjectRun(id=3, first_frame=1, samples=[seen, seen], final_count=1)])
    checkpoint = answer(checkpoint=v1.Checkpoint(token=b"token", next_frame=4, resumable=True))
    warning = v1.TrackResponse()
    warning.warning.code, warning.warning.message = 8, "busy"
    violations = error_details(v1, "BadRequest", b"\x0a\x06\x0a\x01f\x12\x01d")
    going = v1.TrackResponse()
    going.going_away.time_left.seconds = 3
    summary = answer(summary=v1.SessionSummary(frames=3, points=1, final_samples=2))
    return {"session": answer(tracks=tracks) + checkpoint + summary,
            "resumed": answer(tracks=tracks) + checkpoint + accepted + answer(tracks=tracks) + summary,
            "objects": answer(tracks=objects) + checkpoint + accepted + answer(tracks=objects) + summary,
            "warning": piece(warning.SerializeToString()) + violations + piece(going.SerializeToString()),
            "outgrown": answer(checkpoint=v1.Checkpoint()) + answer(tracks=tracks)}


def error_details(v1, kind, value):
    response = v1.TrackResponse()
    response.warning.code = 3
    response.warning.details.add(type_url=f"type.googleapis.com/google.rpc.{kind}", value=value)
    return piece(response.SerializeToString())


def point_files():
    """First byte: the format."""
    listed = [{"id": 1, "x": 2.5, "y": 3, "frame": 4, "name": "nose"}, {"id": 2, "x": 0, "y": 47}]
    return {"csv": b"\0id,x,y,frame\n# c\n1,2.5,3,4\n\n2, 63 ,0\n",
            "list": b"\1" + json.dumps(listed).encode(), "object": b"\1" + json.dumps({"points": listed}).encode()}


def annotations():
    point = {"name": "p", "object": 1, "frames": [0, 1], "xy": [[1, 2.5], [3, 4]], "visible": [True, 0]}
    return {"clip": json.dumps({"width": 8, "height": 8, "fps": 25, "points": [point]}).encode(),
            "later": json.dumps({"width": 8, "height": 8, "points": [dict(point, frames=[1, 5])]}).encode()}


def main():
    corpus = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "corpus"
    with tempfile.TemporaryDirectory() as directory:
        v1, state = generate(directory)
        targets = {"frame": frames(), "session": sessions(v1), "token": tokens(state), "safetensors": safetensors(),
                   "pickle": pickles(), "torch_archive": torch_archives(), "npz": npz_files(), "json": json_texts(),
                   "answers": answers(v1), "point_file": point_files(), "neutral": annotations()}
    for target, seeds in targets.items():
        (corpus / target).mkdir(parents=True, exist_ok=True)
        for name, data in seeds.items():
            (corpus / target / name).write_bytes(data)


if __name__ == "__main__":
    main()
