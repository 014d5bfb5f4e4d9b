#!/usr/bin/env bash
# Usage: unpack.sh DIR
# Fetches the Debian packages of tools.txt and leaves their programs in DIR. The packages must hold programs that need
# nothing but libc, as those written in Go do. Does nothing when DIR was made of the same list before.
set -euo pipefail
list=$(cd "$(dirname "$0")" && pwd)/tools.txt
dir=$1
! cmp -s "$list" "$dir/tools.txt" || exit 0
mapfile -t packages < <(grep -v '^#' "$list")

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir "$scratch/debs" "$scratch/bin"
update=(apt-get -o DPkg::Lock::Timeout=300 update -qq)
if [ "$(id -u)" = 0 ]; then
  chmod 755 "$scratch" && chown _apt "$scratch/debs"  # apt downloads as this user
else
  update=(sudo "${update[@]}")
fi
cd "$scratch/debs"
# apt's lists may be missing or old.
apt-get download -qq "${packages[@]}" > ../apt.log 2>&1 || { "${update[@]}" && apt-get download -qq "${packages[@]}"; }
for package in *.deb; do
  dpkg-deb --fsys-tarfile "$package" | tar -x -C ../bin --strip-components=3 --wildcards './usr/bin/*'
done
cd - > /dev/null
cp "$list" "$scratch/bin"
rm -rf "$dir"
mkdir -p "$(dirname "$dir")"
mv "$scratch/bin" "$dir"
