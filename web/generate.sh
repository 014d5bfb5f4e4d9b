#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes src/gen: the protocol's messages as TypeScript, by Debian's protoc.
set -eu
cd "$(dirname "$0")"
rm -rf src/gen
mkdir -p src/gen
protoc -I ../proto --plugin=protoc-gen-es=node_modules/.bin/protoc-gen-es --es_out=src/gen \
  --es_opt=target=ts,import_extension=none \
  holdfast/v1/point_tracking.proto google/rpc/status.proto google/rpc/error_details.proto
