#!/bin/sh
# Makes include/zivi.h, zivi_f32.h and zivi_host.h anew from the crates, with cbindgen 0.29.
# Usage: header.sh [FOLDER]     FOLDER: where the headers go, by default include
# Without cbindgen (cargo install cbindgen --version 0.29.4) it says so and ends with 77, skipped.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
out=${1:-$here/include}
cbindgen=${CBINDGEN:-cbindgen}
if ! command -v "$cbindgen" >/dev/null 2>&1; then
    echo 'header: skipped: no cbindgen here (cargo install cbindgen --version 0.29.4)' >&2
    exit 77
fi
"$cbindgen" --quiet --config "$here/crates/zivi-c/cbindgen.toml" "$here/crates/zivi-c" --output "$out/zivi.h"
sed -f "$here/tools/c/single.sed" "$out/zivi.h" >"$out/zivi_f32.h"
"$cbindgen" --quiet --config "$here/crates/zivi-host/cbindgen.toml" "$here/crates/zivi-host" --output "$out/zivi_host.h"
