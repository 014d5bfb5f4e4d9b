# SPDX-License-Identifier: Apache-2.0
"""What a session keeps of what it sends, and what it tells of what its server says; no server takes part."""
import tracemalloc
import unittest
import unittest.mock
import warnings

import numpy as np

import support
from holdfast_client import HoldfastWarning
from holdfast_client._proto import point_tracking_pb2 as pb
from holdfast_client._session import SessionState

FRAME_BYTES = 1000
REPLAY, INTERVAL, HOP = 24, 16, 8
NEEDED = REPLAY + INTERVAL + 2 * HOP


def accepted(**fields):
    return pb.SessionAccepted(session_id="f00d", window_frames=24, hop_frames=HOP, **fields)


def with_checkpoints():
    return accepted(replay_frames=REPLAY, checkpoint_interval_frames=INTERVAL)


def frame(index):
    """A message that takes FRAME_BYTES of a buffer at most."""
    return pb.TrackRequest(frame=pb.Frame(index=index, data=bytes(FRAME_BYTES - 300)))


class KeepingTest(unittest.TestCase):
    def state(self, answer, frames):
        """A session that has room for so many frames, and has begun."""
        state = SessionState(pb.SessionConfig(), True, frames * FRAME_BYTES)
        self.assertTrue(state.begin(answer, "a:1"))
        return state

    def send(self, state, index):
        """Whether there is room for the frame, which is sent then."""
        if not state.room_for(frame(index)):
            return False
        state.append(frame(index))
        state.next_message()
        return True

    def test_nothing_is_kept_for_checkpoints_that_never_come(self):
        for fields in ({"replay_frames": REPLAY}, {"checkpoint_interval_frames": INTERVAL}):
            with self.subTest(fields=fields):
                state = self.state(accepted(**fields), 2 * NEEDED)
                self.assertFalse(state.keeps)
                self.assertTrue(all(self.send(state, i) for i in range(4 * NEEDED)))

    def test_a_full_buffer_waits_for_a_checkpoint_that_can_come(self):
        state, sent = self.state(with_checkpoints(), 2 * NEEDED), 0
        while sent < 4 * NEEDED and self.send(state, sent):
            sent += 1
        self.assertGreater(sent, NEEDED)
        self.assertLess(sent, 4 * NEEDED)
        state.take(pb.TrackResponse(checkpoint=pb.Checkpoint(token=b"t", next_frame=sent - NEEDED)))
        self.assertTrue(self.send(state, sent))
        self.assertTrue(state.keeps)

    def test_a_buffer_that_is_full_before_a_checkpoint_has_to_come_is_given_up(self):
        state = self.state(with_checkpoints(), REPLAY + INTERVAL + HOP)
        with self.assertWarnsRegex(HoldfastWarning, f"a:1: session f00d: .*buffer_bytes, and up to {NEEDED + 1} have"):
            self.assertTrue(all(self.send(state, i) for i in range(2 * NEEDED)))
        self.assertFalse(state.keeps)


class TellingTest(unittest.TestCase):
    def told(self, *answers, keeps=True):
        """What a session tells of these answers of its server."""
        state = SessionState(pb.SessionConfig(), keeps, FRAME_BYTES)
        state.begin(with_checkpoints(), "a:1")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            for answer in answers:
                self.assertIsNone(state.take(answer))
        self.assertTrue(all(one.category is HoldfastWarning for one in caught))
        return [str(one.message) for one in caught]

    def test_what_the_server_warns_of_is_told(self):
        answer = pb.TrackResponse()
        answer.warning.message = "frames are dark"
        for keeps in (True, False):
            self.assertEqual(self.told(answer, keeps=keeps), ["a:1: session f00d: frames are dark"])

    def test_a_session_that_has_outgrown_its_token_is_told_of_once(self):
        outgrown = pb.TrackResponse(checkpoint=pb.Checkpoint(next_frame=1))
        self.assertEqual(self.told(outgrown, outgrown),
                         ["a:1: session f00d: it has outgrown what a checkpoint can hold: it ends with its server"])
        self.assertEqual(self.told(outgrown, keeps=False), [])  # it would end with its server anyway

    def test_a_server_that_goes_away_is_told_of_where_the_session_goes_with_it(self):
        going = pb.TrackResponse()
        going.going_away.time_left.FromMilliseconds(2500)
        self.assertEqual(self.told(going), [])
        self.assertEqual(self.told(going, keeps=False),
                         ["a:1: session f00d: its server goes away, and it ends in 2.5 s at the latest"])


def tracks_of(first_frame, count=1, point=0, received=0):
    run = pb.PointRun(id=point, first_frame=first_frame, x=[first_frame] * count, y=[2] * count,
                      visible=[True] * count, confidence=[0.5] * count, final_count=count)
    sample = pb.ObjectSample(x=first_frame, y=2, scale=1, left=[4], outline_x=[1, 2, 3], outline_y=[1, 2, 1])
    kept = pb.ObjectRun(id=point, first_frame=first_frame, samples=[sample] * count, final_count=count)
    return pb.TrackResponse(tracks=pb.Tracks(runs=[run], objects=[kept], frames_received=received))


class TakingTest(unittest.TestCase):
    def setUp(self):
        self.state = SessionState(pb.SessionConfig(), False, 0)

    def test_what_a_session_keeps_begins_with_its_points(self):
        tracemalloc.start()
        self.addCleanup(tracemalloc.stop)
        for point in range(20):
            self.state.take(tracks_of(1_000_000, point=point))
        self.assertLess(tracemalloc.get_traced_memory()[1], 1 << 20)

    def test_a_table_has_every_frame_that_it_was_told_of(self):
        for first in (5, 6, 9, 3):
            self.state.take(tracks_of(first, 2))
        tracks = self.state.table.tracks()
        positions = [np.nan, np.nan, np.nan, 3, 3, 5, 6, 6, np.nan, 9, 9]
        np.testing.assert_array_equal(tracks.of(0)[:, 0], positions)
        np.testing.assert_array_equal(tracks.objects[0].centre[:, 0], positions)
        self.assertEqual(list(tracks.final[0]), list(~np.isnan(positions)))
        self.assertEqual(list(tracks.objects[0].final), list(~np.isnan(positions)))
        self.assertEqual([bool(left) for left in tracks.objects[0].left], list(~np.isnan(positions)))
        self.assertEqual([corners is None for corners in tracks.objects[0].outline], list(np.isnan(positions)))

    def test_long_tracks_are_not_copied_at_every_frame(self):
        with unittest.mock.patch.object(np, "concatenate", side_effect=np.concatenate) as copied:
            for frame in range(1000):
                self.state.take(tracks_of(frame))
        self.assertLess(copied.call_count, 200)  # about ten times nine columns

    def test_frames_that_a_server_had_do_not_become_fewer(self):
        received = [self.state.take(tracks_of(0, received=count)).frames_received for count in (30, 24, 31)]
        self.assertEqual(received, [30, 30, 31])


if __name__ == "__main__":
    support.main()
