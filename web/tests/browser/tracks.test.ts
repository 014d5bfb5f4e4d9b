// SPDX-License-Identifier: Apache-2.0
// What the page makes of a server, against what the command line makes of the same server.
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { strFromU8, unzipSync } from "fflate";
import { BufferSource, Input, WEBM } from "mediabunny";
import type { Browser } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect, test } from "vitest";
import { stretched, trimmed } from "../video_file";
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
let uninterrupted: Buffer; // the first run's .npz

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
async function commandLine(suffix: string, clip = CLIP): Promise<Buffer> {
  const folder = scratch();
  const points = clicked.map(({ x, y }, i) => `${i + 1},${x},${y}\n`).join("");
  writeFileSync(join(folder, "points.csv"), `id,x,y\n${points}`);
  const out = join(folder, `tracks${suffix}`);
  await run(join(BIN, "holdfast"), ["track", clip, `--server=${server.address}`, `--points=${join(folder, "points.csv")}`,
    `--max_frames=${FRAMES}`, "--processing_size=256x192", "--iterations=2", `--out=${out}`]);
  return readFileSync(out);
}

const lines = (csv: string) => csv.trimEnd().split("\n").map((line) => line.split(","));

/** A cell of a table without the digits behind its point. */
const shapeOf = (cell: string) => cell.replace(/\.\d{3}$/, ".ddd");

/** Positions [points, frames, 2] of an .npz file, in full precision. */
const positions = (npz: Uint8Array) => new Float32Array(unzipSync(npz)["tracks.npy"]!.slice(128).buffer);

/** The largest difference between two files' coordinates, which have to know the same samples. */
function difference(npz: Uint8Array, other: Uint8Array): number {
  const [a, b] = [positions(npz), positions(other)];
  expect([a.length, b.length]).toEqual(Array(2).fill(NEAR.length * FRAMES * 2));
  return Math.max(...a.map((value, i) => Math.abs(value - b[i]!)));
}

test("clicked points have the tracks that the command line gives them, in each format", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openPictures(pictures);
  clicked = await clickAll();
  await visitor.page.keyboard.press("Space");
  await visitor.done();
  expect(await visitor.figure("final")).toBe(FRAMES);

  uninterrupted = await visitor.save("NumPy");
  const wanted = await commandLine(".npz");
  expect(difference(uninterrupted, wanted)).toBeLessThanOrEqual(SAME);
  const [mine, theirs] = [unzipSync(uninterrupted), unzipSync(wanted)];
  expect(Object.keys(mine)).toEqual(Object.keys(theirs));
  for (const name of Object.keys(mine)) {
    const estimates = /^(tracks|confidence|fps)/.test(name); // pictures have no rate
    const told = (file: Uint8Array) => strFromU8(estimates ? file.slice(0, 128) : file, true);
    expect(told(mine[name]!), name).toBe(told(theirs[name]!));
  }

  const [page, cli] = [JSON.parse(String(await visitor.save("JSON"))), JSON.parse(String(await commandLine(".json")))];
  expect({ ...page, points: [], fps: 0 }).toEqual({ ...cli, points: [], fps: 0 }); // pictures have no rate
  expect(page.points.map((point: object) => Object.keys(point))).toEqual(cli.points.map((point: object) => Object.keys(point)));

  const [xml, theirXml] = [String(await visitor.save("CVAT")), String(await commandLine(".xml"))];
  // The command line's video goes on behind these frames, and its shapes end there.
  const untilThere = theirXml.replaceAll(new RegExp(`  <points frame="${FRAMES}".*\n`, "g"), "").replace(`<size>${FRAMES + 1}<`, `<size>${FRAMES}<`);
  expect(xml.replaceAll(/\.\d{3}/g, ".ddd")).toBe(untilThere.replaceAll(/\.\d{3}/g, ".ddd"));
  const [curves, theirCurves] = [String(await visitor.save("3DEqualizer")), String(await commandLine(".3de.txt"))];
  expect(curves.replaceAll(/\.\d{6}/g, ".dddddd")).toBe(theirCurves.replaceAll(/\.\d{6}/g, ".dddddd"));

  // Texts differ where a millionth of a pixel rounds to another last digit.
  const [csv, theirCsv] = [lines(String(await visitor.save("CSV"))), lines(String(await commandLine(".csv")))];
  expect(csv.map((row) => row.map(shapeOf))).toEqual(theirCsv.map((row) => row.map(shapeOf)));
  const [table, theirTable] = [lines(String(await visitor.save("DeepLabCut"))), lines(String(await commandLine(".dlc.csv")))];
  expect(table.map((row) => row.map(shapeOf))).toEqual(theirTable.map((row) => row.map(shapeOf)));
});

test("a server that is killed and comes back changes nothing of the tracks", async () => {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openPictures(pictures);
  await clickAll();
  await visitor.page.keyboard.press("Space");
  await visitor.pauseAt(28); // behind a checkpoint, before the end
  await server.stop("SIGKILL");
  await visitor.page.getByText("The server is lost.").waitFor();
  await visitor.page.screenshot({ path: join(ROOT, "web/out/lost.png") });
  await server.start();
  await visitor.page.keyboard.press("Space");
  await visitor.done();
  await visitor.page.getByText("The server is lost.").waitFor({ state: "detached" });
  expect(difference(await visitor.save("NumPy"), uninterrupted)).toBeLessThanOrEqual(SAME);
});

/** An object as it is in files. */
interface SavedObject {
  frames: number[];
  points: number[];
  xy: [number, number][];
  outline: [number, number][][];
}

/** Brushes over a person and tracks it to the end; in a pause meanwhile `during` may happen. */
async function followObject(during: () => Promise<void>): Promise<SavedObject> {
  visitor = await Visitor.at(browser, server.url);
  await visitor.openPictures(pictures);
  await visitor.brush([268, 224], [266, 300]);
  await visitor.page.keyboard.press("Space");
  await visitor.pauseAt(28); // behind a checkpoint, before the end
  await during();
  await visitor.page.keyboard.press("Space");
  await visitor.done();
  return JSON.parse(String(await visitor.save("JSON"))).objects[0];
}

test("an object has its centre and outline on every frame, also when its server is killed", async () => {
  const object = await followObject(async () => {});
  await visitor.page.close();
  expect([object.frames.length, object.points.length]).toEqual([FRAMES, 24]);
  expect(Math.hypot(object.xy[0]![0] - 267, object.xy[0]![1] - 262)).toBeLessThan(4); // of what was brushed
  expect(object.outline.every((corners) => corners.length > 2)).toBe(true);
  const again = await followObject(async () => {
    await server.stop("SIGKILL");
    await visitor.page.getByText("The server is lost.").waitFor();
    await server.start();
  });
  expect(again).toMatchObject({ frames: object.frames, points: object.points });
  const moved = again.xy.map(([x, y], i) => Math.hypot(x - object.xy[i]![0], y - object.xy[i]![1]));
  expect(Math.max(...moved)).toBeLessThanOrEqual(2 * SAME); // thousandths are rounded
});

// The browser decodes the clip, and makes JPEGs of its frames, with other libraries than the command line: pixels differ
// by a few of 255 steps, which moves where a point is found, by less than a pixel as a rule.
test.each([["decodes", ""], ["seeks in, as it gives pages no decoder,", "delete window.VideoDecoder"]])(
  "the clip that the browser %s gives the tracks of the command line, but for what encoders do", async (_way, script) => {
    visitor = await Visitor.at(browser, server.url, script);
    await visitor.openClip();
    await clickAll();
    await visitor.page.keyboard.press("Space");
    await visitor.until("sent", FRAMES);
    await visitor.page.keyboard.press("s");
    await visitor.done();
    const [mine, theirs] = [positions(await visitor.save("NumPy")), positions(uninterrupted)];
    const frames = mine.length / 2 / NEAR.length;
    const distances: number[] = [];
    for (let point = 0; point < NEAR.length; ++point) {
      for (let t = 0; t < FRAMES - 24; ++t) { // whose last window is the same for both
        const [a, b] = [2 * (point * frames + t), 2 * (point * FRAMES + t)];
        distances.push(Math.hypot(mine[a]! - theirs[b]!, mine[a + 1]! - theirs[b + 1]!));
      }
    }
    expect(distances.sort((a, b) => a - b)[distances.length >> 1]).toBeLessThan(0.5);
  });

test.each([["decodes", ""], ["seeks in", "delete window.VideoDecoder"]])(
  "a trimmed clip that the browser %s has the frames of the command line", async (_way, script) => {
    const clip = join(scratch(), "trimmed.mp4");
    writeFileSync(clip, trimmed(readFileSync(CLIP), 136 * 1024 + 512)); // the last 23 frames of 160 are left
    visitor = await Visitor.at(browser, server.url, script);
    await visitor.openVideo(clip);
    clicked = await clickAll();
    await visitor.page.keyboard.press("Space");
    await visitor.done();
    const [mine, theirs] = [positions(await visitor.save("NumPy")), positions(await commandLine(".npz", clip))];
    expect([mine.length, theirs.length]).toEqual(Array(2).fill(NEAR.length * 23 * 2));
    const distances = Array.from({ length: mine.length / 2 }, (_, i) =>
      Math.hypot(mine[2 * i]! - theirs[2 * i]!, mine[2 * i + 1]! - theirs[2 * i + 1]!));
    expect(distances.sort((a, b) => a - b)[distances.length >> 1]).toBeLessThan(0.5);
  });

test("a clip that is shrunk before it is sent has files in its own pixels", async () => {
  visitor = await Visitor.at(browser, server.url, "", "&side=384"); // half of it
  await visitor.openClip();
  const places = await clickAll();
  await visitor.page.keyboard.press("Space");
  await visitor.until("sent", 12);
  await visitor.page.keyboard.press("s");
  await visitor.done();
  const { width, height, points } = JSON.parse(String(await visitor.save("JSON")));
  expect([width, height]).toEqual([768, 576]);
  places.forEach(({ x, y }, i) => {
    const [foundX, foundY] = points[i].xy[0];
    expect(Math.hypot(foundX - x, foundY - y)).toBeLessThan(0.01); // where it was clicked, in the clip's own pixels
  });
});

test("a clip whose pixels are wide has files in its own pixels", async () => {
  const clip = join(scratch(), "wide.mp4");
  writeFileSync(clip, stretched(readFileSync(CLIP), 2));
  visitor = await Visitor.at(browser, server.url);
  await visitor.openVideo(clip);
  const { x, y } = await visitor.clickNear(2 * 513 + 0.5, 162, 2 * 768, 576);
  await visitor.page.keyboard.press("Space");
  await visitor.until("sent", 2);
  await visitor.page.keyboard.press("s");
  await visitor.done();
  const { width, height, points } = JSON.parse(String(await visitor.save("JSON")));
  expect([width, height]).toEqual([768, 576]);
  const [foundX, foundY] = points[0].xy[0];
  expect(Math.hypot(foundX - ((x + 0.5) / 2 - 0.5), foundY - y)).toBeLessThan(0.01);
});

/** A JPEG whose Exif says that its right side is to be the bottom. */
function turned(jpeg: Buffer): Buffer {
  const tiff = [0x4d, 0x4d, 0, 42, 0, 0, 0, 8, 0, 1, 0x01, 0x12, 0, 3, 0, 0, 0, 1, 0, 6, 0, 0, 0, 0, 0, 0];
  const exif = [...Buffer.from("Exif\0\0"), ...tiff];
  return Buffer.concat([jpeg.subarray(0, 2), Buffer.from([0xff, 0xe1, 0, exif.length + 2, ...exif]), jpeg.subarray(2)]);
}

test("pictures that their Exif turns are tracked as they are seen", async () => {
  const folder = scratch();
  const portraits = pictures.slice(0, 4).map((path, i) => {
    const portrait = join(folder, `${i}.jpg`);
    writeFileSync(portrait, turned(readFileSync(path)));
    return portrait;
  });
  visitor = await Visitor.at(browser, server.url);
  await visitor.openPictures(portraits);
  const place = await visitor.clickNear(576 - 1 - 170, 202, 576, 768);
  const low = await visitor.clickNear(100, 700, 576, 768); // below all that there is before it is turned
  await visitor.page.keyboard.press("Space");
  await visitor.done();
  const { width, height, points } = JSON.parse(String(await visitor.save("JSON")));
  expect([width, height]).toEqual([576, 768]);
  [place, low].forEach(({ x, y }, i) => {
    const [foundX, foundY] = points[i].xy[0];
    expect(Math.hypot(foundX - x, foundY - y)).toBeLessThan(1);
  });
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
