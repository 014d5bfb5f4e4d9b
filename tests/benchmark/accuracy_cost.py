#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What accuracy costs: frames a second beside accuracy, over processing sizes, hops, iterations and least steps.

Usage: accuracy_cost.py EVAL [--sizes=512x384,256x192] [--hops=8,16] [--iterations=1,2,4] [--least_steps=0]
                        -- EVAL_FLAGS

EVAL is holdfast-eval, EVAL_FLAGS say what it evaluates: --weights and the clips. Prints a row for each combination, as
it is done. Frames a second are those of all clips one after the other; run it on a machine that is otherwise quiet.
"""
import argparse
import itertools
import json
import pathlib
import subprocess
import sys
import tempfile

from arguments import split

COLUMNS = ["processed", "hop", "iterations", "least step", "frames/s", "iterations taken", "δ_avg", "survival 16 px",
           "MTE", "ECE"]


def texts(text):
    return text.split(",")


def evaluate(program, flags, size, hop, iterations, least_step):
    """The report of the network on all clips."""
    with tempfile.TemporaryDirectory(prefix="holdfast-bench-") as out:
        report = pathlib.Path(out) / "report.json"
        subprocess.run([program, f"--processing_size={size}", f"--hop={hop}", f"--iterations={iterations}",
                        f"--least_step={least_step}", f"--json={report}", *flags], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return json.loads(report.read_text())["reports"][0]


def cells(report):
    sequences, mean = report["sequences"], report["mean"]
    pace = sum(sequence["frames"] for sequence in sequences) / sum(sequence["seconds"] for sequence in sequences)
    return [f"{pace:.1f}", f"{report['iterations']:.2f}", f"{mean['delta_avg']:.1f}", f"{mean['survival_16']:.1f}",
            f"{mean['mte']:.1f}", f"{report['reliability']['ece']:.3f}"]


def main():
    arguments, flags = split(sys.argv[1:])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path, metavar="EVAL")
    parser.add_argument("--sizes", type=texts, default=["512x384", "256x192"])
    parser.add_argument("--hops", type=texts, default=["8", "16"])
    parser.add_argument("--iterations", type=texts, default=["1", "2", "4"])
    parser.add_argument("--least_steps", type=texts, default=["0"])
    options = parser.parse_args(arguments)
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|")
    for setting in itertools.product(options.sizes, options.hops, options.iterations, options.least_steps):
        report = evaluate(options.program, flags, *setting)
        print("| " + " | ".join([*setting, *cells(report)]) + " |", flush=True)


if __name__ == "__main__":
    main()
