// SPDX-License-Identifier: Apache-2.0
import { beforeEach, expect, test, vi } from "vitest";
import { openCamera } from "../../src/sources/camera";

/** A video element that shows a frame whenever one is waited for. */
class FakeVideo {
  videoWidth = 1280;
  videoHeight = 720;
  presentedFrames = 0;

  async play(): Promise<void> {}
  requestVideoFrameCallback(call: (now: number, frame: object) => void): void {
    queueMicrotask(() => call(0, { presentedFrames: ++this.presentedFrames, mediaTime: this.presentedFrames / 30 }));
  }
}

let video: FakeVideo;
let stopped: boolean;

beforeEach(() => {
  video = new FakeVideo();
  stopped = false;
  const track = { getSettings: () => ({ frameRate: 30 }), stop: () => (stopped = true) };
  const stream = { getTracks: () => [track], getVideoTracks: () => [track] };
  vi.stubGlobal("navigator", { mediaDevices: { getUserMedia: async () => stream } });
  vi.stubGlobal("document", { createElement: () => video });
  vi.stubGlobal("OffscreenCanvas", class {
    getContext = () => ({ drawImage: () => {} });
    convertToBlob = async () => new Blob([Uint8Array.of(1)]);
  });
});

test("a camera that is turned ends the run, and says so", async () => {
  const source = await openCamera({ maxSide: 640, quality: 0.9 });
  expect(source).toMatchObject({ width: 640, height: 360, own: { width: 1280, height: 720 } });
  expect([...(await source.next())!.jpeg]).toEqual([1]);
  Object.assign(video, { videoWidth: 720, videoHeight: 1280 });
  await expect(source.next()).rejects.toThrow("The camera was turned: its frames were 1280×720, and are 720×1280 now.");
  Object.assign(video, { videoWidth: 1280, videoHeight: 720 });
  expect([...(await source.next())!.jpeg]).toEqual([1]);
});

test("frames that nobody asked for are dropped, but for those of a pause", async () => {
  const source = await openCamera({ maxSide: 640, quality: 0.9 });
  const dropped = async (more: number) => {
    video.presentedFrames += more;
    await source.next();
    return source.dropped;
  };
  expect([await dropped(5), await dropped(0), await dropped(2)]).toEqual([0, 0, 2]);
  video.presentedFrames += 90;
  source.skip!();
  expect([await dropped(0), await dropped(1)]).toEqual([2, 3]);
});

test("a pause takes no time of what is recorded", async () => {
  const source = await openCamera({ maxSide: 640, quality: 0.9 });
  source.skip!(); // there was none to skip
  const at: number[] = [];
  const give = async () => at.push(Math.round(30 * (await source.next())!.seconds));
  await give();
  await give();
  video.presentedFrames += 2; // dropped
  await give();
  video.presentedFrames += 300;
  source.skip!();
  await give();
  await give();
  expect(at).toEqual([0, 1, 4, 5, 6]);
});

test("a camera whose picture cannot be played is switched off", async () => {
  video.play = () => Promise.reject(new Error("no"));
  await expect(openCamera({ maxSide: 640, quality: 0.9 })).rejects.toThrow("no");
  expect(stopped).toBe(true);
});
