// SPDX-License-Identifier: Apache-2.0
import { effect, signal } from "@preact/signals";
import { Emit, FrameEncoding } from "./gen/holdfast/v1/point_tracking_pb";
import { makeConfig, type SessionConfig } from "./wire";

const CHECKPOINT_FRAMES = 24; // between checkpoints

/** What a user may choose. It is kept in the page's address, so that a link carries it; the defaults are left out. */
export interface Settings {
  size: string; // processing size, WIDTHxHEIGHT; "": the server's default
  hop: number; // frames between windows; 0: the server's default
  iterations: number; // of a window; 0: the server's default
  live: boolean; // an estimate on every frame
  prior: string; // optical flow leads windows: "on", "off", "": the server's default
  polish: string; // likewise, final positions follow the picture
  side: number; // pixels: larger frames are shrunk before they are sent; 0: never
  quality: number; // of JPEG, per cent
  pace: "recorded" | "fastest"; // how files are sent
  trail: number; // frames
  confidence: boolean; // colour tells confidence, not the point
}

export const DEFAULTS: Settings = {
  size: "",
  hop: 0,
  iterations: 0,
  live: true,
  prior: "",
  polish: "",
  side: 1024,
  quality: 90,
  pace: "recorded",
  trail: 24,
  confidence: false,
};

const OPEN: Record<string, (value: string) => boolean> = {
  size: (value) => value === "" || /^[1-9]\d{1,3}x[1-9]\d{1,3}$/.test(value),
  prior: (value) => ["", "on", "off"].includes(value),
  polish: (value) => ["", "on", "off"].includes(value),
  pace: (value) => value === "recorded" || value === "fastest",
};

/** Settings out of an address's fragment. What is unknown or makes no sense is passed over. */
export function parseSettings(fragment: string): Settings {
  const settings: Record<string, unknown> = { ...DEFAULTS };
  for (const [name, value] of new URLSearchParams(fragment.replace(/^#/, ""))) {
    const usual = settings[name];
    if (typeof usual === "boolean") settings[name] = value === "1";
    if (typeof usual === "number" && /^\d{1,5}$/.test(value)) settings[name] = Number(value);
    if (typeof usual === "string" && OPEN[name]?.(value)) settings[name] = value;
  }
  return settings as unknown as Settings;
}

export function formatSettings(settings: Settings): string {
  const fragment = new URLSearchParams();
  for (const [name, usual] of Object.entries(DEFAULTS)) {
    const value = settings[name as keyof Settings];
    if (value !== usual) fragment.set(name, typeof value === "boolean" ? String(Number(value)) : String(value));
  }
  return fragment.toString();
}

/** What a session is asked for. */
export function sessionConfig(
  { size, hop, iterations, live, prior, polish }: Settings,
  frameSize: { width: number; height: number },
): SessionConfig {
  const [width, height] = size.split("x").map(Number);
  const choice = (word: string) => (word ? { value: word === "on" } : null);
  return makeConfig({
    encoding: FrameEncoding.JPEG,
    frameSize,
    processingSize: width && height ? { width, height } : undefined,
    hopFrames: hop,
    iterations,
    label: "web page",
    emit: live ? Emit.EVERY_FRAME : Emit.WINDOWS,
    motionPrior: choice(prior)?.value,
    polish: choice(polish)?.value,
    checkpointIntervalFrames: CHECKPOINT_FRAMES,
  });
}

/** The page's settings, bound to its address: also to one that a user puts there while the page is open. */
export function settingsOfPage() {
  const settings = signal(parseSettings(location.hash));
  effect(() => {
    const fragment = formatSettings(settings.value);
    history.replaceState(null, "", fragment ? `#${fragment}` : location.pathname + location.search);
  });
  addEventListener("hashchange", () => (settings.value = parseSettings(location.hash)));
  return settings;
}
