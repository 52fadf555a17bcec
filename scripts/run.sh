#!/bin/sh
# run.sh [ARGUMENTS]: on a bare Debian 12, installs what is missing, builds a release in build/ and
# runs `spbm ARGUMENTS`. Without arguments: makes three levels of detail of a real scan (the bunny of
# Debian's glmark2-data) and a picture of them in build/demo/. Building is silent unless it fails, and
# speaks on stderr then: standard output is the program's alone.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
build=$root/build

"$root/scripts/install_missing" gcc libc6-dev meson ninja-build pkg-config \
    libdeflate-dev libisal-dev libpng-dev libjansson-dev
log=$(mktemp)
if ! {
    { [ -f "$build/build.ninja" ] ||
        meson setup "$build" "$root" -Dbuildtype=release -Dtests=disabled -Dbench=disabled; } &&
        ninja -C "$build"
} >"$log" 2>&1; then
    cat "$log" >&2
    rm -f "$log"
    exit 1
fi
rm -f "$log"
spbm=$build/tools/spbm

if [ $# -gt 0 ]; then
    exec "$spbm" "$@"
fi

"$root/scripts/install_missing" glmark2-data
scan=$(dpkg -L glmark2-data | grep '/bunny\.obj$')
demo=$build/demo
mkdir -p "$demo"
"$spbm" simplify "$scan" -o "$demo/bunny-%d.ply" --faces 20000,5000,1000
"$spbm" render "$scan" "$demo/bunny-0.ply" "$demo/bunny-1.ply" "$demo/bunny-2.ply" \
    --size 400x400 -o "$demo/bunny.png"
echo "
The scan, $scan, and its three levels:
  $demo/bunny-0.ply  20,000 faces
  $demo/bunny-1.ply   5,000 faces
  $demo/bunny-2.ply   1,000 faces
Side by side: $demo/bunny.png

Your own: scripts/run.sh simplify scan.ply -o small.ply --faces 10k"
