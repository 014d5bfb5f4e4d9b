// SPDX-License-Identifier: Apache-2.0

const KEPT_BYTES = 512 << 20; // of frames; the oldest go first
const KEPT_BITMAPS = 6;

/** The frames of a run, to be looked at again: JPEGs, and bitmaps of those that were looked at last. */
export class FrameStore {
  /** Frames ever added; the newest has the index before. */
  count = 0;
  /** The oldest one that is still there. */
  first = 0;
  private jpegs: Uint8Array<ArrayBuffer>[] = [];
  private times: number[] = [];
  private bytes = 0;
  private bitmaps = new Map<number, Promise<ImageBitmap>>();

  add(jpeg: Uint8Array<ArrayBuffer>, seconds: number): void {
    this.jpegs.push(jpeg);
    this.times.push(seconds);
    this.bytes += jpeg.length;
    ++this.count;
    while (this.bytes > KEPT_BYTES && this.jpegs.length > 1) {
      this.bytes -= this.jpegs.shift()!.length;
      ++this.first;
    }
  }

  /** Of a frame that was ever added: seconds since the first one. */
  seconds(frame: number): number {
    return this.times[frame] ?? 0;
  }

  /** Frames a second, as they came. */
  get fps(): number {
    return this.count < 2 ? NaN : (this.count - 1) / (this.seconds(this.count - 1) - this.seconds(0));
  }

  jpeg(frame: number): Uint8Array<ArrayBuffer> | undefined {
    return this.jpegs[frame - this.first];
  }

  /** Null: the frame is gone. The store closes the bitmap some time after others were asked for. */
  async bitmap(frame: number): Promise<ImageBitmap | null> {
    const known = this.bitmaps.get(frame);
    if (known) return known;
    const jpeg = this.jpeg(frame);
    if (!jpeg) return null;
    const bitmap = createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
    this.bitmaps.set(frame, bitmap);
    this.forgetOldest();
    return bitmap;
  }

  clear(): void {
    for (const bitmap of this.bitmaps.values()) void bitmap.then((b) => b.close());
    Object.assign(this, { count: 0, first: 0, jpegs: [], times: [], bytes: 0, bitmaps: new Map() });
  }

  private forgetOldest(): void {
    if (this.bitmaps.size <= KEPT_BITMAPS) return;
    const [oldest, bitmap] = this.bitmaps.entries().next().value!;
    this.bitmaps.delete(oldest);
    void bitmap.then((b) => b.close());
  }
}
