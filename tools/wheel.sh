#!/bin/sh
# Builds the wheel for this kind of machine and tries it in a fresh environment with NumPy alone.
# On Linux it is linked by zig, so that it runs on systems older than this one.
# Usage: wheel.sh PYTHON_OF_THE_BUILD OUT
set -eu
python=$1
out=$2
rm -rf "$out" && mkdir -p "$out"
export CARGO_PROFILE_RELEASE_LTO=fat
"$python" tools/native.py
if [ "$(uname -s)" = Linux ]; then
    "$python" -m maturin build --release --zig --compatibility "${COMPATIBILITY:-manylinux_2_28}" --out "$out"
    "$python" -m auditwheel show "$out"/zivi-*.whl
else
    "$python" -m maturin build --release --out "$out"
fi
"$python" -m venv "$out/fresh"
"$out/fresh/bin/python" -m pip install --quiet --disable-pip-version-check \
    --constraint constraints.txt "$out"/zivi-*.whl
# away from the sources: what is imported is what was installed
here=$(pwd)
(cd "$out/fresh" && bin/python "$here/tools/smoke.py")
echo "$out: $(cd "$out" && ls zivi-*.whl)"
