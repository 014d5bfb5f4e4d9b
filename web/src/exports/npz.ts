// SPDX-License-Identifier: Apache-2.0
import { zipSync } from "fflate";
import { framesOf, type Table } from "./table";

const ALIGNMENT = 64; // of an array's data, as NumPy asks for

/** An array in NumPy's format, version 1.0. */
export function npyFile(dtype: string, shape: readonly number[], data: ArrayBufferView): Uint8Array {
  const tuple = shape.length === 1 ? `${shape[0]},` : shape.join(", "); // a tuple of one needs its comma
  let header = `{'descr': '${dtype}', 'fortran_order': False, 'shape': (${tuple}), }`;
  const unpadded = 8 + 2 + header.length + 1;
  header += " ".repeat((ALIGNMENT - (unpadded % ALIGNMENT)) % ALIGNMENT) + "\n";
  const file = new Uint8Array(10 + header.length + data.byteLength);
  file.set([0x93, ...new TextEncoder().encode("NUMPY"), 1, 0, header.length & 0xff, header.length >> 8]);
  file.set(new TextEncoder().encode(header), 10);
  file.set(new Uint8Array(data.buffer, data.byteOffset, data.byteLength), 10 + header.length);
  return file;
}

/** Texts of one length, that of the longest, as NumPy has them: code points of 32 bits. */
function texts(values: readonly string[]): Uint8Array {
  const points = values.map((text) => [...text].map((letter) => letter.codePointAt(0)!));
  const longest = Math.max(1, ...points.map((text) => text.length));
  const all = new Uint32Array(values.length * longest);
  points.forEach((text, row) => all.set(text, row * longest));
  return npyFile(`<U${longest}`, [values.length], all);
}

/** tracks [N, T, 2] in pixels, NaN where there is none; visible and confidence [N, T]; of each point and frame what it is. */
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
  const integers = (values: number[]) => BigInt64Array.from(values, BigInt);
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
  });
}
