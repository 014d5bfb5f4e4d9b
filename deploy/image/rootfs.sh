#!/usr/bin/env bash
# Usage: rootfs.sh ROOT PROGRAM...
# Fills ROOT with what the programs need to run on a bare Debian of the same release: the programs in /usr/bin, the
# shared libraries they load, and for every Debian package these come from its copyright and its dpkg status (under
# status.d, where vulnerability scanners look).
set -euo pipefail
root=$1
shift
mkdir -p "$root"/usr/bin "$root"/usr/lib/holdfast "$root"/var/lib/dpkg/status.d "$root"/etc/ld.so.conf.d
install -s -m 755 -t "$root/usr/bin" "$@"
echo /usr/lib/holdfast > "$root/etc/ld.so.conf.d/holdfast.conf"

libraries=$(ldd "$@" | awk '$2 == "=>" && $3 ~ /^\// {print $3}' | sort -u)
packages=()
for library in $libraries; do
  real=$(readlink -f "$library")
  owner=$(dpkg-query -S "$real" 2>/dev/null || dpkg-query -S "${real#/usr}")
  owner=${owner%%:*}
  # The base image has these already, and a second libc beside the loader's would break it.
  [ "$owner" = libc6 ] && continue
  cp -L "$library" "$root/usr/lib/holdfast/$(basename "$library")"
  packages+=("$owner")
done

for package in $(printf '%s\n' "${packages[@]}" | sort -u); do
  dpkg-query -s "$package" > "$root/var/lib/dpkg/status.d/$package"
  if [ -e "/usr/share/doc/$package/copyright" ]; then
    install -D -m 644 "$(readlink -f "/usr/share/doc/$package/copyright")" "$root/usr/share/doc/$package/copyright"
  fi
done
