// SPDX-License-Identifier: Apache-2.0
import type { Track } from "../tracks";
import type { Table } from "./table";
import { fixed } from "./text";

const ANY_POINT = "point"; // the label of points without a name

// XML knows no character below a space but three, not even escaped.
const escaped = (text: string) =>
  text
    .replace(/[\0-\x08\x0b\x0c\x0e-\x1f]/g, " ")
    .replace(/[&<>"]/g, (letter) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[letter]!);

const labelOf = ({ id, name }: Track) => (name === "" || name === String(id) ? ANY_POINT : escaped(name));

// Letters beyond 16 bits are behind all others, as in UTF-8.
function byCodePoint(a: string, b: string): number {
  const [x, y] = [[...a], [...b]].map((text) => text.map((letter) => letter.codePointAt(0)!));
  const at = x!.findIndex((point, i) => point !== y![i]);
  return at < 0 ? x!.length - y!.length : x![at]! - (y![at] ?? -1);
}

function meta(tracks: Track[], { frames, goesOn, width, height }: Table): string {
  const labels = [...new Set(tracks.map(labelOf))].sort(byCodePoint);
  const described = labels.map((label) => `<label><name>${label}</name><type>points</type><attributes></attributes></label>\n`);
  return (
    `<meta><task><size>${frames + Number(goesOn)}</size><mode>interpolation</mode>` +
    `<original_size><width>${width}</width><height>${height}</height></original_size>\n` +
    `<labels>\n${described.join("")}</labels></task></meta>\n`
  );
}

// A shape holds until the next one: where nothing is known any more, the last one is repeated as being outside, behind
// the last frame too where the source has another one.
function shapes(track: Track, { frames, goesOn, width, height }: Table): string {
  const beyond = (at: number, side: number) => !(at >= -0.5 && at < side - 0.5); // the first pixel is around (0, 0)
  let [lines, before] = ["", -1];
  for (let t = track.start; t < frames + Number(goesOn); ++t) {
    const known = t < frames && track.has(t) ? t : before;
    if (known >= 0) {
      const [x, y] = [track.x(known), track.y(known)];
      const outside = known !== t || beyond(x, width) || beyond(y, height);
      lines +=
        `  <points frame="${t}" keyframe="1" outside="${Number(outside)}" occluded="${Number(!track.visible(known))}" ` +
        `points="${fixed(x)},${fixed(y)}" z_order="0"></points>\n`;
    }
    before = known === t ? t : -1;
  }
  return lines;
}

/**
 * CVAT for video 1.1, byte for byte that of `holdfast track`: a track a point, with a shape for each frame. CVAT does not
 * import a file with a track that has no shape: a point that is known on no frame is left out, with its label.
 */
export function toCvat(table: Table): string {
  const known = table.tracks.map((track) => ({ track, shapes: shapes(track, table) })).filter(({ shapes }) => shapes);
  const tracks = known.map(
    ({ track, shapes }) => `<track id="${track.id}" label="${labelOf(track)}" source="auto">\n${shapes}</track>\n`);
  return (
    `<?xml version="1.0" encoding="utf-8"?>\n<annotations>\n<version>1.1</version>\n` +
    `${meta(known.map(({ track }) => track), table)}${tracks.join("")}</annotations>\n`
  );
}
