# SPDX-License-Identifier: Apache-2.0
"""The script of deploy/kubernetes/batch/, as its ConfigMap has it."""
import os
import pathlib
import subprocess
import tempfile
import unittest

from kustomize import render
from tools import DEPLOY


class BatchScriptTest(unittest.TestCase):
    """With a `holdfast` that writes its arguments, or fails on a video that says so."""

    def setUp(self):
        directory = tempfile.TemporaryDirectory(prefix="holdfast-batch-")
        self.addCleanup(directory.cleanup)
        self.directory = pathlib.Path(directory.name)
        self.videos, self.tracks = self.directory / "videos", self.directory / "tracks"
        self.videos.mkdir()
        (self.directory / "bin").mkdir()
        program = self.directory / "bin" / "holdfast"
        program.write_text('#!/usr/bin/env bash\nfor last; do :; done\necho "$@" > "${last#--out=}"\n'
                           'case $(cat "$2") in bad) exit 1 ;; slow) exec sleep 60 ;; esac\n')
        program.chmod(0o755)

    def video(self, name, content="good"):
        (self.videos / name).write_text(content)

    def start(self, index, shards=3):
        script = next(item for item in render(DEPLOY / "kubernetes" / "batch")
                      if item["kind"] == "ConfigMap")["data"]["track.sh"]
        environment = {**os.environ, "PATH": f"{self.directory / 'bin'}:{os.environ['PATH']}",
                       "JOB_COMPLETION_INDEX": str(index)}
        return subprocess.Popen(["bash", "-c", script, "track.sh", str(shards), self.videos, self.tracks, "--grid=9"],
                                env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)

    def run_shard(self, index, shards=3):
        process = self.start(index, shards)
        errors = process.communicate(timeout=60)[1]
        return process.returncode, errors

    def made(self):
        return sorted(path.name for path in self.tracks.iterdir())

    def test_shards_have_every_video_once(self):
        names = [f"v {number}.mp4" for number in range(8)]
        for name in names:
            self.video(name)
        seen = []
        for index in range(3):
            before = self.made() if self.tracks.exists() else []
            self.assertEqual(self.run_shard(index), (0, ""))
            seen.append(len(self.made()) - len(before))
        self.assertEqual(seen, [3, 3, 2])
        self.assertEqual(self.made(), [name + ".json" for name in names])
        self.assertIn("--grid=9", (self.tracks / "v 0.mp4.json").read_text())

    def test_a_video_that_fails_fails_the_shard_after_the_others(self):
        for name, content in (("a", "good"), ("b", "bad"), ("c", "good")):
            self.video(name, content)
        code, errors = self.run_shard(0, 1)
        self.assertEqual(code, 1)
        self.assertIn("b failed", errors)
        self.assertEqual(self.made(), ["a.json", "b.part.json", "c.json"])
        self.video("b")  # mended: only this one is tracked anew
        (self.tracks / "a.json").write_text("kept")
        self.assertEqual(self.run_shard(0, 1)[0], 0)
        self.assertEqual((self.tracks / "a.json").read_text(), "kept")
        self.assertEqual(self.made(), ["a.json", "b.json", "c.json"])

    def test_a_directory_without_videos_is_no_failure(self):
        self.assertEqual(self.run_shard(0), (0, ""))

    def test_a_termination_ends_the_client_too(self):
        self.video("a", "slow")
        started = self.tracks / "a.part.json"
        process = self.start(0, 1)
        while not started.exists():
            try:
                process.wait(0.05)
                self.fail(process.stderr.read())
            except subprocess.TimeoutExpired:
                pass
        process.terminate()
        process.communicate(timeout=30)  # which waits for the client too: it holds the pipe
        self.assertEqual(process.returncode, 143)
        self.assertEqual(self.made(), ["a.part.json"])


if __name__ == "__main__":
    unittest.main(verbosity=2)
