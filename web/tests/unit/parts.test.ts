// SPDX-License-Identifier: Apache-2.0
import { expect, test, vi } from "vitest";
import { grid } from "../../src/brush";
import { confidenceColor } from "../../src/draw";
import { Figures, quantile } from "../../src/figures";
import { keyName } from "../../src/key_name";
import { Kept } from "../../src/kept";
import { areaOf, clickAt } from "../../src/polygon";
import { DEFAULTS, formatSettings, parseSettings, settingsOfPage } from "../../src/settings";
import { sentSize } from "../../src/sources/source";

test("a grid fills the frame as the command line's does", () => {
  const points = grid(12, 400, 300);
  expect(points).toHaveLength(12);
  expect(points[0]).toEqual({ x: 49.5, y: 49.5 });
  expect(points.at(-1)).toEqual({ x: 349.5, y: 249.5 });
});

test("a click on the first corner or on the last one closes a polygon, once there are three", () => {
  const [first, second, third] = [{ x: 10, y: 10 }, { x: 60, y: 10 }, { x: 60, y: 50 }];
  const reach = { first: 14, last: 4 };
  const clicks = (at: { x: number; y: number }, ...corners: { x: number; y: number }[]) => clickAt(corners, at, reach);
  expect([clicks(first), clicks(second, first), clicks(third, first, second)]).toEqual(["corner", "corner", "corner"]);
  expect([clicks(first, first), clicks(second, first, second)]).toEqual(["nothing", "nothing"]); // double clicks
  expect([clicks({ x: 20, y: 10 }, first), clicks({ x: 20, y: 10 }, first, second, third)]).toEqual(["corner", "close"]);
  expect([clicks({ x: 60, y: 53 }, first, second, third), clicks({ x: 60, y: 55 }, first, second, third)]).toEqual(["close", "corner"]);
});

test("what a polygon encloses does not depend on the way round", () => {
  const corners = [{ x: 0, y: 0 }, { x: 10, y: 0 }, { x: 10, y: 6 }, { x: 0, y: 6 }];
  expect([areaOf(corners), areaOf([...corners].reverse()), areaOf(corners.slice(0, 2))]).toEqual([60, 60, 0]);
});

test("keys are called by their small letters, whatever Caps Lock and the layout say", () => {
  const name = (key: string, code: string, shiftKey = false) => keyName({ key, code, shiftKey });
  expect([name("s", "KeyS"), name("S", "KeyS"), name("\u044b", "KeyS"), name("\u042b", "KeyS")]).toEqual(["s", "s", "s", "s"]);
  expect([name("N", "KeyN", true), name("n", "KeyN", true)]).toEqual(["Shift+n", "Shift+n"]);
  expect(name("\u0422", "KeyN", true)).toBe("Shift+n");
  expect([name("j", "KeyC"), name("o", "KeyS")]).toEqual(["j", "o"]); // a Latin layout of another order
  expect([name("\u0445", "BracketLeft"), name("\u00e0", "Digit0"), name("[", "Digit8")]).toEqual(["[", "0", "["]);
  expect([name("?", "Slash", true), name(" ", "Space", true)]).toEqual(["?", " "]);
  expect(name("ArrowLeft", "ArrowLeft", true)).toBe("Shift+ArrowLeft");
});

test("quantiles are by nearest rank", () => {
  const values = [50, 10, 40, 20, 30];
  expect([0.5, 0.95, 1].map((q) => quantile(values, q))).toEqual([30, 50, 50]);
  expect(quantile([], 0.5)).toBeNaN();
});

test("a frame's latency ends with its first estimate", () => {
  const figures = new Figures();
  for (let t = 0; t < 4; ++t) figures.sent(t, 100 * t);
  figures.answered(0, 1, 250);
  figures.answered(0, 3, 450);
  expect(figures.latencies).toEqual([[0, 250], [1, 150], [2, 250], [3, 150]]);
  expect(figures.latency(0.5)).toBe(150);
});

test("the rate is that of the last seconds, and nothing once they are over", () => {
  const figures = new Figures();
  for (let i = 0; i <= 100; ++i) figures.processed(i < 50 ? i : 50 + 2 * (i - 50), 100 * i);
  expect(figures.rate(10_000)).toBeCloseTo(20);
  expect(figures.rate(20_000)).toBeNaN();
  expect([figures.rates[0], figures.rates.at(-1)!.map(Math.round)]).toEqual([[500, 10], [10_000, 20]]);
});

test("settings survive an address, and defaults are left out", () => {
  const settings = { ...DEFAULTS, size: "256x192", hop: 4, live: false, pace: "fastest" as const };
  expect(formatSettings(settings)).toBe("size=256x192&hop=4&live=0&pace=fastest");
  expect(parseSettings(`#${formatSettings(settings)}`)).toEqual(settings);
  expect(formatSettings(DEFAULTS)).toBe("");
});

test("an address that is put in while the page is open changes the settings as one at its beginning does", () => {
  const location = { hash: "#hop=4", pathname: "/", search: "" };
  let changed = () => {};
  vi.stubGlobal("location", location);
  vi.stubGlobal("history", { replaceState: (_state: unknown, _title: string, address: string) => (location.hash = address) });
  vi.stubGlobal("addEventListener", (_type: "hashchange", call: () => void) => (changed = call));
  const settings = settingsOfPage();
  expect(settings.value).toEqual({ ...DEFAULTS, hop: 4 });
  location.hash = "#live=0&unknown=1";
  changed();
  expect(settings.value).toEqual({ ...DEFAULTS, live: false });
  expect(location.hash).toBe("#live=0");
  vi.unstubAllGlobals();
});

test("an address that makes no sense changes nothing", () => {
  expect(parseSettings("#size=big&hop=-1&pace=never&polish=maybe&unknown=1&quality=1e9")).toEqual(DEFAULTS);
});

test("large frames are shrunk to their longest side", () => {
  const [large, small] = [{ width: 1920, height: 1080 }, { width: 640, height: 480 }];
  expect(sentSize(large, { maxSide: 1024, quality: 0.9 })).toEqual({ width: 1024, height: 576 });
  expect(sentSize(small, { maxSide: 1024, quality: 0.9 })).toEqual(small);
  expect(sentSize(large, { maxSide: 0, quality: 0.9 })).toEqual(large);
});

test("confidence is told by colour from one end of the scale to the other", () => {
  expect(confidenceColor(0)).toBe("rgb(197 42 84)");
  expect(confidenceColor(1)).toBe("rgb(120 222 196)");
  expect(confidenceColor(7)).toBe(confidenceColor(1));
});

test("what is kept is there again, and nothing is where the browser keeps nothing", () => {
  const items = new Map<string, string>();
  const storage = {
    getItem: (name: string) => items.get(name) ?? null,
    setItem: (name: string, value: string) => items.set(name, value),
  };
  const kept = new Kept(() => storage as unknown as Storage);
  kept.set("theme", "dark");
  expect([kept.get("theme"), kept.get("token")]).toEqual(["dark", null]);

  const blocked = new Kept(() => {
    throw new DOMException("Access is denied for this document.", "SecurityError");
  });
  blocked.set("theme", "dark");
  expect(blocked.get("theme")).toBeNull();
});
