// SPDX-License-Identifier: Apache-2.0
import type { Track } from "./tracks";

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
// From no confidence to full: told apart in grey and by all kinds of colour vision.
const RAMP: [number, number, number][] = [[197, 42, 84], [232, 106, 52], [245, 178, 60], [214, 226, 117], [120, 222, 196]];

/** Steps of the golden ratio keep neighbours apart, however many there are. */
export function colorOf(track: Track): string {
  const hue = (0.08 + track.order * GOLDEN_RATIO) % 1;
  return `hsl(${(360 * hue).toFixed(1)} 95% 62%)`;
}

export function confidenceColor(confidence: number): string {
  const at = Math.min(Math.max(confidence, 0), 1) * (RAMP.length - 1);
  const [low, high] = [RAMP[Math.floor(at)]!, RAMP[Math.ceil(at)]!];
  const mixed = low.map((channel, i) => Math.round(channel + (high[i]! - channel) * (at % 1)));
  return `rgb(${mixed.join(" ")})`;
}

/** Paints the tracks as they are on a frame: trails first, the oldest part the faintest. */
export function paintTracks(context: Context, tracks: Iterable<Track>, frame: number, look: Look): void {
  const all = [...tracks];
  context.lineCap = context.lineJoin = "round";
  if (look.trail > 0) for (const track of all) paintTrail(context, track, frame, look);
  for (const track of all) paintPoint(context, track, frame, look);
  context.setLineDash([]);
  context.globalAlpha = 1;
}

const placed = (value: number, look: Look) => (value + 0.5) * look.scale; // (0, 0) is the first pixel's centre

const strokeOf = (track: Track, frame: number, look: Look) =>
  look.confidence ? confidenceColor(track.confidence(frame)) : colorOf(track);

function paintTrail(context: Context, track: Track, frame: number, look: Look): void {
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
function paintStretch(context: Context, track: Track, t: number, to: number, look: Look): number {
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

function paintPoint(context: Context, track: Track, frame: number, look: Look): void {
  const at = track.newest(frame);
  if (at < 0 || frame - at > HELD_FRAMES) return;
  const [x, y] = [placed(track.x(at), look), placed(track.y(at), look)];
  const [radius, color] = [5 * look.unit, strokeOf(track, at, look)];
  const visible = track.visible(at);
  context.globalAlpha = frame - at <= DIMMED_AFTER ? 1 : 0.55;
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
