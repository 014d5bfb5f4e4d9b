// SPDX-License-Identifier: Apache-2.0
import { beforeEach, expect, test, vi } from "vitest";
import { compareNames, openPictures } from "../../src/sources/pictures";
import { isUpright } from "../../src/sources/upright";

const START = [0xff, 0xd8];
const SCAN = [0xff, 0xda, 0, 2, 0x12, 0x34];
const segment = (marker: number, bytes: number[]) => [0xff, marker, (bytes.length + 2) >> 8, (bytes.length + 2) & 0xff, ...bytes];

/** What a TIFF file has of a number, in either order of its bytes. */
const number = (value: number, bytes: number, little: boolean) => {
  const big = Array.from({ length: bytes }, (_, i) => Math.floor(value / 256 ** (bytes - 1 - i)) % 256);
  return little ? big.reverse() : big;
};

interface Entry {
  tag?: number;
  type?: number;
  count?: number;
  value: number;
}

/** The content of an Exif segment with these entries; `claimed` is how many it says that there are. */
function exif(entries: Entry[], { little = true, magic = 42, offset = 8, claimed = entries.length } = {}): number[] {
  const n = (value: number, bytes: number) => number(value, bytes, little);
  const directory = entries.flatMap(({ tag = 0x0112, type = 3, count = 1, value }) =>
    [...n(tag, 2), ...n(type, 2), ...n(count, 4), ...n(value, 2), 0, 0]);
  const header = [...(little ? [0x49, 0x49] : [0x4d, 0x4d]), ...n(magic, 2), ...n(offset, 4)];
  return [...Buffer.from("Exif\0\0"), ...header, ...n(claimed, 2), ...directory, 0, 0, 0, 0];
}

const jpeg = (...segments: number[][]) => Uint8Array.from([...START, ...segments.flat(), ...SCAN]);
const withExif = (...parts: Parameters<typeof exif>) => jpeg(segment(0xe0, [1, 2, 3]), segment(0xe1, exif(...parts)));

test("a JPEG is upright without Exif, with no orientation, and with the first of them", () => {
  expect(isUpright(jpeg())).toBe(true);
  expect(isUpright(jpeg(segment(0xe1, [...Buffer.from("http://ns.adobe.com/xap/1.0/\0<x/>")])))).toBe(true);
  expect(isUpright(jpeg(segment(0xe1, [])))).toBe(true);
  for (const little of [true, false]) {
    expect(isUpright(withExif([], { little }))).toBe(true);
    expect(isUpright(withExif([{ tag: 0x010f, value: 6 }, { value: 1 }], { little }))).toBe(true);
  }
});

test.each([2, 3, 4, 5, 6, 7, 8])("a JPEG of orientation %i is not, in either order of bytes", (value) => {
  for (const little of [true, false]) {
    expect(isUpright(withExif([{ value }], { little }))).toBe(false);
    expect(isUpright(withExif([{ tag: 0x010f, value: 1 }, { value }], { little }))).toBe(false);
  }
});

test("a JPEG whose second orientation, or second Exif, is another is not upright", () => {
  expect(isUpright(withExif([{ value: 1 }, { value: 6 }]))).toBe(false);
  expect(isUpright(jpeg(segment(0xe1, exif([{ value: 1 }])), segment(0xe1, exif([{ value: 6 }]))))).toBe(false);
});

test("Exif that cannot be read does not pass for upright", () => {
  const upright = [{ value: 1 }];
  expect(isUpright(withExif(upright, { magic: 43 }))).toBe(false);
  expect(isUpright(withExif(upright, { offset: 0xffffffff }))).toBe(false);
  expect(isUpright(withExif(upright, { offset: 25 }))).toBe(false); // half of a number behind it
  expect(isUpright(withExif(upright, { claimed: 0xffff }))).toBe(false);
  expect(isUpright(withExif([{ type: 4, value: 1 }]))).toBe(false);
  expect(isUpright(withExif([{ count: 2, value: 1 }]))).toBe(false);
  expect(isUpright(withExif([{ value: 0 }]))).toBe(false);
  expect(isUpright(jpeg(segment(0xe1, [...Buffer.from("Exif\0\0XX"), 0, 42, 0, 0, 0, 8, 0, 0])))).toBe(false);
  for (let length = 4; length < 6 + 8 + 2 + 12; ++length) {
    expect(isUpright(jpeg(segment(0xe1, exif(upright).slice(0, length)))), `${length} bytes of Exif`).toBe(false);
  }
});

test("a JPEG that is cut off before its scan, or is none, does not pass for upright", () => {
  const whole = withExif([{ value: 1 }]);
  const scan = whole.length - SCAN.length;
  expect(isUpright(whole.subarray(0, scan + 4))).toBe(true);
  for (let length = 0; length < scan + 4; ++length) expect(isUpright(whole.subarray(0, length)), `${length} bytes`).toBe(false);
  expect(isUpright(Uint8Array.from([0x89, 0x50, 0x4e, 0x47, ...SCAN]))).toBe(false);
  expect(isUpright(jpeg([0xff, 0xe0, 0, 0]))).toBe(false); // a length that would go on for ever
  expect(isUpright(jpeg([0xff, 0xd0, 0, 2]))).toBe(false); // what has no length
  expect(isUpright(jpeg([0x12, 0x34, 0, 2]))).toBe(false); // no marker
});

test("what lies around a JPEG in memory is none of it", () => {
  const whole = withExif([{ value: 6 }]);
  const around = Uint8Array.from([...jpeg(), ...whole, ...jpeg()]);
  expect(isUpright(around.subarray(jpeg().length, jpeg().length + whole.length))).toBe(false);
});

const ENCODED = [1, 2, 3]; // what the browser makes of any picture

beforeEach(() => {
  vi.stubGlobal("createImageBitmap", async () => ({ width: 40, height: 30, close: () => {} }));
  vi.stubGlobal("OffscreenCanvas", class {
    getContext = () => ({ drawImage: () => {} });
    convertToBlob = async () => new Blob([Uint8Array.from(ENCODED)]);
  });
});

/** What is sent of a picture of 40 × 30 pixels. */
async function sent(bytes: Uint8Array<ArrayBuffer>, type = "image/jpeg", maxSide = 0): Promise<number[]> {
  const source = await openPictures([new File([bytes], "picture", { type })], { maxSide, quality: 0.9 });
  return [...(await source.next())!.jpeg];
}

test("a JPEG is sent byte for byte where it need be neither turned nor shrunk", async () => {
  const [upright, turned] = [withExif([{ value: 1 }]), withExif([{ value: 6 }])];
  expect(await sent(upright)).toEqual([...upright]);
  expect(await sent(turned)).toEqual(ENCODED);
  expect(await sent(upright, "image/jpeg", 20)).toEqual(ENCODED);
  expect(await sent(upright, "image/png")).toEqual(ENCODED);
});

test("a picture that is shrunk along one side alone is not sent as it is", async () => {
  vi.stubGlobal("createImageBitmap", async () => ({ width: 1, height: 30, close: () => {} }));
  expect(await sent(jpeg(), "image/jpeg", 20)).toEqual(ENCODED);
});

test("numbers in names count by their worth", async () => {
  const ordered = ["1.png", "002.png", "2.png", "10.png", "a1b2.png", "a1b10.png", "a2.png", "b.png"];
  expect([...ordered].sort().sort(compareNames)).toEqual(ordered);
  expect([...ordered].reverse().sort(compareNames)).toEqual(ordered);
  const files = [2, 10, 1].map((i) => new File([jpeg(segment(0xe0, [i]))], `${i}.jpg`, { type: "image/jpeg" }));
  const source = await openPictures(files, { maxSide: 0, quality: 0.9 });
  for (const i of [1, 2, 10]) expect([...(await source.next())!.jpeg]).toEqual([...jpeg(segment(0xe0, [i]))]);
});
