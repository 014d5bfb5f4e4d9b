#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How fast everything is, in one table: the machine's own ceilings, the stages of tracking, and what is served.

Usage: bench.py BIN [--quick|--full] [--only=ceilings,stages,served] [--out=out/bench.json] [--compare=OLD.json]
                [--repetitions=N] [--bfloat16] [-- SERVER_FLAGS]

BIN holds holdfast-model-benchmark, holdfast-server and holdfast. Run it on a machine that is otherwise quiet.

- ceilings: what convolutions and matrix products of the libraries reach, and memory, with one thread and with all.
- stages: decode, flow, encode, attention, pyramid, correlation, update, window. The work is counted from the network's
  shape (network_work.h). "Of the ceiling": of the time taken, what the ceilings of this machine would allow; more than
  100 % is possible where memory is what limits and all of it lies in caches. "Peak MB": resident memory beyond what the
  stage was given.
- served: `holdfast load` of 1, 4 and 8 sessions at full pace; quiet, beside one and two processes that compute all the
  time, with the server on one core, and under quotas of 1 and 1.5 processors where cgroups can be used. "Peak MB" is of
  the server since its start.

All figures are medians of repetitions that take turns. --quick, the default, takes about ten minutes on two cores and
has each stage and preset at one or two sizes; --full takes hours and has all of them. --only measures again what it
names and keeps the other rows of --out, so that a machine need not be quiet for all parts at once. bfloat16 is left out
where the processor has to emulate it, unless --bfloat16 wants it. --compare also says what has become of each figure of
an older file: "better" or "worse" where all repetitions are beyond all of the older ones, by more than 5 %.
"""
import argparse
import json
import os
import pathlib
import platform
import signal
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import bench_report  # noqa: E402
from arguments import split  # noqa: E402
import served  # noqa: E402

PARTS = ("ceilings", "stages", "served")
INSTRUCTIONS = ("amx_bf16", "avx512_bf16", "avx512f", "avx2")  # the best that a processor has names it
# Of the names of cases, without their precision and threads: (stage/preset, size/points, with one thread too).
QUICK = (("decode/-", ".*/-", True), ("flow/-", "384x512/(64|256)", True),
         ("encode/small", "(256x320|384x512)/-", True), ("encode/pips2", "384x512/-", False),
         ("attention/small", "384x512/-", True), ("attention/paper", "384x512/-", False),
         ("pyramid/(small|pips2)", "384x512/-", False),
         ("correlation/small", "384x512/(64|256)", True), ("correlation/pips2", "384x512/64", False),
         ("update/small", "-/(1|64|256)", True), ("update/pips2", "-/(1|64)", False),
         ("window/small", "(256x320/64|384x512/256)", False), ("window/(pips2|paper)", "256x320/64", False))

QUICK_SESSIONS = {"quiet": (1, 4, 8)}  # 4 elsewhere


def machine():
    lines = dict(map(str.strip, line.split(":", 1)) for line in pathlib.Path("/proc/cpuinfo").read_text().splitlines()
                 if ":" in line)
    known = lines.get("flags", "").split()
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {"processor": lines.get("model name", platform.machine()),
            "instructions": next((name for name in INSTRUCTIONS if name in known), "other"),
            "processors": len(os.sched_getaffinity(0)), "GiB": round(memory / 2 ** 30)}


def commit():
    done = subprocess.run(["git", "-C", pathlib.Path(__file__).parent, "describe", "--always", "--dirty"],
                          capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def stage_filter(parts, full, threads):
    """The regular expression of the cases to be run."""
    patterns = ["ceiling[.].*"] if "ceilings" in parts else []
    if "stages" in parts and full:
        patterns.append("[a-z]+/.*")
    elif "stages" in parts:
        for begin, middle, alone in QUICK:
            patterns.append(f"{begin}/[^/]+/{middle}/{f'(1|{threads})' if alone else threads}")
    return f"^({'|'.join(patterns)})/real_time$"


def measure_stages(options, notes):
    threads = len(os.sched_getaffinity(0))
    variables = {"HOLDFAST_BENCHMARK_THREADS": str(threads), "HOLDFAST_BENCHMARK_BFLOAT16": str(int(options.bfloat16))}
    with tempfile.TemporaryDirectory(prefix="holdfast-bench-") as folder:
        out = pathlib.Path(folder) / "stages.json"
        subprocess.run([options.programs / "holdfast-model-benchmark", f"--benchmark_out={out}",
                        f"--benchmark_filter={stage_filter(options.only, options.full, threads)}",
                        f"--benchmark_repetitions={options.repetitions}", "--benchmark_enable_random_interleaving=true",
                        "--benchmark_min_time=0.05"],
                       env={**os.environ, **variables}, stdout=subprocess.DEVNULL, check=True)
        report = json.loads(out.read_text())
    if report["context"]["bfloat16"] == "emulated" and not options.bfloat16:
        for part in {"ceilings", "stages"} & set(options.only):
            notes[part].append("Left out: bfloat16, which this processor has to emulate.")
    return bench_report.read_stages(report)


def measure_served(options, notes):
    common = {"flags": options.flags, "rounds": options.repetitions, "notes": notes["served"]}
    if not options.full:
        return served.serve(options.programs, **common, size="256x192", points=64, seconds=2,
                            sessions_of=lambda place: QUICK_SESSIONS.get(place, (4,)))
    return served.serve(options.programs, **common, size="512x384", points=64, seconds=15,
                        sessions_of=lambda place: (1, 4, 8))


def read(path):
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None


def parse(arguments):
    arguments, flags = split(arguments)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=pathlib.Path, metavar="BIN")
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--quick", dest="full", action="store_false")
    parser.add_argument("--only", type=lambda text: text.split(","), default=PARTS)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/bench.json"))
    parser.add_argument("--compare", type=pathlib.Path)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--bfloat16", action="store_true")
    options = parser.parse_args(arguments)
    options.flags = flags
    if unknown := set(options.only) - set(PARTS):
        parser.error(f"--only: expected of {', '.join(PARTS)}, got {', '.join(sorted(unknown))}")
    if options.compare and not options.compare.exists():
        parser.error(f"--compare: expected a file, got {options.compare}")
    return options


def main():
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # servers and groups of processes are put away
    options = parse(sys.argv[1:])
    old = read(options.compare) if options.compare else None  # before --out is written, which may be the same
    rows, notes = {}, {part: [] for part in options.only}
    if {"ceilings", "stages"} & set(options.only):
        rows.update(measure_stages(options, notes))
    if "served" in options.only:
        rows.update(measure_served(options, notes))
    parts = {part: {"commit": commit(), "notes": notes[part]} for part in options.only}
    bench = bench_report.merge(read(options.out) if set(options.only) != set(PARTS) else None,
                               {"machine": machine(), "parts": parts, "rows": rows})
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(bench, indent=1) + "\n", encoding="utf-8")
    print(bench_report.report(bench))
    if old:
        print(bench_report.compare(old, bench))


if __name__ == "__main__":
    main()
