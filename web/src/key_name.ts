// SPDX-License-Identifier: Apache-2.0

const BY_CODE: Record<string, string> = { BracketLeft: "[", BracketRight: "]", Digit0: "0" };

// What is printed there on keyboards of the United States.
const printedOn = (code: string) => BY_CODE[code] ?? (/^Key[A-Z]$/.test(code) ? code.slice(3) : "");

/**
 * What a key is called among those that do something: small letters, whatever Caps Lock says, and on layouts that have other
 * letters what stands in the key's place on a Latin one. "Shift+" comes before letters and named keys; signs have it in them.
 */
export function keyName({ key, code, shiftKey }: Pick<KeyboardEvent, "key" | "code" | "shiftKey">): string {
  const known = /^[^\x00-\x7f]$/u.test(key) ? printedOn(code) || key : key;
  const isLetter = /^[a-z]$/i.test(known);
  const name = isLetter ? known.toLowerCase() : known;
  return shiftKey && (isLetter || name.length > 1) ? `Shift+${name}` : name;
}
