#!/usr/bin/env bash
# Usage: track.sh SHARDS VIDEOS TRACKS [FLAG...]
# Tracks each SHARDS-th file of the directory VIDEOS, beginning with number $JOB_COMPLETION_INDEX, with `holdfast track` and
# these flags, into TRACKS/<file>.json. A file that has its tracks is skipped, so that a shard may be started again; tracks
# that are not complete keep another name. Ends with 1 when a video failed, after the others were tried, and with 143 on
# SIGTERM. The order is that of names: videos that are added meanwhile may be left to the next run.
set -euo pipefail
shards=$1 videos=$2 tracks=$3
shift 3
export LC_ALL=C.UTF-8  # the same order in every pod
mkdir -p "$tracks"

child=
trap '[ -z "$child" ] || kill -TERM "$child"; wait; exit 143' TERM
number=0 failed=0
for video in "$videos"/*; do
  [ -f "$video" ] || continue
  mine=$((number % shards == JOB_COMPLETION_INDEX))
  number=$((number + 1))
  out=$tracks/${video##*/}
  if [ $mine = 0 ] || [ -e "$out.json" ]; then continue; fi
  holdfast track "$video" "$@" --out="$out.part.json" &
  child=$!
  if wait "$child"; then
    mv "$out.part.json" "$out.json"
  else
    echo "track.sh: $video failed" >&2
    failed=$((failed + 1))
  fi
  child=
done
[ $failed = 0 ]
