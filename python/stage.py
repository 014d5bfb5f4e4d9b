# SPDX-License-Identifier: Apache-2.0
"""Puts the Python package together: its sources, and the protocol compiled for it.

Usage: stage.py DIRECTORY [--protoc PROGRAM] [--google]

DIRECTORY becomes a project that `python3 -m build` makes a wheel of, and a place to import from. --google: with
google.rpc, which users have from googleapis-common-protos and Debian 12 has not.
"""
import argparse
import pathlib
import shutil
import subprocess
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
PROTO = HERE.parent / "proto"
PACKAGE = "holdfast_client"
PROTOCOL = f"{PACKAGE}/_proto"  # a name of its own: who has generated holdfast/v1 too is not disturbed


def compile_protocol(directory, protoc):
    """The pool of a process knows each full name once, so the messages have a package of their own too. What is sent
    does not name it: only services are called by their package."""
    text = (PROTO / "holdfast" / "v1" / "point_tracking.proto").read_text(encoding="utf-8")
    package = "package holdfast.v1;"
    assert text.count(package) == 1
    with tempfile.TemporaryDirectory() as sources:
        source = pathlib.Path(sources) / "point_tracking.proto"
        source.write_text(text.replace(package, f"package {PACKAGE}.v1;"), encoding="utf-8")
        subprocess.run([protoc, f"--proto_path={PROTOCOL}={sources}", f"--proto_path={PROTO}",
                        f"--python_out={directory}", f"--pyi_out={directory}", f"{PROTOCOL}/point_tracking.proto"],
                       check=True)
    (directory / PROTOCOL / "__init__.py").touch()


def stage(directory, protoc, google):
    directory.mkdir(parents=True, exist_ok=True)
    shutil.copytree(HERE / PACKAGE, directory / PACKAGE, dirs_exist_ok=True,
                    ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(HERE / name, directory)
    shutil.copy(HERE.parent / "LICENSE", directory)
    compile_protocol(directory, protoc)
    if google:
        subprocess.run([protoc, f"--proto_path={PROTO}", f"--python_out={directory}", f"--pyi_out={directory}",
                        "google/rpc/status.proto", "google/rpc/error_details.proto"], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--protoc", default="protoc")
    parser.add_argument("--google", action="store_true")
    args = parser.parse_args()
    stage(args.directory, args.protoc, args.google)


if __name__ == "__main__":
    main()
