#!/bin/sh
# The source distribution as its users meet it: installed in a fresh environment without cargo, which
# gives one readable line, and with cargo, which gives a package that passes tools/smoke.py.
# Usage: sdist-test.sh PYTHON FOLDER     PYTHON: of an environment with maturin; make sdist-test
set -eu
python=$1
mkdir -p "$2"
folder=$(cd "$2" && pwd)
here=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
say() { printf 'sdist: %s\n' "$*"; }
fail() { printf 'sdist: FAILED: %s\n' "$*" >&2; exit 1; }

rm -f "$folder"/zivi-*.tar.gz
(cd "$here" && "$python" -m maturin sdist --out "$folder") >"$work/build.txt" 2>&1 \
    || fail "$(cat "$work/build.txt")"
built=$(ls "$folder"/zivi-*.tar.gz)
"$python" -m venv "$work/fresh"
install() {
    "$work/fresh/bin/python" -m pip install --disable-pip-version-check \
        --constraint "$here/constraints.txt" "$built" >"$work/pip.txt" 2>&1
}

# a PATH with what an installation needs beside cargo
mkdir "$work/bin"
for tool in sh cc ar ld; do ln -s "$(command -v $tool)" "$work/bin/$tool"; done
if PATH=$work/bin install; then fail 'it installs without cargo'; fi
grep -q '^ *zivi: cargo is missing' "$work/pip.txt" || fail "no word of cargo: $(cat "$work/pip.txt")"
if grep -q Traceback "$work/pip.txt"; then fail "a traceback: $(cat "$work/pip.txt")"; fi
say "without cargo: $(sed -n 's/^ *zivi: //p' "$work/pip.txt" | head -n 1)"

install || fail "$(cat "$work/pip.txt")"
(cd "$work" && "$work/fresh/bin/python" "$here/tools/smoke.py") || fail 'tools/smoke.py'
say "installed from $(basename "$built") with cargo, and tried"
