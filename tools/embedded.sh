#!/bin/sh
# The library on simulated microcontrollers, a Cortex-M4 (doubles in software) and a Cortex-M7 (in
# hardware), and in single precision on the Cortex-M4, which has that in hardware: the bits of
# tests/c/bits.txt (bits_f32.txt), the stack, the instructions and the code of a call.
# Usage: embedded.sh     make embedded
#
# Needs `rustup target add thumbv7em-none-eabihf`, arm-none-eabi-gcc and qemu-system-arm (Debian:
# gcc-arm-none-eabi, qemu-system-arm). Without one of them it says so and ends with 77, skipped.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
built=${CARGO_TARGET_DIR:-$here/target}/embedded
triple=thumbv7em-none-eabihf
gcc=${ARM_GCC:-arm-none-eabi-gcc}
tools=${gcc%gcc}
qemu=${QEMU_ARM:-qemu-system-arm}
say() { printf 'embedded: %s\n' "$*"; }
fail() { printf 'embedded: FAILED: %s\n' "$*" >&2; exit 1; }
skip() { printf 'embedded: skipped: %s\n' "$*"; exit 77; }

command -v "$gcc" >/dev/null 2>&1 || skip "no $gcc (apt-get install gcc-arm-none-eabi)"
command -v "$qemu" >/dev/null 2>&1 || skip "no $qemu (apt-get install qemu-system-arm)"
"$qemu" --version >/dev/null 2>&1 || skip "$qemu does not start"
library=$(rustc --print target-libdir --target $triple 2>/dev/null || true)
ls "$library"/libcore-*.rlib >/dev/null 2>&1 || skip "rustc cannot build for $triple (rustup target add $triple)"

calls() { for call in "$@"; do printf -- '-u %s%s ' "$prefix" "$call"; done; }
ours() { "${tools}size" -A "$1" | awk '$1 ~ /^\.text.*zivi/ { text += $2 } END { printf "%d", text }'; }
all() { "${tools}size" -A "$1" | awk '$1 ~ /^\.(text|rodata)/ { text += $2 } END { printf "%d", text }'; }

# name, machine of qemu, options of rustc, options of gcc, `single` for single precision
board() {
    name=$1 machine=$2 rust=$3 c=$4 single=${5:-}
    work=$built/$machine$single
    mkdir -p "$work"
    if [ "$single" ]; then
        prefix=zivi_f32_ features=target,single bits=bits_f32.txt
        sed -f "$here/tools/c/single.sed" "$here/tests/c/bits.c" >"$work/bits.c"
    else
        prefix=zivi_ features=target bits=bits.txt
        cp "$here/tests/c/bits.c" "$work/bits.c"
    fi
    (cd "$here" && RUSTFLAGS="$rust" cargo rustc --locked --quiet --profile bare --package zivi-c \
        --features $features --crate-type staticlib --target $triple --target-dir "$work") \
        >"$work/rustc.txt" 2>&1 || fail "$name: $(cat "$work/rustc.txt")"
    archive=$work/$triple/bare/libzivi_c.a
    # shellcheck disable=SC2086 # several words
    "$gcc" -std=c99 -Wall -Wextra -Werror -O2 -ffp-contract=off -ffreestanding -mthumb $c \
        -I"$here/include" -I"$here/tests/c" "$here/examples/cortex-m/start.c" \
        "$here/examples/cortex-m/bits.c" "$work/bits.c" "$archive" -nostdlib -lgcc -Wl,--gc-sections,-z,noexecstack \
        -T "$here/examples/cortex-m/mps2.ld" -o "$work/bits.elf"
    timeout 300 "$qemu" -machine "$machine" -icount shift=0 -display none -monitor none \
        -serial none -semihosting-config enable=on,target=native -kernel "$work/bits.elf" \
        >"$work/bits.txt" 2>&1 </dev/null || fail "$name: $(tail -n 3 "$work/bits.txt")"
    cut -d' ' -f1,5- "$work/bits.txt" | cmp -s - "$here/tests/c/$bits" \
        || fail "$name: other bits than those of tests/c/$bits: $(cat "$work/bits.txt")"
    say "$name: the bits of tests/c/$bits"
    awk '{ printf "embedded: %-36s stack %5d   instructions %6d, at most %6d\n",
        substr($0, index($0, $5)), $2, $3, $4 }' "$work/bits.txt"
    if [ "$single" ]; then # what small boards have left: 512 bytes and 3000 instructions of a call
        awk '$2 > 512 || (/tracker/ && $4 > 3000) { print; bad = 1 } END { exit bad }' \
            "$work/bits.txt" || fail "$name: a call takes more than 512 bytes or 3000 instructions"
    fi
    # shellcheck disable=SC2046
    "${tools}ld" -r --gc-sections $(calls tracker_step tracker_step_to regulator_step) \
        "$archive" -o "$work/ticks.o"
    # shellcheck disable=SC2046
    "${tools}ld" -r --gc-sections $(calls tracker_defaults tracker_init tracker_reset tracker_step \
        tracker_step_to regulator_defaults regulator_init regulator_reset regulator_step \
        observer_defaults observer_init observer_reset observer_step mass_defaults mass_init \
        mass_reset mass_step message) "$archive" -o "$work/library.o"
    say "$name: code of the ticks of regulator and tracker $(ours "$work/ticks.o") bytes," \
        "of all calls $(ours "$work/library.o") bytes; with constants and the routines of the" \
        "compiler $(all "$work/ticks.o") and $(all "$work/library.o")"
}

board 'Cortex-M4' mps2-an386 '-C target-cpu=cortex-m4' '-mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard'
board 'Cortex-M7' mps2-an500 '-C target-cpu=cortex-m7 -C target-feature=+fp64' \
    '-mcpu=cortex-m7 -mfpu=fpv5-d16 -mfloat-abi=hard'
board 'Cortex-M4, single precision' mps2-an386 '-C target-cpu=cortex-m4' \
    '-mcpu=cortex-m4 -mfpu=fpv4-sp-d16 -mfloat-abi=hard' single
