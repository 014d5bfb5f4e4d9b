#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Trains and evaluates the grid behind the paper's two ablation tables: one budget a variant, several seeds.

  training/tools/ablation.py --bin build/release/bin --out out/ablation --time_budget 30m --seeds 1,2,3

Table 5: objectness loss x contextual attention, and what each of the two changes, seed by seed. Table 6: weight alpha
of the objectness loss. Variants that stand in both are trained once. Each run has a directory of its own,
<out>/<variant>/seed<k>: stop the script at any time and start it again, and it goes on where it was (finished runs are
kept, a run in the middle resumes from its checkpoint). The tables, <out>/ablation.md and <out>/ablation.json, are
written anew after every run, from the runs there are. --tables=table5 trains and writes one of them; what another call
trained in the same directory stays.

Flags after "--" go to holdfast-train unchanged, e.g. -- --pictures=DIR.
"""
import argparse
import itertools
import json
import math
import os
import statistics
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

METRICS = (("delta_avg", "δ_avg ↑"), ("survival_50", "Survival ↑"), ("mte", "MTE ↓"), ("left_object", "left object ↓"))
DEFAULT_ALPHA = 0.15


@dataclass(frozen=True)
class Variant:
    """A network and loss to train. attention: contextual attention on or off; alpha: weight of the objectness loss."""

    attention: bool
    alpha: float

    @property
    def name(self):
        return f"attention-{'on' if self.attention else 'off'}_alpha-{self.alpha:g}"

    def train_flags(self):
        flags = [f"--alpha={self.alpha:g}"]
        return flags if self.attention else flags + ["--attention_blocks=0"]


# (title, label of the row, variant, the paper's figures on PointOdyssey in the order of METRICS; None, or missing at
# the end: not published)
TABLES = {
    "table5": (
        "Objectness loss and contextual attention (the paper's Table 5)",
        [
            ("neither", Variant(False, 0), (29.0, 47.0, 44.3)),
            ("objectness loss only", Variant(False, DEFAULT_ALPHA), (30.2, 49.6, 42.3)),
            ("contextual attention only", Variant(True, 0), (30.6, 49.1, 48.3)),
            ("both", Variant(True, DEFAULT_ALPHA), (32.8, 52.1, 37.6)),
        ],
    ),
    "table6": (
        "Weight of the objectness loss (the paper's Table 6)",
        [
            ("α = 0", Variant(True, 0), (None, 49.1, None)),
            ("α = 0.05", Variant(True, 0.05), (None, 50.3, None)),
            ("α = 0.15", Variant(True, DEFAULT_ALPHA), (None, 52.1, None)),
            ("α = 0.5", Variant(True, 0.5), (None, 50.6, None)),
            ("α = 1", Variant(True, 1), (None, 49.8, None)),
        ],
    ),
}

# {factor of table 5: [(setting of the other factor, the variant with the factor, the one without)]}
FACTORS = {
    "objectness loss": [
        ("without attention", Variant(False, DEFAULT_ALPHA), Variant(False, 0)),
        ("with attention", Variant(True, DEFAULT_ALPHA), Variant(True, 0)),
    ],
    "contextual attention": [
        ("without objectness loss", Variant(True, 0), Variant(False, 0)),
        ("with objectness loss", Variant(True, DEFAULT_ALPHA), Variant(False, DEFAULT_ALPHA)),
    ],
}
CRITICAL_T = {2: 12.71, 3: 4.30, 4: 3.18, 5: 2.78, 6: 2.57, 8: 2.36, 10: 2.26}  # {n: two-sided 5 %, n - 1 degrees}
NO_DEVIATION = 1e-9  # differences this close to each other differ by rounding alone


def variants_of(tables):
    """Every variant of these tables once, in their order."""
    return list(dict.fromkeys(variant for table in tables for _, variant, _ in TABLES[table][1]))


def run(command, log):
    """Runs a program with its output appended to a log file; an exit code other than 0 ends the script."""
    with open(log, "a", encoding="utf-8") as out:
        out.write(f"$ {' '.join(map(str, command))}\n")
        out.flush()
        code = subprocess.run(command, stdout=out, stderr=subprocess.STDOUT).returncode
    if code != 0:
        sys.exit(f"ablation: {command[0]} ended with code {code}; see {log}")


def write_atomically(path, text):
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def budget_of(args):
    """What makes runs comparable: the tables never mix runs that differ in it."""
    return {
        "preset": args.preset,
        "time_budget": args.time_budget,
        "steps": args.steps,
        "train_flags": args.train_flags,
        "eval_flags": eval_flags(args),
    }


def eval_flags(args):
    flags = [f"--format={args.format}", f"--processing_size={args.processing_size}", f"--seed={args.eval_seed}"]
    flags += [f"--count={args.eval_count}"] if args.eval_count else []
    flags += [f"--data={args.data}"] if args.data else []
    return flags + args.eval_flags


def check_budget(args):
    """Writes the budget beside the runs, or refuses to mix runs made under another one."""
    path = args.out / "budget.json"
    budget = budget_of(args)
    if not path.exists():
        args.out.mkdir(parents=True, exist_ok=True)
        write_atomically(path, json.dumps(budget, indent=2) + "\n")
    elif json.loads(path.read_text(encoding="utf-8")) != budget:
        sys.exit(f"ablation: {path} is another budget; give another --out")


def train_and_evaluate(args, variant, seed):
    """The run's directory holds evaluation.json once it is complete."""
    folder = args.out / variant.name / f"seed{seed}"
    result = folder / "evaluation.json"
    if result.exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    train = [args.bin / "holdfast-train", f"--preset={args.preset}", f"--seed={seed}", f"--out={folder}"]
    # Without a number of steps the learning rate's schedule follows the time.
    train += [f"--steps={args.steps}"] + ([] if args.steps else [f"--time_budget={args.time_budget}"])
    print(f"train {variant.name} seed {seed}", flush=True)
    run(train + variant.train_flags() + args.train_flags, folder / "ablation.log")
    evaluate = [args.bin / "holdfast-eval", f"--weights={folder / args.weights_name}", f"--json={result}"]
    run(evaluate + eval_flags(args), folder / "ablation.log")


def collect(args, variant):
    """{finished seed: its metrics}; data without masks, and older evaluations, lack some."""
    metrics = {}
    for seed in args.seeds:
        path = args.out / variant.name / f"seed{seed}" / "evaluation.json"
        if path.exists():
            metrics[seed] = json.loads(path.read_text(encoding="utf-8"))["reports"][0]["mean"]
    return metrics


def by_seed(metrics, key):
    """{seed: value} of one metric, without the seeds that lack it."""
    return {seed: mean[key] for seed, mean in metrics.items() if mean.get(key) is not None}


def summary(values):
    """Mean and sample deviation; the deviation needs two values."""
    return {
        "mean": statistics.fmean(values) if values else None,
        "deviation": statistics.stdev(values) if len(values) > 1 else None,
        "values": values,
    }


def differences(with_factor, without):
    """Two variants' {seed: metrics} -> {metric: {seed: difference}}, of the seeds in which both have the metric."""
    result = {}
    for key, _ in METRICS:
        ours, others = by_seed(with_factor, key), by_seed(without, key)
        result[key] = {seed: ours[seed] - others[seed] for seed in ours if seed in others}
    return result


def mean_of(first, second):
    """The mean of two such differences, of the seeds that both have."""
    return {key: {seed: (first[key][seed] + second[key][seed]) / 2 for seed in first[key] if seed in second[key]}
            for key in first}


def paired(by_seeds):
    """{seed: difference} -> their summary, Student's t against no difference (it needs two that are not equal), and
    how many are above and below zero."""
    values = list(by_seeds.values())
    result = {"seeds": list(by_seeds), **summary(values), "n": len(values), "t": None}
    if len(values) > 1 and result["deviation"] > NO_DEVIATION:
        result["t"] = result["mean"] / (result["deviation"] / math.sqrt(len(values)))
    return {**result, "above_0": sum(value > 0 for value in values), "below_0": sum(value < 0 for value in values)}


def make_differences(runs):
    """A row for each factor and setting of the other one, and their mean: with the factor minus without it."""
    rows = []
    for factor, settings in FACTORS.items():
        found = {setting: differences(runs[ours], runs[others]) for setting, ours, others in settings}
        found["mean of both"] = mean_of(*found.values())
        rows += [{"factor": factor, "other": setting, "ours": {key: paired(values[key]) for key in values}}
                 for setting, values in found.items()]
    return rows


def make_tables(args):
    runs = {variant: collect(args, variant) for variant in variants_of(args.tables)}
    tables = {}
    for key in args.tables:
        title, rows = TABLES[key]
        tables[key] = {"title": title, "rows": []}
        for label, variant, published in rows:
            metrics = runs[variant]
            tables[key]["rows"].append({
                "label": label,
                "variant": variant.name,
                "runs": len(metrics),
                "ours": {metric: summary(list(by_seed(metrics, metric).values())) for metric, _ in METRICS},
                "published": {metric: figure for (metric, _), figure in itertools.zip_longest(METRICS, published)},
            })
    if "table5" in tables:
        tables["table5"]["differences"] = make_differences(runs)
    return tables


def cell(entry, runs):
    """Says so where not all of the row's runs have the metric."""
    if entry["mean"] is None:
        return "–"
    deviation = "" if entry["deviation"] is None else f" ± {entry['deviation']:.1f}"
    count = len(entry["values"])
    return f"{entry['mean']:.1f}{deviation}" + ("" if count == runs else f", n = {count}")


def difference_cell(entry):
    if entry["mean"] is None:
        return "–"
    deviation = "" if entry["deviation"] is None else f" ± {entry['deviation']:.2f}"
    t = "" if entry["t"] is None else f"t = {entry['t']:.2f}, "
    return f"{entry['mean']:+.2f}{deviation}; {t}n = {entry['n']}"


def differences_to_markdown(rows):
    """Lines of a section."""
    critical = ", ".join(f"{t:.2f} for n = {n}" for n, t in CRITICAL_T.items())
    lines = [
        "### What each factor changes", "",
        "A run with the factor minus the one of the same seed without it: mean ± deviation over n seeds. Student's t is"
        " mean / (deviation / √n); where all seeds agree there is none. Two-sided at 5 %, a difference is more than"
        f" chance where |t| is above {critical}.", "",
        "| factor | the other one | " + " | ".join(header for _, header in METRICS) + " |",
        "|---" * (len(METRICS) + 2) + "|",
    ]
    for row in rows:
        cells = " | ".join(difference_cell(row["ours"][metric]) for metric, _ in METRICS)
        lines.append(f"| {row['factor']} | {row['other']} | {cells} |")
    return lines


def to_markdown(args, tables):
    budget = f"{args.steps} steps" if args.steps else args.time_budget
    lines = [
        f"Preset `{args.preset}`, {budget} a run, seeds {', '.join(map(str, args.seeds))}; evaluated on {args.format}"
        f" data, processed at {args.processing_size}. Mean ± deviation over the seeds. In brackets: the paper, on"
        " PointOdyssey, processed at 896x512. Left object: percent of the estimates of visible points that lie on"
        " another object; the paper has no such figure. –: nothing measured; n: how many runs have the metric, where"
        " not all do."
    ]
    for table in tables.values():
        lines += ["", f"## {table['title']}", "", "| | " + " | ".join(header for _, header in METRICS) + " | runs |"]
        lines.append("|---" * (len(METRICS) + 2) + "|")
        for row in table["rows"]:
            cells = []
            for metric, _ in METRICS:
                published = row["published"][metric]
                cells.append(cell(row["ours"][metric], row["runs"]) + ("" if published is None else f" ({published})"))
            lines.append(f"| {row['label']} | " + " | ".join(cells) + f" | {row['runs']} |")
        if "differences" in table:
            lines += ["", *differences_to_markdown(table["differences"])]
    return "\n".join(lines) + "\n"


def write_tables(args):
    tables = make_tables(args)
    document = {"budget": budget_of(args), "seeds": args.seeds, "tables": tables}
    write_atomically(args.out / "ablation.json", json.dumps(document, indent=2, ensure_ascii=False) + "\n")
    markdown = to_markdown(args, tables)
    write_atomically(args.out / "ablation.md", markdown)
    return markdown


def table_names(text):
    """Names separated by commas -> those names, in the order of TABLES."""
    names = text.split(",")
    for name in names:
        if name not in TABLES:
            raise argparse.ArgumentTypeError(f"there is no {name!r}, but {' and '.join(TABLES)}")
    return [name for name in TABLES if name in names]


def parse(argv):
    own, train_flags = (argv[: argv.index("--")], argv[argv.index("--") + 1 :]) if "--" in argv else (argv, [])
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=Path, default=Path("build/release/bin"), help="where the programs are")
    parser.add_argument("--out", type=Path, default=Path("out/ablation"), help="directory of the runs and tables")
    parser.add_argument("--tables", type=table_names, default=list(TABLES), help=f"some of {','.join(TABLES)}")
    parser.add_argument("--preset", default="small")
    budget = parser.add_mutually_exclusive_group()
    budget.add_argument("--time_budget", default="30m",
                        help="of each run; attention costs time, so it makes fewer steps")
    budget.add_argument("--steps", type=int, default=0, help="of each run, in place of a time")
    parser.add_argument("--seeds", type=lambda text: [int(seed) for seed in text.split(",")], default=[1, 2, 3])
    parser.add_argument("--format", default="synthetic", help="of the evaluation data, as holdfast-eval names it")
    parser.add_argument("--data", default="", help="directory of the evaluation data")
    parser.add_argument("--eval_count", type=int, default=50, help="sequences; 0: holdfast-eval's default")
    parser.add_argument("--eval_seed", type=int, default=1000)
    parser.add_argument("--processing_size", default="512x384")
    parser.add_argument("--eval_flags", type=str.split, default=[], help="more flags of holdfast-eval, in one argument")
    parser.add_argument("--weights_name", default="final.safetensors",
                        help="file in holdfast-train's --out; best.safetensors: by validation, where that took place")
    args = parser.parse_args(own)
    args.train_flags = train_flags
    return args


def main(argv):
    args = parse(argv)
    check_budget(args)
    # Seed by seed, so that a first complete table is there after a third of the time.
    for seed in args.seeds:
        for variant in variants_of(args.tables):
            train_and_evaluate(args, variant, seed)
            write_tables(args)
    print(write_tables(args), end="")


if __name__ == "__main__":
    main(sys.argv[1:])
