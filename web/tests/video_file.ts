// SPDX-License-Identifier: Apache-2.0

/** A copy of an MP4 file whose only edit list begins so many ticks of its track later: what trimming does to a file. */
export function trimmed(mp4: Uint8Array, ticks: number): Uint8Array<ArrayBuffer> {
  const copy = Uint8Array.from(mp4);
  const mediaTime = Buffer.from(copy.buffer).indexOf("elst") + 16; // behind version, flags, count and duration
  const view = new DataView(copy.buffer);
  view.setInt32(mediaTime, view.getInt32(mediaTime) + ticks);
  return copy;
}

/** A copy of an MP4 file whose pixels are so many times as wide as high. Its bit rates give way to that. */
export function stretched(mp4: Uint8Array, factor: number): Uint8Array<ArrayBuffer> {
  const copy = Uint8Array.from(mp4);
  const rates = Buffer.from(copy.buffer).indexOf("btrt");
  copy.set(Buffer.from("pasp"), rates);
  const view = new DataView(copy.buffer);
  view.setUint32(rates + 4, factor);
  view.setUint32(rates + 8, 1);
  return copy;
}
