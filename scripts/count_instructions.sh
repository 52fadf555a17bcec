#!/bin/sh
# count_instructions.sh [--update]: builds a release in build-count/ and compares the instructions of
# each stage with the last record (bench/instructions.py); installs what is missing.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
build=$root/build-count
cd "$root"

scripts/install_missing gcc libc6-dev binutils meson ninja-build pkg-config libdeflate-dev libisal-dev \
    libpng-dev libjansson-dev python3 valgrind
[ -f "$build/build.ninja" ] ||
    meson setup "$build" "$root" -Dbuildtype=release -Dtests=disabled -Dbench=enabled >/dev/null
ninja -C "$build" >/dev/null
python3 bench/instructions.py --build "$build" "$@"
