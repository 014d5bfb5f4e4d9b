// SPDX-License-Identifier: Apache-2.0
import { computed, effect, signal } from "@preact/signals";
import type { World } from "./connection";
import { subprotocols } from "./connection";
import { Kept } from "./kept";
import { ServerInfo } from "./server_info";
import { settingsOfPage } from "./settings";
import { openCamera } from "./sources/camera";
import { openPictures } from "./sources/pictures";
import type { Encoding } from "./sources/source";
import { openVideo } from "./sources/video";
import { Tracker } from "./tracker";
import { grid, maskOf } from "./brush";
import type { Position, Stroke } from "./points";
import { areaOf, clickAt, LEAST_CORNERS, type Reach } from "./polygon";

const GRID_POINTS = 64;
const LARGEST_BRUSH = 200; // pixels
const SMALLEST_BRUSH = 1 / 64; // of a frame's longer side: what it covers has room for some points
const CLIP = "clip.mp4";

export type Tool = "point" | "brush" | "outline";
export type Theme = "light" | "dark";

const keptForTab = new Kept(() => sessionStorage);
const keptForSite = new Kept(() => localStorage);

export const settings = settingsOfPage();
export const token = signal(keptForTab.get("token") ?? "");
export const tool = signal<Tool>("point");
export const brush = signal({ radius: 24, count: 24 }); // pixels of the frame; points of an object, at most
export const stroking = signal(false); // the brush is at work
export const corners = signal<readonly Position[]>([]); // of the outline that is being drawn, on the frame that is shown
export const selected = signal<number | null>(null);
export const hovered = signal<number | null>(null);
export const helpOpen = signal(false);
export const theme = signal<Theme>(startingTheme());
export const zoomReset = signal(0); // counts up to have the whole frame shown

function startingTheme(): Theme {
  const chosen = keptForSite.get("theme");
  if (chosen === "light" || chosen === "dark") return chosen;
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

export function changeTheme(): void {
  theme.value = theme.value === "dark" ? "light" : "dark";
  keptForSite.set("theme", theme.value);
}

effect(() => {
  document.documentElement.dataset.theme = theme.value;
});
effect(() => keptForTab.set("token", token.value));

const world: World = {
  open: () => new WebSocket(new URL("v1/track", location.href.replace(/^http/, "ws")), subprotocols(token.value)),
  now: () => performance.now(),
  after: (ms, call) => {
    const timer = setTimeout(call, ms);
    return () => clearTimeout(timer);
  },
  refusal: () => {
    if (server.standing.value === "serving") return "No connection to the server: it does not know this page's address.";
    return `No connection. ${server.words.value}.`;
  },
  hidden: () => document.visibilityState === "hidden",
  random: Math.random,
};

export const tracker = new Tracker(world, () => settings.value);
export const server = new ServerInfo(() => token.value);
effect(() => {
  const state = tracker.link.value?.state;
  if (state === "waiting" || state === "ended") void server.ask();
});

effect(() => tracker.hold(stroking.value || corners.value.length > 0));
// An outline is of the picture that it was begun on.
effect(() => {
  void [tracker.source.value, tracker.shown.value, tool.value];
  corners.value = [];
});

export const smallestBrush = computed(() => {
  const { width, height } = tracker.source.value ?? { width: 1, height: 1 };
  return Math.ceil(Math.max(width, height) * SMALLEST_BRUSH);
});
export const brushRadius = computed(() => Math.max(brush.value.radius, smallestBrush.value));

const encoding = (): Encoding => ({ maxSide: settings.value.side, quality: settings.value.quality / 100 });

function load(open: Parameters<Tracker["load"]>[0]): Promise<void> {
  selected.value = hovered.value = null;
  return tracker.load(open);
}

export const loadClip = () =>
  load(async () => {
    const answer = await fetch(CLIP);
    if (!answer.ok) throw new Error(`The sample clip cannot be loaded: the server says ${answer.status}.`);
    return openVideo(await answer.blob(), "Sample clip", encoding());
  });

export const loadCamera = () => load(() => openCamera(encoding()));

/** A video, or pictures. */
export function loadFiles(files: readonly File[]): void {
  const pictures = files.filter((file) => file.type.startsWith("image/"));
  const video = files.find((file) => !file.type.startsWith("image/"));
  if (pictures.length > 0) void load(() => openPictures(pictures, encoding()));
  else if (video) void load(() => openVideo(video, video.name, encoding()));
}

/** Those of a grid that are not there yet. */
export function addGrid(): void {
  const source = tracker.source.value;
  if (!source) return;
  const there = new Set(tracker.points.seedsOn(tracker.shown.value).map(({ x, y }) => `${x} ${y}`));
  tracker.add(grid(GRID_POINTS, source.width, source.height).filter(({ x, y }) => !there.has(`${x} ${y}`)));
}

/** Follows what a stroke of the brush went over. */
export async function addObject(path: Stroke["path"]): Promise<void> {
  const source = tracker.source.value!;
  const stroke = { path, radius: brushRadius.value };
  stroking.value = true;
  try {
    const mask = await maskOf(stroke, source.width, source.height);
    if (source !== tracker.source.value) return; // another one was asked for meanwhile
    selected.value = tracker.addObject({ ...stroke, mask }, brush.value.count) ?? selected.value;
  } finally {
    stroking.value = false;
  }
}

/** A click of the outline's tool: places a corner, or closes the outline and follows what it encloses. */
export function clickOutline(at: Position, reach: Reach): void {
  const { width, height } = tracker.source.value!;
  const inside = { x: Math.min(Math.max(at.x, 0), width - 1), y: Math.min(Math.max(at.y, 0), height - 1) };
  const does = clickAt(corners.value, inside, reach);
  if (does === "corner") corners.value = [...corners.value, inside];
  if (does === "close") closeOutline();
}

export function closeOutline(): void {
  const least = smallestBrush.value;
  if (corners.value.length === 0) return;
  if (corners.value.length < LEAST_CORNERS) return tracker.say(`An outline takes at least ${LEAST_CORNERS} corners.`);
  if (areaOf(corners.value) < least ** 2) {
    return tracker.say(`The outline is too small to follow: expected at least ${least} × ${least} pixels.`);
  }
  selected.value = tracker.addObject({ corners: corners.value }, brush.value.count) ?? selected.value;
  corners.value = [];
}

export function takeCornerBack(): void {
  corners.value = corners.value.slice(0, -1);
}

export function dropOutline(): void {
  corners.value = [];
}

/** The last corner while there is an outline, otherwise what is selected. */
export function removeLast(): void {
  corners.value.length > 0 ? takeCornerBack() : removeSelected();
}

/** Gives up an outline; where there is none, selects nothing. */
export function escape(): void {
  corners.value.length > 0 ? dropOutline() : (selected.value = null);
}

export function removeSelected(): void {
  if (selected.value !== null) remove(selected.value);
}

/** A point or an object. */
export function remove(id: number): void {
  tracker.remove([id]);
  if (selected.value === id) selected.value = null;
  if (hovered.value === id) hovered.value = null;
}

/** Selects the next point or object, in the order in which they were made. */
export function selectNext(step: number): void {
  const ids = [...tracker.points.all, ...tracker.points.objects].map(({ id }) => id).sort((a, b) => a - b);
  if (ids.length === 0) return;
  const at = selected.value === null ? (step > 0 ? -1 : 0) : ids.indexOf(selected.value);
  selected.value = ids[(at + step + ids.length) % ids.length]!;
}

export function change(part: Partial<typeof settings.value>): void {
  settings.value = { ...settings.value, ...part };
}

export function resizeBrush(factor: number): void {
  const radius = Math.round(Math.min(LARGEST_BRUSH, Math.max(smallestBrush.value, brushRadius.value * factor)));
  brush.value = { ...brush.value, radius };
}
