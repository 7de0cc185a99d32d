#!/bin/sh
# Where rustup cannot fetch its wasm32 target: makes one from Debian's packages, installing nothing.
# Usage: toolchain.sh FOLDER     then: ZIVI_WASM_RUSTC=FOLDER/rustc build.sh
# Needs apt-get (bookworm with security updates) and dpkg; about 170 MB are fetched.
set -eu
mkdir -p "$1/packages"
root=$(cd "$1" && pwd)
command -v apt-get >/dev/null && command -v dpkg >/dev/null || {
    echo 'toolchain: skipped: this needs apt-get and dpkg' >&2
    exit 77
}
(
    cd "$root/packages"
    apt-get download -q rustc-web libstd-rust-web-1.96 libstd-rust-web-dev rust-web-src libllvm22 \
        lld-19 libllvm19 libz3-4
    for package in *.deb; do dpkg -x "$package" "$root"; done
)
ln -sf lld-19 "$root/usr/bin/wasm-ld" # lld acts by its name
cat >"$root/rustc" <<END
#!/bin/sh
# the target's code is linked by lld, that of build scripts by cc
export LD_LIBRARY_PATH="$root/usr/lib/x86_64-linux-gnu" RUSTC_BOOTSTRAP=1
case " \$* " in
    *" --target wasm32-unknown-unknown "*)
        exec "$root/usr/bin/rustc" "\$@" -C linker="$root/usr/bin/wasm-ld" -C linker-flavor=wasm-ld ;;
esac
exec "$root/usr/bin/rustc" "\$@"
END
chmod +x "$root/rustc"
library=$root/usr/lib/rustlib/src/rust/library
lib=$root/usr/lib/rustlib/wasm32-unknown-unknown/lib
mkdir -p "$lib"
crate() {
    name=$1
    source=$2
    shift 2
    "$root/rustc" --target wasm32-unknown-unknown --edition 2024 --crate-type rlib \
        --crate-name "$name" --cap-lints allow -Zforce-unstable-if-unmarked \
        -C opt-level=3 -C panic=abort -L "$lib" "$@" -o "$lib/lib$name.rlib" "$source"
}
crate core "$library/core/src/lib.rs"
crate compiler_builtins "$library/compiler-builtins/compiler-builtins/src/lib.rs" \
    --cfg 'feature="mem"' --cfg 'feature="compiler-builtins"' --extern core="$lib/libcore.rlib"
echo "ZIVI_WASM_RUSTC=$root/rustc"
