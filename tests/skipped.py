#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Says what ctest's last run has skipped, and why. ctest itself counts a program as passed when some of its tests ran.

Usage: skipped.py BUILD...
"""
import collections
import pathlib
import re
import sys

TEST = re.compile(r"^\d+/\d+ Testing: (?P<name>.+)\n(?P<output>(?:.*\n)*?)<end of output>$", re.MULTILINE)
# As GoogleTest, unittest (in its verbose form) and the programs of SKIP_RETURN_CODE say it.
REASON = re.compile(r"""^.+:\d+:[ ]Skipped\n(.*)$ | [ ]\.\.\.[ ]skipped[ ](['"])(.*)\2$ | ^skipped:[ ](.*)$""",
                    re.MULTILINE | re.VERBOSE)


def skipped(log):
    """Of each reason, how often each of ctest's tests gives it; 'log' is the text of a LastTest.log."""
    reasons = collections.defaultdict(collections.Counter)
    for test in TEST.finditer(log):
        for reason in REASON.finditer(test["output"]):
            words = reason[1] or reason[3] or reason[4] or "no reason is given"
            reasons[words][test["name"]] += 1
    return reasons


def report(build):
    reasons = skipped((build / "Testing/Temporary/LastTest.log").read_text(encoding="utf-8", errors="replace"))
    if not reasons:
        print(f"{build.name}: nothing was skipped")
    for words, tests in sorted(reasons.items()):
        print(f"{build.name}: skipped {tests.total()}: {words} ({', '.join(sorted(tests))})")


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        report(pathlib.Path(argument))
