# SPDX-License-Identifier: Apache-2.0
"""Command lines that end with flags for another program."""


def split(arguments):
    """Those before the first "--", and those behind it."""
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    return arguments[:cut], arguments[cut + 1:]
