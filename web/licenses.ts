// SPDX-License-Identifier: Apache-2.0
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";

const APACHE = new URL("../LICENSE", import.meta.url);

/** The files of packages among those that a page is made of, by the package's folder. */
export function byPackage(files: Iterable<string>): Map<string, string[]> {
  const packages = new Map<string, string[]>();
  for (const id of files) {
    const file = id.replace("\0", "").replace(/\?.*$/, "");
    const folder = /^.*\/node_modules\/(?:@[^/]+\/)?[^/]+(?=\/)/.exec(file)?.[0];
    if (folder) packages.set(folder, [...(packages.get(folder) ?? []), file]);
  }
  return new Map([...packages].sort(([a], [b]) => (a < b ? -1 : 1)));
}

/** What a page that has these files of a package must say of it. An error when the package tells no licence. */
export function license(folder: string, files: string[]): string {
  const { name, version, license } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
  const file = readdirSync(folder).find((entry) => /^licen[cs]e/i.test(entry));
  const text = file ? readFileSync(join(folder, file), "utf8").trim() : fromHeaders(files);
  if (!text) throw new Error(`${name} ${version} has neither a file of its licence nor files that begin with one`);
  return `${name} ${version}, ${license}, https://www.npmjs.com/package/${name}\n\n${text}\n\n${"-".repeat(100)}\n`;
}

/** The notices that files begin with, each once, and the licence that some of them only name. */
function fromHeaders(files: string[]): string {
  const notices = new Set<string>();
  for (const file of files) {
    const header = /^(?:\/\/.*\n)+/.exec(readFileSync(file, "utf8"))?.[0] ?? "";
    if (/copyright/i.test(header)) notices.add(header.replace(/^\/\/ ?/gm, "").trim());
  }
  const texts = [...notices].sort();
  if (texts.some((text) => text.includes("Apache License"))) texts.push(readFileSync(APACHE, "utf8").trim());
  return texts.join("\n\n");
}
