// SPDX-License-Identifier: Apache-2.0

const ALIGNMENT = 64; // of an array's data, as NumPy asks for

/** An array in NumPy's format, version 1.0. */
export function npyFile(dtype: string, shape: readonly number[], data: ArrayBufferView): Uint8Array {
  const tuple = shape.length === 1 ? `${shape[0]},` : shape.join(", "); // a tuple of one needs its comma
  let header = `{'descr': '${dtype}', 'fortran_order': False, 'shape': (${tuple}), }`;
  const unpadded = 8 + 2 + header.length + 1;
  header += " ".repeat((ALIGNMENT - (unpadded % ALIGNMENT)) % ALIGNMENT) + "\n";
  const file = new Uint8Array(10 + header.length + data.byteLength);
  file.set([0x93, ...new TextEncoder().encode("NUMPY"), 1, 0, header.length & 0xff, header.length >> 8]);
  file.set(new TextEncoder().encode(header), 10);
  file.set(new Uint8Array(data.buffer, data.byteOffset, data.byteLength), 10 + header.length);
  return file;
}

/** Texts of one length, that of the longest, as NumPy has them: code points of 32 bits. */
export function texts(values: readonly string[]): Uint8Array {
  const points = values.map((text) => [...text].map((letter) => letter.codePointAt(0)!));
  const longest = Math.max(1, ...points.map((text) => text.length));
  const all = new Uint32Array(values.length * longest);
  points.forEach((text, row) => all.set(text, row * longest));
  return npyFile(`<U${longest}`, [values.length], all);
}

export const integers = (values: readonly number[]) => BigInt64Array.from(values, BigInt);
