// SPDX-License-Identifier: Apache-2.0
import { defineConfig } from "vite";

// Few files, of fixed names: they are committed, and the server that embeds them tells versions apart by ETag.
export default defineConfig({
  base: "./",
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
