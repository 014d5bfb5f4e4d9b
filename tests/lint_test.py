# SPDX-License-Identifier: Apache-2.0
"""Scripts, manifests and Python sources of the tree, as their checkers see them: lint_test.py shell|yaml|python."""
import subprocess
import sys
import tempfile
import pathlib

from source_tree import ROOT, source_files


def is_shell_script(path):
    with open(path, "rb") as file:
        first_line = file.readline(80)
    return path.suffix == ".sh" or (first_line.startswith(b"#!") and first_line.strip().endswith((b"bash", b"/sh")))


# Of each kind: which files, the checker's command line, and a file in which it must find something.
KINDS = {
    "shell": (is_shell_script, ["shellcheck", "--external-sources"], ("x.sh", "#!/bin/sh\ncat $1\n")),
    "yaml": (lambda path: path.suffix in (".yaml", ".yml"), ["yamllint", "--strict", "-c", ROOT / ".yamllint"],
             ("x.yaml", "a: 1\na: 2\n")),
    "python": (lambda path: path.suffix == ".py", ["/usr/bin/python3", "-m", "flake8", "--config", ROOT / ".flake8"],
               ("x.py", "import os\n")),
}


def main(kind):
    belongs, command, (bad_name, bad_text) = KINDS[kind]
    files = [name for name in source_files() if belongs(ROOT / name)]
    if not files:
        sys.exit(f"no {kind} files: the search for them is broken")
    with tempfile.TemporaryDirectory() as folder:
        bad_file = pathlib.Path(folder) / bad_name
        bad_file.write_text(bad_text, encoding="utf-8")
        seeded = subprocess.run(command + [bad_file], cwd=ROOT, capture_output=True, text=True, check=False)
    if seeded.returncode == 0 or bad_name not in seeded.stdout:
        sys.exit(f"{command[0]} does not find what is wrong with {bad_text!r}: {seeded.stdout}{seeded.stderr}")
    found = subprocess.run(command + files, cwd=ROOT, check=False).returncode
    print(f"{len(files)} {kind} files, {'findings' if found else 'no finding'}")
    sys.exit(found)


if __name__ == "__main__":
    main(sys.argv[1])
