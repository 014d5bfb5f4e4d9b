# SPDX-License-Identifier: Apache-2.0
"""What bench.py has measured: rows read, joined, made tables of and compared. Measures nothing.

A row has a name ("encode/small/float32/384x512/-/2", "served/256x192/64/1 busy/4"), the part it belongs to, lists of
repetitions ("ms", "frames_per_second"...), and single numbers ("operations", "bytes", "peak_bytes").
"""
import re
import statistics

FIELDS = ("stage", "preset", "precision", "size", "points", "threads")  # of the names that holdfast-model-benchmark has
STAGES = ("decode", "flow", "encode", "attention", "pyramid", "correlation", "update", "window")  # in a table's order
FEWEST_PER_CENT = 5  # that count as a change
# What is compared, and whether more of it is better.
MEASURES = {"ms": False, "frames_per_second": True, "first_ms": False, "processor_ms": False}


def fields_of(name):
    return dict(zip(FIELDS, name.split("/")))


def read_stages(report):
    """Rows of the JSON that Google Benchmark writes, repetitions together."""
    rows = {}
    for run in report["benchmarks"]:
        if run["run_type"] != "iteration" or run["name"].startswith("BM_"):
            continue
        if run.get("error_occurred"):
            raise ValueError(f"{run['name']}: {run['error_message']}")
        name = "/".join(run["name"].split("/")[:len(FIELDS)])
        row = rows.setdefault(name, {"part": "ceilings" if name.startswith("ceiling.") else "stages", "ms": []})
        if run["time_unit"] != "ms":
            raise ValueError(f"{name}: time_unit: expected ms, got {run['time_unit']}")
        row["ms"].append(run["real_time"])
        row.update({key: run[key] for key in ("operations", "bytes", "peak_bytes") if key in run})
    return rows


def median(row, measure):
    return statistics.median(row[measure])


def giga_a_second(row, what):
    return row[what] / median(row, "ms") / 1e6


def ceilings(rows):
    """{(kind, precision, threads): (GFLOP/s or GB/s, shape)}, the best of each kind: convolution, matmul, memory."""
    best = {}
    for name, row in rows.items():
        if row["part"] != "ceilings":
            continue
        case = fields_of(name)
        kind = case["stage"].split(".")[1]
        key = (kind, case["precision"], case["threads"])
        speed = giga_a_second(row, "bytes" if kind == "memory" else "operations")
        best[key] = max(best.get(key, (0, "")), (speed, case["size"]))
    return best


def derive(rows):
    """Adds to stages "gflops" and "share": of the time that they take, what the ceilings would allow for their
    operations or for their bytes, whichever takes longer."""
    best = ceilings(rows)
    for name, row in rows.items():
        if row["part"] != "stages":
            continue
        case = fields_of(name)
        threads = case["threads"]
        speed = max((best.get((kind, case["precision"], threads), (0,))[0] for kind in ("convolution", "matmul")))
        memory = best.get(("memory", "-", threads), (0,))[0]
        if row.get("operations"):
            row["gflops"] = giga_a_second(row, "operations")
        if row.get("bytes") and speed and memory:
            row["share"] = max(giga_a_second(row, "operations") / speed, giga_a_second(row, "bytes") / memory)
    return rows


def merge(old, new):
    """What has parts of 'new' as they are there, and the other parts as they are in 'old', which may be None."""
    if old and old["machine"] != new["machine"]:
        raise ValueError(f"machine: expected {old['machine']}, as the file has, got {new['machine']}")
    old = old or {"parts": {}, "rows": {}}
    rows = {name: row for name, row in old["rows"].items() if row["part"] not in new["parts"]}
    return {"machine": new["machine"], "parts": {**old["parts"], **new["parts"]},
            "rows": derive({**rows, **new["rows"]})}


def number(value, digits=3):
    """With so many digits that count: 0.123, 12.3, 1230."""
    if value is None:
        return ""
    before = len(str(int(abs(value)))) if abs(value) >= 1 else 0
    return f"{value:.{max(0, digits - before)}f}"


def mega(row):
    return number(row["peak_bytes"] / 1e6) if "peak_bytes" in row else ""


def markdown(columns, rows):
    lines = ["| " + " | ".join(columns) + " |", "|---" * len(columns) + "|"]
    return "\n".join(lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows]) + "\n"


def ceilings_table(rows):
    cells = [(kind, precision, threads, number(speed), "GB/s" if kind == "memory" else "GFLOP/s", shape)
             for (kind, precision, threads), (speed, shape) in sorted(ceilings(rows).items())]
    return markdown(("ceiling", "type", "threads", "best", "", "at"), cells)


def table_place(name):
    """What names of stages are sorted by: numbers in them as numbers, whatever order they were measured in."""
    case = fields_of(name)
    stage = STAGES.index(case["stage"]) if case["stage"] in STAGES else len(STAGES)
    numbers = [int(digits) for digits in re.findall(r"\d+", "/".join((case["size"], case["points"], case["threads"])))]
    return stage, case["preset"], case["precision"], numbers


def stages_table(rows):
    cells = []
    for name in sorted((name for name, row in rows.items() if row["part"] == "stages"), key=table_place):
        row = rows[name]
        share = f"{100 * row['share']:.0f} %" if "share" in row else ""
        cells.append((*fields_of(name).values(), number(median(row, "ms")), number(row.get("gflops")), share,
                      mega(row)))
    return markdown((*FIELDS, "ms", "GFLOP/s", "of the ceiling", "peak MB"), cells)


def served_table(rows):
    cells = []
    for name, row in rows.items():
        if row["part"] == "served":
            quiet = rows.get("/".join([*name.split("/")[:3], "quiet", name.split("/")[4]]))
            rate = median(row, "frames_per_second")
            share = f"{100 * rate / median(quiet, 'frames_per_second'):.0f} %" if quiet else ""
            cells.append((*name.split("/")[1:], number(rate), share,
                          f"{median(row, 'first_ms'):.0f} / {median(row, 'first_ms_95'):.0f}",
                          number(median(row, "processor_ms")), mega(row)))
    return markdown(("size", "points", "beside", "sessions", "frames/s", "of quiet", "first estimate ms, p50 / p95",
                     "processor ms a frame", "peak MB"), cells)


def report(bench):
    """All tables, as Markdown."""
    texts = [", ".join(f"{key} {value}" for key, value in bench["machine"].items()) + "\n"]
    for part, table in {"ceilings": ceilings_table, "stages": stages_table, "served": served_table}.items():
        if part in bench["parts"]:
            about = bench["parts"][part]
            texts += [f"{part}, commit {about['commit']}\n", table(bench["rows"]), *map("{}\n".format, about["notes"])]
    return "\n".join(texts)


def moved(before, now, more_is_better):
    """1 or -1 where each repetition is better or worse than each before, by more than FEWEST_PER_CENT; else 0."""
    less, more = sorted((before, now), key=statistics.median)
    apart = max(less) < min(more) and statistics.median(more) > (1 + FEWEST_PER_CENT / 100) * statistics.median(less)
    return 0 if not apart else 1 if (now is more) == more_is_better else -1


def compare(old, new):
    """A table of how many times as good each measure of rows that both have has become."""
    words = {1: "better", 0: "", -1: "worse"}
    cells, machine = [], []
    for name, row in new["rows"].items():
        for measure, more_is_better in MEASURES.items():
            before = old["rows"].get(name, {}).get(measure)
            if measure not in row or not before:
                continue
            ratio = median(row, measure) / statistics.median(before)
            ratio = ratio if more_is_better else 1 / ratio
            if row["part"] == "ceilings":
                machine.append(ratio)
            cells.append((name, measure, number(statistics.median(before)), number(median(row, measure)),
                          f"{ratio:.2f}", words[moved(before, row[measure], more_is_better)]))
    text = markdown(("row", "measure", "before", "now", "times as good", "beyond noise"), cells)
    if machine:
        text += f"\nThe machine's own ceilings: {statistics.median(machine):.2f} times as good (median).\n"
    counts = [sum(1 for cell in cells if cell[-1] == word) for word in ("better", "worse")]
    return text + f"\n{len(cells)} compared: {counts[0]} better, {counts[1]} worse beyond noise.\n"
