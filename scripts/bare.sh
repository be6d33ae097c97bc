#!/bin/sh
# Proves that `make demo` and `make test` do their whole set-up on a bare Debian 12 that has only
# python3.11 and make. Needs root and debootstrap. The root borrows the host's network set-up:
# name servers, certificates and the PIP_* variables.
# usage: bare.sh [FOLDER]   (default: a temporary folder, removed afterwards)
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
[ "$(id -u)" = 0 ] || { echo "make bare needs root: it makes a root file system" >&2; exit 1; }
command -v debootstrap >/dev/null || { echo "run: apt-get install -y debootstrap" >&2; exit 1; }
keep=no
[ $# = 0 ] || keep=yes
root=${1:-$(mktemp -d)}

leave() {
    # lazily: a process that is just ending may still hold a device
    umount --lazy "$root/proc" "$root/dev" 2>/dev/null || true
    [ "$keep" = yes ] || rm -rf --one-file-system "$root" "$root.log"
}
trap 'leave' EXIT

debootstrap --variant=minbase --include=ca-certificates,make,python3.11 bookworm "$root" >"$root.log" 2>&1 ||
    { tail -5 "$root.log" >&2; exit 1; }
cp /etc/resolv.conf "$root/etc/resolv.conf"
cp /etc/hosts "$root/etc/hosts"
cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/ca-certificates.crt"
mount -t proc proc "$root/proc"
mount --bind /dev "$root/dev"
mkdir "$root/project"
git -C "$here" archive HEAD | tar -x -C "$root/project"

run() {
    start=$(date +%s)
    chroot "$root" /usr/bin/env -i HOME=/root LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin \
        $(env | grep -E '^(PIP_(CERT|DEFAULT_TIMEOUT|INDEX_URL)|https?_proxy|no_proxy)=' || true) \
        sh -c "cd /project && $1"
    echo "bare: '$1' took $(($(date +%s) - start)) s"
}
run "make demo"
run "make test"
