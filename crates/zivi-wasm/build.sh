#!/bin/sh
# Builds the binary of the page without Python, docs/_static/browser/zivi.wasm, and what goes with
# it: its SHA-256 and binary.js, the same bytes for a page that is opened from a disk.
# Usage: build.sh [FOLDER]     FOLDER: where the results go, if not into the page
# Needs the target (rustup target add wasm32-unknown-unknown), or ZIVI_WASM_RUSTC, a rustc that has
# it (toolchain.sh makes one on Debian). Without either it says so and ends with 77, skipped.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
page=$here/../../docs/_static/browser
out=${1:-$page}
target=${CARGO_TARGET_DIR:-$here/../../target}/wasm
triple=wasm32-unknown-unknown

if [ -n "${ZIVI_WASM_RUSTC:-}" ]; then
    RUSTC=$ZIVI_WASM_RUSTC
    export RUSTC
else
    sysroot=$(rustc --print sysroot 2>/dev/null) || sysroot=
    if ! [ -d "$sysroot/lib/rustlib/$triple" ]; then
        echo "wasm: skipped: no $triple here. rustup target add $triple, or on Debian toolchain.sh" >&2
        exit 77
    fi
fi
cargo build --manifest-path "$here/Cargo.toml" --target-dir "$target" --locked --quiet --release \
    --target "$triple"
mkdir -p "$out"
install -m 644 "$target/$triple/release/zivi_wasm.wasm" "$out/zivi.wasm"
(cd "$out" && sha256sum zivi.wasm >zivi.wasm.sha256 && cat zivi.wasm.sha256)
{
    echo '// zivi.wasm in base64, written by crates/zivi-wasm/build.sh'
    printf 'const ZIVI_WASM = "%s";\n' "$(base64 -w0 <"$out/zivi.wasm")"
} >"$out/binary.js"
cmp -s "$out/zivi.wasm" "$page/zivi.wasm" || echo "wasm: not the binary of the page (another rustc?)"
