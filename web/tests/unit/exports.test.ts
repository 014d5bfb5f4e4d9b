// SPDX-License-Identifier: Apache-2.0
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { strToU8, unzipSync } from "fflate";
import { expect, test } from "vitest";
import { toCvat } from "../../src/exports/cvat";
import { npyFile } from "../../src/exports/npy";
import { toNpz } from "../../src/exports/npz";
import type { Table } from "../../src/exports/table";
import { fixed, to3de, toCsv, toDeepLabCut, toJson } from "../../src/exports/text";
import { TrackStore } from "../../src/tracks";
import { objectPointId } from "../../src/wire";
import { objectRun, run } from "./support";

/** Two points on three frames; the second begins on frame 1 and is hidden on frame 2. */
function table(more: Partial<Table> = {}): Table {
  const store = new TrackStore();
  store.seed(7, 0).name = 'left "ear", inner';
  store.seed(9, 1);
  store.apply([
    { id: 7, firstFrame: 0, x: [1, 1.25, 1.0625], y: [2, -0.0004, 300.1], visible: [true, true, true], confidence: [1, 0.5, 0.1239], finalCount: 3 },
    { id: 9, firstFrame: 1, x: [4, 5], y: [6, 7], visible: [true, false], confidence: [0, 0.25], finalCount: 1 },
  ]);
  const size = { width: 640, height: 480, fps: 10, frames: 3 };
  return { tracks: [...store.tracks], objects: [], ...size, complete: false, finalFrames: 2, expectedFrames: 5, goesOn: false, ...more };
}

test("three digits are those of printf, halves included", () => {
  expect([0.0625, 0.1875, 1.0625, 2.5, 3, 100.9375].map((x) => fixed(x))).toEqual(["0.062", "0.188", "1.062", "2.500", "3.000", "100.938"]);
  expect([-0.0625, -0.1875, -0.0001].map((x) => fixed(x))).toEqual(["-0.062", "-0.188", "-0.000"]);
  expect([0.0078125, 0.0234375, 2.5004].map((x) => fixed(x, 6))).toEqual(["0.007812", "0.023438", "2.500400"]);
});

/** Those of tests/client/cli/track_exports_test.cc: one ends early, one has a gap, one hides and leaves the picture. */
function threePoints(): Table {
  const store = new TrackStore();
  store.seed(4, 0).name = 'nose, "left" <1>';
  store.seed(7, 0).name = "paw";
  store.seed(9, 1);
  const part = (id: number, firstFrame: number, x: number[], y: number[], visible: boolean[], confidence: number[]) =>
    ({ id, firstFrame, x, y, visible, confidence, finalCount: x.length });
  store.apply([
    part(4, 0, [1.25, 2.0004], [10, 20], [true, true], [0.5, 0.25]),
    part(7, 0, [5, 6], [-0.5, 30], [true, false], [0.75, 0.0625]),
    part(7, 3, [8, 9], [31, 32], [true, true], [1, 1]),
    part(9, 1, [61, 62, 63.4, 63.5], [40, 41, 42, 43], [false, true, true, true], [0.125, 1, 1, 1]),
  ]);
  const size = { width: 64, height: 48, fps: 10, frames: 5 };
  return { tracks: [...store.tracks], objects: [], ...size, complete: true, finalFrames: 5, expectedFrames: 5, goesOn: false };
}

test.each([["tracks.dlc.csv", toDeepLabCut], ["tracks.xml", toCvat], ["tracks.3de.txt", to3de]])(
  "%s is byte for byte that of the command line", (name, write) => {
    expect(write(threePoints())).toBe(readFileSync(join(import.meta.dirname, "../../../tests/data/exports", name), "utf8"));
  });

test("CVAT's labels are in the order of their letters' bytes, and have no characters that XML has not", () => {
  const table = threePoints();
  ["\u{1f43e}", "\uffee", "a\x01b"].forEach((name, i) => (table.tracks[i]!.name = name));
  expect([...toCvat(table).matchAll(/<name>(.*?)</g)].map(([, name]) => name)).toEqual(["a b", "\uffee", "\u{1f43e}"]);
});

test("CVAT has no track without a shape, with which it would not import the file", () => {
  const store = new TrackStore();
  store.seed(7, 2).name = "late";
  const text = toCvat({ ...threePoints(), tracks: [...threePoints().tracks, ...store.tracks], frames: 2 });
  expect([...text.matchAll(/<track id="(\d+)"/g)].map(([, id]) => id)).toEqual(["4", "7", "9"]);
  expect(text).not.toContain("late");
});

test("CVAT's shapes end behind the last frame where the source goes on", () => {
  const text = toCvat({ ...threePoints(), goesOn: true });
  expect(text).toContain("<size>6</size>");
  const last = [...text.matchAll(/<points frame="5" keyframe="1" outside="(.)"/g)].map(([, outside]) => outside);
  expect(last).toEqual(["1", "1"]); // the first point had ended before
});

test("JSON has objects as the command line does, with the ids that its file has for their points", () => {
  const store = new TrackStore();
  const object = store.seedObject(1, 0);
  store.apply([run(objectPointId(1, 0), 0, 2, 2), run(objectPointId(1, 2), 0, 2, 2)], [objectRun(1, 0, 2, 2, 0.25, [2], [2])]);
  const text = toJson(table({ tracks: [...store.tracks], objects: [object] }));
  expect(text.slice(text.lastIndexOf("\n],") + 1)).toBe(
    '],\n"objects": [{"frames":[0,1],"id":1,"joined":[[4],[]],"left":[[4],[4]],"name":"Object 1","outline":[[[0.0,1.0],[4.0,1.0],[0.0,8.0]],[[1.0,1.0],[5.0,1.0],[1.0,8.0]]],' +
      '"points":[2,4],"rotation":[0.5,0.5],"scale":[1.0,1.0],"visible":[0.75,0.75],"xy":[[0.25,0.0],[1.25,2.0]]}]}\n',
  );
  expect(JSON.parse(text).objects[0].points).toEqual([2, 4]);
});

test("JSON is that of the command line", () => {
  expect(toJson(table())).toBe(
    '{"width": 640, "height": 480, "fps": 10, "frames": 3, "complete": false, "final_frames": 2, "expected_frames": 5, "points": [\n' +
      '{"confidence":[1.0,0.5,0.124],"frames":[0,1,2],"id":7,"name":"left \\"ear\\", inner","visible":[true,true,true],' +
      '"xy":[[1.0,2.0],[1.25,-0.0],[1.063,300.1]]},\n' +
      '{"confidence":[0.0,0.25],"frames":[1,2],"id":9,"name":"9","visible":[true,false],"xy":[[4.0,6.0],[5.0,7.0]]}\n]}\n',
  );
  expect(JSON.parse(toJson(table({ tracks: [] }))).points).toEqual([]);
});

test("a rate is read back as it was", () => {
  const head = (fps: number) => /"fps": ([^,]*),/.exec(toJson(table({ fps })))![1];
  expect([30, 12.5, 60000 / 1001, 24000 / 1001].map(head)).toEqual(["30", "12.5", "59.94005994005994", "23.976023976023978"]);
});

test("CSV has a line a point and frame", () => {
  expect(toCsv(table())).toBe(
    "id,frame,x,y,visible,confidence\n7,0,1.000,2.000,1,1.000\n7,1,1.250,-0.000,1,0.500\n7,2,1.062,300.100,1,0.124\n" +
      "9,1,4.000,6.000,1,0.000\n9,2,5.000,7.000,0,0.250\n",
  );
});

test("DeepLabCut's table has a row a frame, and empty cells where nothing is known", () => {
  const part = '"left ""ear"", inner"';
  expect(toDeepLabCut(table())).toBe(
    "scorer,holdfast,holdfast,holdfast,holdfast,holdfast,holdfast\n" +
      `bodyparts,${part},${part},${part},9,9,9\ncoords,x,y,likelihood,x,y,likelihood\n` +
      "0,1.000,2.000,1.000,,,\n1,1.250,-0.000,0.500,4.000,6.000,0.000\n2,1.062,300.100,0.124,5.000,7.000,0.250\n",
  );
});

test("columns of points with the same name are told apart", () => {
  const twins = table();
  for (const track of twins.tracks) track.name = "ear";
  expect(toDeepLabCut(twins).split("\n")[1]).toBe("bodyparts,ear,ear,ear,ear_9,ear_9,ear_9");
});

test("an array's header is padded to 64 bytes, and a tuple of one has its comma", () => {
  const file = npyFile("<i8", [2], new BigInt64Array([1n, 2n]));
  expect(file.length).toBe(128 + 16);
  expect([...file.subarray(0, 10)]).toEqual([0x93, ...strToU8("NUMPY"), 1, 0, 118, 0]);
  expect(new TextDecoder().decode(file.subarray(10, 128)).trimEnd()).toBe("{'descr': '<i8', 'fortran_order': False, 'shape': (2,), }");
});

test("npz has what `holdfast track` writes, with NaN where nothing is known", () => {
  const files = unzipSync(toNpz(table()));
  const names = ["tracks", "visible", "confidence", "ids", "names", "query_frames", "frames", "size", "fps", "complete"];
  expect(Object.keys(files)).toEqual([...names, "final_frames", "expected_frames"].map((name) => `${name}.npy`));
  const data = files["tracks.npy"]!.slice(128);
  const xy = new Float32Array(data.buffer);
  expect([...xy.slice(6, 12)]).toEqual([NaN, NaN, 4, 6, 5, 7]);
  expect([...files["visible.npy"]!.slice(128)]).toEqual([1, 1, 1, 0, 1, 0]);
  expect([...new BigInt64Array(files["ids.npy"]!.slice(128).buffer)]).toEqual([7n, 9n]);
  expect([...new BigInt64Array(files["query_frames.npy"]!.slice(128).buffer)]).toEqual([0n, 1n]);
  expect([...new BigInt64Array(files["frames.npy"]!.slice(128).buffer)]).toEqual([0n, 1n, 2n]);
  expect([...new Float64Array(files["fps.npy"]!.slice(128).buffer)]).toEqual([10]);
  expect([...new BigInt64Array(files["expected_frames.npy"]!.slice(128).buffer)]).toEqual([5n]);
});

test("npz has objects as files of `holdfast track` do", () => {
  const store = new TrackStore();
  store.seed(1, 0);
  const [object, later] = [store.seedObject(2, 0), store.seedObject(300, 1)];
  object.given = "fish";
  store.apply(
    [run(1, 0, 3, 2), run(objectPointId(2, 0), 0, 3, 2), run(objectPointId(2, 1), 0, 3, 2)],
    [objectRun(2, 0, 3, 2, 0.25, [1]), objectRun(300, 1, 1, 0, 0.5)],
  );
  const files = unzipSync(toNpz(table({ tracks: [...store.tracks], objects: [object, later] })));
  const array = (name: string) => {
    const file = files[`${name}.npy`]!;
    return { header: new TextDecoder().decode(file.subarray(10, 128)), data: file.slice(128).buffer };
  };
  const floats = (name: string) => [...new Float32Array(array(name).data)];
  const integers = (name: string) => [...new BigInt64Array(array(name).data)];
  expect(integers("ids")).toEqual([1n, 3n, 4n]);
  expect(integers("of_object")).toEqual([-1n, 2n, 2n]);
  expect(integers("replaces")).toEqual([-1n, -1n, -1n]);
  expect([...new Uint8Array(array("left").data)]).toEqual([0, 0, 0, 0, 0, 0, 1, 1, 1]);
  expect(integers("object_ids")).toEqual([2n, 300n]);
  expect(array("object_names").header).toContain("'<U10', 'fortran_order': False, 'shape': (2,)"); // "Object 300"
  expect(array("object_centre").header).toContain("(2, 3, 2)");
  expect(floats("object_centre")).toEqual([0.25, 0, 1.25, 2, 2.25, 4, NaN, NaN, 1.5, 2, NaN, NaN]);
  expect(floats("object_scale")).toEqual([1, 1, 1, NaN, 1, NaN]);
  expect(floats("object_visible")).toEqual([0.75, 0.75, 0.75, 0, 0.75, 0]);
  expect(array("object_outline").header).toContain("(2, 3, 3, 2)");
  expect(floats("object_outline").slice(0, 12)).toEqual([0, 1, 4, 1, 0, 8, 1, 1, 5, 1, 1, 8]);
  expect(floats("object_outline").slice(18, 24)).toEqual(Array(6).fill(NaN));
});

test("names are texts of NumPy's, letters beyond 16 bits included", () => {
  const named = table();
  named.tracks[1]!.name = "\u{1f43e}é";
  const file = unzipSync(toNpz({ ...named, tracks: [named.tracks[1]!] }))["names.npy"]!;
  expect(new TextDecoder().decode(file.subarray(10, 128)).trimEnd()).toBe("{'descr': '<U2', 'fortran_order': False, 'shape': (1,), }");
  expect([...new Uint32Array(file.slice(128).buffer)]).toEqual([0x1f43e, 0xe9]);
});
