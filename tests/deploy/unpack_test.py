# SPDX-License-Identifier: Apache-2.0
"""deploy/packages/unpack.sh, with an apt-get of its own: nothing is downloaded."""
import os
import pathlib
import subprocess
import tempfile
import unittest

from tools import DEPLOY

SCRIPT = DEPLOY / "packages" / "unpack.sh"
APT = """#!/usr/bin/env bash
echo "$@" >> "$HERE/calls"
for word; do
  case $word in Dir::Cache::archives=*) cp "$HERE"/*.deb "${word#*=}" 2> /dev/null || true ;; esac
done
"""


class UnpackTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="holdfast-unpack-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.tools = self.folder / "build" / "tools"
        (self.folder / "bin").mkdir()
        self.executable(self.folder / "bin" / "apt-get", APT)

    @staticmethod
    def executable(path, text):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        path.chmod(0o755)

    def package(self, *files):
        """What the archive has: a package of these files."""
        tree = self.folder / "tree"
        self.executable(tree / "DEBIAN" / "control",
                        "Package: judge\nVersion: 1\nArchitecture: all\nMaintainer: a <a@b.c>\nDescription: d\n")
        for file in files:
            self.executable(tree / file, "")
        subprocess.run(["dpkg-deb", "--build", tree, self.folder / "judge.deb"], check=True, capture_output=True)

    def unpack(self):
        done = subprocess.run([SCRIPT, self.tools], capture_output=True, text=True, check=False,
                              env={**os.environ, "HERE": str(self.folder),
                                   "PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}"})
        self.assertEqual(done.returncode, 0, done.stderr)
        return {path.relative_to(self.tools).as_posix() for path in self.tools.rglob("*") if path.is_file()}

    def test_where_every_package_is_installed_there_is_nothing_to_unpack(self):
        self.assertEqual(self.unpack(), {"tools.txt"})

    def test_programs_and_libraries_of_what_is_missing_are_unpacked(self):
        self.package("usr/sbin/judge", "usr/lib/x86_64-linux-gnu/libjudge.so.1", "usr/share/doc/judge/copyright")
        self.assertEqual(self.unpack(), {"judge", "lib/libjudge.so.1", "tools.txt"})

    def test_what_is_unpacked_stays(self):
        self.unpack()
        calls = (self.folder / "calls").read_text(encoding="utf-8")
        self.unpack()
        self.assertEqual((self.folder / "calls").read_text(encoding="utf-8"), calls)


if __name__ == "__main__":
    unittest.main(verbosity=2)
