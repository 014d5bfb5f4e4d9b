# SPDX-License-Identifier: Apache-2.0
"""No source file of the programs asks the system for the time, or waits by the wall clock, but by api/clock.h."""
import pathlib
import re
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[1]
DIRECTORIES = ("api", "client", "io", "model", "program", "proto", "server", "training")
# What may: each file, for the one reason in its own comment.
ALLOWED = {
    "api/clock.h": r"absl::Now\(|steady_clock::now|absl/time/clock\.h",  # the system's clock itself
    "proto/grpc_deadline.h": r"gpr_now",                                   # gRPC's name for the steady clock
    "training/tools/synth_main.cc": r"std::clock\(|clock_t|<ctime>",             # processor time
}
BYPASSES = re.compile("|".join((
    r"\babsl::Now\(", r"absl/time/clock\.h", r"\bGetCurrentTimeNanos\b", r"_clock::now\b", r"_clock::to_time_t",
    r"\bstd::time\(", r"(?<![\w.>:])time\((?:NULL|nullptr|0|&)", r"\bgettimeofday\b", r"\bclock_gettime\b",
    r"\bgpr_now\b", r"<ctime>|<time\.h>|<sys/time\.h>", r"\bstd::clock\(|\bclock_t\b", r"\bgetTick", r"\bTickMeter\b",
    r"\bSleepFor\b", r"\bsleep_(?:for|until)\b", r"\bu?sleep\(", r"\bnanosleep\b", r"\btimerfd_",
    # absl's waits: by the wall clock in the version of Debian 12 (see api/steady_event.h).
    r"\bAwaitWith(?:Timeout|Deadline)\b", r"\bLockWhenWith(?:Timeout|Deadline)\b",
    r"\bWaitWith(?:Timeout|Deadline)\b", r"\bWaitForNotificationWith(?:Timeout|Deadline)\b", r"\bwait_until\b",
    r"\bToChronoTime\b")))


def bypasses(name, text):
    """Lines of 'text' that bypass the clock, as 'name:line: text'."""
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        code = line.split("//")[0]
        if name in ALLOWED:
            code = re.sub(ALLOWED[name], "", code)
        if BYPASSES.search(code):
            found.append(f"{name}:{number}: {line.strip()}")
    return found


class ClockTest(unittest.TestCase):
    def test_no_file_bypasses_the_clock(self):
        files = [path for directory in DIRECTORIES for path in sorted((SOURCE / directory).rglob("*"))
                 if path.suffix in (".cc", ".h")]
        self.assertGreater(len(files), 100)
        found = [line for path in files
                 for line in bypasses(path.relative_to(SOURCE).as_posix(), path.read_text(encoding="utf-8"))]
        self.assertEqual(found, [])

    def test_every_exception_is_still_needed(self):
        for name, pattern in ALLOWED.items():
            self.assertRegex((SOURCE / name).read_text(encoding="utf-8"), pattern)

    def test_a_bypass_is_found(self):
        for line in ("const auto t = absl::Now();", "  x = std::chrono::system_clock::now() + y;",
                     "  srand(time(nullptr));", "absl::SleepFor(absl::Seconds(1));", "  mu_.AwaitWithTimeout(c, d);",
                     "cv::getTickCount()", "std::this_thread::sleep_for(d);", "clock_gettime(CLOCK_REALTIME, &t);"):
            self.assertTrue(bypasses("server/x.cc", line), line)
        for line in ("// absl::Now() is not asked", "clock_.SteadyNow()", "CheckTime(now)", "report.time(0.5)"):
            self.assertFalse(bypasses("server/x.cc", line), line)


if __name__ == "__main__":
    unittest.main(verbosity=2)
