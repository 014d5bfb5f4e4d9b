// SPDX-License-Identifier: Apache-2.0
import { defineConfig, type Plugin } from "vite";
import { byPackage, license } from "./licenses.ts";

// Few files, of fixed names: they are committed, and the server that embeds them tells versions apart by ETag.
export default defineConfig({
  base: "./",
  plugins: [licenses()],
  build: {
    target: "es2022",
    modulePreload: false,
    assetsInlineLimit: 0,
    chunkSizeWarningLimit: 1000,
    rollupOptions: {
      output: { entryFileNames: "app.js", chunkFileNames: "[name].js", assetFileNames: "app[extname]" },
    },
  },
});

/** Writes licenses.txt: what the page is made of beside its own code. */
function licenses(): Plugin {
  return {
    name: "licenses",
    generateBundle(_options, bundle) {
      const files = Object.values(bundle).flatMap((chunk) => (chunk.type === "chunk" ? Object.keys(chunk.modules) : []));
      const source = [...byPackage(files)].map(([folder, used]) => license(folder, used)).join("\n");
      this.emitFile({ type: "asset", fileName: "licenses.txt", source });
    },
  };
}
