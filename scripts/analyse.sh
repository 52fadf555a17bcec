#!/bin/sh
# analyse.sh [quick]: on a bare Debian 12, installs what is missing and runs every analyser; says a line for
# each and ends with 1 if one complains. What they say is in build-analyse/*.log.
#   quick: gcc without warnings, cppcheck (for CI; fuzz.sh, which is in CI too, has clang's)
#   all:   also clang-tidy, the program under valgrind, and the tests of threads
#          under the thread sanitizer
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
out=$root/build-analyse
mkdir -p "$out"
cd "$root"
scripts/install_missing gcc libc6-dev meson ninja-build pkg-config libdeflate-dev libisal-dev \
    libpng-dev libjansson-dev libcmocka-dev cppcheck
[ "${1:-}" = quick ] || scripts/install_missing clang clang-tidy valgrind libclang-rt-14-dev python3
result=0

# NAME COMMAND...: runs it, its words to a log; a line that says how it went.
judge() {
    name=$1
    shift
    if "$@" >"$out/$name.log" 2>&1; then
        echo "$name: clean"
    else
        echo "$name: see $out/$name.log"
        result=1
    fi
}

compile() {
    compiler=$1
    shift
    [ -f "$out/$compiler/build.ninja" ] ||
        CC=$compiler meson setup "$out/$compiler" "$root" -Dwerror=true -Dbuildtype=release \
            -Dtests=disabled -Dbench=disabled "$@"
    ninja -C "$out/$compiler"
}

check_c() {
    # Not so: the address of a report that nobody wants is taken, and memset follows; a loop that shortens
    # a line ends at four characters; a ring has a face.
    find src tools -name '*.c' | xargs cppcheck --quiet --error-exitcode=1 --std=c11 -Isrc \
        --enable=warning,portability,performance --inline-suppr --suppress=missingIncludeSystem \
        --suppress='uninitvar:src/api*.c' --suppress=pointerOutOfBoundsCond:src/inspect/render.c \
        --suppress=uninitvar:src/simplify/collapse_shape.c -D_GNU_SOURCE -D__GNUC__
}

tidy() {
    checks='-*,bugprone-*,clang-analyzer-*,cert-flp*,-bugprone-misplaced-widening-cast,-clang-analyzer-valist.Uninitialized,-clang-analyzer-security.insecureAPI.strcpy,-bugprone-easily-swappable-parameters,-bugprone-narrowing-conversions,-bugprone-implicit-widening-of-multiplication-result,-bugprone-assignment-in-if-condition,-bugprone-reserved-identifier,-clang-analyzer-security.insecureAPI.DeprecatedOrUnsafeBufferHandling,-bugprone-suspicious-include,-bugprone-not-null-terminated-result'
    # The analyser sees one file at a time; of what the others promise, analyser_model.h tells it. Bytes that
    # are copied end in no NUL, and are not to.
    find src tools -name '*.c' ! -path src/base/memory.c ! -path src/base/report.c |
        xargs clang-tidy -p "$out/clang" --quiet --warnings-as-errors='*' --checks="$checks" \
            --extra-arg=-include --extra-arg="$root/scripts/analyser_model.h" &&
        clang-tidy -p "$out/clang" --quiet --warnings-as-errors='*' --checks="$checks" src/base/memory.c src/base/report.c
}

under_valgrind() {
    folder=$(mktemp -d)
    spbm="valgrind --quiet --error-exitcode=99 --leak-check=full $out/gcc/tools/spbm"
    python3 -c "
import sys
sys.path.insert(0, 'tests/fuzz')
import mutate
for name, data in mutate.originals():
    open('$folder/' + name, 'wb').write(data)"
    for mesh in "$folder"/*; do
        for mode in collapse classic; do
            $spbm simplify "$mesh" -o "$folder/out.ply" --faces 50 --mode $mode --threads 2 || [ $? -eq 3 ]
        done
        $spbm check "$folder/out.ply"
        $spbm measure "$mesh" "$folder/out.ply" >/dev/null
    done
    rm -rf "$folder"
}

under_tsan() {
    [ -f "$out/tsan/build.ninja" ] ||
        CC=clang meson setup "$out/tsan" "$root" -Db_sanitize=thread -Db_lundef=false \
            -Dbuildtype=debugoptimized
    ninja -C "$out/tsan"
    TSAN_OPTIONS=halt_on_error=1 meson test -C "$out/tsan" --no-rebuild base_parallel base_sort chain_build \
        store lod_collapse_random attributes api
}

judge gcc compile gcc
judge cppcheck check_c
if [ "${1:-}" != quick ]; then
    judge clang compile clang
    judge clang-tidy tidy
    judge valgrind under_valgrind
    judge tsan under_tsan
fi
exit $result
