#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""holdfast-train as its users run it, and what may befall it. Arguments: the program, the repository."""
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import unittest
import urllib.request
import zlib
from pathlib import Path

PROGRAM, REPOSITORY = sys.argv[1], Path(sys.argv[2])
TINY = ["--preset=test", "--threads=1", "--validate_every=0", "--log_every=1"]


def command(out, *flags):
    return [PROGRAM, *TINY, f"--out={out}", *flags]


def train(out, *flags, **options):
    return subprocess.run(command(out, *flags), capture_output=True, text=True, **options)


def steps(out):
    lines = [json.loads(line) for line in (Path(out) / "log.jsonl").read_text().splitlines()]
    return [line for line in lines if line["event"] == "step"]


def by_step(out):
    """The last report of every step: a step done again after a kill counts once."""
    return {line["step"]: line["loss"] for line in steps(out)}


def tensors(path):
    data = Path(path).read_bytes()
    (size,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8:8 + size])
    body = data[8 + size:]
    return {name: struct.unpack(f"<{(e['data_offsets'][1] - e['data_offsets'][0]) // 4}f",
                                body[e["data_offsets"][0]:e["data_offsets"][1]])
            for name, e in header.items() if name != "__metadata__"}


def png(side):
    """A picture of side x side pixels with alpha."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = b"".join(b"\0" + bytes(b for x in range(side) for b in (x * y % 256, 3 * x, 5 * y % 256, 255))
                    for y in range(side))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 6, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def start_ranks(out, *flags):
    port = free_port()
    ranks = []
    for rank in range(2):
        env = {**os.environ, "RANK": str(rank), "WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1",
               "MASTER_PORT": str(port)}
        ranks.append(subprocess.Popen(command(out, *flags), env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                      text=True))
    return ranks


class TrainProgramTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def test_two_processes_train_as_one_with_the_whole_batch(self):
        one, two = self.folder / "one", self.folder / "two"
        result = train(one, "--batch_size=2")
        self.assertEqual(result.returncode, 0, result.stderr)
        for rank in start_ranks(two, "--batch_size=1"):
            _, errors = rank.communicate()
            self.assertEqual(rank.returncode, 0, errors)
        for a, b in zip(steps(one), steps(two), strict=True):
            self.assertAlmostEqual(a["loss"], b["loss"], delta=1e-5 * abs(a["loss"]))
            self.assertAlmostEqual(a["gradient_norm"], b["gradient_norm"], delta=1e-4 * a["gradient_norm"])
        expected, got = (tensors(d / "final.safetensors") for d in (one, two))
        worst = max(abs(x - y) for name in expected for x, y in zip(expected[name], got[name], strict=True))
        print(f"2-process weights differ from 1-process weights by at most {worst:.2e}")
        self.assertLess(worst, 1e-5)

    def test_a_rank_that_dies_ends_the_job_and_it_resumes(self):
        out = self.folder / "out"
        first, second = start_ranks(out, "--steps=4000", "--checkpoint_every=2")
        for line in first.stdout:
            if line.startswith("step 5/"):
                break
        second.kill()
        second.communicate()
        _, errors = first.communicate()
        self.assertEqual(first.returncode, 1)
        self.assertIn("rank 0 of 2 lost another process of the job", errors)
        first, second = start_ranks(out, "--steps=4000", "--checkpoint_every=2")
        for line in first.stdout:
            if line.startswith("going on from step "):
                break
        self.assertGreaterEqual(int(line.split()[4]), 4)
        first.send_signal(signal.SIGTERM)
        for rank in (first, second):
            _, errors = rank.communicate()
            self.assertEqual(rank.returncode, 128 + signal.SIGTERM, errors)  # the second one as well: both go on later

    def test_a_rank_that_does_not_come_can_be_seen_from_outside(self):
        env = {**os.environ, "RANK": "0", "WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1",
               "MASTER_PORT": str(free_port())}
        rank = subprocess.Popen(command(self.folder / "out", "--metrics_address=127.0.0.1:0"), env=env,
                                stdout=subprocess.PIPE, text=True)
        self.addCleanup(rank.communicate)
        self.addCleanup(rank.kill)
        port = re.search(r"metrics on port (\d+)", rank.stdout.readline())[1]
        self.assertIn("until 2 processes are there", rank.stdout.readline())
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as page:
            metrics = page.read().decode()
        for name in ("steps_total", "progress"):  # what the alert about a training that stands still asks for
            self.assertIn(f"\nholdfast_training_{name} 0\n", metrics)

    def write_clip(self, name, frames):
        """Pictures of 64 x 64 whose four points stand still."""
        folder = self.folder / "clips" / name / "frames"
        folder.mkdir(parents=True)
        for number in range(frames):
            (folder / f"{number:05d}.png").write_bytes(png(64))
        points = [{"frames": list(range(frames)), "xy": [[x, 20]] * frames, "visible": [True] * frames}
                  for x in (10, 20, 30, 40)]
        (folder.parent / "tracks.json").write_text(json.dumps({"width": 64, "height": 64, "points": points}))

    def test_clips_that_are_too_short_hinder_no_start_from_weights(self):
        first = self.folder / "first"
        self.assertEqual(train(first, "--steps=1").returncode, 0)
        for name in "abc":
            self.write_clip(name, 3)
        self.write_clip("d", 24)
        for seed in (1, 2):
            result = train(self.folder / f"out{seed}", "--steps=1", f"--init={first / 'final.safetensors'}",
                           "--format=neutral", f"--data={self.folder / 'clips'}", f"--seed={seed}")
            self.assertEqual(result.returncode, 0, result.stderr)

    def stop_by(self, number, out):
        """Sends the signal after the third step of a long training; its exit code, and what it printed last."""
        process = subprocess.Popen(command(out, "--steps=100000", "--checkpoint_every=0"), stdout=subprocess.PIPE,
                                   text=True)
        for line in process.stdout:
            if line.startswith("step 3/"):
                process.send_signal(number)
                break
        rest, _ = process.communicate()
        return process.returncode, rest

    def test_a_signal_writes_a_checkpoint_and_tells_that_the_training_is_not_done(self):
        for number in (signal.SIGTERM, signal.SIGINT):
            out = self.folder / number.name
            code, rest = self.stop_by(number, out)
            self.assertEqual(code, 128 + number)
            self.assertIn("stopped at step", rest)
            self.assertEqual(len(list(out.glob("checkpoint-*.state.safetensors"))), 1)

    def test_a_training_whose_time_is_used_up_is_done(self):
        out = self.folder / "out"
        for _ in range(2):  # whoever starts it again learns the same
            result = train(out, "--steps=0", "--time_budget=1s")
            self.assertEqual(result.returncode, 0, result.stderr)
            self.assertIn("finished at step", result.stdout)

    def test_killed_while_it_writes_checkpoints_it_goes_on_with_the_same_losses(self):
        whole, killed = self.folder / "whole", self.folder / "killed"
        flags = ["--steps=30", "--checkpoint_every=1"]
        self.assertEqual(train(whole, *flags).returncode, 0)
        for stop_at in (4, 9, 15, 22):
            process = subprocess.Popen(command(killed, *flags), stdout=subprocess.PIPE, text=True)
            for line in process.stdout:
                if line.startswith(f"step {stop_at}/"):  # its checkpoint is being written now
                    break
            process.kill()
            process.communicate()
            done = max(by_step(killed))
            reached = max(int(p.name[11:19]) for p in killed.glob("checkpoint-*.state.safetensors"))
            self.assertGreaterEqual(reached, done - 1, "at most the step since the last checkpoint is lost")
        result = train(killed, *flags)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("going on from step", result.stdout)
        self.assertEqual(by_step(whole), by_step(killed))

    def test_a_directory_of_another_preset_is_refused(self):
        out = self.folder / "out"
        self.assertEqual(train(out, "--steps=1").returncode, 0)
        result = subprocess.run([PROGRAM, "--preset=small", "--steps=1", f"--out={out}", "--validate_every=0"],
                                capture_output=True, text=True)
        self.assertEqual(result.returncode, 1)
        self.assertIn("made by another recipe", result.stderr)

    def test_pictures_that_cannot_be_read_do_not_stop_it(self):
        pictures = self.folder / "pictures"
        for kind in ("objects", "backgrounds"):
            (pictures / kind).mkdir(parents=True)
            (pictures / kind / "good.png").write_bytes(png(64))
            (pictures / kind / "broken.png").write_bytes(png(64)[:200])
        result = train(self.folder / "out", f"--pictures={pictures}", "--steps=4")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(len(steps(self.folder / "out")), 4)
        self.assertGreater(steps(self.folder / "out")[-1]["skipped_samples"], 0)

    def test_a_directory_without_pictures_is_an_error(self):
        result = train(self.folder / "out", "--pictures=/nonexistent")
        self.assertEqual(result.returncode, 1)
        self.assertIn("/nonexistent", result.stderr)

    def test_a_device_that_computes_nothing_is_an_error(self):
        result = train(self.folder / "out", "--device=meta", "--steps=1")
        self.assertEqual(result.returncode, 1, result.stderr)
        self.assertIn("holdfast-train: ", result.stderr)

    def test_starts_from_weights_of_a_similar_network(self):
        out = self.folder / "out"
        weights = REPOSITORY / "tests/data/interim.safetensors"
        result = subprocess.run([PROGRAM, "--preset=small", "--steps=1", f"--init={weights}", f"--out={out}",
                                 "--phases=1:64x64:8:2", "--frames=4", "--validate_every=0"],
                                capture_output=True, text=True)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("2 padded", result.stdout)

    def test_wrong_use_ends_with_code_2_and_names_the_flag(self):
        for flags, message in ((["--preset=huge"], "--preset"), (["--colour"], "--colour"), (["clip"], "clip"),
                               (["--alpha=-1"], "alpha")):
            result = train(self.folder / "out", *flags)
            self.assertEqual(result.returncode, 2)
            self.assertIn(message, result.stderr)

    def test_help_ends_well(self):
        result = subprocess.run([PROGRAM, "--help"], capture_output=True, text=True)
        self.assertEqual(result.returncode, 0)
        self.assertIn("--time_budget", result.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
