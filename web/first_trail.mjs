// SPDX-License-Identifier: Apache-2.0
// How long it takes from a fresh clone to the first trail in a browser. Usage: node web/first_trail.mjs
// Clones what is committed here, runs `make web` there, opens the page in Debian's chromium, opens the sample clip, places
// a point, starts, and says when each was done. Wants `npm ci` in web/. A compiler cache makes it another measurement.
import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { chromium } from "playwright-core";

const begin = performance.now();
const done = (what) => console.log(`${((performance.now() - begin) / 1000).toFixed(1).padStart(8)} s  ${what}`);

const freePort = () =>
  new Promise((found) => {
    const server = createServer().listen(0, "127.0.0.1", () => {
      const { port } = server.address();
      server.close(() => found(port));
    });
  });

async function answers(url, made) {
  for (;;) {
    if (made.exitCode !== null) throw new Error(`make web ended with ${made.exitCode}`);
    const answer = await fetch(url).catch(() => null);
    if (answer?.ok) return;
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
}

async function visit(url) {
  const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium", args: ["--no-sandbox", "--disable-gpu"] });
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  await page.goto(url);
  await page.getByRole("button", { name: "Open the sample clip" }).click();
  await page.locator(".stage-canvas[data-frame]").waitFor();
  done("the clip is open in the page");
  await page.locator(".stage-canvas").click();
  await page.getByRole("button", { name: "Start", exact: true }).click();
  await page.waitForFunction(() => {
    const median = [...document.querySelectorAll(".figure")].find((figure) => figure.textContent.startsWith("p50"));
    return /\d/.test(median.lastChild.textContent) && Number(document.querySelector("[data-figure=processed]").textContent) > 2;
  });
  done("there are estimates of three frames: a trail");
  await browser.close();
}

const clone = join(mkdtempSync(join(tmpdir(), "holdfast-first-trail-")), "holdfast");
const port = await freePort();
execFileSync("git", ["clone", "--quiet", resolve(import.meta.dirname, ".."), clone]);
done("cloned");
const made = spawn("make", ["-C", clone, "web", `WEB_PORT=${port}`], { detached: true, stdio: ["ignore", "ignore", "inherit"] });
const stop = () => made.exitCode === null && process.kill(-made.pid);
process.once("SIGINT", () => {
  stop();
  process.exit(1);
});
try {
  await answers(`http://localhost:${port}/v1/info`, made);
  done("built, and the server is ready");
  await visit(`http://localhost:${port}/`);
} finally {
  stop();
  rmSync(resolve(clone, ".."), { recursive: true });
}
