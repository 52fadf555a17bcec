#!/bin/sh
# fuzz.sh [SECONDS [TARGET...]]: on a bare Debian 12, installs what is missing, builds with clang,
# libFuzzer, address and undefined-behaviour sanitizers in build-fuzz/ (readers accept any checksum), and
# fuzzes each target (default: all) for so many seconds (default 20) from seeds made in code; then 200
# damaged files through the whole program. Corpora stay in build-fuzz/corpus and grow from run to run,
# findings in build-fuzz/findings. A line a target: executions, coverage (edges), findings. The exit code
# is 0 only without findings. Two hours over all targets: scripts/fuzz.sh 720
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
build=${SPBM_FUZZ_BUILD:-$root/build-fuzz}
seconds=${1:-20}
[ $# -gt 0 ] && shift

"$root/scripts/install_missing" clang llvm libclang-rt-14-dev libc6-dev meson ninja-build pkg-config \
    libdeflate-dev libisal-dev libpng-dev libjansson-dev python3
if [ ! -f "$build/build.ninja" ]; then
    CC=clang meson setup "$build" "$root" -Dfuzz=true -Dbench=disabled -Dbuildtype=debugoptimized \
        -Db_sanitize=address,undefined -Db_lundef=false -Dwerror=true
fi
targets=${*:-number polygon gzip ply obj stl off import store chains shape resume}
programs=$([ $# -gt 0 ] || echo tools/spbm)
for target in $targets; do
    programs="$programs tests/fuzz/fuzz_$target tests/fuzz/replay_$target"
done
# shellcheck disable=SC2086
ninja -C "$build" $programs

export UBSAN_OPTIONS=halt_on_error=1:print_stacktrace=1
export ASAN_OPTIONS=detect_leaks=1:allocator_may_return_null=1
mkdir -p "$build/corpus" "$build/findings" "$build/log"
result=0
for target in $targets; do
    corpus=$build/corpus/$target
    log=$build/log/$target
    mkdir -p "$corpus"
    "$build/tests/fuzz/replay_$target" --seeds "$corpus" >/dev/null
    dictionary=
    case $target in ply | obj | stl | off | import) dictionary=-dict=$root/tests/fuzz/text.dict ;; esac
    # 10 s and 2 GB (the sanitizer's shadow counted) an input. Targets count memory themselves; leaks of
    # what is not counted show when the corpus is replayed.
    if "$build/tests/fuzz/fuzz_$target" "$corpus" $dictionary -max_total_time="$seconds" -timeout=10 \
        -detect_leaks=0 -rss_limit_mb=2048 -max_len=65536 -print_final_stats=1 -verbosity=1 \
        -artifact_prefix="$build/findings/$target-" >"$log" 2>&1 &&
        find "$corpus" -type f -exec "$build/tests/fuzz/replay_$target" {} + >>"$log" 2>&1; then
        found=none
    else
        found="one: $(grep -m1 -E 'does not hold|SUMMARY|ERROR' "$log" || tail -1 "$log")"
        result=1
    fi
    executions=$(sed -n 's/^stat::number_of_executed_units: //p' "$log")
    edges=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -1)
    echo "$target: ${executions:-?} executions, ${edges:-?} edges, $(find "$corpus" -type f | wc -l) inputs kept, findings: $found"
done
if [ $# -eq 0 ]; then
    python3 "$root/tests/fuzz/mutate.py" "$build/tools/spbm" --count 200 --seconds 30 --megabytes 0 \
        --keep "$build/findings" || result=1
fi
exit $result
