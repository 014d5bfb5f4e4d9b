// SPDX-License-Identifier: Apache-2.0
import type { Position, Stroke } from "./points";

/** The line that a stroke follows. A touch has a length too: canvases paint nothing that has none. */
export const lineOf = ({ path }: Stroke): Position[] => [...path, { x: path.at(-1)!.x + 0.01, y: path.at(-1)!.y }];

/** A PNG of the frame's size that is white where a stroke of the brush went. */
export async function maskOf(stroke: Stroke, width: number, height: number): Promise<Uint8Array> {
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d", { alpha: false })!; // black
  context.translate(0.5, 0.5); // (0, 0) is the first pixel's centre
  context.lineCap = context.lineJoin = "round";
  context.lineWidth = 2 * stroke.radius;
  context.strokeStyle = "#fff";
  for (const { x, y } of lineOf(stroke)) context.lineTo(x, y);
  context.stroke();
  return new Uint8Array(await (await canvas.convertToBlob({ type: "image/png" })).arrayBuffer());
}

/** About `count` positions in rows over a frame, as `holdfast track --grid` has them. */
export function grid(count: number, width: number, height: number): Position[] {
  const cell = Math.sqrt((width * height) / count);
  const columns = Math.min(Math.max(1, Math.round(width / cell)), count, width);
  const rows = Math.min(Math.max(1, Math.round(count / columns)), height);
  const points: Position[] = [];
  for (let row = 0; row < rows; ++row) {
    for (let column = 0; column < columns; ++column) {
      points.push({ x: ((column + 0.5) * width) / columns - 0.5, y: ((row + 0.5) * height) / rows - 0.5 });
    }
  }
  return points;
}
