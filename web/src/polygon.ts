// SPDX-License-Identifier: Apache-2.0
import type { Position } from "./points";

export const LEAST_CORNERS = 3;
const MOST_CORNERS = 1024; // that a server takes

/** Pixels of the frame within which a click means a corner. */
export interface Reach {
  first: number;
  last: number;
}

/**
 * What a click does to a polygon that is being drawn: on the first corner it closes it, and on the last one, as the second
 * of a double click. Where it cannot be closed yet the last corner is not placed again.
 */
export function clickAt(corners: readonly Position[], at: Position, reach: Reach): "corner" | "close" | "nothing" {
  const near = (corner: Position | undefined, pixels: number) =>
    corner !== undefined && Math.hypot(corner.x - at.x, corner.y - at.y) <= pixels;
  const again = near(corners.at(-1), reach.last);
  if (corners.length >= LEAST_CORNERS && (again || near(corners[0], reach.first))) return "close";
  return again || corners.length === MOST_CORNERS ? "nothing" : "corner";
}

/** Pixels that a polygon encloses, whichever way round its corners are. */
export function areaOf(corners: readonly Position[]): number {
  let twice = 0;
  corners.forEach(({ x, y }, i) => {
    const next = corners[(i + 1) % corners.length]!;
    twice += x * next.y - next.x * y;
  });
  return Math.abs(twice) / 2;
}

/** Where a shape of these corners is taken hold of. */
export function middleOf(corners: readonly Position[]): Position {
  const mean = (along: (corner: Position) => number) => corners.reduce((sum, corner) => sum + along(corner), 0) / corners.length;
  return { x: mean(({ x }) => x), y: mean(({ y }) => y) };
}
