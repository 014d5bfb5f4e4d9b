# SPDX-License-Identifier: Apache-2.0
"""What the server's image is filled with: enough to serve, nothing to open a shell with, and all of it listed.

Usage: image_test.py BIN
"""
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import jsonschema
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCHEMA = json.loads(pathlib.Path(__file__).with_name("cyclonedx_schema.json").read_text(encoding="utf-8"))
UNSHARE = ["unshare", "--mount", *([] if os.geteuid() == 0 else ["--map-root-user"])]
# Runs a program over a root of its own, with the devices and processes that a container has; it stays the process.
ENTER = [*UNSHARE, "sh", "-c",
         'mount --rbind /dev "$0/dev" && mount --rbind /proc "$0/proc" && exec chroot "$0" "$@"']
CAN_ENTER = subprocess.run([*UNSHARE, "true"], check=False, capture_output=True).returncode == 0
needs_root = unittest.skipUnless(CAN_ENTER, "no namespaces here: what runs over a root of its own is not tested")
PROGRAMS = ("holdfast-server", "holdfast-healthcheck", "holdfast-import")
SMALL = ["--processing_size=128x96", "--iterations=1", "--compute_threads=1", "--precision=float32"]


class ImageTest(unittest.TestCase):
    programs = None

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory(prefix="holdfast-image-")
        cls.addClassCleanup(cls.folder.cleanup)
        cls.root = pathlib.Path(cls.folder.name) / "root"
        # From a checkout that is its owner's alone.
        source = pathlib.Path(cls.folder.name) / "source"
        for part in ("deploy/image", "weights", "web/dist"):
            shutil.copytree(ROOT / part, source / part)
        shutil.copy(ROOT / "LICENSE", source)
        subprocess.run(["chmod", "-R", "go=", source], check=True)
        subprocess.run(["sh", "-c", 'umask 077 && exec "$@"', "-", source / "deploy" / "image" / "rootfs.sh", "--alone",
                        cls.root, *PROGRAMS], cwd=cls.programs, check=True)
        cls.bom = json.loads((cls.root / "usr/share/holdfast/sbom.cdx.json").read_text(encoding="utf-8"))

    def run_inside(self, program, *flags):
        return subprocess.run([*ENTER, self.root, f"/usr/bin/{program}", *flags], check=False, capture_output=True,
                              text=True, env={"LANG": "C.UTF-8"})

    def start_inside(self):
        ports = self.root / "tmp" / "ports"
        ports.unlink(missing_ok=True)
        server = subprocess.Popen(
            [*ENTER, self.root, "/usr/bin/holdfast-server", "--listen=127.0.0.1:0", "--metrics_listen=127.0.0.1:0",
             "--port_file=/tmp/ports", "--weights=/usr/share/holdfast/weights/small.safetensors", *SMALL],
            env={"LANG": "C.UTF-8"}, stderr=subprocess.PIPE, text=True)
        self.addCleanup(server.wait)
        self.addCleanup(server.kill)
        for line in server.stderr:
            if "ready: " in line:
                break
        while not ports.exists() and server.poll() is None:
            pass  # it is written right after that line
        return server, dict(line.split("=") for line in ports.read_text(encoding="utf-8").split())

    @needs_root
    def test_programs_run_without_anything_else(self):
        for program in PROGRAMS:
            answer = self.run_inside(program, "--version")
            self.assertEqual(answer.returncode, 0, answer.stderr)
            self.assertRegex(answer.stdout, rf"^{program} \d+\.\d+\.\d+")

    @needs_root
    def test_the_server_serves_and_knows_its_health(self):
        server, ports = self.start_inside()
        listen = f"--metrics_listen=0.0.0.0:{ports['metrics']}"
        healthy = self.run_inside("holdfast-healthcheck", listen)
        self.assertEqual((healthy.returncode, healthy.stderr), (0, ""))
        server.terminate()
        self.assertEqual(server.wait(60), 0)
        server.stderr.close()
        gone = self.run_inside("holdfast-healthcheck", listen)
        self.assertEqual(gone.returncode, 1)
        self.assertIn("cannot be reached", gone.stderr)

    def test_there_is_no_other_program(self):
        programs = {path.relative_to(self.root).as_posix() for path in self.root.rglob("*")
                    if path.is_file() and os.access(path, os.X_OK) and ".so" not in path.name}
        self.assertEqual(programs, {f"usr/bin/{program}" for program in PROGRAMS})

    def test_everybody_may_read_all_of_it(self):
        self.assertTrue((self.root / "usr/share/holdfast/weights/small.safetensors").is_file())
        for path in self.root.rglob("*"):
            mode = path.lstat().st_mode
            needed = 0o777 if path.is_symlink() else 0o555 if path.is_dir() else 0o444
            self.assertEqual(mode & needed, needed, path)

    def test_the_list_of_packages_is_valid_and_whole(self):
        jsonschema.validate(self.bom, SCHEMA)
        listed = {component["name"]: component["version"] for component in self.bom["components"]}
        self.assertEqual(set(listed), {file.name for file in (self.root / "var/lib/dpkg/status.d").iterdir()})
        for name in ("libc6", "libtorch", "libgrpc++", "libssl", "libopencv-core", "ca-certificates"):
            self.assertTrue(any(package.startswith(name) for package in listed), name)
        for name in ("nlohmann-json3-dev", "libboost"):  # headers alone
            self.assertTrue(any(package.startswith(name) for package in listed), name)
        print(f"image: {len(listed)} packages, {self.size() >> 20} MiB")

    def test_it_has_the_licences_of_what_is_in_it(self):
        doc = self.root / "usr/share/doc"
        self.assertEqual((doc / "holdfast/copyright").read_bytes(), (ROOT / "LICENSE").read_bytes())
        self.assertEqual((doc / "holdfast/copyright.page").read_bytes(), (ROOT / "web/dist/licenses.txt").read_bytes())
        packages = {component["name"] for component in self.bom["components"]}
        without = {name for name in packages if not (doc / name / "copyright").is_file()}
        self.assertEqual(without, set())

    def test_scanners_learn_which_release_it_is(self):
        release = self.root / "etc" / "os-release"
        self.assertEqual(release.resolve(), (self.root / "usr/lib/os-release").resolve())
        fields = dict(line.split("=", 1) for line in release.read_text(encoding="utf-8").splitlines())
        self.assertEqual(fields["ID"], "debian")
        distro = "distro=debian-" + fields["VERSION_ID"].strip('"')
        for component in self.bom["components"]:
            self.assertRegex(component["purl"], rf"^pkg:deb/debian/{re.escape(component['name'])}@\S+&{distro}$")

    def test_a_list_that_is_wrong_is_refused(self):
        for fault in ({"name": None}, {"type": "lib"}, {"licence": "Apache-2.0"}):
            wrong = json.loads(json.dumps(self.bom))
            wrong["components"][0].update(fault)
            with self.subTest(fault), self.assertRaises(jsonschema.ValidationError):
                jsonschema.validate(wrong, SCHEMA)

    def size(self):
        return sum(path.stat().st_size for path in self.root.rglob("*") if path.is_file() and not path.is_symlink())


class DockerfileTest(unittest.TestCase):
    recipe = (ROOT / "Dockerfile").read_text(encoding="utf-8")

    def test_images_take_no_file_with_the_mode_that_it_has_in_the_checkout(self):
        images = self.recipe[self.recipe.index(" AS runtime"):]
        copies = re.findall(r"^(?:COPY|ADD) .*", images, re.MULTILINE)
        self.assertEqual(len(copies), 3)
        self.assertEqual([line for line in copies if "--from=build" not in line], [])

    def test_a_new_volume_of_the_trainer_is_for_its_user(self):
        trainer = re.search(r" AS trainer\n.*?^USER", self.recipe, re.MULTILINE | re.DOTALL)[0]
        volume = yaml.safe_load((ROOT / "deploy/compose.yaml").read_text(encoding="utf-8"))
        self.assertEqual(volume["services"]["trainer"]["volumes"], ["training:/data"])
        self.assertIn("install -d -o holdfast -g holdfast /data", trainer)

    def test_no_more_compilers_run_at_once_than_there_is_memory_for(self):
        self.assertRegex(self.recipe, r'cmake --build build/release -j "\$\(make -s jobs\)"')
        for wanted in ([], ["JOBS=3"]):
            jobs = subprocess.run(["make", "-s", "jobs", *wanted], cwd=ROOT, check=True, capture_output=True, text=True)
            self.assertRegex(jobs.stdout, r"^3\n$" if wanted else r"^[1-9]\d*\n$")


if __name__ == "__main__":
    ImageTest.programs = sys.argv.pop(1)
    unittest.main(verbosity=2)
