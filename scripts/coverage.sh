#!/bin/sh
# coverage.sh: on a bare Debian 12, installs what is missing, builds with gcov in build-cov/, runs all tests and
# says which lines of src/ none of them reached: a line a file, then the sums. All figures are in
# build-cov/coverage.txt. Ends with 1 if fewer than 90 % of the lines were reached.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
build=$root/build-cov
"$root/scripts/install_missing" gcc libc6-dev meson ninja-build pkg-config libdeflate-dev libisal-dev \
    libpng-dev libjansson-dev libcmocka-dev python3 python3-numpy gcovr
if [ ! -f "$build/build.ninja" ]; then
    meson setup "$build" "$root" -Dbuildtype=debug -Doptimization=1 -Db_coverage=true -Dtests=enabled \
        -Dbench=disabled
fi
ninja -C "$build"
find "$build" -name '*.gcda' -delete
# test_header and test_install compile against the library as it is installed, without gcov's runtime.
meson test -C "$build" --no-rebuild --no-suite layers || true
cd "$build"
gcovr -r .. --filter '../src/' . --fail-under-line 90 -s -o coverage.txt
result=$?
grep '^src/' coverage.txt | awk '$4 != "100%"'
exit $result
