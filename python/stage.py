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

HERE = pathlib.Path(__file__).resolve().parent
PROTO = HERE.parent / "proto"
PACKAGE = "holdfast_client"
PROTOCOL = f"{PACKAGE}/_proto"  # a name of its own: who has generated holdfast/v1 too is not disturbed


def stage(directory, protoc, google):
    directory.mkdir(parents=True, exist_ok=True)
    shutil.copytree(HERE / PACKAGE, directory / PACKAGE, dirs_exist_ok=True,
                    ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(HERE / name, directory)
    shutil.copy(HERE.parent / "LICENSE", directory)
    protocol = [f"--proto_path={PROTOCOL}={PROTO / 'holdfast' / 'v1'}", f"--proto_path={PROTO}"]
    subprocess.run([protoc, *protocol, f"--python_out={directory}", f"--pyi_out={directory}",
                    f"{PROTOCOL}/point_tracking.proto"], check=True)
    (directory / PROTOCOL / "__init__.py").touch()
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
