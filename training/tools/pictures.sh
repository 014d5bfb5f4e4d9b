#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Prepares the free pictures that synthetic training clips are made of: objects with alpha and backgrounds, from Debian
# packages, with the licences they come under.
#
#   training/tools/pictures.sh DIRECTORY
#
# Packages that are installed are used as they are; others are downloaded and unpacked to a temporary folder (about
# 1.3 GB for all of them), which needs no root. Needs apt-get, dpkg and python3 with Pillow and numpy.
set -euo pipefail

objects_from="tuxpaint-stamps-default openclipart-png"
backgrounds_from="plasma-workspace-wallpapers mate-backgrounds stellarium-data supertuxkart-data"

if [ $# -ne 1 ]; then
  sed -n '3,9p' "$0" | sed 's/^# \{0,1\}//' >&2
  exit 2
fi
out=$1
here=$(cd "$(dirname "$0")" && pwd)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
mkdir -p "$out/licences"

# Prints the root folder of a package's files.
root_of() {
  local package=$1
  if dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed'; then
    echo /
    return
  fi
  mkdir -p "$scratch/$package"
  (cd "$scratch" && apt-get download -qq "$package" >&2 && dpkg-deb -x "$package"_*.deb "$package" && rm "$package"_*.deb)
  echo "$scratch/$package"
}

# The pictures of a package, one path a line.
pictures_of() {
  local package=$1 root=$2
  if [ "$root" = / ]; then dpkg -L "$package"; else find "$root" -type f; fi | grep -iE '\.(png|jpe?g)$' || true
}

prepare() {
  local kind=$1 package root
  for package in $2; do
    root=$(root_of "$package")
    pictures_of "$package" "$root" | "${PYTHON:-/usr/bin/python3}" "$here/prepare_pictures.py" "$kind" "$package" "$out"
    cp "${root%/}/usr/share/doc/$package/copyright" "$out/licences/$package.txt"
    [ "$root" = / ] || rm -rf "$root"
  done
}

rm -f "$out/LICENCES.txt"
prepare objects "$objects_from"
prepare backgrounds "$backgrounds_from"
echo "The licences of each package are in $out/licences; $out/LICENCES.txt says which picture came from where."
