# SPDX-License-Identifier: Apache-2.0
"""The package's annotations, as mypy sees them in the package itself and in a program over it."""
import subprocess
import sys
import unittest

import support

GOOD = """
import asyncio
import numpy as np
from holdfast_client import Client, Run, Session, Tls, Tracks, aio

with Client("a:1,b:2", tls=Tls(ca="ca.pem"), token="t") as client:
    tracks: Tracks = client.track([b""], {1: (2, 3.5)}, both=True)
    live: Session = client.session(np.zeros((3, 2)), size=(512, 384))
    for update in live.push(b""):
        runs: tuple[Run, ...] = update.runs
    centre: np.ndarray = client.track([b""], [], objects={1: np.zeros((3, 4), bool)}).objects[1].centre
    window: int = client.info().window_frames

async def main() -> Tracks:
    async with aio.Client() as client, client.session() as session:
        async for update in session:
            run: Run = update.runs[0]
        return await session.finish()
asyncio.run(main())
"""
BAD = {  # a line that is wrong, and what mypy has to say
    "Client(42)": 'Argument 1 to "Client"',
    "Client().session(sise=(1, 2))": 'Unexpected keyword argument "sise"',
    "number: int = Client().track([], [])": 'expression has type "Tracks"',
    "Client().session().push('text')": 'Argument 1 to "push"',
    "aio.Client(42)": 'Argument 1 to "Client"',
    "aio.Client().track([], []).xy": '"Coroutine[Any, Any, Tracks]" has no attribute "xy"',
}


def mypy(*arguments):
    found = subprocess.run([sys.executable, "-m", "mypy", "--no-color-output", *arguments], cwd=support.STAGED,
                           capture_output=True, text=True, check=False)
    return found.stdout + found.stderr


class TypesTest(unittest.TestCase):
    def check(self, text):
        program = support.STAGED / "program.py"
        program.write_text(text, encoding="utf-8")
        self.addCleanup(program.unlink)
        return mypy("program.py")

    def test_the_package_is_annotated_and_holds_to_it(self):
        self.assertRegex(mypy(), r"^Success: no issues found in \d\d source files\n$")

    def test_programs_see_its_types(self):
        self.assertEqual(self.check(GOOD), "Success: no issues found in 1 source file\n")
        self.assertTrue((support.STAGED / "holdfast_client" / "py.typed").exists())

    def test_mistakes_in_programs_are_found(self):
        found = self.check("from holdfast_client import Client, aio\n" + "\n".join(BAD)).splitlines()
        for number, said in enumerate(BAD.values(), 2):
            self.assertTrue(any(line.startswith(f"program.py:{number}: error") and said in line for line in found),
                            f"{said} in line {number} of {found}")


if __name__ == "__main__":
    support.main()
