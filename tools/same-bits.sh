#!/bin/sh
# Builds crates/zivi/examples/flight_bits.rs for processors with and without AVX2 and fused
# operations, runs each, and once more with the mathematical library of the system as it is on a
# processor without them: all must print the same.
set -eu
cd "$(dirname "$0")/.."

case "$(uname -m)" in
    x86_64) cpus='x86-64 x86-64-v2 x86-64-v3' ;;
    *) cpus='generic native' ;;
esac
out=target/bits
mkdir -p "$out"
for cpu in $cpus; do
    # every bit is that of the formulas, however much is inlined
    CARGO_PROFILE_RELEASE_LTO=off CARGO_PROFILE_RELEASE_CODEGEN_UNITS=8 \
        RUSTFLAGS="-C target-cpu=$cpu" \
        cargo build --locked --quiet --release --package zivi --example flight_bits \
        --target-dir "$out/$cpu"
    "$out/$cpu/release/examples/flight_bits" > "$out/$cpu.txt"
    echo "$cpu: $(tr '\n' ' ' < "$out/$cpu.txt")"
    first=${first:-$cpu}
    cmp "$out/$first.txt" "$out/$cpu.txt"
done
GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4 \
    "$out/$first/release/examples/flight_bits" | cmp "$out/$first.txt" -
echo 'the same bits'
