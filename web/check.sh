#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Holds the committed page (web/dist) against its sources, and runs the page's tests. Those in a browser run where
# HOLDFAST_BIN (build/release/bin) has a server, and need Debian's chromium. `check.sh build` makes web/dist anew instead.
set -euo pipefail
cd "$(dirname "$0")"
most_bytes=$((200 * 1024)) # of the page, compressed

[ node_modules/.package-lock.json -nt package-lock.json ] || npm ci --silent --no-fund --no-audit
npm run -s generate
npm run -s check
if [ "${1:-}" = build ]; then
  npx vite build --logLevel warn
else
  npx vite build --logLevel warn --outDir out/dist --emptyOutDir
  diff -rq dist out/dist || { echo "web: web/dist is not what its sources make: run make web-page" >&2; exit 1; }
fi

bytes=0
for file in dist/*; do bytes=$((bytes + $(gzip -9c "$file" | wc -c))); done
echo "web: $(find dist -type f | wc -l) files, $bytes bytes compressed"
[ "$bytes" -le "$most_bytes" ] || { echo "web: expected at most $most_bytes bytes" >&2; exit 1; }
[ "${1:-}" != build ] || exit 0

npx vitest run --dir tests/unit
if [ -x "${HOLDFAST_BIN:-../build/release/bin}/holdfast-server" ]; then
  npx vitest run --dir tests/browser --no-file-parallelism
else
  echo "web: no server in ${HOLDFAST_BIN:-../build/release/bin}: the tests in a browser were not run"
fi
