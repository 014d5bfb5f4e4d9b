// SPDX-License-Identifier: Apache-2.0
import type { ObjectTrack } from "./objects";
import type { Track } from "./tracks";

export type Lane = Track | ObjectTrack;

/** Frames first .. last of a track that look alike in its lane. */
export interface Stretch {
  first: number;
  last: number;
  visible: boolean;
  final: boolean;
}

/** A track between two frames, as stretches of one look. */
export function stretches(track: Lane, from: number, to: number): Stretch[] {
  const found: Stretch[] = [];
  let open: Stretch | null = null;
  for (let t = Math.max(from, track.start); t <= Math.min(to, track.end - 1); ++t) {
    if (!track.has(t)) {
      open = null;
      continue;
    }
    const [visible, final] = [track.visible(t), track.isFinal(t)];
    if (open && open.visible === visible && open.final === final) {
      open.last = t;
    } else {
      open = { first: t, last: t, visible, final };
      found.push(open);
    }
  }
  return found;
}

/** The frames that a timeline shows: all of them, or the newest `most` of a long run. Null: nobody knows how many come. */
export function shownFrames(frames: number, expected: number | null, most: number): { from: number; to: number } {
  const to = Math.max(expected ?? 48, frames, 1) - 1;
  return { from: Math.max(0, to - most + 1), to };
}
