# SPDX-License-Identifier: Apache-2.0
"""clang-tidy over every C++ source file of the tree, several at a time; clang's own warnings, its analysis of what
locks guard among them, are findings too.

The build need only be configured: of it are made the headers that sources include and the precompiled ones, nothing
else. A file without findings leaves a stamp in <build>/tidy-clean that says what the verdict hangs on: hashes of the
file and of the headers of the tree that it includes, of how it is compiled, of the protocol, the configuration and the
version of clang-tidy. A file whose stamp holds is skipped. The plugin in tidy_own_code.cc keeps the checks out of
libraries' headers.
"""
import argparse
import concurrent.futures
import hashlib
import json
import pathlib
import shlex
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
PLUGIN = ".ci/tidy_own_code.cc"
# The plugin itself, what is for sanitizers' builds alone, and a project of its own.
NOT_COMPILED = (PLUGIN, "tests/support/tsan_libraries.cc", "tests/fuzz/fuzz_program.cc", "examples/cpp/follow.cc")


def output_of(*command, cwd=ROOT):
    return subprocess.run(command, cwd=cwd, check=True, capture_output=True, text=True).stdout


def digest_of(path):
    """The hash of a file of the tree; '' where there is none any more."""
    try:
        return hashlib.sha256((ROOT / path).read_bytes()).hexdigest()
    except FileNotFoundError:
        return ""


def configuration_of(source):
    """The texts of the .clang-tidy of its folder and of those above it."""
    paths = (ROOT / folder / ".clang-tidy" for folder in source.parents)
    return "".join(path.read_text(encoding="utf-8") for path in paths if path.exists())


class Source:
    """A file to be checked, and the stamp that it leaves."""

    def __init__(self, command, stamps, common):
        self.name = pathlib.Path(command["file"]).relative_to(ROOT).as_posix()
        self.command = command
        conditions = common + configuration_of(pathlib.Path(self.name)) + command["command"]
        self.conditions = hashlib.sha256(conditions.encode()).hexdigest()
        self.stamp = stamps / hashlib.sha256(self.name.encode()).hexdigest()

    def is_clean(self):
        """Whether nothing has changed since this file was found clean."""
        try:
            known = json.loads(self.stamp.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return False
        return known["conditions"] == self.conditions and all(
            digest_of(path) == digest for path, digest in known["files"].items())

    def files(self):
        """The file and the headers of the tree that it includes, each with its hash."""
        words = shlex.split(self.command["command"])
        place = words.index("-o")
        rule = output_of(*words[:place], *words[place + 2:], "-MM", cwd=self.command["directory"])
        paths = (pathlib.Path(self.command["directory"], word) for word in rule.replace("\\\n", " ").split()[1:])
        names = {path.resolve().relative_to(ROOT).as_posix() for path in paths if path.resolve().is_relative_to(ROOT)}
        return {name: digest_of(name) for name in sorted(names)}


def find_sources(build, names, common):
    """The sources that git lists and the build compiles; ends the program when the build leaves one out."""
    commands = {}
    for command in json.loads((build / "compile_commands.json").read_text(encoding="utf-8")):
        commands.setdefault(pathlib.Path(command["file"]), command)
    left_out = [name for name in names if ROOT / name not in commands]
    if left_out:
        sys.exit("not compiled by this build, so not checked: " + " ".join(left_out))
    return [Source(commands[ROOT / name], build / "tidy-clean", common) for name in names]


def make_headers(build, jobs):
    """Has ninja make what a source needs before it compiles: the protocol's headers and the precompiled ones."""
    targets = output_of("ninja", "-C", build, "-t", "targets", "all").splitlines()
    headers = [name for name in (target.split(": ")[0] for target in targets)
               if name.endswith((".pb.h", ".pch")) and not name.startswith("/")]
    subprocess.run(["ninja", "-C", build, "-j", str(jobs), *headers], check=True)


def build_plugin(build):
    """Compiles the plugin, where it has changed, against the headers of the clang that clang-tidy is of; its path."""
    library = build / "tidy_own_code.so"
    if library.exists() and library.stat().st_mtime > (ROOT / PLUGIN).stat().st_mtime:
        return library
    version = output_of("clang-tidy", "--version").split("version ")[1].split(".")[0]
    output_of("c++", "-std=c++17", "-O1", "-fno-rtti", "-fPIC", "-shared", f"-isystem/usr/lib/llvm-{version}/include",
              PLUGIN, "-o", library)
    return library


def check(build, plugin, source):
    begin = time.monotonic()
    command = ["clang-tidy", "-p", build, "--quiet", f"--load={plugin}", "--checks=holdfast-own-code", source.name]
    files = source.files()
    result = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    if result.returncode == 0:
        source.stamp.write_text(json.dumps({"conditions": source.conditions, "files": files}), encoding="utf-8")
    else:
        print(f"{result.stdout}{result.stderr}", flush=True)
    print(f"tidy: {source.name}: {'FINDINGS' if result.returncode else 'clean'}, {time.monotonic() - begin:.0f} s",
          flush=True)
    return result.returncode == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build/clang"))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("files", nargs="*", help="all that git lists, by default")
    args = parser.parse_args()
    build = (ROOT / args.build).resolve()
    (build / "tidy-clean").mkdir(exist_ok=True)
    names = args.files or [name for name in output_of("git", "ls-files", "*.cc").splitlines()
                           if name not in NOT_COMPILED]
    protocol = output_of("git", "ls-files", "--cached", "--others", "--exclude-standard", "*.proto")
    common = output_of("clang-tidy", "--version") + "".join(
        (ROOT / name).read_text(encoding="utf-8") for name in (*protocol.splitlines(), PLUGIN))
    make_headers(build, args.jobs)
    sources = find_sources(build, names, common)
    stale = [source for source in sources if not source.is_clean()]
    print(f"tidy: {len(sources)} files, {len(sources) - len(stale)} clean and unchanged, {len(stale)} to check",
          flush=True)
    plugin = build_plugin(build)
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        clean = sum(pool.map(lambda source: check(build, plugin, source), stale))
    print(f"tidy: {len(stale) - clean} of {len(stale)} checked files have findings", flush=True)
    sys.exit(clean != len(stale))


if __name__ == "__main__":
    main()
