// SPDX-License-Identifier: Apache-2.0
import { readFileSync } from "node:fs";
import { type Browser, chromium, type Page } from "playwright-core";
import { expect } from "vitest";

export const launch = (): Promise<Browser> =>
  chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--disable-gpu", "--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"],
  });

/** Small and quick: what a test asks of the network. */
export const SETTINGS = "#size=256x192&iterations=2&pace=fastest&side=0";

/** The page as its user has it. */
export class Visitor {
  readonly complaints: string[] = []; // errors of scripts and of the content security policy
  readonly visited = new Set<string>(); // origins of requests

  private constructor(readonly page: Page) {
    page.on("pageerror", (error) => this.complaints.push(error.message));
    page.on("console", (message) => {
      if (message.type() === "error" && !/WebSocket connection|Failed to load resource/.test(message.text())) {
        this.complaints.push(message.text());
      }
    });
    page.on("request", (request) => {
      if (/^(http|ws)/.test(request.url())) this.visited.add(new URL(request.url()).origin);
    });
    page.on("websocket", (socket) => this.visited.add(new URL(socket.url().replace(/^ws/, "http")).origin));
  }

  /** With `script`, which runs before those of the page. Of two settings of one name the later one counts. */
  static async at(browser: Browser, url: string, script = "", settings = ""): Promise<Visitor> {
    const page = await browser.newPage({ viewport: { width: 1280, height: 800 }, colorScheme: "light" });
    await page.addInitScript(script);
    const visitor = new Visitor(page);
    await page.goto(url + SETTINGS + settings);
    return visitor;
  }

  async openClip(): Promise<void> {
    await this.page.getByRole("button", { name: "Sample clip", exact: true }).click();
    await this.firstFrame();
  }

  async openVideo(path: string): Promise<void> {
    await this.page.locator("input[aria-label=Video]").setInputFiles(path);
    await this.firstFrame();
  }

  async openPictures(paths: string[]): Promise<void> {
    await this.page.getByLabel("Pictures").setInputFiles(paths);
    await this.firstFrame();
  }

  async firstFrame(): Promise<void> {
    await this.page.locator(".stage-canvas[data-frame]").waitFor();
  }

  /** Where the picture lies, in pixels of the page for each of the frame's. */
  async picture(width: number, height: number): Promise<{ left: number; top: number; scale: number }> {
    const box = (await this.page.locator(".stage-canvas").boundingBox())!;
    const scale = Math.min(box.width / width, box.height / height);
    return { scale, left: box.x + (box.width - width * scale) / 2, top: box.y + (box.height - height * scale) / 2 };
  }

  /** Clicks near a position of the frame; returns the very position that the click has there. */
  async clickNear(x: number, y: number, width = 768, height = 576): Promise<{ x: number; y: number }> {
    const { left, top, scale } = await this.picture(width, height);
    const [clientX, clientY] = [Math.round(left + (x + 0.5) * scale), Math.round(top + (y + 0.5) * scale)];
    await this.page.mouse.click(clientX, clientY);
    return { x: (clientX - left) / scale - 0.5, y: (clientY - top) / scale - 0.5 };
  }

  /** A stroke from one position of the frame to another, with the button still held. */
  async stroke(from: readonly [number, number], to: readonly [number, number], width = 768, height = 576): Promise<void> {
    const { left, top, scale } = await this.picture(width, height);
    const at = ([x, y]: readonly [number, number]) => [Math.round(left + (x + 0.5) * scale), Math.round(top + (y + 0.5) * scale)] as const;
    await this.page.mouse.move(...at(from));
    await this.page.mouse.down();
    await this.page.mouse.move(...at(to), { steps: 8 });
  }

  /** Brushes over an object, and waits until it is listed. */
  async brush(from: readonly [number, number], to: readonly [number, number]): Promise<void> {
    const listed = this.page.locator(".objects li");
    const count = await listed.count();
    await this.page.keyboard.down("Shift");
    await this.stroke(from, to);
    await this.page.mouse.up();
    await this.page.keyboard.up("Shift");
    await listed.nth(count).waitFor();
  }

  async figure(name: "sent" | "processed" | "final"): Promise<number> {
    return Number(await this.page.locator(`[data-figure=${name}]`).textContent());
  }

  async until(name: "sent" | "processed" | "final", least: number): Promise<void> {
    await expect.poll(() => this.figure(name), { timeout: 90_000, interval: 50 }).toBeGreaterThanOrEqual(least);
  }

  /** Pauses the run once so many frames were sent, and waits until the server has worked off all but a few of them. */
  async pauseAt(sent: number): Promise<void> {
    await this.page.evaluate(`new Promise((found) => {
      const count = () => document.querySelector("[data-figure=sent]").textContent;
      const look = () => count() >= ${sent} ? found() : requestAnimationFrame(look);
      look();
    })`);
    await this.page.keyboard.press("Space");
    await this.until("processed", sent - 4);
  }

  async done(): Promise<void> {
    await this.page.getByRole("button", { name: "Play", exact: true }).waitFor({ timeout: 90_000 });
  }

  /** What a button of the exports saves. */
  async save(name: string): Promise<Buffer> {
    const [download] = await Promise.all([
      this.page.waitForEvent("download", { timeout: 60_000 }),
      this.page.getByRole("button", { name, exact: true }).click(),
    ]);
    return readFileSync(await download.path());
  }
}
