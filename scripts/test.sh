#!/bin/sh
# test.sh: on a bare Debian 12, installs what is missing, builds with address and undefined-behaviour
# sanitizers in build-test/ and runs all tests. The last line is `N passed, N failed` (and
# `, N skipped`), counting test cases; the exit code is 0 only if none failed.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
build=$root/build-test
cd "$root"

scripts/install_missing gcc libc6-dev meson ninja-build pkg-config libdeflate-dev libisal-dev \
    libpng-dev libjansson-dev libcmocka-dev python3 python3-numpy
if [ ! -f "$build/build.ninja" ]; then
    meson setup "$build" "$root" -Dbuildtype=debugoptimized -Db_sanitize=address,undefined \
        -Dtests=enabled
fi
ninja -C "$build"

result=0
rm -f "$build/meson-logs/testlog.json"
meson test -C "$build" --no-rebuild --print-errorlogs || result=$?
python3 scripts/count_tests.py "$build/meson-logs/testlog.json" "$result"
