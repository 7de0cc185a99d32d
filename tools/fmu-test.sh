#!/bin/sh
# The binary of the FMUs with every call and every mistake of an importer (tests/c/fmu.c): as it is,
# under valgrind, and built with the sanitizer of addresses: make fmu-test. What is missing is named.
# Usage: fmu-test.sh PREFIX [quick]     where fmu/*.so is; quick: without the sanitizer
set -eu
prefix=$(cd "$1" && pwd)
here=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cc=${CC:-cc}
say() { printf 'fmu-test: %s\n' "$*"; }
fail() { printf 'fmu-test: FAILED: %s\n' "$*" >&2; exit 1; }

built=$(find "$prefix/fmu" -name "$(uname -m)-*.so" | head -n 1)
[ -n "$built" ] || { say 'skipped: no binary of this machine'; exit 77; }
compile() { "$cc" -std=c99 -Wall -Wextra -Werror -g -O1 "$here/tests/c/fmu.c" "$@" -ldl; }
compile -o "$work/fmu"
"$work/fmu" "$built" || fail 'the importer'
if command -v valgrind >/dev/null 2>&1; then
    valgrind --quiet --error-exitcode=9 --leak-check=full "$work/fmu" "$built" >/dev/null \
        || fail valgrind
    say 'valgrind: nothing'
else
    say 'skipped: no valgrind'
fi
[ "${2:-}" = quick ] && exit 0

# the same code with checks: rustc has the sanitizer, under the name of a nightly feature
triple=$(rustc -vV | sed -n 's/^host: //p')
target=${CARGO_TARGET_DIR:-$here/target}/sanitized
if (cd "$here" && RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=address cargo rustc --locked --quiet \
        --profile bare --package zivi-fmu --features target --crate-type cdylib \
        --target "$triple" --target-dir "$target") >"$work/rustc.txt" 2>&1 \
    && compile -fsanitize=address -o "$work/checked" 2>"$work/cc.txt"; then
    library=$target/$triple/bare/libzivi_fmu.so
    nm "$library" | grep -q __asan_report_load || fail 'the library is not checked'
    "$work/checked" "$library" >"$work/checked.txt" 2>&1 || fail "$(cat "$work/checked.txt")"
    say 'sanitizer of addresses: nothing'
else
    say "skipped: no sanitizer of addresses: $(cat "$work"/*.txt | tail -n 2)"
fi
