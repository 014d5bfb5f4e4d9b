// SPDX-License-Identifier: Apache-2.0
import { beforeAll, expect, test, vi } from "vitest";
import { toCvat } from "../../src/exports/cvat";
import { to3de, toJson } from "../../src/exports/text";
import { DEFAULTS } from "../../src/settings";
import type { Picture, Size, Source } from "../../src/sources/source";
import { Tracker } from "../../src/tracker";
import { objectPointId } from "../../src/wire";
import { accepted, FakeWorld, objectRun, request, response, run, tracks } from "./support";

beforeAll(() => vi.stubGlobal("createImageBitmap", async () => ({ close: () => {} })));

/** Frames of one byte, 10 a second. */
class FakeSource implements Source {
  readonly label = "fake";
  readonly width = 640;
  readonly height = 480;
  readonly fps = 10;
  readonly dropped = 0;
  given = 0;
  closed = false;
  skips = 0;

  constructor(
    private readonly count: number,
    readonly live = false,
    readonly own: Size = { width: 640, height: 480 },
  ) {}

  get frames(): number | null {
    return this.live ? null : this.count;
  }
  async next(): Promise<Picture | null> {
    if (this.closed || this.given === this.count) return null;
    return { jpeg: new Uint8Array([this.given]), seconds: this.given++ / 10 };
  }
  skip(): void {
    ++this.skips;
  }
  close(): void {
    this.closed = true;
  }
}

const settled = async () => {
  for (let i = 0; i < 200; ++i) await Promise.resolve();
};

async function loaded(source: Source): Promise<{ tracker: Tracker; world: FakeWorld }> {
  const world = new FakeWorld();
  const tracker = new Tracker(world, () => ({ ...DEFAULTS, pace: "fastest" }));
  await tracker.load(async () => source);
  return { tracker, world };
}

async function accept(world: FakeWorld, more: object = {}): Promise<void> {
  world.socket.open();
  world.socket.say(accepted(more));
  await settled();
}

test("a source shows its first frame, and waits for the user", async () => {
  const { tracker, world } = await loaded(new FakeSource(5));
  expect(tracker.phase.value).toBe("ready");
  expect(tracker.shown.value).toBe(0);
  expect(world.sockets).toEqual([]);
});

test("of two sources asked for at once the later one stays, also while the other's picture is made", async () => {
  let decode = (_bitmap: object) => {};
  vi.stubGlobal("createImageBitmap", () => new Promise((made) => (decode = made)));
  const tracker = new Tracker(new FakeWorld(), () => DEFAULTS);
  const [early, late] = [new FakeSource(5), new FakeSource(7)];
  const first = tracker.load(async () => early);
  await settled();
  vi.stubGlobal("createImageBitmap", async () => ({ close: () => {} }));
  let open = (_source: Source) => {};
  const second = tracker.load(() => new Promise((opened) => (open = opened)));
  decode({ close: () => {} });
  await first;
  expect([early.closed, tracker.phase.value, tracker.source.value]).toEqual([true, "loading", null]);
  open(late);
  await second;
  expect([late.closed, tracker.phase.value, tracker.source.value]).toEqual([false, "ready", late]);
});

test("a whole video goes to the server, with the points on their frame, and ends with everything final", async () => {
  const { tracker, world } = await loaded(new FakeSource(3));
  tracker.add([{ x: 10, y: 20 }, { x: 700, y: -3 }]);
  tracker.start();
  await accept(world);
  expect(world.socket.names).toEqual(["config", "frame 0", "frame 1", "frame 2", "finish"]);
  const first = request(world.socket.sent[1]!);
  const inside = [{ id: 1n, x: 10, y: 20 }, { id: 2n, x: 639, y: 0 }];
  expect(first.case === "frame" && first.value.points).toMatchObject(inside);
  world.socket.say(tracks(3, [run(1, 0, 3, 3), run(2, 0, 3, 3)]));
  world.socket.say(response({ case: "summary", value: {} }));
  expect(tracker.phase.value).toBe("done");
  expect(tracker.table()).toMatchObject({ frames: 3, complete: true, finalFrames: 3, expectedFrames: 3 });
});

test("files have the size and the pixels of the source's own frames, what is painted those of the frames sent", async () => {
  const { tracker, world } = await loaded(new FakeSource(3, false, { width: 1920, height: 960 }));
  tracker.add([{ x: 0, y: 0 }]);
  const id = tracker.addObject(STROKE, 2)!;
  tracker.start();
  await accept(world);
  world.socket.say(tracks(3, [run(1, 0, 3), run(objectPointId(id, 0), 0, 3)], [objectRun(id, 0, 3, 0, 0.25)]));

  const own = tracker.table();
  expect(own).toMatchObject({ width: 1920, height: 960, frames: 3 });
  expect(own.tracks.map((track) => track.at(2))).toMatchObject([{ x: 7, y: 8.5 }, { x: 7, y: 8.5 }]);
  expect(own.tracks.map(({ object }) => object)).toEqual([null, own.objects[0]]);
  expect(own.objects[0]!.at(2)).toMatchObject({ x: 7.75, y: 8.5, scale: 1, outline: [[7, 2.5], [19, 2.5], [7, 16.5]] });
  expect(toJson(own)).toContain('"xy":[[1.0,0.5],[4.0,4.5],[7.0,8.5]]');
  expect(JSON.parse(toJson(own)).objects[0].points).toEqual([3]);
  expect(toCvat(own)).toContain("<width>1920</width><height>960</height>");
  expect(to3de({ ...own, tracks: own.tracks.slice(0, 1) })).toBe(
    "1\n1\n0\n3\n1 1.500000 959.000000\n2 4.500000 955.000000\n3 7.500000 951.000000\n");

  const sent = tracker.tableAsSent();
  expect(sent).toMatchObject({ width: 640, height: 480, frames: 3 });
  expect(sent.tracks[0]!.at(2)).toMatchObject({ x: 2, y: 4 });
  expect(sent.objects[0]!.at(2)).toMatchObject({ x: 2.25, y: 4, outline: [[2, 1], [6, 1], [2, 8]] });
});

test("points that are placed while it runs begin on the newest frame sent", async () => {
  const { tracker, world } = await loaded(new FakeSource(100));
  tracker.add([{ x: 1, y: 1 }]);
  tracker.start();
  await accept(world);
  expect(tracker.shown.value).toBe(11);
  const [id] = tracker.add([{ x: 1, y: 2 }]);
  tracker.place(id!, { x: 3, y: 4 });
  tracker.remove([id!]);
  expect(world.socket.names.slice(-4)).toEqual(["frame 11", "addPoints", "addPoints", "removePoints"]);
  expect(tracker.stale.value).toBe(false);
});

test("a pause sends nothing, and going on follows the newest frame", async () => {
  const { tracker, world } = await loaded(new FakeSource(100));
  tracker.add([{ x: 1, y: 1 }]);
  tracker.start();
  await accept(world);
  tracker.toggle();
  world.socket.say(tracks(12));
  await settled();
  expect(world.socket.names.at(-1)).toBe("frame 11");
  tracker.show(3);
  tracker.toggle();
  await settled();
  expect(world.socket.names.at(-1)).toBe("frame 23");
  expect(tracker.shown.value).toBe(23);
});

test("a point on an earlier frame is followed when the run begins anew, on that frame", async () => {
  const { tracker, world } = await loaded(new FakeSource(5));
  tracker.start();
  await accept(world);
  tracker.show(2);
  tracker.add([{ x: 5, y: 6 }]);
  expect(tracker.stale.value).toBe(true);
  expect(world.socket.names).not.toContain("addPoints");
  tracker.start();
  await accept(world);
  expect(tracker.stale.value).toBe(false);
  const third = request(world.socket.sent[3]!);
  expect(third.case === "frame" && third.value).toMatchObject({ index: 2n, points: [{ id: 1n, x: 5, y: 6 }] });
  expect(world.socket.names).toEqual(["config", "frame 0", "frame 1", "frame 2", "frame 3", "frame 4", "finish"]);
});

test("a correction on an earlier frame leaves the estimates of this run alone", async () => {
  const { tracker, world } = await loaded(new FakeSource(5));
  const [id] = tracker.add([{ x: 1, y: 1 }]);
  tracker.start();
  await accept(world);
  world.socket.say(tracks(5, [run(1, 0, 5, 5)]));
  tracker.show(2);
  tracker.place(id!, { x: 50, y: 60 });
  expect(tracker.stale.value).toBe(true);
  expect(tracker.tracks.get(id!)!.at(4)!.x).toBe(4);
  expect(tracker.points.get(id!)!.placed.map(({ frame }) => frame)).toEqual([0, 2]);
});

/** A run of three frames with a point, all of it final. */
async function finished(): Promise<{ tracker: Tracker; world: FakeWorld; id: number }> {
  const { tracker, world } = await loaded(new FakeSource(3));
  const [id] = tracker.add([{ x: 1, y: 1 }]);
  tracker.start();
  await accept(world);
  world.socket.say(tracks(3, [run(1, 0, 3, 3)]));
  world.socket.say(response({ case: "summary", value: {} }));
  return { tracker, world, id: id! };
}

test("a correction on the last frame of a run that is over leaves its result alone", async () => {
  const { tracker, world, id } = await finished();
  tracker.show(2);
  tracker.place(id, { x: 50, y: 60 });
  expect(tracker.tracks.get(id)!.at(2)).toMatchObject({ x: 2, y: 4, final: true });
  expect(tracker.table()).toMatchObject({ complete: true, finalFrames: 3 });
  expect(tracker.stale.value).toBe(true);
  tracker.start();
  await accept(world);
  const last = request(world.socket.sent[3]!);
  expect(last.case === "frame" && last.value.points).toMatchObject([{ id: 1n, x: 50, y: 60 }]);
});

test("what is placed after a run is for the next one, and is no part of this one's result", async () => {
  const { tracker, world, id } = await finished();
  tracker.show(1);
  const [later] = tracker.add([{ x: 5, y: 6 }]);
  const object = tracker.addObject(STROKE, 3)!;
  const seen = [tracker.tracks.get(later!), tracker.tracks.getObject(object)];
  expect(seen).toMatchObject([{ start: 1 }, { start: 1 }]);
  expect([tracker.final.value, tracker.stale.value]).toEqual([3, true]);
  expect(tracker.table()).toMatchObject({ tracks: [{ id }], objects: [], complete: true, finalFrames: 3 });
  tracker.start();
  await accept(world);
  expect(tracker.table()).toMatchObject({ tracks: [{ id }, { id: later }], objects: [{ id: object }] });
});

test("what is placed on a frame behind the run is no part of its result either", async () => {
  const { tracker, world } = await loaded(new FakeSource(3));
  tracker.start();
  await accept(world);
  tracker.show(1);
  tracker.add([{ x: 5, y: 6 }]);
  world.socket.say(tracks(3));
  world.socket.say(response({ case: "summary", value: {} }));
  expect([tracker.final.value, tracker.table().tracks]).toEqual([3, []]);
});

const STROKE = { path: [{ x: 50, y: 50 }], radius: 20, mask: new Uint8Array([1]) };

/** The objects that a message has. */
function objectsOf(bytes: Uint8Array): number[] {
  const message = request(bytes);
  return message.case === "frame" ? message.value.objects.map(({ id }) => id) : [];
}

test("an object begins on the frame that it was painted on, or on the next where that one was sent", async () => {
  const { tracker, world } = await loaded(new FakeSource(100));
  expect(tracker.addObject(STROKE, 3)).toBe(1);
  tracker.start();
  await accept(world);
  expect(objectsOf(world.socket.sent[1]!)).toEqual([1]);
  const id = tracker.addObject(STROKE, 3)!; // on frame 11, the newest sent
  world.socket.say(tracks(1, [run(objectPointId(1, 2), 0, 1)], [objectRun(1, 0, 1)]));
  await settled();
  expect([world.socket.names.at(-1), objectsOf(world.socket.sent.at(-1)!)]).toEqual(["frame 12", [id]]);
  expect([...tracker.tracks.tracks].map((track) => track.id)).toEqual([4]);
  tracker.remove([1]);
  const removal = request(world.socket.sent.at(-1)!);
  expect(removal.case === "removePoints" && removal.value.ids.length).toBe(3);
  expect([[...tracker.tracks.tracks], [...tracker.tracks.objects].length]).toEqual([[], 1]);
  expect(tracker.stale.value).toBe(false);
  tracker.show(2);
  tracker.addObject(STROKE, 3);
  expect(tracker.stale.value).toBe(true);
});

test("no frame is sent while something is drawn", async () => {
  const { tracker, world } = await loaded(new FakeSource(100));
  tracker.start();
  await accept(world);
  tracker.hold(true);
  world.socket.say(tracks(5));
  await settled();
  expect([world.socket.names.at(-1), tracker.shown.value]).toEqual(["frame 11", 11]);
  tracker.hold(false);
  await settled();
  expect(world.socket.names.at(-1)).toBe("frame 16");
});

test("a name that is given to an object is its points' too, also of those to come and of runs to come", async () => {
  const { tracker, world } = await loaded(new FakeSource(100));
  const id = tracker.addObject(STROKE, 3)!;
  const names = () => [...tracker.table().objects, ...tracker.table().tracks].map(({ name }) => name);
  tracker.start();
  await accept(world);
  world.socket.say(tracks(1, [run(objectPointId(id, 0), 0, 1)], [objectRun(id, 0, 1)]));
  expect(names()).toEqual(["Object 1", "2"]);
  tracker.rename(id, "Car");
  world.socket.say(tracks(2, [run(objectPointId(id, 1), 0, 2)], [objectRun(id, 0, 2)]));
  expect(names()).toEqual(["Car", "Car", "Car"]);
  tracker.start();
  expect(names()).toEqual(["Car"]);
  tracker.rename(id, "");
  expect(names()).toEqual(["Object 1"]);
});

test("what is played stands still while something is drawn on it", async () => {
  const { tracker, world } = await loaded(new FakeSource(3));
  tracker.start();
  await accept(world);
  world.socket.say(response({ case: "summary", value: {} }));
  tracker.toggle();
  tracker.hold(true);
  world.pass(500);
  expect([tracker.playing.value, tracker.shown.value]).toEqual([false, 0]);
});

test("an object for which no frame came begins on the last one when the run begins anew", async () => {
  const { tracker, world } = await loaded(new FakeSource(12));
  tracker.start();
  await accept(world, { hopFrames: 7 }); // 11 frames leave
  tracker.addObject(STROKE, 3);
  tracker.stop();
  await settled();
  world.socket.say(response({ case: "summary", value: {} }));
  expect(tracker.stale.value).toBe(true);
  expect(tracker.table().objects).toEqual([]);
  tracker.start();
  await accept(world);
  expect(objectsOf(world.socket.sent[11]!)).toEqual([1]);
});

test("more objects, or points of theirs, than the server takes are refused here", async () => {
  const { tracker, world } = await loaded(new FakeSource(100));
  tracker.start();
  await accept(world, { limits: { maxPoints: 9, maxObjects: 1 } });
  expect(tracker.addObject(STROKE, 10)).toBeNull();
  expect(tracker.notice.value!.text).toContain("at most 9 points");
  expect(tracker.addObject(STROKE, 5)).toBe(1);
  expect(tracker.addObject(STROKE, 4)).toBeNull();
  expect(tracker.notice.value!.text).toContain("at most 1 objects");
});

test("a camera starts at once, and stopping it makes everything final", async () => {
  const source = new FakeSource(1000, true);
  const { tracker, world } = await loaded(source);
  await accept(world);
  expect(tracker.phase.value).toBe("running");
  expect(world.socket.names.at(-1)).toBe("frame 11"); // and no more before the server says how far it is
  world.socket.say(tracks(1));
  await settled();
  expect(world.socket.names.at(-1)).toBe("frame 12");
  tracker.stop();
  await settled();
  expect(source.closed).toBe(true);
  expect(world.socket.names.at(-1)).toBe("finish");
});

test("a camera is off once the server has ended the run", async () => {
  const source = new FakeSource(1000, true);
  const { tracker, world } = await loaded(source);
  await accept(world);
  world.socket.say(response({ case: "error", value: { code: 8, message: "too many sessions", details: [] } }));
  await settled();
  expect([tracker.phase.value, source.closed]).toEqual(["failed", true]);
});

test("a camera stays on where the server refused to begin, for the next attempt", async () => {
  const source = new FakeSource(1000, true);
  const { tracker, world } = await loaded(source);
  world.socket.say(response({ case: "error", value: { code: 8, message: "too many sessions", details: [] } }));
  await settled();
  expect([tracker.phase.value, source.closed]).toEqual(["failed", false]);
  tracker.start();
  await accept(world);
  expect(tracker.phase.value).toBe("running");
  expect(world.socket.names.at(-1)).toBe("frame 11");
});

test("what a camera has during a pause, or while something is drawn, is not missed", async () => {
  const source = new FakeSource(1000, true);
  const { tracker, world } = await loaded(source);
  await accept(world);
  tracker.hold(false); // as it was
  expect(source.skips).toBe(0);
  tracker.toggle();
  tracker.toggle();
  expect(source.skips).toBe(1);
  tracker.hold(true);
  tracker.hold(false);
  expect(source.skips).toBe(2);
});

/** Of a source, how many frames leave while as many bytes as a frame has wait for the network, and once none do. */
async function leaving(live: boolean): Promise<[number, number]> {
  const { tracker, world } = await loaded(new FakeSource(1000, live));
  if (!live) tracker.start();
  world.socket.open();
  world.socket.bufferedAmount = 1;
  world.socket.say(accepted());
  await settled();
  const behind = tracker.sent.value;
  world.socket.bufferedAmount = 0;
  world.pass(20);
  await settled();
  return [behind, tracker.sent.value];
}

test("a camera gives no frame while one waits for the network, a file as many as the server takes", async () => {
  expect(await leaving(true)).toEqual([1, 12]);
  expect(await leaving(false)).toEqual([12, 12]);
});

test("a source that breaks ends the run, and leaves what was tracked", async () => {
  const source = new FakeSource(1000, true);
  const { tracker, world } = await loaded(source);
  tracker.add([{ x: 1, y: 1 }]);
  await accept(world);
  source.next = () => Promise.reject(new Error("The camera was turned."));
  world.socket.say(tracks(12, [run(1, 0, 12, 4)]));
  await settled();
  expect([tracker.phase.value, tracker.notice.value]).toEqual(["failed", { text: "The camera was turned.", bad: true }]);
  expect(tracker.table()).toMatchObject({ frames: 12, complete: false, finalFrames: 4 });
  expect(source.closed).toBe(true);
});

test("a file keeps the pace at which it was recorded", async () => {
  const world = new FakeWorld();
  const tracker = new Tracker(world, () => DEFAULTS);
  await tracker.load(async () => new FakeSource(100));
  tracker.start();
  await accept(world);
  expect(world.socket.names.at(-1)).toBe("frame 0");
  for (let i = 0; i < 5; ++i) {
    world.pass(100);
    await settled();
  }
  expect(world.socket.names.at(-1)).toBe("frame 5");
  world.away = true; // nobody looks, and timers of hidden pages are slow
  world.pass(100);
  await settled();
  expect(world.socket.names.at(-1)).toBe("frame 11");
});

test("after a loss the page says where the session goes on, and the run ends as if nothing had been", async () => {
  const { tracker, world } = await loaded(new FakeSource(3));
  tracker.start();
  await accept(world);
  world.socket.break();
  expect(tracker.link.value!.state).toBe("waiting");
  world.pass(100);
  await accept(world);
  expect(tracker.notice.value!.text).toContain("goes on at frame 0");
  expect(world.socket.names).toEqual(["config", "frame 0", "frame 1", "frame 2", "finish"]);
});

test("an error of the server ends the run, and says why", async () => {
  const { tracker, world } = await loaded(new FakeSource(100));
  tracker.add([{ x: 1, y: 1 }]);
  tracker.start();
  await accept(world);
  world.socket.say(response({ case: "error", value: { code: 8, message: "too many points", details: [] } }));
  await settled();
  expect(tracker.phase.value).toBe("failed");
  expect(tracker.notice.value).toEqual({ text: "The server has no room for this: too many points.", bad: true });
});

test("more points than the server takes are refused here", async () => {
  const { tracker, world } = await loaded(new FakeSource(100));
  tracker.start();
  await accept(world, { limits: { maxPoints: 2 } });
  expect(tracker.add([{ x: 1, y: 1 }, { x: 2, y: 2 }, { x: 3, y: 3 }])).toEqual([]);
  expect(tracker.points.size).toBe(0);
  expect(tracker.notice.value!.text).toContain("at most 2 points");
});

test("a source that cannot be opened leaves nothing behind", async () => {
  const tracker = new Tracker(new FakeWorld(), () => DEFAULTS);
  await tracker.load(() => Promise.reject(new Error("no camera")));
  expect(tracker.phase.value).toBe("empty");
  expect(tracker.notice.value).toEqual({ text: "no camera", bad: true });
  tracker.start();
  expect(tracker.phase.value).toBe("empty");
});

test("of two sources that are asked for, the later one stands", async () => {
  const tracker = new Tracker(new FakeWorld(), () => DEFAULTS);
  let open!: (source: Source) => void;
  const slow = new FakeSource(9);
  const first = tracker.load(() => new Promise((resolve) => (open = resolve)));
  const second = new FakeSource(5);
  await tracker.load(async () => second);
  open(slow);
  await first;
  expect(tracker.source.value).toBe(second);
  expect(slow.closed).toBe(true);
  expect(tracker.frames.count).toBe(1);
});

test("after it was stopped a file can be tracked to its end", async () => {
  const { tracker, world } = await loaded(new FakeSource(14));
  tracker.add([{ x: 1, y: 1 }]);
  tracker.start();
  await accept(world);
  tracker.stop();
  await settled();
  expect(world.socket.names.at(-1)).toBe("finish");
  world.socket.say(response({ case: "summary", value: {} }));
  tracker.start();
  await accept(world);
  world.socket.say(tracks(12));
  await settled();
  expect(world.socket.names.slice(-2)).toEqual(["frame 13", "finish"]);
});

test("after the run it plays from the beginning, at the recorded pace", async () => {
  const { tracker, world } = await loaded(new FakeSource(3));
  tracker.start();
  await accept(world);
  world.socket.say(response({ case: "summary", value: {} }));
  tracker.toggle();
  expect(tracker.shown.value).toBe(0);
  world.pass(100);
  expect(tracker.shown.value).toBe(1);
  world.pass(500);
  expect(tracker.shown.value).toBe(2);
  expect(tracker.playing.value).toBe(false);
});
