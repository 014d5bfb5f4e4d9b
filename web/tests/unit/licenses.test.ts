// SPDX-License-Identifier: Apache-2.0
import { mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { afterEach, beforeEach, expect, test } from "vitest";
import { byPackage, license } from "../../licenses";

let root: string;
beforeEach(() => {
  root = mkdtempSync(join(tmpdir(), "holdfast-licenses-"));
});
afterEach(() => rmSync(root, { recursive: true }));

/** A package of these files; its folder. */
function pack(files: Record<string, string>): string {
  const folder = join(root, "node_modules", "@some", "thing");
  mkdirSync(folder, { recursive: true });
  const about = JSON.stringify({ name: "@some/thing", version: "1.2.3", license: "MIT" });
  for (const [name, text] of Object.entries({ ...files, "package.json": about })) writeFileSync(join(folder, name), text);
  return folder;
}

test("a package's file of its licence is shown", () => {
  const folder = pack({ "LICENCE.md": "Do as you like.\n", "a.js": "// Copyright nobody\nlet a;\n" });
  const text = license(folder, [join(folder, "a.js")]);
  expect(text).toMatch(/^@some\/thing 1\.2\.3, MIT, .*\n\nDo as you like\.\n\n-+\n$/);
});

test("without one, what its files begin with is, each notice once, and the licence that they name", () => {
  const apache = "// Copyright one\n//\n// Licensed under the Apache License, Version 2.0\n";
  const folder = pack({ "a.js": `${apache}let a;\n`, "b.js": `${apache}let b;\n`, "c.js": "// Copyright two\nlet c;\n// no\n" });
  const text = license(folder, ["a.js", "b.js", "c.js"].map((name) => join(folder, name)));
  expect(text.match(/Copyright one/g)).toHaveLength(1);
  expect(text).toContain("Copyright two\n");
  expect(text).not.toContain("// ");
  expect(text).toContain("TERMS AND CONDITIONS FOR USE, REPRODUCTION, AND DISTRIBUTION");
});

test("a package that tells no licence is an error", () => {
  const folder = pack({ "a.js": "// a file\nlet a;\n" });
  expect(() => license(folder, [join(folder, "a.js")])).toThrow("@some/thing 1.2.3");
});

test("files are sorted by the innermost package that they are of", () => {
  const files = ["/w/src/a.ts", "\0/w/node_modules/x/node_modules/@y/z/b.js?commonjs", "/w/node_modules/x/c.js"];
  expect([...byPackage(files)]).toEqual([
    ["/w/node_modules/x", ["/w/node_modules/x/c.js"]],
    ["/w/node_modules/x/node_modules/@y/z", ["/w/node_modules/x/node_modules/@y/z/b.js"]],
  ]);
});

test("the page has a text for every package that it is made of", () => {
  const sections = readFileSync("dist/licenses.txt", "utf8").split(/^-{100}$/m).slice(0, -1);
  expect(sections.length).toBeGreaterThan(5);
  for (const section of sections) expect(section.trim().split("\n").length).toBeGreaterThan(10);
  expect(sections[0]).toContain("@bufbuild/protobuf");
  expect(sections[0]).toContain("Copyright 2008 Google Inc.");
});
