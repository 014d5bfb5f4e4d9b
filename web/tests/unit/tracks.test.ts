// SPDX-License-Identifier: Apache-2.0
import { expect, test } from "vitest";
import { shownFrames, stretches } from "../../src/lanes";
import { Points } from "../../src/points";
import { TrackStore } from "../../src/tracks";
import { objectPointId } from "../../src/wire";
import { objectRun, run } from "./support";

function storeWith(...ids: number[]): TrackStore {
  const store = new TrackStore();
  for (const id of ids) store.seed(id, 0);
  return store;
}

test("runs join into tracks, and final estimates stay", () => {
  const store = storeWith(1);
  store.apply([run(1, 0, 4, 2)]);
  store.apply([run(1, 0, 6, 0, 100)]); // would revise everything
  const track = store.get(1)!;
  expect([0, 1, 2, 5].map((t) => track.at(t)!.x)).toEqual([0, 1, 102, 105]);
  expect(track.at(1)).toEqual({ x: 1, y: 2, confidence: 0.5, visible: true, final: true });
  expect(track.at(2)!.final).toBe(false);
  expect(track.at(6)).toBeNull();
  expect(track.finalEnd).toBe(2);
});

test("tracks grow over any number of frames", () => {
  const store = storeWith(1);
  for (let first = 0; first < 1000; first += 10) store.apply([run(1, first, 10, 10)]);
  expect(store.get(1)!.at(999)!.x).toBe(999);
  expect(store.get(1)!.finalEnd).toBe(1000);
});

test("a gap is no estimate", () => {
  const store = storeWith(1);
  store.apply([run(1, 0, 2), run(1, 4, 2)]);
  const track = store.get(1)!;
  expect(track.has(3)).toBe(false);
  expect(track.newest(3)).toBe(1);
  expect(track.newest(99)).toBe(5);
});

test("a point that begins anew keeps what was before, and nothing after", () => {
  const store = storeWith(1);
  store.apply([run(1, 0, 10, 6)]);
  store.seed(1, 8);
  const track = store.get(1)!;
  expect(track.has(7)).toBe(true);
  expect(track.has(8)).toBe(false);
  expect(track.finalEnd).toBe(8);
  store.apply([run(1, 8, 3, 1, 50)]);
  expect(track.at(8)!.x).toBe(58);
  expect(track.finalEnd).toBe(9);
});

test("late results of a removed point meet nobody", () => {
  const store = storeWith(1, 2);
  store.remove(1);
  store.apply([run(1, 0, 3), run(2, 0, 3)]);
  expect([...store.tracks].map(({ id }) => id)).toEqual([2]);
});

test("the slowest point says how far frames are final", () => {
  const store = storeWith(1, 2);
  store.seed(3, 30);
  store.apply([run(1, 0, 20, 12), run(2, 0, 20, 9)]);
  expect(store.finalFrames(40)).toBe(9);
  store.remove(2);
  expect(store.finalFrames(40)).toBe(12);
  expect(storeWith().finalFrames(40)).toBe(40);
});

test("an object has a life of its own, and points that are there once something is heard of them", () => {
  const store = storeWith(1);
  const object = store.seedObject(2, 4);
  expect([object.newest(9), store.finalFrames(40)]).toEqual([-1, 0]);
  store.apply([run(objectPointId(2, 0), 4, 6, 3), run(objectPointId(2, 7), 4, 6, 3)], [objectRun(2, 4, 6, 2)]);
  store.apply([], [objectRun(2, 4, 8, 0, 100, [7])]); // would revise everything
  expect([4, 5, 6, 11].map((t) => object.at(t)!.x)).toEqual([4, 5, 106, 111]);
  expect([object.finalEnd, object.isFinal(5), object.isFinal(6), object.has(12)]).toEqual([6, true, false, false]);
  const points = store.pointsOf(2);
  expect(points.map(({ id, name, order, start }) => [id, name, order, start])).toEqual([[3, "3", 1, 4], [10, "10", 1, 4]]);
  expect(points.map(({ id }) => object.hasLeft(id, 8))).toEqual([false, true]);
  expect(object.hasLeft(10, 5)).toBe(false); // it had not by then
  expect(store.finalFrames(40)).toBe(0); // of point 1 nothing is known
});

test("a point that is placed anew goes on where the one before it left", () => {
  const store = storeWith(300);
  const object = store.seedObject(1, 0);
  const [old, anew] = [objectPointId(1, 3), objectPointId(1, 3 + 256)];
  store.apply([run(old, 0, 24, 9), run(300, 0, 2)], [objectRun(1, 0, 12, 9, 0, [3])]);
  store.apply([run(anew, 8, 20, 0, 100)], [objectRun(1, 9, 9, 7, 0, [3], [3 + 256])]);
  store.apply([run(old, 9, 12, 12)]); // it goes on to the end of its window
  const [track, ...others] = store.pointsOf(1);
  expect([track!.id, others.length]).toEqual([5, 0]);
  expect([7, 8, 9, 20, 27].map((t) => track!.x(t))).toEqual([7, 108, 109, 120, 127]);
  expect([track!.isFinal(7), track!.isFinal(9), track!.end, track!.seedFrame]).toEqual([true, false, 28, 8]);
  expect([8, 9, 12].map((t) => object.hasLeft(5, t))).toEqual([true, false, false]);
  store.apply([], [objectRun(1, 16, 1, 1, 0, [3 + 256])]); // and leaves in turn
  expect([15, 16].map((t) => object.hasLeft(5, t))).toEqual([false, true]);
  expect(store.get(300)!.x(1)).toBe(1); // ids of the user's own points say nothing of the kind
});

test("an object goes with all of its points, and late results meet nobody", () => {
  const store = storeWith(1);
  store.seedObject(2, 0);
  store.apply([run(objectPointId(2, 0), 0, 3)], [objectRun(2, 0, 3)]);
  store.remove(2);
  store.apply([run(objectPointId(2, 1), 0, 3)], [objectRun(2, 0, 3)]);
  expect([...store.tracks].map(({ id }) => id)).toEqual([1]);
  expect([...store.objects]).toEqual([]);
});

test("an object takes as many ids as it may have points", () => {
  const points = new Points();
  const shape = { path: [{ x: 1, y: 1 }], radius: 9, mask: new Uint8Array() };
  const object = points.addObject({ frame: 3, shown: 2, shape, count: 24 });
  expect([object.id, points.add(0, 1, 1).id, points.most]).toEqual([1, 26, 25]);
  expect(points.objectsOn(3)).toEqual([{ id: 1, shape, points: 24 }]);
  expect(points.objectsOn(2)).toEqual([]);
});

test("ids of removed points are not given again", () => {
  const points = new Points();
  points.remove(points.add(0, 1, 1).id);
  expect(points.add(0, 2, 2).id).toBe(2);
});

test("a point is sent with every frame on which it was placed, once", () => {
  const points = new Points();
  const { id } = points.add(5, 1, 1);
  points.place(id, 2, 3, 3);
  points.place(id, 5, 4, 4);
  expect(points.seedsOn(2)).toEqual([{ id, x: 3, y: 3 }]);
  expect(points.seedsOn(5)).toEqual([{ id, x: 4, y: 4 }]);
  expect(points.seedsOn(3)).toEqual([]);
  expect(points.get(id)!.placed.map(({ frame }) => frame)).toEqual([2, 5]);
});

test("a lane is cut where its look changes", () => {
  const store = storeWith(1);
  const hidden = { ...run(1, 0, 6, 3), visible: [true, true, false, false, false, true] };
  store.apply([hidden, run(1, 8, 1)]);
  const look = (first: number, last: number, visible: boolean, final: boolean) => ({ first, last, visible, final });
  expect(stretches(store.get(1)!, 0, 99)).toEqual([
    look(0, 1, true, true),
    look(2, 2, false, true),
    look(3, 4, false, false),
    look(5, 5, true, false),
    look(8, 8, true, false),
  ]);
  expect(stretches(store.get(1)!, 1, 2)).toEqual([look(1, 1, true, true), look(2, 2, false, true)]);
});

test("a timeline shows all of a file, and what there may be of an endless camera", () => {
  expect(shownFrames(1, 3, 1000, 0, 0)).toEqual({ from: 0, to: 2 });
  expect(shownFrames(3, 160, 1000, 2, 0)).toEqual({ from: 0, to: 159 });
  expect(shownFrames(3, null, 1000, 2, 0)).toEqual({ from: 0, to: 47 });
});

test("of a long run a timeline shows those frames that have the one on the stage among them", () => {
  expect(shownFrames(1, 5000, 1000, 0, 0)).toEqual({ from: 0, to: 999 }); // which are the first ones, while it begins
  expect(shownFrames(1700, 5000, 1000, 1699, 699)).toEqual({ from: 700, to: 1699 });
  expect(shownFrames(1700, 5000, 1000, 900, 700)).toEqual({ from: 700, to: 1699 });
  expect(shownFrames(1700, 5000, 1000, 650, 700)).toEqual({ from: 650, to: 1649 }); // someone goes back
  expect(shownFrames(1700, 5000, 1000, 1649, 650)).toEqual({ from: 650, to: 1649 });
  expect(shownFrames(5000, 5000, 1000, 4999, 0)).toEqual({ from: 4000, to: 4999 });
  expect(shownFrames(5000, null, 1000, 4999, 3999)).toEqual({ from: 4000, to: 4999 });
  expect(shownFrames(1, 5000, 1000, 0, 4000)).toEqual({ from: 0, to: 999 }); // it begins anew
  expect(shownFrames(0, 2, 1000, -1, 4000)).toEqual({ from: 0, to: 1 });
});
