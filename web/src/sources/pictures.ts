// SPDX-License-Identifier: Apache-2.0
import { type Encoding, JpegEncoder, type Picture, sentSize, type Source } from "./source";
import { isUpright } from "./upright";

const FPS = 30; // as the command line takes for a directory of pictures

/**
 * Pictures as frames, in the order of their names (compareNames). A JPEG that need be neither shrunk nor turned is sent
 * as it is, byte for byte; of all others, what this browser shows.
 */
export async function openPictures(files: readonly File[], encoding: Encoding): Promise<Source> {
  const sorted = [...files].sort((a, b) => compareNames(a.name, b.name));
  if (sorted.length === 0) throw new Error("No pictures: choose .jpg or .png files.");
  const first = await decode(sorted[0]!);
  const own = { width: first.width, height: first.height };
  first.close();
  const sent = sentSize(own, encoding);
  const encoder = new JpegEncoder(sent.width, sent.height, encoding.quality);
  const whole = sent.width === own.width && sent.height === own.height;
  let index = 0;

  const next = async (): Promise<Picture | null> => {
    const file = sorted[index];
    if (!file) return null;
    const bitmap = await decode(file);
    try {
      if (bitmap.width !== own.width || bitmap.height !== own.height) {
        throw new Error(`${file.name} is ${bitmap.width}×${bitmap.height}, the first picture ${own.width}×${own.height}.`);
      }
      const asIs = whole && file.type === "image/jpeg" ? new Uint8Array(await file.arrayBuffer()) : null;
      const jpeg = asIs && isUpright(asIs) ? asIs : await encoder.encode(bitmap);
      return { jpeg, seconds: index++ / FPS };
    } finally {
      bitmap.close();
    }
  };
  return {
    label: `${sorted.length} pictures`,
    live: false,
    ...sent,
    own,
    fps: FPS,
    frames: sorted.length,
    dropped: 0,
    next,
    close: () => {},
  };
}

/** Numbers within names count by what they are worth, so that 2 is before 10: the order of `holdfast track`. */
export function compareNames(a: string, b: string): number {
  const [partsOfA, partsOfB] = [partsOf(a), partsOf(b)];
  for (let i = 0; i < Math.min(partsOfA.length, partsOfB.length); ++i) {
    const order = compareParts(partsOfA[i]!, partsOfB[i]!);
    if (order !== 0) return order;
  }
  return partsOfA.length - partsOfB.length || compareText(a, b);
}

// Numbers, and single characters that are none.
const partsOf = (name: string): string[] => name.match(/[0-9]+|[^]/gu) ?? [];

function compareParts(a: string, b: string): number {
  const [worthOfA, worthOfB] = [a, b].map((part) => part.replace(/^0+/, "")) as [string, string];
  const numbers = /^[0-9]/.test(a) && /^[0-9]/.test(b);
  return (numbers && worthOfA.length - worthOfB.length) || compareText(worthOfA, worthOfB);
}

const compareText = (a: string, b: string) => (a < b ? -1 : a > b ? 1 : 0);

async function decode(file: File): Promise<ImageBitmap> {
  try {
    return await createImageBitmap(file);
  } catch {
    throw new Error(`${file.name} is not a picture that this browser reads.`);
  }
}
