// SPDX-License-Identifier: Apache-2.0
import { lineOf } from "./brush";
import type { ObjectTrack } from "./objects";
import type { Polygon, Position, Stroke } from "./points";
import type { Track } from "./tracks";

/** All that there is to paint. */
export interface Scene {
  tracks: Iterable<Track>;
  objects: Iterable<ObjectTrack>;
}

/** How tracks are painted over a frame. */
export interface Look {
  scale: number; // canvas pixels per pixel of the frame
  unit: number; // canvas pixels; a disc's radius is 5 of them
  trail: number; // frames
  confidence: boolean; // colour tells confidence, not the point
  selected: number | null;
  hovered: number | null;
}

type Context = CanvasRenderingContext2D | OffscreenCanvasRenderingContext2D;

const GOLDEN_RATIO = 0.6180339887498949;
const BANDS = 6; // steps in which a trail fades
const HELD_FRAMES = 48; // for so long a point without a newer estimate is shown where it was,
const DIMMED_AFTER = 12; // and paler when it is older than what the network is usually behind
const DARK = "rgb(10 14 20 / 0.75)";
const RIM = "rgb(10 14 20 / 0.35)";
const LEFT = "#ff8a7d"; // points that have left their object
// From no confidence to full: told apart in grey and by all kinds of colour vision.
const RAMP: [number, number, number][] = [[197, 42, 84], [232, 106, 52], [245, 178, 60], [214, 226, 117], [120, 222, 196]];

/** Steps of the golden ratio keep neighbours apart, however many there are. */
export function colorOf(track: { order: number }): string {
  const hue = (0.08 + track.order * GOLDEN_RATIO) % 1;
  return `hsl(${(360 * hue).toFixed(1)} 95% 62%)`;
}

export function confidenceColor(confidence: number): string {
  const at = Math.min(Math.max(confidence, 0), 1) * (RAMP.length - 1);
  const [low, high] = [RAMP[Math.floor(at)]!, RAMP[Math.ceil(at)]!];
  const mixed = low.map((channel, i) => Math.round(channel + (high[i]! - channel) * (at % 1)));
  return `rgb(${mixed.join(" ")})`;
}

/** Paints what there is as it is on a frame: trails first, the oldest part the faintest. */
export function paintScene(context: Context, scene: Scene, frame: number, look: Look): void {
  const [tracks, objects] = [[...scene.tracks], [...scene.objects]];
  context.lineCap = context.lineJoin = "round";
  for (const object of objects) paintOutline(context, object, frame, look);
  for (const path of [...tracks.filter((track) => !track.object), ...objects]) {
    if (look.trail > 0) paintTrail(context, path, frame, look);
  }
  for (const track of tracks) (track.object ? paintMember : paintPoint)(context, track, frame, look);
  for (const object of objects) paintCentre(context, object, frame, look);
  context.setLineDash([]);
  context.globalAlpha = 1;
}

const placed = (value: number, look: Look) => (value + 0.5) * look.scale; // (0, 0) is the first pixel's centre

const strokeOf = (track: Track | ObjectTrack, frame: number, look: Look) =>
  look.confidence ? confidenceColor(track.confidence(frame)) : colorOf(track);

function paintTrail(context: Context, track: Track | ObjectTrack, frame: number, look: Look): void {
  const begin = Math.max(track.start, frame - look.trail);
  frame = Math.min(frame, track.end - 1); // the newest part is where the estimates end
  context.lineWidth = (look.selected === track.id ? 3 : 2.2) * look.unit;
  for (let band = 0; band < BANDS; ++band) {
    const from = Math.max(begin, frame - look.trail + Math.round((look.trail * band) / BANDS));
    const to = Math.min(track.end - 1, frame - look.trail + Math.round((look.trail * (band + 1)) / BANDS));
    context.globalAlpha = ((band + 1) / BANDS) ** 1.3 * 0.95;
    for (let t = from; t < to; ) t = paintStretch(context, track, t, to, look);
  }
}

// Frames of one look, from t on; returns where they end.
function paintStretch(context: Context, track: Track | ObjectTrack, t: number, to: number, look: Look): number {
  if (!track.has(t)) return t + 1;
  const final = track.isFinal(t);
  context.beginPath();
  context.moveTo(placed(track.x(t), look), placed(track.y(t), look));
  const first = t;
  while (t < to && track.has(t + 1) && (t === first || track.isFinal(t) === final) && (t === first || !look.confidence)) {
    ++t;
    context.lineTo(placed(track.x(t), look), placed(track.y(t), look));
  }
  context.setLineDash(final ? [] : [2.5 * look.unit, 3.5 * look.unit]);
  const width = context.lineWidth;
  context.lineWidth = width + 1.4 * look.unit; // a dark rim shows it on bright ground
  context.strokeStyle = RIM;
  context.stroke();
  context.lineWidth = width;
  context.strokeStyle = strokeOf(track, first, look);
  context.stroke();
  return Math.max(t, first + 1);
}

/** The frame whose estimate is shown on this one, or -1; paler where it is old. */
function shownAt(context: Context, track: Track | ObjectTrack, frame: number): number {
  const at = track.newest(frame);
  context.globalAlpha = frame - at <= DIMMED_AFTER ? 1 : 0.55;
  return frame - at > HELD_FRAMES ? -1 : at;
}

function paintPoint(context: Context, track: Track, frame: number, look: Look): void {
  const at = shownAt(context, track, frame);
  if (at < 0) return;
  const [x, y] = [placed(track.x(at), look), placed(track.y(at), look)];
  const [radius, color] = [5 * look.unit, strokeOf(track, at, look)];
  const visible = track.visible(at);
  context.setLineDash([]);
  disc(context, x, y, radius + 1.6 * look.unit, DARK);
  if (visible) disc(context, x, y, radius - (track.isFinal(at) ? 0 : 1.8 * look.unit), color);
  // Around what is provisional goes a dashed ring; a hidden point is nothing but a ring.
  ring(context, x, y, radius, color, 1.6 * look.unit, track.isFinal(at) ? [] : [2.2 * look.unit, 2.2 * look.unit]);
  if (track.id !== look.selected && track.id !== look.hovered) return;
  context.globalAlpha = 1;
  ring(context, x, y, radius + 4 * look.unit, "#fff", 1.8 * look.unit, []);
  if (track.id === look.selected) label(context, track.name, x + radius + 8 * look.unit, y, look.unit);
}

// A point of an object: smaller than one that the user placed, and a cross where it has left.
function paintMember(context: Context, track: Track, frame: number, look: Look): void {
  const at = shownAt(context, track, frame);
  if (at < 0) return;
  const [x, y, unit] = [placed(track.x(at), look), placed(track.y(at), look), look.unit];
  const color = strokeOf(track, at, look);
  if (track.object!.hasLeft(track.id, at)) return cross(context, x, y, unit);
  disc(context, x, y, 3.4 * unit, DARK);
  if (track.visible(at)) disc(context, x, y, 2.3 * unit, color);
  else ring(context, x, y, 2.2 * unit, color, unit, []);
}

function cross(context: Context, x: number, y: number, unit: number): void {
  context.setLineDash([]);
  for (const [style, width] of [[DARK, 4.6], [LEFT, 2.2]] as const) {
    context.beginPath();
    for (const way of [1, -1]) {
      context.moveTo(x - 4.5 * unit, y - 4.5 * way * unit);
      context.lineTo(x + 4.5 * unit, y + 4.5 * way * unit);
    }
    context.strokeStyle = style;
    context.lineWidth = width * unit;
    context.stroke();
  }
}

function paintOutline(context: Context, object: ObjectTrack, frame: number, look: Look): void {
  const at = shownAt(context, object, frame);
  if (at < 0) return;
  const chosen = object.id === look.selected || object.id === look.hovered;
  const [alpha, color] = [context.globalAlpha * (object.visible(at) ? 1 : 0.5), strokeOf(object, at, look)];
  context.beginPath();
  for (const [x, y] of object.at(at)!.outline) context.lineTo(placed(x, look), placed(y, look));
  context.closePath();
  context.globalAlpha = alpha * (chosen ? 0.2 : 0.09);
  context.fillStyle = color;
  context.fill();
  context.globalAlpha = alpha;
  context.setLineDash(object.isFinal(at) ? [] : [5 * look.unit, 5 * look.unit]);
  for (const [style, width] of [[DARK, 3.6], [color, 1.8]] as const) {
    context.strokeStyle = style;
    context.lineWidth = (chosen ? width + 0.8 : width) * look.unit;
    context.stroke();
  }
}

// A gauge: the part of its ring that is bright is the share of the object that is in sight.
function paintCentre(context: Context, object: ObjectTrack, frame: number, look: Look): void {
  const at = shownAt(context, object, frame);
  if (at < 0) return;
  const [x, y, unit] = [placed(object.x(at), look), placed(object.y(at), look), look.unit];
  const share = object.confidence(at);
  context.setLineDash([]);
  disc(context, x, y, 9.5 * unit, DARK);
  ring(context, x, y, 6.5 * unit, "rgb(255 255 255 / 0.28)", 3 * unit, []);
  context.beginPath();
  context.arc(x, y, 6.5 * unit, -Math.PI / 2, (2 * share - 0.5) * Math.PI);
  context.lineWidth = 3 * unit;
  context.strokeStyle = strokeOf(object, at, look);
  if (share > 0) context.stroke();
  disc(context, x, y, 1.8 * unit, "#fff");
  if (object.id !== look.selected && object.id !== look.hovered) return;
  context.globalAlpha = 1;
  ring(context, x, y, 11 * unit, "#fff", 1.8 * unit, []);
  label(context, `${object.name}, ${Math.round(100 * share)} % seen`, x + 16 * unit, y, unit);
}

/** What an object was said to cover, where nothing is known of it yet. */
export function paintShape(context: Context, shape: Stroke | Polygon, color: string, look: Look): void {
  if ("path" in shape) return paintStroke(context, shape, color, look);
  paintLines(context, shape.corners, color, look, true);
}

/** An outline that is being drawn; with the click that would come now it has `next` as a corner, or is closed. */
export function paintOutlining(
  context: Context, corners: readonly Position[], next: Position | null, closes: boolean, color: string, look: Look,
): void {
  paintLines(context, next && !closes ? [...corners, next] : corners, color, look, closes);
  corners.forEach(({ x, y }, i) => {
    const large = closes && i === 0;
    disc(context, placed(x, look), placed(y, look), (large ? 7.5 : 4.5) * look.unit, DARK);
    disc(context, placed(x, look), placed(y, look), (large ? 6 : 3) * look.unit, i === 0 ? "#fff" : color);
  });
}

function paintLines(context: Context, corners: readonly Position[], color: string, look: Look, closed: boolean): void {
  context.beginPath();
  for (const { x, y } of corners) context.lineTo(placed(x, look), placed(y, look));
  if (closed) context.closePath();
  context.globalAlpha = 0.3;
  context.fillStyle = color;
  context.fill();
  context.globalAlpha = 1;
  context.setLineDash([]);
  context.lineCap = context.lineJoin = "round";
  for (const [style, width] of [[DARK, 3.6], [color, 1.8]] as const) {
    context.strokeStyle = style;
    context.lineWidth = width * look.unit;
    context.stroke();
  }
}

/** What a stroke of the brush covers. */
export function paintStroke(context: Context, stroke: Stroke, color: string, look: Look): void {
  context.beginPath();
  for (const { x, y } of lineOf(stroke)) context.lineTo(placed(x, look), placed(y, look));
  context.setLineDash([]);
  context.lineCap = context.lineJoin = "round";
  context.lineWidth = 2 * stroke.radius * look.scale;
  context.strokeStyle = color;
  context.globalAlpha = 0.4;
  context.stroke();
  context.globalAlpha = 1;
}

/** Where a point was placed and nothing is known of it yet. */
export function paintPlaced(context: Context, x: number, y: number, color: string, look: Look): void {
  const [cx, cy, unit] = [placed(x, look), placed(y, look), look.unit];
  disc(context, cx, cy, 6.1 * unit, DARK);
  ring(context, cx, cy, 4.5 * unit, color, 1.6 * unit, [2.2 * unit, 2.2 * unit]);
  disc(context, cx, cy, 1.6 * unit, color);
}

function disc(context: Context, x: number, y: number, radius: number, color: string): void {
  context.beginPath();
  context.arc(x, y, Math.max(0, radius), 0, 2 * Math.PI);
  context.fillStyle = color;
  context.fill();
}

function ring(context: Context, x: number, y: number, radius: number, color: string, width: number, dash: number[]): void {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.lineWidth = width;
  context.strokeStyle = color;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

function label(context: Context, text: string, x: number, y: number, unit: number): void {
  context.font = `600 ${12 * unit}px system-ui, sans-serif`;
  context.textBaseline = "middle";
  const width = context.measureText(text).width;
  context.fillStyle = DARK;
  context.beginPath();
  context.roundRect(x, y - 9 * unit, width + 10 * unit, 18 * unit, 5 * unit);
  context.fill();
  context.fillStyle = "#fff";
  context.fillText(text, x + 5 * unit, y + 0.5 * unit);
}
