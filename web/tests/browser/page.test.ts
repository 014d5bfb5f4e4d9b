// SPDX-License-Identifier: Apache-2.0
// The page itself: gestures, keys, who can use it, and on which screens.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import type { Browser } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect, test } from "vitest";
import { launch, Visitor } from "./page";
import { ROOT, Server } from "./server";

const AXE = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
const SHOTS = join(ROOT, "web/out");

const server = new Server();
let browser: Browser;
let visitor: Visitor;

beforeAll(async () => {
  await server.start();
  const served = await (await fetch(`${server.url}app.js`)).text();
  if (served !== readFileSync(join(ROOT, "web/dist/app.js"), "utf8")) throw new Error("the server was built with another page");
  browser = await launch();
});

afterEach(async () => {
  expect(visitor.complaints).toEqual([]);
  await visitor.page.close();
});

afterAll(async () => {
  await browser?.close();
  await server.stop();
});

/** Rules of axe-core that the page breaks as it stands. */
async function violations(): Promise<string[]> {
  const found = (await visitor.page.evaluate(`${AXE}; axe.run()`)) as {
    violations: { id: string; nodes: { html: string; failureSummary: string }[] }[];
  };
  return found.violations.map(({ id, nodes }) => `${id}: ${nodes.map(({ html, failureSummary }) => `${html} ${failureSummary}`).join("; ")}`);
}

const points = async () => Number(/, (\d+) points/.exec((await visitor.page.locator(".stage-canvas").getAttribute("aria-label"))!)![1]);
const nameField = () => visitor.page.getByLabel("Name of the point");

test("points are placed by click, moved by dragging, removed by right click", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openClip();
  await visitor.clickNear(268, 224);
  await visitor.clickNear(513, 162);
  expect(await points()).toBe(2);
  const { left, top, scale } = await visitor.picture(768, 576);
  const at = (x: number, y: number) => [left + (x + 0.5) * scale, top + (y + 0.5) * scale] as const;
  await visitor.page.mouse.move(...at(513, 162));
  await visitor.page.mouse.down();
  await visitor.page.mouse.move(...at(560, 190), { steps: 4 });
  await visitor.page.mouse.move(...at(600, 200));
  await visitor.page.mouse.up();
  expect(await points()).toBe(2);
  await visitor.page.mouse.click(...at(513, 162), { button: "right" }); // nobody is there any more
  expect(await points()).toBe(2);
  await visitor.page.mouse.click(...at(600, 200), { button: "right" });
  expect(await points()).toBe(1);
});

test("neither a finger that rests on a point nor a click in the midst of a drag removes it", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openClip();
  await visitor.clickNear(268, 224);
  const { left, top, scale } = await visitor.picture(768, 576);
  const [x, y] = [left + 268.5 * scale, top + 224.5 * scale];
  const menu = (init: string) => visitor.page.evaluate(`document.querySelector(".stage-canvas").dispatchEvent(
    new PointerEvent("contextmenu", { clientX: ${x}, clientY: ${y}, bubbles: true, cancelable: true, ${init} }))`);
  expect(await menu('pointerType: "touch"')).toBe(false); // and the browser shows no menu of its own
  await visitor.page.mouse.move(x, y);
  await visitor.page.mouse.down();
  expect(await menu('pointerType: "mouse"')).toBe(false);
  expect(await points()).toBe(1);
  expect(await menu('pointerType: "mouse", ctrlKey: true')).toBe(false);
  expect(await points()).toBe(0);
  await visitor.page.mouse.up();
  expect(await points()).toBe(0);
});

test("an object is brushed over, followed, listed with what is seen of it, and removed", async () => {
  visitor = await Visitor.at(browser, server.url);
  const { page } = visitor;
  await visitor.openClip();
  await page.keyboard.press("b");
  await visitor.stroke([268, 224], [266, 300]);
  await page.screenshot({ path: join(SHOTS, "brush.png") });
  await page.mouse.up();
  const entry = page.locator(".objects li");
  await entry.waitFor();
  expect(await entry.locator(".seen").textContent()).toBe("–");
  await page.keyboard.press("Space");
  await visitor.until("processed", 12);
  const object = page.getByRole("button", { name: /^Object / });
  await expect.poll(() => entry.locator(".seen").textContent(), { timeout: 30_000 }).toMatch(/[1-9]\d* %/);
  await object.click(); // it was selected when it was made
  await object.click();
  await page.screenshot({ path: join(SHOTS, "object.png") });
  await visitor.brush([513, 162], [515, 230]); // while it runs: it begins on the next frame
  await visitor.until("processed", 36);
  await expect.poll(() => entry.nth(1).locator(".seen").textContent(), { timeout: 30_000 }).toMatch(/\d+ %/);
  await page.getByRole("button", { name: /^Remove Object/ }).first().click();
  await expect.poll(() => entry.count()).toBe(1);
  await page.keyboard.press("s");
  await visitor.done();
  const { objects, points } = JSON.parse(String(await visitor.save("JSON")));
  expect(objects.map(({ points }: { points: number[] }) => points.length)).toEqual([points.length]);
  expect(objects[0].frames.length).toBeGreaterThan(0);
});

test("an object is outlined corner by corner, closed in three ways, named and followed", async () => {
  visitor = await Visitor.at(browser, server.url);
  const { page } = visitor;
  await visitor.openClip();
  await page.keyboard.press("o");
  const entries = page.locator(".objects li");
  const corners = async (...places: [number, number][]) => {
    for (const [x, y] of places) await visitor.clickNear(x, y);
  };
  await corners([250, 200], [290, 200]);
  await page.keyboard.press("Escape");
  await page.locator(".outlining").waitFor({ state: "detached" });
  await corners([250, 200], [290, 200], [292, 330], [500, 500]);
  await page.keyboard.press("Backspace"); // not that one
  await corners([246, 330]);
  await page.screenshot({ path: join(SHOTS, "outline.png") });
  await corners([251, 201]);
  await expect.poll(() => entries.count()).toBe(1);
  await page.getByLabel("Name of the object").fill("walker");
  await page.getByLabel("Name of the object").press("Tab");
  await corners([500, 150], [530, 150], [530, 240]);
  await page.keyboard.press("Enter");
  await expect.poll(() => entries.count()).toBe(2);
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await visitor.until("processed", 12);
  await corners([650, 240], [690, 240], [690, 310]); // while it runs: it begins on the next frame
  const { left, top, scale } = await visitor.picture(768, 576);
  await page.mouse.dblclick(left + 650 * scale, top + 310 * scale);
  await expect.poll(() => entries.count()).toBe(3);
  await visitor.until("processed", 36);
  await page.keyboard.press("s");
  await visitor.done();
  const { objects, points } = JSON.parse(String(await visitor.save("JSON")));
  expect(objects.map(({ name }: { name: string }) => name)).toEqual(["walker", "Object 26", "Object 51"]);
  expect(points.filter(({ name }: { name: string }) => name === "walker").length).toBe(objects[0].points.length);
  const [x, y] = objects[0].xy[0];
  expect(Math.hypot(x - 269, y - 265)).toBeLessThan(4);
});

test("without a pointer everything can be done as well", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openClip();
  await visitor.page.locator(".stage-canvas").focus();
  for (const key of ["ArrowRight", "Shift+ArrowDown", "Enter"]) await visitor.page.keyboard.press(key);
  expect(await points()).toBe(1);
  expect(await nameField().inputValue()).toBe("1");
  await visitor.page.keyboard.press("b");
  await visitor.page.keyboard.press("Enter");
  await visitor.page.getByRole("button", { name: "Object 2", exact: true }).waitFor();
  await visitor.page.keyboard.press("Delete");
  await visitor.page.getByRole("button", { name: "Object 2", exact: true }).waitFor({ state: "detached" });
  await visitor.page.keyboard.press("o");
  await visitor.page.locator(".stage-canvas").focus();
  for (const key of ["Enter", "Enter", ...Array(4).fill("ArrowRight"), "Enter", ...Array(4).fill("ArrowDown"), "Enter", "Enter"]) {
    await visitor.page.keyboard.press(key);
  }
  await visitor.page.getByRole("button", { name: "Object 27", exact: true }).waitFor();
  await visitor.page.keyboard.press("Delete");
  await visitor.page.keyboard.press("p");
  await visitor.page.keyboard.press("g");
  expect(await points()).toBeGreaterThan(60);
  await visitor.page.keyboard.press("n");
  expect(await nameField().inputValue()).not.toBe("");
  await visitor.page.keyboard.press("Delete");
  await visitor.page.keyboard.press("?");
  await visitor.page.getByRole("dialog").waitFor();
  await visitor.page.keyboard.press("Escape");
  await visitor.page.getByRole("dialog").waitFor({ state: "hidden" });
  await visitor.page.keyboard.press("d");
  expect(await visitor.page.locator("html").getAttribute("data-theme")).toBe("dark");
});

test("a name that was given to a point is the one in files", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openClip();
  await visitor.clickNear(268, 224);
  await nameField().fill("head, left");
  await nameField().press("Tab");
  await visitor.page.getByRole("button", { name: "Start", exact: true }).click();
  await visitor.until("sent", 4);
  await visitor.page.keyboard.press("s");
  await visitor.done();
  expect(String(await visitor.save("DeepLabCut")).split("\n")[1]).toBe('bodyparts,"head, left","head, left","head, left"');
});

test("a server that wants a token says so, and takes the one that the user gives", async () => {
  const token = "a-token-of-32-letters-and-digits-";
  const guarded = new Server(token);
  await guarded.start();
  try {
    visitor = await Visitor.at(browser, guarded.url);
    await visitor.page.getByText("The server wants a token", { exact: true }).waitFor();
    await visitor.page.getByLabel("Token", { exact: true }).fill(token);
    await visitor.page.getByLabel("Token", { exact: true }).press("Enter");
    await visitor.page.getByText("Serving", { exact: true }).waitFor();
    await visitor.openClip();
    await visitor.page.keyboard.press("Space");
    await visitor.until("processed", 20); // with no point to speak of
  } finally {
    await guarded.stop("SIGKILL"); // its session is still open: it would wait for that
  }
});

test("where the browser keeps nothing of sites the page is there all the same", async () => {
  const denied = 'get() { throw new DOMException("Access is denied for this document.", "SecurityError"); }';
  const block = (name: string) => `Object.defineProperty(window, "${name}", { ${denied} });`;
  visitor = await Visitor.at(browser, server.url, block("localStorage") + block("sessionStorage"));
  await visitor.openClip();
  await visitor.page.keyboard.press("d");
  expect(await visitor.page.locator("html").getAttribute("data-theme")).toBe("dark");
});

test("it is usable by all, in both colours, and leaves the narrow screen's width alone", async () => {
  visitor = await Visitor.at(browser, server.url);
  const { page } = visitor;
  const shot = (name: string) => page.screenshot({ path: join(SHOTS, `${name}.png`), fullPage: true });
  expect(await violations()).toEqual([]);
  await shot("welcome");
  await visitor.openClip();
  for (const [x, y] of [[268, 224], [262, 298], [513, 162], [518, 216], [657, 246], [676, 302], [420, 29], [202, 170], [462, 464], [598, 52]] as const) await visitor.clickNear(x, y);
  await visitor.brush([100, 300], [104, 380]);
  await page.keyboard.press("Space");
  await visitor.pauseAt(40);
  await page.getByText(/^1 session, \d\d points$/).waitFor();
  await shot("light");
  await page.keyboard.press("s");
  await visitor.done();
  for (const theme of ["light", "dark"]) {
    expect(await page.locator("html").getAttribute("data-theme")).toBe(theme);
    for (const title of ["Settings", "Server"]) await page.getByRole("heading", { name: title }).click();
    expect(await violations()).toEqual([]);
    for (const title of ["Settings", "Server"]) await page.getByRole("heading", { name: title }).click();
    await shot(`${theme}-done`);
    await page.keyboard.press("?");
    expect(await violations()).toEqual([]);
    await shot(`${theme}-help`);
    await page.keyboard.press("?");
    if (theme === "light") await page.keyboard.press("d");
  }
  await page.keyboard.press("c");
  await page.locator(".scale").waitFor();
  await shot("dark-confidence");
  await page.setViewportSize({ width: 390, height: 844 });
  await shot("narrow");
  const overflow = "document.documentElement.scrollWidth - document.documentElement.clientWidth";
  expect(await page.evaluate(overflow)).toBe(0);
});
