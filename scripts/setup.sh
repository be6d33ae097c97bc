#!/bin/sh
# Sets up a virtual environment with everything that the demo, the tests and the linters need.
# usage: setup.sh PYTHON VENV
set -eu
python=$1
venv=$2

# Packages of Debian that are missing: installed where that is allowed, else the line to run.
need=""
command -v "$python" >/dev/null 2>&1 || need="$need python3.11"
"$python" -c 'import ensurepip' >/dev/null 2>&1 || need="$need python3.11-venv"
libraries=$(PATH=$PATH:/sbin ldconfig -p 2>/dev/null || true)
for pair in libEGL.so.1:libegl1 libGL.so.1:libgl1 libusb-1.0.so.0:libusb-1.0-0 libgomp.so.1:libgomp1; do
    case $libraries in *"${pair%%:*}"*) ;; *) need="$need ${pair##*:}" ;; esac
done
if [ -n "$need" ]; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
        apt-get update -qq
        # shellcheck disable=SC2086
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $need
    else
        echo "system packages are missing; run: sudo apt-get install -y$need" >&2
        exit 1
    fi
fi

[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
"$venv/bin/python" -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
"$venv/bin/contactfusion" doctor --warm
