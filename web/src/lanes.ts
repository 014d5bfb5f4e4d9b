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

/** The frames first .. last that a timeline shows. */
export interface Span {
  from: number;
  to: number;
}

/**
 * All frames that there will be, or `most` of a longer run: the same ones as before, which began at `from`, moved no further
 * than it takes to have the frame on the stage among them. Expected null: nobody knows how many come.
 */
export function shownFrames(frames: number, expected: number | null, most: number, shown: number, from: number): Span {
  const end = Math.max(expected ?? 48, frames, 1);
  const latest = Math.max(0, Math.min(shown, end - most));
  const first = Math.min(Math.max(from, shown - most + 1), latest);
  return { from: first, to: Math.min(first + most, end) - 1 };
}
