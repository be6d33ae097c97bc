#!/usr/bin/env bash
# Installs contactfusion, some of its extras and its laboratory into a virtual environment, and
# compiles its kernels.
# Started again with more extras, it adds what is missing.
# usage: setup.sh PYTHON VENV EXTRAS   (such as: setup.sh python3.11 .venv sim,record)
set -euo pipefail
python=$1
venv=$2
extras=$3

say() { echo "set-up: $*"; }
used() { du -sm "$venv" | cut -f 1; }
seconds() { echo $((SECONDS - start)); }

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
        say "installing packages of Debian:$need"
        start=$SECONDS
        apt-get update -qq
        # shellcheck disable=SC2086
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $need >/dev/null
        say "packages of Debian: $(seconds) s"
    else
        echo "system packages are missing; run: sudo apt-get install -y$need" >&2
        exit 1
    fi
fi

[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
had=$(used)

# Downloading stands apart from installing, so that the time of each is known.
wheels=$venv/wheels
say "downloading what contactfusion[$extras] needs; of that over 10 MB:"
start=$SECONDS
"$venv/bin/python" -m pip download --progress-bar off --constraint constraints.txt \
    --dest "$wheels" ".[$extras]" ./lab setuptools |
    sed -n -u -E 's/^ *(Downloading|Using cached) ([^ -]+)-[^ ]* \(([0-9]{2,}\.[0-9] MB)\)/    \2, \3/p'
say "downloaded $(du -sm "$wheels" | cut -f 1) MB in $(seconds) s"

say "installing $(ls "$wheels" | wc -l) packages ..."
start=$SECONDS
"$venv/bin/python" -m pip install --quiet --no-compile --no-index --find-links "$wheels" \
    --constraint constraints.txt --editable ".[$extras]" --editable ./lab
rm -rf "$wheels"
say "installed $(($(used) - had)) MB in $(seconds) s; $venv takes $(used) MB"

"$venv/bin/contactfusion" doctor --warm
