#!/usr/bin/env bash
# Usage, where the programs lie: rootfs.sh [--alone] ROOT PROGRAM...
# Fills ROOT with what the programs need to run on a bare Debian of the same release: the programs in /usr/bin, the
# shared libraries they load, the weights unless the first program is the client, which has no use for them, the
# authorities that TLS clients trust, and for every Debian package these come from its copyright and its dpkg status
# (under status.d, where vulnerability scanners look). With --alone they need nothing else: the C library and its loader
# come too, the name of the release (os-release) and the user 'holdfast', but no shell and no other program. What the
# image is made of, libraries that are headers alone among it, is listed in /usr/share/holdfast/sbom.cdx.json
# (CycloneDX), and our own licence, with those of the server's page, is in /usr/share/doc/holdfast. Everybody may read
# all of it, however the checkout may be read.
set -euo pipefail
umask 022
alone=false
[ "$1" = --alone ] && { alone=true; shift; }
root=$1
shift
here=$(cd "$(dirname "$0")" && pwd)
source=$here/../..
mkdir -p "$root"/usr/bin "$root"/usr/lib/holdfast "$root"/usr/share/holdfast "$root"/var/lib/dpkg/status.d \
  "$root"/etc/ld.so.conf.d "$root"/etc/ssl/certs
install -s -m 755 -t "$root/usr/bin" "$@"
[ "$1" = holdfast ] || install -D -m 644 -t "$root/usr/share/holdfast/weights" "$source"/weights/*
install -D -m 644 "$source/LICENSE" "$root/usr/share/doc/holdfast/copyright"
[ "$1" != holdfast-server ] || install -m 644 "$source/web/dist/licenses.txt" "$root/usr/share/doc/holdfast/copyright.page"

mapfile -t libraries < <(ldd "$@" | awk '$2 == "=>" && $3 ~ /^\// {print $3}' | sort -u)
# Which package has which file, asked for all of them at once. Packages name files of /usr/lib as /lib, too.
declare -A package_of
while IFS=: read -r package path; do
  package_of[${path##*[: ]}]=$package
done < <(for library in "${libraries[@]}"; do
           real=$(readlink -f "$library")
           printf '%s\n%s\n' "$real" "${real#/usr}"
         done | xargs dpkg-query -S 2> /dev/null || true)

packages=(ca-certificates)
for library in "${libraries[@]}"; do
  real=$(readlink -f "$library")
  package=${package_of[$real]:-${package_of[${real#/usr}]:-}}
  [ -n "$package" ] || { echo "rootfs.sh: no package has $library" >&2; exit 1; }
  # The base image has these already, and a second libc beside the loader's would break it.
  $alone || [ "$package" != libc6 ] || continue
  cp -L "$library" "$root/usr/lib/holdfast/$(basename "$library")"
  packages+=("$package")
done
# These leave no file behind and are in the programs all the same; the client has no Boost.
headers=(nlohmann/json.hpp)
[ "$1" = holdfast ] || headers+=(boost/version.hpp)
for header in "${headers[@]}"; do
  package=$(dpkg-query -S "/usr/include/$header" | cut -d: -f1)
  packages+=("$package")
done

cp -L /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"

echo /usr/lib/holdfast > "$root/etc/ld.so.conf.d/holdfast.conf"
if $alone; then
  loader=$(ldd "$1" | awk '$1 ~ /^\// && !seen++ {print $1}')
  install -D -m 755 "$(readlink -f "$loader")" "$root$loader"
  install -D -m 644 -t "$root/usr/lib" /usr/lib/os-release
  ln -s ../usr/lib/os-release "$root/etc/os-release"
  echo 'include /etc/ld.so.conf.d/*.conf' > "$root/etc/ld.so.conf"
  ldconfig -r "$root" -X
  echo 'holdfast:x:10001:10001::/:/nonexistent' > "$root/etc/passwd"
  echo 'holdfast:x:10001:' > "$root/etc/group"
  mkdir -m 1777 "$root/tmp"
  mkdir "$root/dev" "$root/proc" "$root/sys"  # filled by whoever runs it
fi

for package in $(printf '%s\n' "${packages[@]}" | sort -u); do
  dpkg-query -s "$package" > "$root/var/lib/dpkg/status.d/$package"
  if [ -e "/usr/share/doc/$package/copyright" ]; then
    install -D -m 644 "$(readlink -f "/usr/share/doc/$package/copyright")" "$root/usr/share/doc/$package/copyright"
  fi
done
version=$("./$1" --version | awk '{print $2}')
release=$(. /usr/lib/os-release && echo "$ID-${VERSION_ID:-$VERSION_CODENAME}")
python3 "$here/sbom.py" "$1" "$version" "$release" "$root/var/lib/dpkg/status.d" \
  > "$root/usr/share/holdfast/sbom.cdx.json"
