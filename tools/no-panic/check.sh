#!/bin/sh
# No tick can panic: the release build links although its panic handler calls a function that
# exists nowhere, and a build with one index that can be out of range (the canary) does not.
# Usage: check.sh [TARGET_DIR]     needs cargo and a C compiler, works offline
set -eu
here=$(cd "$(dirname "$0")" && pwd)
target=${1:-${CARGO_TARGET_DIR:-$here/../../target}/no-panic}
missing=zivi_panic_is_reachable
fail() { printf 'no-panic: %s\n' "$1" >&2; exit 1; }

# elsewhere the linker refuses undefined symbols by itself
case $(uname -s) in
    Linux) strict='-Clink-arg=-Wl,--no-undefined -Clink-arg=-lc'; library=libno_panic.so ;;
    Darwin) strict='-Clink-arg=-lSystem'; library=libno_panic.dylib ;;
    *) printf 'no-panic: not checked on %s\n' "$(uname -s)"; exit 0 ;;
esac
build() {
    # shellcheck disable=SC2086 # several words
    "${CARGO:-cargo}" rustc --manifest-path "$here/Cargo.toml" --target-dir "$target" \
        --locked --quiet --release "$@" -- $strict
}

mkdir -p "$target"
# libm is the only dependency from a registry, and mostly it is there already
if "${CARGO:-cargo}" fetch --manifest-path "$here/Cargo.toml" --locked --offline --quiet 2>/dev/null
then
    CARGO_NET_OFFLINE=true
    export CARGO_NET_OFFLINE
fi

if build --features canary >"$target/canary.log" 2>&1; then
    fail 'the canary links: this check would not see a panic'
fi
grep -q "$missing" "$target/canary.log" \
    || fail "the canary fails for another reason: $(cat "$target/canary.log")"
if ! build >"$target/link.log" 2>&1; then
    grep -q "$missing" "$target/link.log" && fail "a panic is reachable: $(cat "$target/link.log")"
    # seen once in many builds: the linker takes an object of core that needs the unwinder, which
    # names no panic; the same build then links
    build >"$target/link.log" 2>&1 || fail "the build fails: $(cat "$target/link.log")"
fi
printf 'no-panic: links without a panic, not with the canary\n'

command -v nm >/dev/null 2>&1 || exit 0
found=$(nm "$target/release/$library")
printf '%s\n' "$found" | grep -cE ' T _*zivi_(tracker_tick|tracker_tick_to|observer_tick)$' | grep -qx 3 || fail 'the ticks are not in the library'
if printf '%s\n' "$found" | grep -iE 'panic|alloc|unwind|unwrap|expect' >&2; then
    fail 'symbols of panics or of allocation'
fi
outside=$(printf '%s\n' "$found" | awk '$1 == "U" { sub(/@.*/, "", $2); print $2 }' \
    | grep -vxE '_*(memcpy|memmove|memset|memcmp|bcmp)|dyld_stub_binder' || true)
[ -z "$outside" ] || fail "needs from outside: $outside"
command -v size >/dev/null 2>&1 || exit 0
size -A "$target/release/$library" | awk '
    $1 ~ /^\.(text|rodata|data|bss)/ { printf "no-panic: %-8s %6d bytes\n", $1, $2 }
    $1 == ".text" && $2 > 36864 { large = 1 }
    END { exit large }' || fail 'more than 36 kB of code'
