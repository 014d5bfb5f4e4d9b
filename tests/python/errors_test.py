# SPDX-License-Identifier: Apache-2.0
"""The exceptions by themselves; no server takes part."""
import copy
import pickle
import unittest

import grpc

import support
import holdfast_client
from holdfast_client import HoldfastError, InvalidRequest, NotAllowed, NotResumable, Overloaded, Unavailable

CODE = grpc.StatusCode


class ErrorsTest(unittest.TestCase):
    def test_an_error_reaches_another_process_whole(self):
        invalid = InvalidRequest(CODE.INVALID_ARGUMENT, "no", "a:1")
        invalid.violations = (holdfast_client.Violation("points[0].x", "is -1"),)
        full = Overloaded(CODE.RESOURCE_EXHAUSTED, "full", "a:1")
        full.budget, full.retry_after = "sessions", 2.5
        for error in (invalid, full, NotAllowed(CODE.UNAUTHENTICATED, "who?", "a:1"),
                      NotResumable(CODE.FAILED_PRECONDITION, "other keys"),
                      Unavailable(CODE.UNAVAILABLE, "gone", "a:1"), HoldfastError(CODE.INTERNAL, "broken", "a:1")):
            for again in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
                with self.subTest(error=error):
                    self.assertIs(type(again), type(error))
                    self.assertEqual((str(again), vars(again)), (str(error), vars(error)))


if __name__ == "__main__":
    support.main()
