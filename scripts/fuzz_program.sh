#!/bin/sh
# fuzz_program.sh [SECONDS [COMMAND...]]: on a bare Debian 12, installs what is missing, builds the program with AFL++
# in build-afl/ (readers accept any checksum) and fuzzes each command (default: simplify topology patchify lod
# measure) for so many seconds (default 60) from small meshes, stores and chain files: the whole program as users run
# it, where scripts/fuzz.sh has a target for each part. A line a command: executions, edges, crashes and hangs; what
# crashed is in build-afl/found. The exit code is 0 only if nothing crashed or hung.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
build=$root/build-afl
seconds=${1:-60}
[ $# -gt 0 ] && shift

"$root/scripts/install_missing" afl++ clang llvm libc6-dev meson ninja-build pkg-config libdeflate-dev \
    libisal-dev libpng-dev libjansson-dev python3
if [ ! -f "$build/build.ninja" ]; then
    CC=afl-clang-fast meson setup "$build" "$root" -Dbuildtype=release -Dtests=disabled -Dbench=disabled \
        -Dc_args=-DSPBM_ACCEPT_ANY_CHECKSUM
fi
ninja -C "$build" tools/spbm
program=$build/tools/spbm

work=$(mktemp -d "${TMPDIR:-/dev/shm}/spbm-afl-XXXXXX")
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/mesh" "$work/store" "$work/chains" "$build/found"
# The smallest of mutate.py's meshes, and what the program makes of them.
python3 - "$root/tests/fuzz" "$work/mesh" <<'END'
import sys
sys.path.insert(0, sys.argv[1])
import mutate
small, sheet = mutate.sphere(2), mutate.grid(3)
for name, data in (("a.ply", mutate.ply(small, colours=True)), ("b.ply", mutate.ply(sheet, "ascii")),
                   ("c.obj", mutate.obj(sheet)), ("d.stl", mutate.stl_text(mutate.sphere(1))),
                   ("e.off", b"OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"),
                   ("f.ply", mutate.ply(small, "binary_big_endian"))):
    with open(sys.argv[2] + "/" + name, "wb") as file:
        file.write(data)
END
for mesh in "$work"/mesh/*; do
    name=$(basename "$mesh")
    "$program" import "$mesh" -o "$work/store/$name" -q
    "$program" patchify "$work/store/$name" -o "$work/chains/$name" --faces 12 -q
done

export AFL_NO_UI=1 AFL_SKIP_CPUFREQ=1 AFL_NO_AFFINITY=1 AFL_I_DONT_CARE_ABOUT_MISSING_CRASHES=1
export AFL_DISABLE_TRIM=1 AFL_AUTORESUME=1
result=0
# COMMAND SEEDS WORDS...: fuzzes one command and says how it went.
fuzz() {
    name=$1
    seeds=$2
    shift 2
    afl-fuzz -i "$work/$seeds" -o "$build/out-$name" -V "$seconds" -t 10000 -m none -- "$program" "$@" -q \
        >"$build/$name.log" 2>&1 || { tail -5 "$build/$name.log"; result=1; return; }
    stats=$build/out-$name/default/fuzzer_stats
    value() { sed -n "s/^$1 *: //p" "$stats"; }
    echo "$name: $(value execs_done) executions, $(value edges_found) of $(value total_edges) edges," \
        "$(value corpus_count) inputs kept, $(value saved_crashes) crashes, $(value saved_hangs) hangs"
    if [ "$(value saved_crashes)" != 0 ] || [ "$(value saved_hangs)" != 0 ]; then
        cp "$build/out-$name/default/crashes"/id* "$build/out-$name/default/hangs"/id* "$build/found/" 2>/dev/null || true
        result=1
    fi
}
for command in ${*:-simplify topology patchify lod measure}; do
    case $command in
    simplify) fuzz simplify mesh simplify @@ -o "$work/out.ply" --faces 12 -t 1 --tmp "$work" ;;
    topology) fuzz topology mesh topology @@ -o "$work/out.ply" --max-feature 20% --close-cracks 20% \
        --drop-components 5% --merge-coplanar -t 1 --tmp "$work" ;;
    patchify) fuzz patchify store patchify @@ -o "$work/out.chains" --faces 12 -t 1 ;;
    lod) fuzz lod chains lod @@ -o "$work/out.ply" --faces 12 -t 1 ;;
    measure) fuzz measure mesh measure "$work/mesh/a.ply" @@ -t 1 ;;
    *) echo "$0: there is no $command to fuzz" >&2 && exit 2 ;;
    esac
done
exit $result
