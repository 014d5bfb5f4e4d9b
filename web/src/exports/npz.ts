// SPDX-License-Identifier: Apache-2.0
import { zipSync } from "fflate";
import { integers, npyFile, texts } from "./npy";
import { objectArrays } from "./object_arrays";
import { framesOf, type Table } from "./table";

/**
 * tracks [N, T, 2] in pixels, NaN where there is none; visible and confidence [N, T]; of each point and frame what it is;
 * and of objects, where there are any, what objectArrays() has.
 */
export function toNpz(table: Table): Uint8Array {
  const [points, frames] = [table.tracks.length, table.frames];
  const xy = new Float32Array(points * frames * 2).fill(NaN);
  const visible = new Uint8Array(points * frames);
  const confidence = new Float32Array(points * frames);
  table.tracks.forEach((track, row) => {
    for (const t of framesOf(track, frames)) {
      const at = row * frames + t;
      xy.set([track.x(t), track.y(t)], 2 * at);
      visible[at] = track.visible(t) ? 1 : 0;
      confidence[at] = track.confidence(t);
    }
  });
  return zipSync({
    "tracks.npy": npyFile("<f4", [points, frames, 2], xy),
    "visible.npy": npyFile("|b1", [points, frames], visible),
    "confidence.npy": npyFile("<f4", [points, frames], confidence),
    "ids.npy": npyFile("<i8", [points], integers(table.tracks.map((track) => track.id))),
    "names.npy": texts(table.tracks.map((track) => track.name)),
    "query_frames.npy": npyFile("<i8", [points], integers(table.tracks.map((track) => track.start))),
    "frames.npy": npyFile("<i8", [frames], integers(Array.from({ length: frames }, (_, t) => t))),
    "size.npy": npyFile("<i8", [2], integers([table.width, table.height])),
    "fps.npy": npyFile("<f8", [], Float64Array.of(table.fps)),
    "complete.npy": npyFile("|b1", [], Uint8Array.of(table.complete ? 1 : 0)),
    "final_frames.npy": npyFile("<i8", [], integers([table.finalFrames])),
    "expected_frames.npy": npyFile("<i8", [], integers([table.expectedFrames])),
    ...(table.objects.length > 0 ? objectArrays(table) : {}),
  });
}
