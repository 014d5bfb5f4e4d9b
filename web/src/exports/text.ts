// SPDX-License-Identifier: Apache-2.0
// Text files of tracks, byte for byte those of `holdfast track`.
import type { ObjectTrack } from "../objects";
import type { Track } from "../tracks";
import { framesOf, type Table } from "./table";

/** As printf's %.3f, or with other digits: halves, which are whole at one binary digit more, go to the even digit. */
export function fixed(value: number, digits = 3): string {
  const halves = value * 2 ** (digits + 1);
  if (!Number.isInteger(halves) || halves % 2 === 0) return value.toFixed(digits);
  const below = Math.floor(value * 10 ** digits);
  const text = ((below % 2 === 0 ? below : below + 1) / 10 ** digits).toFixed(digits);
  return Number(text) === 0 && value < 0 ? `-${text.replace("-", "")}` : text;
}

// A thousandth of a pixel; halves away from zero, and a number with a point, as the command line writes them.
function rounded(value: number): string {
  const thousandth = (Math.sign(value) * Math.round(Math.abs(value) * 1000)) / 1000;
  const text = Object.is(thousandth, -0) ? "-0" : String(thousandth);
  return /^-?\d+$/.test(text) ? `${text}.0` : text;
}

function jsonPoint(track: Track, frames: number): string {
  const at = [...framesOf(track, frames)];
  const list = (text: (frame: number) => string) => `[${at.map(text).join(",")}]`;
  const fields = [
    `"confidence":${list((t) => rounded(track.confidence(t)))}`,
    `"frames":${list(String)}`,
    `"id":${track.id}`,
    `"name":${JSON.stringify(track.name)}`,
    `"visible":${list((t) => String(track.visible(t)))}`,
    `"xy":${list((t) => `[${rounded(track.x(t))},${rounded(track.y(t))}]`)}`,
  ];
  return `{${fields.join(",")}}`;
}

function jsonObject(object: ObjectTrack, { tracks, frames }: Table): string {
  const at = [...framesOf(object, frames)];
  const list = <T>(values: readonly T[], text: (value: T) => string) => `[${values.map(text).join(",")}]`;
  const place = (x: number, y: number) => `[${rounded(x)},${rounded(y)}]`;
  const samples = at.map((t) => object.at(t)!);
  const fields = [
    `"frames":${list(at, String)}`,
    `"id":${object.id}`,
    `"joined":${list(samples, ({ joined }) => list(joined, (i) => String(object.pointAt(i))))}`,
    `"left":${list(samples, ({ left }) => list(left, (i) => String(object.pointAt(i))))}`,
    `"name":${JSON.stringify(object.name)}`,
    `"outline":${list(samples, ({ outline }) => list(outline, ([x, y]) => place(x, y)))}`,
    `"points":${list(tracks.filter((track) => track.object === object), ({ id }) => String(id))}`,
    `"rotation":${list(samples, ({ rotation }) => rounded(rotation))}`,
    `"scale":${list(samples, ({ scale }) => rounded(scale))}`,
    `"visible":${list(samples, ({ visible }) => rounded(visible))}`,
    `"xy":${list(samples, ({ x, y }) => place(x, y))}`,
  ];
  return `{${fields.join(",")}}`;
}

// The rate is the shortest text that reads back as the same number: with fewer digits long videos would run away from it.
export function toJson(table: Table): string {
  const { width, height, fps, frames, complete, finalFrames, expectedFrames } = table;
  const head =
    `{"width": ${width}, "height": ${height}, "fps": ${fps}, "frames": ${frames}, ` +
    `"complete": ${complete}, "final_frames": ${finalFrames}, "expected_frames": ${expectedFrames}, "points": [`;
  const points = table.tracks.map((track) => `\n${jsonPoint(track, frames)}`);
  const objects = table.objects.map((object) => jsonObject(object, table)).join(",");
  return `${head}${points.join(",")}\n]${objects && `,\n"objects": [${objects}]`}}\n`;
}

export function toCsv(table: Table): string {
  const lines = ["id,frame,x,y,visible,confidence"];
  for (const track of table.tracks) {
    for (const t of framesOf(track, table.frames)) {
      const numbers = [fixed(track.x(t)), fixed(track.y(t)), track.visible(t) ? 1 : 0, fixed(track.confidence(t))];
      lines.push([track.id, t, ...numbers].join(","));
    }
  }
  return `${lines.join("\n")}\n`;
}

// A field of a CSV file that may hold separators (RFC 4180).
const quoted = (text: string) => (/[,"\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

// One for each track, none twice.
function uniqueNames(tracks: readonly Track[]): string[] {
  const taken = new Set<string>();
  return tracks.map((track) => {
    let name = track.name || String(track.id);
    while (taken.has(name)) name += `_${track.id}`;
    taken.add(name);
    return name;
  });
}

/** DeepLabCut's table of one animal: a row a frame, and of each point x, y and likelihood. */
export function toDeepLabCut(table: Table): string {
  const row = (head: string, cells: (part: string) => string[]) => [head, ...uniqueNames(table.tracks).map(quoted).flatMap(cells)];
  const rows: (string | number)[][] = [
    row("scorer", () => Array(3).fill("holdfast")),
    row("bodyparts", (part) => Array(3).fill(part)),
    row("coords", () => ["x", "y", "likelihood"]),
  ];
  for (let t = 0; t < table.frames; ++t) {
    const cells = table.tracks.flatMap((track) =>
      track.has(t) ? [track.x(t), track.y(t), track.confidence(t)].map((value) => fixed(value)) : ["", "", ""]);
    rows.push([t, ...cells]);
  }
  return rows.map((cells) => `${cells.join(",")}\n`).join("");
}

const C3DE_COLOR = 0; // of points in 3DEqualizer: red

/**
 * 2D tracks as 3DEqualizer reads them: of each point its name, colour, number of keys, and those. From the lower left
 * corner of the picture, and from frame 1.
 */
export function to3de({ tracks, height, frames }: Table): string {
  const names = uniqueNames(tracks);
  const curves = tracks.map((track, i) => {
    const seen = [...framesOf(track, frames)].filter((t) => track.visible(t));
    const keys = seen.map((t) => `${t + 1} ${fixed(track.x(t) + 0.5, 6)} ${fixed(height - (track.y(t) + 0.5), 6)}\n`);
    return `${names[i]!.replace(/[\r\n]/g, " ")}\n${C3DE_COLOR}\n${keys.length}\n${keys.join("")}`;
  });
  return `${tracks.length}\n${curves.join("")}`;
}
