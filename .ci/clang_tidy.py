# SPDX-License-Identifier: Apache-2.0
"""clang-tidy over every C++ source file of the tree, several at a time.

A file without findings leaves a stamp in <build>/tidy-clean, named by a hash of all that the verdict hangs on: the
file and the headers of the tree that it includes, how it is compiled, the configuration and the version of clang-tidy.
A file with a stamp is skipped. The build must be up to date: ninja knows from it which headers belong to which
file. The plugin in tidy_own_code.cc keeps the checks out of libraries' headers.
"""
import argparse
import concurrent.futures
import functools
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


def output_of(*command):
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def read_dependencies(build):
    """Object file -> files of the tree that it was made of, from `ninja -t deps`."""
    @functools.cache  # a library's header comes hundreds of times
    def in_tree(name):
        path = (build / name).resolve()
        return path if ROOT in path.parents and build not in path.parents else None

    dependencies, current = {}, []
    for line in output_of("ninja", "-C", build, "-t", "deps").splitlines():
        if line.startswith("    "):
            if path := in_tree(line.strip()):
                current.append(path)
        elif ": #deps" in line:
            current = dependencies[line.split(": #deps")[0]] = []
    return dependencies


class Source:
    """A file to be checked."""

    def __init__(self, command, dependencies, common):
        self.name = pathlib.Path(command["file"]).relative_to(ROOT).as_posix()
        words = shlex.split(command["command"])
        made_of = dependencies.get(words[words.index("-o") + 1])
        if made_of is None:
            sys.exit(f"{self.name} is not built: build {command['directory']} first")
        digest = hashlib.sha256((common + command["command"]).encode())
        for path in sorted({ROOT / self.name, *made_of}):
            digest.update(path.read_bytes())
        self.key = digest.hexdigest()


def find_sources(build, names, common):
    """The sources that git lists and the build compiles; ends the program when the build leaves one out."""
    commands, dependencies = {}, read_dependencies(build)
    for command in json.loads((build / "compile_commands.json").read_text(encoding="utf-8")):
        commands.setdefault(pathlib.Path(command["file"]), command)
    left_out = [name for name in names if ROOT / name not in commands]
    if left_out:
        sys.exit("not compiled by this build, so not checked: " + " ".join(left_out))
    return [Source(commands[ROOT / name], dependencies, common) for name in names]


def build_plugin(build):
    """Compiles the plugin against the headers of the clang that clang-tidy is of; its path."""
    library = build / "tidy_own_code.so"
    version = output_of("clang-tidy", "--version").split("version ")[1].split(".")[0]
    output_of("c++", "-std=c++17", "-O1", "-fno-rtti", "-fPIC", "-shared", f"-isystem/usr/lib/llvm-{version}/include",
              PLUGIN, "-o", library)
    return library


def check(build, plugin, source):
    begin = time.monotonic()
    command = ["clang-tidy", "-p", build, "--quiet", f"--load={plugin}", "--checks=holdfast-own-code", source.name]
    result = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    if result.returncode == 0:
        (build / "tidy-clean" / source.key).touch()
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
    configurations = output_of("git", "ls-files", "--cached", "--others", "--exclude-standard", "*.clang-tidy")
    common = output_of("clang-tidy", "--version") + "".join(
        (ROOT / name).read_text(encoding="utf-8") for name in (*configurations.splitlines(), PLUGIN))
    sources = find_sources(build, names, common)
    stale = [source for source in sources if not (build / "tidy-clean" / source.key).exists()]
    print(f"tidy: {len(sources)} files, {len(sources) - len(stale)} clean and unchanged, {len(stale)} to check",
          flush=True)
    plugin = build_plugin(build)
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        clean = sum(pool.map(lambda source: check(build, plugin, source), stale))
    print(f"tidy: {len(stale) - clean} of {len(stale)} checked files have findings", flush=True)
    sys.exit(clean != len(stale))


if __name__ == "__main__":
    main()
