# SPDX-License-Identifier: Apache-2.0
"""What is installed works by itself: the client library for a stranger's program, and Debian packages.

Usage: package_test.py BUILD CMAKE
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "e2e"))
from server_process import VIDEO, ServerProcess  # noqa: E402

SMALL = ["--processing_size=128x96", "--iterations=1", "--compute_threads=1", "--precision=float32"]
PACKAGES = {"holdfast-server": ["usr/bin/holdfast-server", "usr/bin/holdfast-healthcheck", "usr/bin/holdfast-import"],
            "holdfast-client": ["usr/bin/holdfast"],
            "libholdfast-dev": ["usr/include/holdfast/client/remote_tracker.h"]}


def run(*command, **options):
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, **options)
    if done.returncode != 0:
        raise AssertionError(f"{command}: {done.stdout}{done.stderr}")
    return done.stdout


def settings(unit):
    """{name: value} of a unit's settings."""
    lines = (line.partition("=") for line in unit.splitlines() if re.match(r"\w+=", line))
    return {name: value for name, _, value in lines}


class PackageTest(unittest.TestCase):
    build = cmake = None

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="holdfast-package-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def install(self, *components):
        prefix = self.folder / "installed"
        for component in components:
            run(self.cmake, "--install", self.build, "--component", component, "--prefix", prefix)
        return prefix

    def packages(self):
        """The packages by their names, made anew under a umask that gives nothing to others."""
        before = os.umask(0o077)
        try:
            run("cpack", "--config", pathlib.Path(self.build) / "CPackConfig.cmake", "-B", self.folder)
        finally:
            os.umask(before)
        return {path.name.split("_")[0]: path for path in self.folder.glob("*.deb")}

    def assert_readable(self, deb):
        """Everybody may read what a package installs, as Debian's policy wants, and root alone may write it."""
        for line in run("dpkg-deb", "-c", deb).splitlines():
            mode, owner, *_, path = line.split()
            program = path.startswith("./usr/bin/") and not path.endswith("/")
            expected = "drwxr-xr-x" if mode[0] == "d" else "-rwxr-xr-x" if program else "-rw-r--r--"
            self.assertEqual((mode, owner), (expected, "root/root"), line)

    def test_a_strangers_program_finds_the_library_and_tracks(self):
        prefix = self.install("libholdfast-dev", "holdfast-server")
        # Nothing of the source tree is at hand but the example itself.
        example = self.folder / "example"
        example.mkdir()
        for source in (ROOT / "examples" / "cpp").iterdir():
            (example / source.name).write_bytes(source.read_bytes())
        run(self.cmake, "-B", example / "build", "-S", example, f"-DCMAKE_PREFIX_PATH={prefix}")
        run(self.cmake, "--build", example / "build")
        server = ServerProcess(str(prefix / "bin" / "holdfast-server"), *SMALL, weights=None, directory="/")
        self.addCleanup(server.stop)
        lines = run(example / "build" / "follow", server.address, VIDEO, 338, 458).splitlines()
        self.assertEqual([int(line.split()[0]) for line in lines], list(range(len(lines))))
        self.assertGreater(len(lines), 100)
        x, y = map(float, lines[-1].split()[1:3])
        self.assertLess(abs(x - 338) + abs(y - 458), 12)  # a bag on the lawn
        with self.assertRaisesRegex(AssertionError, "nowhere.mp4: cannot be opened"):
            run(example / "build" / "follow", server.address, "nowhere.mp4", 338, 458)

    def test_the_installed_protocol_compiles_by_itself(self):
        protocol = self.install("libholdfast-dev") / "share" / "holdfast" / "proto"
        files = sorted(path.relative_to(protocol).as_posix() for path in protocol.rglob("*.proto"))
        self.assertIn("holdfast/v1/point_tracking.proto", files)
        run("protoc", f"--proto_path={protocol}", f"--python_out={self.folder}", *files)

    def test_debian_packages_hold_what_they_should_and_could_be_installed(self):
        debs = self.packages()
        self.assertEqual(set(debs), set(PACKAGES))
        for name, files in PACKAGES.items():
            self.assert_readable(debs[name])
            run("dpkg-deb", "-x", debs[name], self.folder / name)
            for file in files:
                self.assertTrue((self.folder / name / file).is_file(), file)
            licence = (self.folder / name / "usr/share/doc" / name / "copyright").read_text(encoding="utf-8")
            self.assertIn("Apache License", licence)
            self.assertRegex(run("dpkg-deb", "-f", debs[name], "Version"), r"^0\.\d+\.\d+")
        page = self.folder / "holdfast-server/usr/share/doc/holdfast-server/copyright.page"
        self.assertEqual(page.read_bytes(), (ROOT / "web/dist/licenses.txt").read_bytes())
        self.assertEqual(run("dpkg-deb", "-I", debs["holdfast-server"], "prerm"),
                         (ROOT / "deploy/packages/holdfast-server/prerm").read_text(encoding="utf-8"))
        self.assertIn("libtorch", run("dpkg-deb", "-f", debs["holdfast-server"], "Depends"))
        self.assertNotIn("libtorch", run("dpkg-deb", "-f", debs["holdfast-client"], "Depends"))
        # Windows come with a toolkit, which whoever has no display need not install.
        self.assertNotIn("highgui", run("dpkg-deb", "-f", debs["holdfast-client"], "Depends"))
        self.assertIn("libopencv-highgui", run("dpkg-deb", "-f", debs["holdfast-client"], "Recommends"))
        run("apt-get", "install", "--simulate", *debs.values(), env={**os.environ, "LC_ALL": "C"})
        # As installed, the server finds its weights.
        server = ServerProcess(str(self.folder / "holdfast-server/usr/bin/holdfast-server"), *SMALL, weights=None,
                               directory="/")
        self.addCleanup(server.stop)
        info = run(self.folder / "holdfast-client/usr/bin/holdfast", "info", f"--server={server.address}")
        self.assertIn("small", info)

    def test_the_service_is_understood_by_systemd(self):
        prefix = self.install("holdfast-server")
        unit = (prefix / "lib/systemd/system/holdfast-server.service").read_text(encoding="utf-8")
        found = settings(unit)
        self.assertTrue((prefix / "bin" / found["ExecStart"]).is_file())
        source = (ROOT / "server/streams/served_streams.cc").read_text(encoding="utf-8")
        flush = int(re.search(r"kFlushTime = absl::Seconds\((\d+)\)", source)[1])
        grace = int(re.search(r"--grace_period=(\d+)s", run(prefix / "bin/holdfast-server", "--help"))[1])
        self.assertGreater(int(found["TimeoutStopSec"].removesuffix("s")), grace + flush)
        if not shutil.which("systemd-analyze"):
            self.skipTest("there is no systemd-analyze")
        copy = self.folder / "holdfast-server.service"  # systemd looks for the program in its own folders
        copy.write_text(unit.replace("ExecStart=", f"ExecStart={prefix}/bin/"), encoding="utf-8")
        self.assertEqual(run("systemd-analyze", "verify", "--man=no", copy), "")


if __name__ == "__main__":
    PackageTest.build, PackageTest.cmake = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1])
