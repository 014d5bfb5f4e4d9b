# SPDX-License-Identifier: Apache-2.0
"""What a process has used so far, from /proc."""
import pathlib


def processor_ms(pid):
    """Milliseconds of processor time, in steps of 10."""
    times = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(times[11]) + int(times[12])) * 10


def memory_kb(pid, line="VmRSS"):
    """kB of resident memory; its peak with 'line' VmHWM."""
    return int(pathlib.Path(f"/proc/{pid}/status").read_text().split(f"{line}:")[1].split()[0])
