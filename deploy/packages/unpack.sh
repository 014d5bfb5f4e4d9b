#!/usr/bin/env bash
# Usage: unpack.sh DIR
# Fetches the Debian packages of tools.txt, and those that they depend on, as far as they are not installed. Leaves
# their programs in DIR and their libraries in DIR/lib. Does nothing when DIR was made of the same list before.
set -euo pipefail
list=$(cd "$(dirname "$0")" && pwd)/tools.txt
dir=$1
! cmp -s "$list" "$dir/tools.txt" || exit 0
mapfile -t packages < <(grep -v '^#' "$list")

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
# The folders are there even where nothing comes into them, as all packages are installed.
mkdir -p "$scratch"/{debs,bin/lib} "$scratch/root/usr/"{bin,sbin,lib}
update=(apt-get -o DPkg::Lock::Timeout=300 update -qq)
# Nothing is installed, so that neither root's rights nor apt's locks are needed.
fetch=(apt-get install -qq --download-only --no-install-recommends -o Debug::NoLocking=1
       -o "Dir::Cache::archives=$scratch/debs" "${packages[@]}")
if [ "$(id -u)" = 0 ]; then
  chmod 755 "$scratch" && chown _apt "$scratch/debs"  # apt downloads as this user
else
  update=(sudo "${update[@]}")
fi
# apt's lists may be missing or old.
"${fetch[@]}" > "$scratch/apt.log" 2>&1 || { "${update[@]}" && "${fetch[@]}"; }
for package in "$scratch"/debs/*.deb; do
  [ -e "$package" ] || continue  # all of them are installed
  dpkg-deb --extract "$package" "$scratch/root"
done
find "$scratch/root/usr/bin" "$scratch/root/usr/sbin" -type f -executable -exec mv -t "$scratch/bin" {} \;
find "$scratch/root/usr/lib" -path '*-linux-gnu/*.so*' -exec mv -t "$scratch/bin/lib" {} \;
cp "$list" "$scratch/bin"
rm -rf "$dir"
mkdir -p "$(dirname "$dir")"
mv "$scratch/bin" "$dir"
