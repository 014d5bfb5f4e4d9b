// SPDX-License-Identifier: Apache-2.0
import type { ObjectTrack } from "../objects";
import type { Track } from "../tracks";

/** What a file of tracks says; the same things as files of `holdfast track` (client/cli/track_writer.cc). */
export interface Table {
  tracks: Track[]; // of all points, objects' included
  objects: ObjectTrack[];
  width: number; // of the frames, pixels
  height: number;
  fps: number;
  frames: number;
  complete: boolean; // false: `frames` is fewer than was asked for, and those from finalFrames on may be provisional
  finalFrames: number;
  expectedFrames: number;
}

/** The frames on which a point or an object has an estimate. */
export function* framesOf(track: Track | ObjectTrack, frames: number): Generator<number> {
  for (let t = track.start; t < Math.min(track.end, frames); ++t) if (track.has(t)) yield t;
}
