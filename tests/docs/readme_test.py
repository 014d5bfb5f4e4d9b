# SPDX-License-Identifier: Apache-2.0
"""What README and the pages for users and operators show, block by block: run as it is printed where a test can, held
against the files and programs that it speaks of where not (images, training). A block of an unknown kind fails.

Usage: readme_test.py HOLDFAST_SERVER PROTOC BUILD CMAKE
"""
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
import unittest
import urllib.request

BUILD, CMAKE = pathlib.Path(sys.argv[3]), sys.argv[4]
del sys.argv[3:5]
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "python"))

import support  # noqa: E402
from PIL import Image  # noqa: E402
from certificates import Authority  # noqa: E402
from documents import ROOT, Block, read_blocks  # noqa: E402
from server_process import VIDEO  # noqa: E402

DOCUMENTS = ["README.md", *(f"docs/{page}.md" for page in ("cli", "cpp", "operate", "protocol", "train"))]
PROGRAMS = ("holdfast", "holdfast-server", "holdfast-train", "holdfast-eval", "holdfast-synth")
FEW_FRAMES = 10
# What is made smaller to be run here.
SHORTER = {"--grid=100": "--grid=9", "--grid=20": "--grid=9", "--sessions=8": "--sessions=4",
           "--points=64": "--points=4", "--fps=15": "--fps=2", "--seconds=30": "--seconds=2"}
# C++ blocks are files of this name; one that is no program gets this main().
SOURCE, MAIN = "follow.cc", """
#include <fstream>
#include <iterator>
int main(int argc, char** argv) {
  holdfast::RemoteTracker::Options options;
  options.addresses = {"localhost:50051"};
  const auto tracker = holdfast::RemoteTracker::Connect(options);
  std::vector<std::string> jpegs;
  for (int i = 1; i < argc; ++i) {
    std::ifstream file(argv[i], std::ios::binary);
    jpegs.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return tracker.ok() && Follow(**tracker, jpegs).ok() ? 0 : 1;
}
"""


def text_of(*paths):
    return "\n".join((ROOT / path).read_text(encoding="utf-8") for path in paths)


def flags_in(text):
    """Names of flags, without what is behind "=" and without the "no" that turns one off."""
    return set(re.findall(r"(?<![\w-])--(?:no(?=open_|resume))?([a-z][a-z0-9_-]*)", text))


def commands_of(block):
    """Of each command its line, where "\\" joins lines, and its words without comments."""
    for line in block.text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words:
            yield line, words


class ReadmeTest(support.ServedTest, unittest.TestCase):
    maxDiff = None

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.helps = {}
        for program in PROGRAMS:
            if (BUILD / "bin" / program).exists():
                cls.helps[program] = subprocess.run([BUILD / "bin" / program, "--help"], capture_output=True, text=True,
                                                    check=True).stdout

    def setUp(self):
        directory = tempfile.TemporaryDirectory(prefix="holdfast-readme-")
        self.addCleanup(directory.cleanup)
        self.folder = pathlib.Path(directory.name)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        self.images = set()  # that commands have built
        (self.folder / "build").mkdir()
        os.symlink(BUILD.resolve(), self.folder / "build/release")
        os.symlink(VIDEO, self.folder / "video.mp4")
        mask = Image.new("L", (768, 576))
        mask.paste(255, (250, 200, 290, 300))
        mask.save(self.folder / "object.png")
        (self.folder / "frames").mkdir()
        for number, picture in enumerate(support.PICTURES[:FEW_FRAMES]):
            Image.fromarray(picture).resize((768, 576)).save(self.folder / f"frames/{number:03}.jpg", quality=95)
        self.environment = {**{name: value for name, value in os.environ.items() if not name.startswith("HOLDFAST_")},
                            "HOLDFAST_SERVER": self.server.address, "HOLDFAST_MAX_FRAMES": str(FEW_FRAMES)}

    def run_command(self, words):
        done = subprocess.run(words, env=self.environment, capture_output=True, text=True, timeout=300, check=False)
        self.assertEqual(done.returncode, 0, f"{words}: {done.stdout}{done.stderr}")
        return done.stdout

    # --- Of each document, every block in order.

    def check(self, document):
        for block in read_blocks(document):
            with self.subTest(str(block)):
                self.check_block(block)

    def check_block(self, block):
        check = getattr(self, f"check_{block.language}_{block.kind}".rstrip("_"), None)
        self.assertIsNotNone(check, f"no check for a block of ```{block.language} {block.kind}")
        check(block)

    def test_readme(self):
        self.check("README.md")

    def test_command_line(self):
        self.check("docs/cli.md")
        written = {"tracks.json", "overlay.mp4", "tracks.csv", "tracks.dlc.csv"}
        self.assertLessEqual(written, {path.name for path in self.folder.iterdir()})

    def test_cpp(self):
        self.check("docs/cpp.md")

    def test_operating(self):
        self.check("docs/operate.md")
        self.start_server("--checkpoint_keys=keys").stop()

    def test_protocol(self):
        self.check("docs/protocol.md")

    @unittest.skipUnless((BUILD / "bin/holdfast-train").exists(), "training is not built")
    def test_training(self):
        self.check("docs/train.md")

    # --- Of each kind of block.

    def check_python(self, block):
        names = {}
        support.run_python([block], names, self.server.address)
        self.assertEqual(names["tracks"].xy.shape, (1, FEW_FRAMES, 2))

    def check_cmake(self, block):
        """Builds with the source that follows."""

    def check_cpp(self, block):
        project = self.folder / "project"
        project.mkdir()
        (cmake,) = (other.text for other in read_blocks("docs/cpp.md") if other.language == "cmake")
        (project / "CMakeLists.txt").write_text(cmake, encoding="utf-8")
        source = block.text + ("" if "int main(" in block.text else MAIN)
        (project / SOURCE).write_text(source.replace("localhost:50051", self.server.address), encoding="utf-8")
        prefix = self.folder / "prefix"
        if not prefix.exists():
            self.run_command([CMAKE, "--install", BUILD, "--component", "libholdfast-dev", "--prefix", prefix])
        self.run_command([CMAKE, "-B", project / "build", "-S", project, f"-DCMAKE_PREFIX_PATH={prefix}"])
        self.run_command([CMAKE, "--build", project / "build"])
        printed = self.run_command([project / "build/follow", *sorted((self.folder / "frames").iterdir())])
        self.assertRegex(printed, r"(?m)^7 ")

    def check_json(self, block):
        """A line of --out=-."""
        lines = self.run_command(["build/release/bin/holdfast", "track", "video.mp4", "--grid=1", "--out=-"])
        self.assertEqual(list(json.loads(block.text)), list(json.loads(lines.splitlines()[0])))

    def check_text_output(self, block):
        """Its words, but for numbers and names, are those of the client's sources; gRPC says that a socket closed."""
        sources = text_of(*(path.relative_to(ROOT) for path in (ROOT / "client").rglob("*.cc")))
        for words in re.split(r"[\w.]+\.(?:json|mp4)|\b[\w.]+:\d+|[\d.]+|[:;,()\n]|Socket closed", block.text):
            if len(words.strip()) > 3:
                self.assertIn(words.strip(), sources)

    def check_text_protocol(self, block):
        """Its names are those of the protocol."""
        protocol = text_of("proto/holdfast/v1/point_tracking.proto")
        names = set(re.findall(r"\b([a-z_]+)(?=:| \{)", block.text))
        self.assertEqual({name for name in names if not re.search(rf"\b{name}\b", protocol)}, set())
        self.assertTrue(names)

    def check_text_tokens(self, block):
        """A --token_file, and of its first line what a caller shows."""
        (self.folder / "tokens").write_text(block.text, encoding="utf-8")
        (self.folder / "token").write_text(block.text.split()[0].split(":")[1] + "\n", encoding="utf-8")

    def check_sh(self, block):
        checks = {"make": self.check_make, "docker": self.check_docker, "cmake": self.run_cmake,
                  "holdfast": self.run_client, "holdfast-server": self.run_server, "holdfast-train": self.check_flags,
                  "holdfast-eval": self.check_flags, "holdfast-synth": self.check_flags, "for": self.check_loop,
                  "pictures.sh": self.check_script, "printf": None, "echo": None}
        for line, words in commands_of(block):
            name = pathlib.PurePath(words[0]).name
            self.assertIn(name, checks, "no check for this command")
            if checks[name] is None:
                self.run_command(["bash", "-c", line])
            else:
                checks[name](words)

    # --- Of each command.

    def run_server(self, words):
        server = self.start_server(*(word for word in words[1:] if word != "&"))
        with urllib.request.urlopen(server.metrics.replace("metrics", "readyz")) as ready:
            self.assertEqual(ready.status, 200)
        self.assertEqual(server.stop(), 0)

    def run_client(self, words):
        words = [SHORTER.get(word, word) for word in words]
        for i, word in enumerate(words):
            if word.startswith("--server="):
                words[i] = "--server=" + self.serve_securely(word.partition("=")[2])
        self.run_command([BUILD / "bin/holdfast", *words[1:]])

    def serve_securely(self, address):
        """The two servers of docs/operate.md: one asks for tokens, the other one for a client's certificate."""
        authority = Authority(self.folder, "ca")
        certificate, key = authority.issue("server")
        for own, name in zip(authority.issue("me"), ("me.pem", "me.key")):
            own.rename(self.folder / name)
        self.environment["HOLDFAST_TLS_CA"] = "ca.pem"  # in place of the system's authorities
        access = {"track.example.com:443": "--token_file=tokens", "10.0.0.7:50051": "--tls_client_ca=ca.pem"}
        server = self.start_server(f"--tls_cert={certificate}", f"--tls_key={key}", access[address])
        self.addCleanup(server.stop)
        return server.address

    def run_cmake(self, words):
        self.run_command([CMAKE, *words[1:]])

    def check_make(self, words):
        for word in words[1:]:
            name, is_variable, _ = word.partition("=")
            self.assertRegex(text_of("Makefile"), rf"(?m)^{name} \?=" if is_variable else rf"(?m)^{name}:.*## ")

    def check_docker(self, words):
        recipe = text_of("Dockerfile")
        (image,) = (word for word in words if word.startswith("holdfast-"))
        stage = image.partition("-")[2]
        if words[1] == "build":
            is_last = re.findall(r"(?m)^FROM .* AS (\w+)$", recipe)[-1] == stage
            self.assertEqual(words[2:], [*([] if is_last else ["--target", stage]), "-t", image, "."])
            self.images.add(image)
            return
        self.assertEqual(words[1], "run")
        self.assertIn(image, self.images, "no line above builds it")
        if "-v" in words:
            self.assertIn("--user", words, "the image's own user may not write into the directory")
        program = {"holdfast-client": "holdfast"}.get(image, image)
        self.assertRegex(recipe, rf"(?m)^FROM .* AS {stage}$")
        self.assertIn(f'ENTRYPOINT ["{program}"]', recipe)
        self.check_flags([program, *words[words.index(image) + 1:]])
        for port in re.findall(r"-p \d+:(\d+)", " ".join(words)):
            self.assertRegex(recipe, rf"(?m)^EXPOSE .*\b{port}\b")

    def check_flags(self, words):
        program = pathlib.PurePath(words[0]).name
        self.assertEqual(flags_in(" ".join(words[1:])) - flags_in(self.helps[program]), set(), program)

    def check_loop(self, words):
        self.assertEqual(words[1:3], ["rank", "in"])
        self.check_flags(words[words.index("holdfast-train"):])

    def check_script(self, words):
        self.assertTrue(os.access(ROOT / words[0], os.X_OK))

    # --- That it finds something.

    def test_what_is_wrong_or_not_known_fails(self):
        build = "docker build -t holdfast-server .\n"
        for language, kind, text in (
                ("sh", "", "frobnicate video.mp4"), ("perl", "", "print 1"), ("text", "", "so what"),
                ("sh", "", "make nothing"), ("sh", "", "make demo NOTHING=1"),
                ("sh", "", "build/release/bin/holdfast track none.mp4 --grid=1 --out=x.json"),
                ("sh", "", "docker build -t holdfast-client ."), ("sh", "", "docker run holdfast-trainer"),
                ("sh", "", build + "docker run -p 1:1 holdfast-server"), ("json", "", '{"id": 4}'),
                ("sh", "", build + "docker run holdfast-server --nothing"),
                ("sh", "", build + "docker run -v /:/ holdfast-server"),
                ("text", "output", "the server sang a song"), ("text", "protocol", "frame {nothing: 1}")):
            with self.subTest(text), self.assertRaises(AssertionError):
                self.check_block(Block("x.md", 1, language, kind, text + "\n"))

    def test_blocks_that_would_be_passed_over_are_errors(self):
        for text in ("```\nmake\n```\n", "Text:\n\n    make\n", "```sh\nmake\n"):
            (self.folder / "x.md").write_text(text, encoding="utf-8")
            with self.subTest(text), self.assertRaises(ValueError):
                read_blocks(self.folder / "x.md")

    # --- Of the whole pages.

    def test_every_flag_of_the_server_has_its_row(self):
        rows = flags_in("".join(re.findall(r"^\| .*$", text_of("docs/operate.md"), re.MULTILINE)))
        flags = flags_in("\n".join(re.findall(r"^  --.*$", self.helps["holdfast-server"], re.MULTILINE)))
        self.assertEqual(flags - rows, set())

    @unittest.skipUnless((BUILD / "bin/holdfast-train").exists(), "training is not built")
    def test_flags_that_are_named_exist(self):
        docker = "--network --build-arg --target --user --gpus "
        others = docker + "--help --now --install --component --prefix --benchmark_filter --python"
        scripts = "".join(text_of(f"tests/benchmark/{name}.py") for name in ("bench", "wait_policy"))
        known = flags_in("".join(self.helps.values()) + scripts + others)
        for document in DOCUMENTS:
            self.assertEqual(flags_in(text_of(document)) - known, set(), document)

    def test_every_metric_is_named(self):
        with urllib.request.urlopen(self.server.metrics) as page:
            names = set(re.findall(r"^# TYPE (holdfast_\w+)", page.read().decode(), re.MULTILINE))
        self.assertGreater(len(names), 15)
        self.assertEqual({name for name in names if name not in text_of("docs/operate.md")}, set())

    def test_the_moving_picture_is_light(self):
        self.assertLess((ROOT / "media/demo.webp").stat().st_size, 2_000_000)


if __name__ == "__main__":
    support.main()
