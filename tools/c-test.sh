#!/bin/sh
# Tries the C library as its users meet it: make c-test. Needs a C compiler; what else is there (a
# C++ compiler, sanitizers, valgrind, pkg-config, cmake) is used too, and named where it is missing.
# Usage: c-test.sh PREFIX     where include/zivi.h and lib/libzivi.a are, and those of zivi_f32
set -eu
prefix=$(cd "$1" && pwd)
here=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cc=${CC:-cc}
cxx=${CXX:-c++}
library=$prefix/lib/libzivi.a
strict='-Wall -Wextra -Wpedantic -Werror'
say() { printf 'c-test: %s\n' "$*"; }
fail() { printf 'c-test: FAILED: %s\n' "$*" >&2; exit 1; }

# the examples, in C99 and as C++, with no other library than that of C itself
run_examples() {
    for name in bounce regulate track observe; do
        # shellcheck disable=SC2086 # several words
        "$@" "$here/examples/c/$name.c" -I"$prefix/include" -o "$work/$name" -xnone "$library"
        "$work/$name" >"$work/$name.txt" || fail "$name: $(cat "$work/$name.txt")"
    done
    grep -q '^rest at 2.444 s, then x = 0, xdot = 0$' "$work/bounce.txt" || fail 'rest of the ball'
    grep -q 'x = 0, xdot = 0, u = -9.690000' "$work/track.txt" || fail 'rest of the tracker'
}
# shellcheck disable=SC2086
run_examples "$cc" -std=c99 $strict
say 'examples in C99: rest at 2.444 s, exactly'
if command -v "$cxx" >/dev/null 2>&1; then
    # shellcheck disable=SC2086
    run_examples "$cxx" $strict -xc++
    say 'examples as C++'
else
    say 'skipped: no C++ compiler'
fi

# layout, bad arguments, independence, the S-function
program() {
    name=$1
    shift
    # shellcheck disable=SC2086
    "$cc" -std=c99 $strict "$@" -I"$prefix/include" -I"$here/tests/c/simulink" \
        "$here/tests/c/$name.c" "$library" -lm -o "$work/$name"
}
for name in layout behaviour sfunction; do
    program $name -O1
    say "$("$work/$name")"
done
if program behaviour -g -fsanitize=address,undefined 2>/dev/null && "$work/behaviour" >/dev/null; then
    say 'sanitizers of addresses and of undefined behaviour: nothing'
else
    program behaviour -g
    "$work/behaviour" >/dev/null || fail 'behaviour'
    say 'skipped: no sanitizers'
fi
if command -v valgrind >/dev/null 2>&1; then
    program behaviour -g -O1
    valgrind --quiet --error-exitcode=9 "$work/behaviour" >/dev/null || fail valgrind
    say 'valgrind: nothing'
else
    say 'skipped: no valgrind'
fi

# the bits of many calls, the same on every machine, and how much stack a call takes
program bits_host -O2 "$here/tests/c/bits.c" -pthread
"$work/bits_host" >"$work/bits.txt" || fail 'the series of tests/c/bits.c'
cut -d' ' -f1,3- "$work/bits.txt" | cmp -s - "$here/tests/c/bits.txt" \
    || fail "other bits than those of tests/c/bits.txt: $(cat "$work/bits.txt")"
say 'the bits are those of tests/c/bits.txt'
if [ "$(uname -sm)" = 'Linux x86_64' ]; then
    awk '$2 > most { most = $2 }
        $2 > 1280 { print; bad = 1 }
        END { printf "c-test: stack of a call: at most %d bytes\n", most; exit bad }' \
        "$work/bits.txt" || fail 'the stack of a call'
fi

# the same in single precision
sed -f "$here/tools/c/single.sed" "$here/tests/c/bits.c" >"$work/bits_f32.c"
# shellcheck disable=SC2086
"$cc" -std=c99 $strict -O2 -I"$prefix/include" -I"$here/tests/c" "$here/tests/c/bits_host.c" \
    "$work/bits_f32.c" "$prefix/lib/libzivi_f32.a" -pthread -o "$work/bits_f32"
"$work/bits_f32" >"$work/bits_f32.txt" || fail 'the series of tests/c/bits.c in single precision'
cut -d' ' -f1,3- "$work/bits_f32.txt" | cmp -s - "$here/tests/c/bits_f32.txt" \
    || fail "other bits than those of tests/c/bits_f32.txt: $(cat "$work/bits_f32.txt")"
say 'in single precision the bits are those of tests/c/bits_f32.txt'

# how many instructions a tick takes, where a process may be stepped one instruction at a time
if [ "$(uname -sm)" = 'Linux x86_64' ]; then
    "$cc" -O2 -DDRAWS=40 "$here/benchmarks/tick_instructions.c" -I"$prefix/include" "$library" -lm \
        -o "$work/instructions"
    if "$work/instructions" >"$work/instructions.txt"; then
        awk -F'|' '/tracker/ { sum += $5; kinds++; most = $7 > most ? $7 : most }
            END {
                mean = sum / kinds
                printf "c-test: instructions of a tick of the tracker: mean %d, at most %d\n", mean, most
                exit !(kinds == 3 && mean <= 700 && most <= 5000)
            }' "$work/instructions.txt" || fail "instructions: $(cat "$work/instructions.txt")"
    else
        say 'skipped: the instructions of a tick: no process may be stepped here'
    fi
fi

if command -v pkg-config >/dev/null 2>&1; then
    # shellcheck disable=SC2046
    "$cc" "$here/examples/c/bounce.c" -o "$work/bounce" \
        $(PKG_CONFIG_PATH=$prefix/lib/pkgconfig pkg-config --cflags --libs zivi)
    "$work/bounce" >/dev/null
    say 'pkg-config'
else
    say 'skipped: no pkg-config'
fi
if command -v cmake >/dev/null 2>&1; then
    cmake -S "$here/examples/c" -B "$work/build" -DCMAKE_PREFIX_PATH="$prefix" >"$work/cmake.txt" \
        && cmake --build "$work/build" >>"$work/cmake.txt" || fail "$(cat "$work/cmake.txt")"
    "$work/build/track" >/dev/null
    say 'CMake'
else
    say 'skipped: no cmake'
fi

# one object: only names of ours, nothing from outside on x86-64, no memory of its own
nm "$library" >"$work/nm.txt"
if awk '$2 ~ /^[A-Z]$/ && $2 != "U" { print $3 }' "$work/nm.txt" | grep -vE '^_*zivi_' >&2; then
    fail 'global names that do not start with zivi_'
fi
case $(uname -sm) in
    'Linux x86_64')
        if grep ' U ' "$work/nm.txt" >&2; then fail 'needs something from outside'; fi
        size -A "$library" | awk '
            $1 ~ /^\.(data|bss|tdata|tbss)/ && $2 > 0 { print; bad = 1 }
            $1 ~ /^\.text/ { text += $2 }
            $1 ~ /^\.rodata/ { constants += $2 }
            END {
                printf "c-test: text %d bytes, constants %d, no .data, no .bss\n", text, constants
                exit bad
            }' || fail 'memory of its own'
        ;;
esac
say 'nothing undefined, nothing global but zivi_*'

# the code of a program that calls these functions and no others: name, limit, functions
part() {
    name=$1 limit=$2
    shift 2
    # shellcheck disable=SC2046 # several words
    ld -r --gc-sections $(printf -- '-u zivi_%s ' "$@") "$library" -o "$work/part.o"
    size -A "$work/part.o" | awk -v name="$name" -v limit="$limit" '
        $1 ~ /^\.text/ { text += $2 }
        END { printf "c-test: text of %s: %d bytes\n", name, text; exit text > limit }' \
        || fail "more than $limit bytes of code: $name"
}
calls() { for call in defaults init reset step; do printf '%s_%s ' "$1" $call; done; }
if [ "$(uname -sm)" = 'Linux x86_64' ] && command -v ld >/dev/null 2>&1; then
    part 'the ticks of regulator and tracker' 13900 regulator_step tracker_step tracker_step_to
    # shellcheck disable=SC2046
    part 'regulator and tracker, all calls' 17408 $(calls regulator) $(calls tracker) tracker_step_to
    # shellcheck disable=SC2046
    part 'the tracker' 15400 $(calls tracker) tracker_step_to
    # shellcheck disable=SC2046
    part 'the tracker, other periods too' 18200 $(calls tracker) tracker_step_to tracker_step_over \
        tracker_step_to_over
    # shellcheck disable=SC2046
    part 'the regulator' 3600 $(calls regulator)
    # shellcheck disable=SC2046
    part 'the observer' 10240 $(calls observer)
    # shellcheck disable=SC2046
    part 'the mass' 5600 $(calls mass)
fi
