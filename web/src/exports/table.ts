// SPDX-License-Identifier: Apache-2.0
import type { ObjectTrack } from "../objects";
import { type Source, toOwnPixels } from "../sources/source";
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
  goesOn: boolean; // the source is known to have frames behind the last one
}

/** A table in pixels of the frames sent, as one in pixels of its source's own frames. */
export function inOwnPixels(table: Table, source: Source): Table {
  const resizing = toOwnPixels(source);
  const objects = new Map<ObjectTrack | null, ObjectTrack>(table.objects.map((object) => [object, object.resized(resizing)]));
  const tracks = table.tracks.map((track) => track.resized(resizing, objects.get(track.object) ?? null));
  return { ...table, ...source.own, tracks, objects: [...objects.values()] };
}

/** The frames on which a point or an object has an estimate. */
export function* framesOf(track: Track | ObjectTrack, frames: number): Generator<number> {
  for (let t = track.start; t < Math.min(track.end, frames); ++t) if (track.has(t)) yield t;
}
