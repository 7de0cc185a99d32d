#!/bin/sh
# Names what is missing of the few tools that a build needs, and how to get it.
# Usage: check-tools.sh PYTHON
set -u
missing=0
say() { printf 'zivi: %s\n' "$1" >&2; missing=1; }

if ! command -v "$1" >/dev/null 2>&1; then
    say "no Python found. Install Python >= 3.11 (Debian: apt-get install python3 python3-venv), or run make PYTHON=/path/to/python3"
elif ! "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    say "$1 is older than 3.11. Install Python >= 3.11, or run make PYTHON=/path/to/python3"
elif ! "$1" -c 'import venv, ensurepip' 2>/dev/null; then
    say "$1 cannot make virtual environments. Debian: apt-get install python3-venv"
fi
if ! command -v cargo >/dev/null 2>&1; then
    say "cargo is missing. Install Rust >= 1.88 with rustup (https://rustup.rs)"
else
    minor=$(cargo --version | sed 's/^cargo 1\.\([0-9]*\).*/\1/')
    case $minor in
        *[!0-9]* | '') ;;
        *) [ "$minor" -ge 88 ] || say "$(cargo --version) is too old: Rust >= 1.88 is needed (rustup update)" ;;
    esac
fi
command -v cc >/dev/null 2>&1 || say "a C compiler (cc) is missing: Rust links with it. Debian: apt-get install gcc libc6-dev"
exit $missing
