// SPDX-License-Identifier: Apache-2.0
import { BufferTarget, CanvasSource, canEncodeVideo, Output, QUALITY_HIGH, WebMOutputFormat } from "mediabunny";
import { type Look, paintScene } from "../draw";
import type { FrameStore } from "../frames";
import type { Table } from "./table";

/** Why no video can be made here, or null. */
export const noOverlay = (): string | null =>
  "VideoEncoder" in window ? null : "Browsers encode video for pages of https and localhost only.";

/** A video of the frames that are kept, with the tracks drawn on them. */
export async function toWebm(
  table: Table,
  frames: FrameStore,
  look: Pick<Look, "trail" | "confidence">,
  progress: (share: number) => void,
): Promise<Uint8Array<ArrayBuffer>> {
  const canvas = new OffscreenCanvas(table.width & ~1, table.height & ~1); // codecs want even sides
  const context = canvas.getContext("2d", { alpha: false })!;
  const codec = (await canEncodeVideo("vp9")) ? "vp9" : "vp8";
  const target = new BufferTarget();
  const output = new Output({ format: new WebMOutputFormat(), target });
  const video = new CanvasSource(canvas, { codec, bitrate: QUALITY_HIGH });
  output.addVideoTrack(video, { frameRate: table.fps });
  await output.start();
  const unit = Math.max(1, Math.min(table.width, table.height) / 480);
  const whole: Look = { ...look, scale: 1, unit, selected: null, hovered: null };
  for (let frame = frames.first; frame < table.frames; ++frame) {
    const bitmap = await frames.bitmap(frame);
    if (!bitmap) continue;
    context.drawImage(bitmap, 0, 0);
    paintScene(context, table, frame, whole);
    await video.add((frame - frames.first) / table.fps, 1 / table.fps);
    progress((frame + 1 - frames.first) / (table.frames - frames.first));
  }
  await output.finalize();
  return new Uint8Array(target.buffer!);
}
