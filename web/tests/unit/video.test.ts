// SPDX-License-Identifier: Apache-2.0
// Videos where the browser has no decoder; tests in a browser hold both ways against the command line.
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { beforeEach, expect, test, vi } from "vitest";
import type { Picture, Source } from "../../src/sources/source";
import { openVideo } from "../../src/sources/video";
import { stretched, trimmed } from "../video_file";

const CLIP = readFileSync(join(import.meta.dirname, "../../../media/pedestrians.mp4"));
const FRAMES = 160;
const FPS = 10;
const TICKS = 1024; // of the clip's clock, for a frame

/** A video element that knows where it was led to. Before it has read the file's beginning it is led nowhere. */
class FakeVideo {
  seeks: number[] = [];
  intact = Infinity; // seconds
  onloadedmetadata: (() => void) | null = null;
  onseeked: (() => void) | null = null;
  onerror: (() => void) | null = null;
  private loaded = false;

  set src(_address: string) {
    queueMicrotask(() => {
      this.loaded = true;
      this.onloadedmetadata?.();
    });
  }
  set currentTime(seconds: number) {
    if (!this.loaded) return;
    this.seeks.push(seconds);
    queueMicrotask(() => (seconds < this.intact ? this.onseeked?.() : this.onerror?.()));
  }
  removeAttribute(): void {}
}

let video: FakeVideo;

beforeEach(() => {
  video = new FakeVideo();
  vi.stubGlobal("window", {});
  vi.stubGlobal("document", { createElement: () => video });
  vi.stubGlobal("OffscreenCanvas", class {
    getContext = () => ({ drawImage: () => {} });
    convertToBlob = async () => new Blob([Uint8Array.of(1)]);
  });
});

const open = (mp4: Uint8Array<ArrayBuffer>, maxSide = 0) =>
  openVideo(new Blob([mp4]), "clip", { maxSide, quality: 0.9 });

async function all(source: Source): Promise<Picture[]> {
  const pictures: Picture[] = [];
  for (let next = await source.next(); next; next = await source.next()) pictures.push(next);
  return pictures;
}

test("a video is given frame by frame, at its rate", async () => {
  const source = await open(Uint8Array.from(CLIP));
  expect(source).toMatchObject({ frames: FRAMES, fps: FPS, width: 768, height: 576, own: { width: 768, height: 576 } });
  const at = (await all(source)).map(({ seconds }) => Math.round(FPS * seconds));
  expect(at).toEqual(Array.from({ length: FRAMES }, (_, i) => i));
});

test.each([[0, 10], [1, 11], [TICKS - 1, 11]])(
  "a trimmed video begins with the first frame behind the cut, %i ticks into one", async (more, first) => {
    const source = await open(trimmed(CLIP, 10 * TICKS + more));
    expect(source).toMatchObject({ frames: FRAMES - first, fps: FPS });
    const pictures = await all(source);
    expect(pictures.length).toBe(FRAMES - first);
    expect(pictures[0]!.seconds).toBe(0);
    expect(video.seeks[0]).toBeCloseTo((first - 10 + 0.5) / FPS - more / TICKS / FPS, 6);
  });

test("a video of a single frame has a rate", async () => {
  expect(await open(trimmed(CLIP, (FRAMES - 1) * TICKS))).toMatchObject({ frames: 1, fps: 30 });
});

test("a video of wide pixels is sent as it is seen, and its tracks are in the pixels that it has", async () => {
  const own = { width: 768, height: 576 };
  expect(await open(stretched(CLIP, 2))).toMatchObject({ width: 1536, height: 576, own });
  expect(await open(stretched(CLIP, 2), 768)).toMatchObject({ width: 768, height: 288, own });
});

test("a video that is damaged fails there, however often it is asked for more", async () => {
  const source = await open(Uint8Array.from(CLIP));
  video.intact = 2 / FPS;
  expect([await source.next(), await source.next()]).toMatchObject([{ seconds: 0 }, { seconds: 1 / FPS }]);
  for (let i = 0; i < 2; ++i) await expect(source.next()).rejects.toThrow("does not decode");
});
