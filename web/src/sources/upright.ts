// SPDX-License-Identifier: Apache-2.0

// Markers of JPEG (ITU-T T.81, B.1.1.3).
const START_OF_IMAGE = 0xffd8;
const START_OF_SCAN = 0xffda;
const APP1 = 0xffe1;

// Exif (CIPA DC-008, 4.5 and 4.6) is a TIFF file after six bytes of its own.
const EXIF = 0x45786966; // the first four of them
const EXIF_BYTES = 6;
const LITTLE_ENDIAN = 0x4949;
const BIG_ENDIAN = 0x4d4d;
const TIFF = 42;
const ENTRY_BYTES = 12;
const ORIENTATION = 0x0112;
const SHORT = 3;
const UPRIGHT = 1;

// Those that have a length behind them: not a restart, nor the beginning or end of a picture.
const hasLength = (marker: number) => marker >= 0xffc0 && marker < 0xffff && !(marker >= 0xffd0 && marker <= 0xffd9);

/**
 * Whether a JPEG's pixels are for certain stored as they are to be seen: browsers turn and mirror pictures as their Exif
 * says, the server does not. False where that cannot be told, so that nothing damaged or malicious passes for upright.
 */
export function isUpright(jpeg: Uint8Array): boolean {
  const bytes = viewOf(jpeg);
  if (jpeg.length < 2 || bytes.getUint16(0) !== START_OF_IMAGE) return false;
  for (let at = 2; at + 4 <= jpeg.length; ) {
    const [marker, length] = [bytes.getUint16(at), bytes.getUint16(at + 2)];
    if (marker === START_OF_SCAN) return true; // what comes behind it is not looked at by browsers
    const end = at + 2 + length;
    if (!hasLength(marker) || length < 2 || end > jpeg.length) return false;
    if (marker === APP1 && mayTurn(jpeg.subarray(at + 4, end))) return false;
    at = end;
  }
  return false;
}

// Whether a segment is Exif, and either says another orientation or cannot be read.
function mayTurn(segment: Uint8Array): boolean {
  if (segment.length < 4 || viewOf(segment).getUint32(0) !== EXIF) return false;
  const tiff = viewOf(segment.subarray(EXIF_BYTES));
  if (tiff.byteLength < 8) return true;
  const order = tiff.getUint16(0);
  const little = order === LITTLE_ENDIAN;
  if ((!little && order !== BIG_ENDIAN) || tiff.getUint16(2, little) !== TIFF) return true;
  const first = tiff.getUint32(4, little) + 2; // behind the number of entries
  if (first > tiff.byteLength) return true;
  const end = first + ENTRY_BYTES * tiff.getUint16(first - 2, little);
  if (end > tiff.byteLength) return true;
  for (let at = first; at < end; at += ENTRY_BYTES) if (turns(tiff, at, little)) return true;
  return false;
}

// An entry is a tag, a type, a count and, as the value is so short, the value itself.
function turns(tiff: DataView, at: number, little: boolean): boolean {
  if (tiff.getUint16(at, little) !== ORIENTATION) return false;
  const [type, count] = [tiff.getUint16(at + 2, little), tiff.getUint32(at + 4, little)];
  return type !== SHORT || count !== 1 || tiff.getUint16(at + 8, little) !== UPRIGHT;
}

const viewOf = (bytes: Uint8Array) => new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
