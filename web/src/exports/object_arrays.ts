// SPDX-License-Identifier: Apache-2.0
import type { ObjectTrack } from "../objects";
import { integers, npyFile, texts } from "./npy";
import { framesOf, type Table } from "./table";

type Arrays = Record<string, Uint8Array>;

/** [O, T, ...width] of what objects say on each frame; `unknown` on those that they do not have. */
function perFrame(
  { objects, frames }: Table, width: readonly number[], values: (object: ObjectTrack, t: number) => number[], unknown = NaN,
): Uint8Array {
  const size = width.reduce((product, length) => product * length, 1);
  const all = new Float32Array(objects.length * frames * size).fill(unknown);
  objects.forEach((object, row) => {
    for (const t of framesOf(object, frames)) all.set(values(object, t), (row * frames + t) * size);
  });
  return npyFile("<f4", [objects.length, frames, ...width], all);
}

/** As many corners as the largest outline has. */
function cornersOf({ objects, frames }: Table): number {
  let corners = 0;
  for (const object of objects)
    for (const t of framesOf(object, frames)) corners = Math.max(corners, object.at(t)!.outline.length);
  return corners;
}

/** Whether a point does not move with its object, [N, T]. */
function leftOf({ tracks, frames }: Table): Uint8Array {
  const left = new Uint8Array(tracks.length * frames);
  tracks.forEach(({ id, object }, row) => {
    if (object === null) return;
    for (const t of framesOf(object, frames))
      if (object.at(t)!.left.some((place) => object.pointAt(place) === id)) left[row * frames + t] = 1;
  });
  return npyFile("|b1", [tracks.length, frames], left);
}

/**
 * Arrays of O objects, as files of `holdfast track` have them (client/cli/track_writer.h), and their names. A point that
 * was placed anew goes on in the row of the one before, so that none replaces another.
 */
export function objectArrays(table: Table): Arrays {
  const { tracks, objects } = table;
  return {
    "of_object.npy": npyFile("<i8", [tracks.length], integers(tracks.map(({ object }) => object?.id ?? -1))),
    "replaces.npy": npyFile("<i8", [tracks.length], integers(tracks.map(() => -1))),
    "left.npy": leftOf(table),
    "object_ids.npy": npyFile("<i8", [objects.length], integers(objects.map(({ id }) => id))),
    "object_names.npy": texts(objects.map(({ name }) => name)),
    "object_centre.npy": perFrame(table, [2], (object, t) => [object.x(t), object.y(t)]),
    "object_scale.npy": perFrame(table, [], (object, t) => [object.at(t)!.scale]),
    "object_rotation.npy": perFrame(table, [], (object, t) => [object.at(t)!.rotation]),
    "object_visible.npy": perFrame(table, [], (object, t) => [object.at(t)!.visible], 0),
    "object_outline.npy": perFrame(table, [cornersOf(table), 2], (object, t) => object.at(t)!.outline.flat()),
  };
}
