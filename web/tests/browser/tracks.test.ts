// SPDX-License-Identifier: Apache-2.0
// What the page makes of a server, against what the command line makes of the same server.
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { strFromU8, unzipSync } from "fflate";
import { BufferSource, Input, WEBM } from "mediabunny";
import type { Browser } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect, test } from "vitest";
import { launch, Visitor } from "./page";
import { sentFrames } from "./recorder";
import { BIN, CLIP, ROOT, run, scratch, Server } from "./server";

const FRAMES = 36;
const NEAR = [[268, 224], [513, 162], [420, 29], [202, 170]] as const; // two people, a lamp, the ground
const SAME = 1e-3; // pixels: what the order of sums may change

const server = new Server();
let browser: Browser;
let visitor: Visitor;
let pictures: string[];
let clicked: { x: number; y: number }[];
let uninterrupted: string; // the CSV of the first run

beforeAll(async () => {
  pictures = await sentFrames(CLIP, FRAMES);
  await server.start();
  browser = await launch();
});

afterEach(async () => {
  expect(visitor.complaints).toEqual([]);
  expect([...visitor.visited]).toEqual([new URL(server.url).origin]);
  await visitor.page.close();
});

afterAll(async () => {
  await browser?.close();
  await server.stop();
});

async function clickAll(): Promise<{ x: number; y: number }[]> {
  const places = [];
  for (const [x, y] of NEAR) places.push(await visitor.clickNear(x, y));
  return places;
}

/** The command line's file of the same points through the same frames. */
async function commandLine(suffix: string): Promise<Buffer> {
  const folder = scratch();
  const points = clicked.map(({ x, y }, i) => `${i + 1},${x},${y}\n`).join("");
  writeFileSync(join(folder, "points.csv"), `id,x,y\n${points}`);
  const out = join(folder, `tracks${suffix}`);
  await run(join(BIN, "holdfast"), ["track", CLIP, `--server=${server.address}`, `--points=${join(folder, "points.csv")}`,
    `--max_frames=${FRAMES}`, "--processing_size=256x192", "--iterations=2", `--out=${out}`]);
  return readFileSync(out);
}

const lines = (csv: string) => csv.trimEnd().split("\n").map((line) => line.split(","));

/** The largest distance between two files' positions, which have to speak of the same points and frames. */
function distance(csv: string, other: string): number {
  const [a, b] = [lines(csv), lines(other)];
  expect(a.map(([id, frame]) => `${id} ${frame}`)).toEqual(b.map(([id, frame]) => `${id} ${frame}`));
  expect(a.length).toBe(1 + NEAR.length * FRAMES);
  return Math.max(...a.slice(1).map((row, i) => Math.hypot(Number(row[2]) - Number(b[i + 1]![2]), Number(row[3]) - Number(b[i + 1]![3]))));
}

test("clicked points have the tracks that the command line gives them, in each format", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openPictures(pictures);
  clicked = await clickAll();
  await visitor.page.keyboard.press("Space");
  await visitor.done();
  expect(await visitor.figure("final")).toBe(FRAMES);

  uninterrupted = String(await visitor.save("CSV"));
  expect(distance(uninterrupted, String(await commandLine(".csv")))).toBeLessThanOrEqual(SAME);

  const [page, cli] = [JSON.parse(String(await visitor.save("JSON"))), JSON.parse(String(await commandLine(".json")))];
  expect({ ...page, points: [], fps: 0 }).toEqual({ ...cli, points: [], fps: 0 }); // pictures have no rate
  expect(page.points.map((point: object) => Object.keys(point))).toEqual(cli.points.map((point: object) => Object.keys(point)));

  const [mine, theirs] = [unzipSync(await visitor.save("NumPy")), unzipSync(await commandLine(".npz"))];
  expect(Object.keys(mine)).toEqual(Object.keys(theirs));
  for (const name of Object.keys(mine)) {
    expect(strFromU8(mine[name]!.slice(0, 128), true), name).toBe(strFromU8(theirs[name]!.slice(0, 128), true));
  }
  const [table, wanted] = [lines(String(await visitor.save("DeepLabCut"))), lines(String(await commandLine(".dlc.csv")))];
  expect(table.slice(0, 3)).toEqual(wanted.slice(0, 3));
  expect(table.map((row) => row.length)).toEqual(wanted.map((row) => row.length));
});

test("a server that is killed and comes back changes nothing of the tracks", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openPictures(pictures);
  await clickAll();
  await visitor.page.keyboard.press("Space");
  await visitor.until("processed", 27); // behind a checkpoint, before the end
  await server.stop("SIGKILL");
  await visitor.page.getByText("The server is lost.").waitFor();
  await visitor.page.screenshot({ path: join(ROOT, "web/out/lost.png") });
  await server.start();
  await visitor.done();
  await visitor.page.getByText("The server is lost.").waitFor({ state: "detached" });
  expect(distance(String(await visitor.save("CSV")), uninterrupted)).toBeLessThanOrEqual(SAME);
});

// The browser decodes the clip, and makes JPEGs of its frames, with other libraries than the command line: pixels differ
// by a few of 255 steps, which moves where a point is found, by less than a pixel as a rule.
test("the clip that the browser decodes gives the tracks of the command line, but for what encoders do", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openClip();
  await clickAll();
  await visitor.page.keyboard.press("Space");
  await visitor.until("sent", FRAMES);
  await visitor.page.keyboard.press("s");
  await visitor.done();
  const mine = lines(String(await visitor.save("CSV"))).slice(1);
  const theirs = new Map(lines(uninterrupted).map((row) => [`${row[0]} ${row[1]}`, row]));
  const settled = mine.filter(([id, frame]) => Number(frame) < FRAMES - 24 && theirs.has(`${id} ${frame}`));
  const distances = settled.map((row) => {
    const other = theirs.get(`${row[0]} ${row[1]}`)!;
    return Math.hypot(Number(row[2]) - Number(other[2]), Number(row[3]) - Number(other[3]));
  });
  expect(distances.length).toBe(NEAR.length * (FRAMES - 24));
  expect(distances.sort((a, b) => a - b)[distances.length >> 1]).toBeLessThan(0.5);
});

test("a video with the tracks has a frame for each that was tracked", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openPictures(pictures.slice(0, 12));
  await clickAll();
  await visitor.page.keyboard.press("Space");
  await visitor.done();
  const source = new BufferSource(await visitor.save("Video with tracks"));
  const video = (await new Input({ formats: [WEBM], source }).getPrimaryVideoTrack())!;
  expect([await video.getDisplayWidth(), await video.getDisplayHeight()]).toEqual([768, 576]);
  expect((await video.computePacketStats()).packetCount).toBe(12);
});

test("a camera is followed live, and its end makes everything final", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.page.getByRole("button", { name: "Camera" }).click();
  await visitor.until("sent", 3);
  await visitor.page.mouse.click(500, 300);
  await visitor.until("processed", 12);
  await visitor.page.getByRole("button", { name: "Stop: everything becomes final" }).click();
  await visitor.done();
  expect(await visitor.figure("final")).toBe(await visitor.figure("sent"));
  const rows = lines(String(await visitor.save("CSV"))).slice(1);
  expect(rows.length).toBeGreaterThan(4);
  expect(new Set(rows.map(([id]) => id))).toEqual(new Set(["1"]));
});
