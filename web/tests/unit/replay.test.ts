// SPDX-License-Identifier: Apache-2.0
import { expect, test } from "vitest";
import { ReplayBuffer } from "../../src/replay";

/** Frames by their index, other messages as null; the first `sent` have left. */
function buffer(frames: (number | null)[], sent: number): ReplayBuffer {
  const replay = new ReplayBuffer();
  for (const frame of frames) replay.push({ bytes: new Uint8Array(10), frame });
  for (let i = 0; i < sent; ++i) replay.advance();
  return replay;
}

function left(replay: ReplayBuffer): (number | null)[] {
  replay.rewind(0);
  const frames = [];
  for (let message; (message = replay.peek()); replay.advance()) frames.push(message.frame);
  return frames;
}

test("messages leave in their order, and stay", () => {
  const replay = buffer([0, null, 1], 2);
  expect(replay.unsent).toBe(1);
  expect(replay.peek()!.frame).toBe(1);
  expect(left(replay)).toEqual([0, null, 1]);
});

test("a checkpoint lets go of what it holds, but for the frame that later messages speak of", () => {
  const replay = buffer([0, 1, null, 2, null, 3], 6);
  expect(replay.dropBefore(3)).toBe(true);
  expect(replay.frames).toBe(1);
  expect(replay.bytes).toBe(10);
  expect(left(replay)).toEqual([3]);
  expect(buffer([0, 1, null, 2], 4).dropBefore(2)).toBe(true);
});

test("points added on the newest frame before the checkpoint's survive it", () => {
  const replay = buffer([0, 1, null], 3);
  expect(replay.dropBefore(2)).toBe(true);
  expect(left(replay)).toEqual([1, null]);
});

test("what has not left is never dropped", () => {
  const replay = buffer([0, 1, 2, 3], 2);
  expect(replay.dropBefore(3)).toBe(true);
  expect(left(replay)).toEqual([2, 3]);
});

test("a checkpoint that wants a frame that is gone is of no use", () => {
  const replay = buffer([5, 6], 2);
  expect(replay.dropBefore(4)).toBe(false);
  expect(left(replay)).toEqual([5, 6]);
});

test("a server that would go on at a frame that is gone cannot be followed", () => {
  expect(buffer([5, 6], 2).rewind(4)).toBe(false);
  expect(buffer([5, 6], 2).rewind(5)).toBe(true);
  expect(buffer([], 0).rewind(9)).toBe(true);
});

test("a buffer that keeps nothing forgets what it has sent, and will send", () => {
  const replay = buffer([0, 1, 2], 2);
  replay.keepNothing();
  expect(replay.frames).toBe(1);
  replay.advance();
  expect(replay.frames).toBe(0);
  expect(replay.bytes).toBe(0);
});
