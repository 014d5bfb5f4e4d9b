#!/usr/bin/env bash
# Usage: demo.sh BIN_DIR OUT_DIR [SERVER_ADDRESS]
# Tracks people and background of a real video through a server and says where to look. Without SERVER_ADDRESS it
# starts a server of its own and stops it again.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$1 out=$2 address=${3:-}
mkdir -p "$out"

# The line of status that the port $1 answers with when it is asked for $2.
status_of() {
  exec 3<> "/dev/tcp/127.0.0.1/$1"
  printf 'GET %s HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n' "$2" >&3
  head -n 1 <&3
}

if [ -z "$address" ]; then
  ports=$(mktemp -u)
  "$bin/holdfast-server" --listen=127.0.0.1:0 --metrics_listen=127.0.0.1:0 --web_listen=127.0.0.1:0 \
    --port_file="$ports" 2> "$out/server.log" &
  server=$!
  trap 'kill -TERM $server 2>/dev/null; wait $server 2>/dev/null; rm -f "$ports"' EXIT
  until [ -s "$ports" ]; do
    kill -0 $server 2>/dev/null || { cat "$out/server.log" >&2; exit 1; }
    sleep 0.1
  done
  address=127.0.0.1:$(sed -n 's/^grpc=//p' "$ports") web=$(sed -n 's/^web=//p' "$ports")
fi

"$bin/holdfast" track media/pedestrians.mp4 --server="$address" --points=media/pedestrians_points.csv \
  --max_frames=120 --out="$out/tracks.json" --overlay="$out/overlay.mp4" --still="$out/still.png"

for path in ${web:+/ /v1/info}; do
  [[ $(status_of "$web" "$path") == "HTTP/1.1 200"* ]] || { echo "the page for browsers: no answer at $path" >&2; exit 1; }
done

echo
echo "Tracks:  $out/tracks.json"
echo "Video:   $out/overlay.mp4"
echo "Picture: $out/still.png"
echo "Live, in a browser: make web"
