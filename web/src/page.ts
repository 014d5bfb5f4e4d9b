// SPDX-License-Identifier: Apache-2.0
import { effect, signal } from "@preact/signals";
import type { World } from "./connection";
import { subprotocols } from "./connection";
import { ServerInfo } from "./server_info";
import { settingsOfPage } from "./settings";
import { openCamera } from "./sources/camera";
import { openPictures } from "./sources/pictures";
import type { Encoding } from "./sources/source";
import { openVideo } from "./sources/video";
import { Tracker } from "./tracker";
import { grid } from "./brush";

const GRID_POINTS = 64;
const CLIP = "clip.mp4";

export type Tool = "point" | "brush";
export type Theme = "light" | "dark";

export const settings = settingsOfPage();
export const token = signal(sessionStorage.getItem("token") ?? "");
export const tool = signal<Tool>("point");
export const brush = signal({ radius: 24, count: 16 }); // pixels of the frame; points of a stroke
export const selected = signal<number | null>(null);
export const hovered = signal<number | null>(null);
export const helpOpen = signal(false);
export const theme = signal<Theme>(startingTheme());
export const zoomReset = signal(0); // counts up to have the whole frame shown

function startingTheme(): Theme {
  const chosen = localStorage.getItem("theme");
  if (chosen === "light" || chosen === "dark") return chosen;
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

export function changeTheme(): void {
  theme.value = theme.value === "dark" ? "light" : "dark";
  localStorage.setItem("theme", theme.value);
}

effect(() => {
  document.documentElement.dataset.theme = theme.value;
});
effect(() => sessionStorage.setItem("token", token.value));

const world: World = {
  open: () => new WebSocket(new URL("v1/track", location.href.replace(/^http/, "ws")), subprotocols(token.value)),
  now: () => performance.now(),
  after: (ms, call) => {
    const timer = setTimeout(call, ms);
    return () => clearTimeout(timer);
  },
  random: Math.random,
};

export const tracker = new Tracker(world, () => settings.value);
export const server = new ServerInfo(() => token.value);
effect(() => {
  if (tracker.link.value?.state === "waiting") void server.ask();
});

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

export function addGrid(): void {
  const source = tracker.source.value;
  if (source) tracker.add(grid(GRID_POINTS, source.width, source.height));
}

export function removeSelected(): void {
  const id = selected.value;
  if (id !== null) removePoint(id);
}

export function removePoint(id: number): void {
  tracker.remove([id]);
  if (selected.value === id) selected.value = null;
  if (hovered.value === id) hovered.value = null;
}

/** Selects the next point, in the order in which they were made. */
export function selectNext(step: number): void {
  const ids = [...tracker.points.all].map(({ id }) => id);
  if (ids.length === 0) return;
  const at = selected.value === null ? (step > 0 ? -1 : 0) : ids.indexOf(selected.value);
  selected.value = ids[(at + step + ids.length) % ids.length]!;
}

export function change(part: Partial<typeof settings.value>): void {
  settings.value = { ...settings.value, ...part };
}

export function resizeBrush(factor: number): void {
  const radius = Math.round(Math.min(200, Math.max(4, brush.value.radius * factor)));
  brush.value = { ...brush.value, radius };
}
