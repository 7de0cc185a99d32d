"""Build what goes into the package beside the extension: ``python tools/native.py [NAME ...]``.

Into ``python/zivi/_native``, from which it gets into wheels; laid out like ``/usr/local``:

- ``lib/libzivi.a`` (``zivi.lib`` on Windows), ``include/zivi.h``, the same in single precision
  as ``zivi_f32``, ``lib/pkgconfig`` and ``lib/cmake``: the C library for targets;
- ``fmu/x86_64-linux.so``, or what this machine is called in FMI: the binary of the FMUs;
  ``fmu_loops`` in the same way: that of closed loops of mechanical systems.

Asked for by name, ``host`` builds the shared library for programs in C and C++ into ``out/host``.

Needs cargo and a C compiler, nothing else. ``CARGO_TARGET_DIR`` says where cargo builds.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "python" / "zivi" / "_native"
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()


def main(names: list[str]) -> int:
    """Build the products with these names, by default those of the package."""
    unknown = sorted(set(names) - set(PRODUCTS))
    if unknown:
        print(f"native: no {', '.join(unknown)}; there are {', '.join(PRODUCTS)}", file=sys.stderr)
        return 2
    if shutil.which("cargo") is None:
        print("native: cargo is missing: install Rust >= 1.88 (https://rustup.rs)", file=sys.stderr)
        return 2
    whole_workspace()
    for name in names or PACKAGED:
        PRODUCTS[name]()
    return 0


def whole_workspace() -> None:
    """Put our crates back into the workspace: in a source distribution maturin leaves them out.

    The workspace there has the crates of the extension alone, although the others are in it too.
    """
    manifest = ROOT / "Cargo.toml"
    text = manifest.read_text()
    listed = tomllib.loads(text)["workspace"]["members"]
    missing = [name for name in CRATES if name not in listed]
    if missing:
        members = ", ".join(f'"{name}"' for name in [*listed, *missing])
        manifest.write_text(
            re.sub(r"(?ms)^members = \[.*?\]", f"members = [{members}]", text, count=1)
        )


CRATES = ("crates/zivi-c", "crates/zivi-fmu", "crates/zivi-host")
"""What is built here and is no part of the extension."""


def c_library() -> None:
    """Build the static libraries for C programs and put what finds them beside them."""
    windows = sys.platform == "win32"
    built = TARGET / "bare" / ("zivi_c.lib" if windows else "libzivi_c.a")
    for name, features in (("zivi", "target"), ("zivi_f32", "target,single")):
        build("zivi-c", "staticlib", features)
        library = place("lib", f"{name}.lib" if windows else f"lib{name}.a")
        if windows:
            shutil.copyfile(built, library)
        else:
            archive_of(own_member(built.read_bytes()), library)
        shutil.copyfile(ROOT / "include" / f"{name}.h", place("include", f"{name}.h"))
    for source, *parts in CONFIGS:
        text = (ROOT / "tools" / "c" / source).read_text()
        place("lib", *parts, source).write_text(text.replace("@VERSION@", version()))


def fmu() -> None:
    """Build the binary of the FMUs. It loads wherever there is a C library: it names none."""
    options = [] if sys.platform != "darwin" else ["--", "-Clink-arg=-lSystem"]
    build("zivi-fmu", "cdylib", "target", *options)
    place_unit("bare", "fmu")


def fmu_loops() -> None:
    """Build the binary of the FMUs of closed loops of mechanical systems."""
    if sys.platform == "win32":
        return  # it loads compiled systems as other systems do
    command = "cargo rustc --locked --quiet --release --package zivi-fmu --lib --features"
    # as the extension has it: what both are made of is compiled once
    features = "loops,avx512" if minor_version_of_cargo() >= 89 else "loops"
    options = ["--crate-type", "cdylib", "--target-dir", str(TARGET)]
    subprocess.run([*command.split(), features, *options], check=True, cwd=ROOT)
    place_unit("release", "fmu_loops")


def minor_version_of_cargo() -> int:
    """Give the second number of cargo's version, 0 where it does not tell."""
    told = subprocess.run(["cargo", "--version"], capture_output=True, text=True, check=False)
    found = re.match(r"cargo 1\.(\d+)", told.stdout)
    return int(found[1]) if found else 0


def place_unit(built_in: str, folder: str) -> None:
    """Put the binary of FMUs where the package has it, under the name of this machine."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(
        platform.machine().lower(), platform.machine().lower()
    )
    system, prefix, ending = {
        "darwin": ("darwin", "lib", ".dylib"),
        "win32": ("windows", "", ".dll"),
    }.get(sys.platform, ("linux", "lib", ".so"))
    built = TARGET / built_in / f"{prefix}zivi_fmu{ending}"
    copied(built, place(folder, f"{machine}-{system}{ending}"))


def host() -> None:
    """Build the shared library for programs on this machine, and put its headers beside it."""
    command = "cargo rustc --locked --quiet --release --package zivi-host --lib --crate-type cdylib"
    subprocess.run([*command.split(), "--target-dir", str(TARGET)], check=True, cwd=ROOT)
    prefix, ending = {"darwin": ("lib", ".dylib"), "win32": ("", ".dll")}.get(
        sys.platform, ("lib", ".so")
    )
    folder = ROOT / "out" / "host"
    for part in ("include", "lib"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    built = TARGET / "release" / f"{prefix}zivi_host{ending}"
    shutil.copyfile(built, folder / "lib" / f"{prefix}zivi{ending}")
    for name in ("zivi.h", "zivi_host.h", "zivi.hpp"):
        shutil.copyfile(ROOT / "include" / name, folder / "include" / name)
    print(folder)


CONFIGS = [
    ("zivi.pc", "pkgconfig"),
    ("zivi_f32.pc", "pkgconfig"),
    ("ziviConfig.cmake", "cmake", "zivi"),
    ("ziviConfigVersion.cmake", "cmake", "zivi"),
]


def place(*parts: str) -> Path:
    """Give the path of a product, in a folder that is there."""
    path = OUT.joinpath(*parts)
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def version() -> str:
    """Give the version of the workspace."""
    return str(tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]["version"])


def copied(source: Path, to: Path) -> None:
    """Copy a file in one go: who has the old one loaded keeps it."""
    with tempfile.TemporaryDirectory(dir=OUT) as folder:
        new = shutil.copyfile(source, Path(folder, "new"))
        os.replace(new, to)


def build(package: str, kind: str, features: str, *options: str) -> None:
    """Build one crate without the standard library."""
    command = ["cargo", "rustc", "--locked", "--quiet", "--profile", "bare", "--package", package]
    command += ["--features", features, "--crate-type", kind, "--target-dir", str(TARGET)]
    # the profile is that of Cargo.toml: without its link-time optimisation there are many objects
    given = {key: it for key, it in os.environ.items() if not key.startswith("CARGO_PROFILE_")}
    subprocess.run([*command, *options], check=True, cwd=ROOT, env=given)


def own_member(archive: bytes) -> bytes:
    """Take our object out of what rustc makes: 4 MB of the compiler's routines, none called."""
    place, names, ours = 8, b"", []  # after the magic number
    while place < len(archive):
        name, size = archive[place : place + 16].strip(), int(archive[place + 48 : place + 58])
        member = archive[place + 60 : place + 60 + size]
        if name == b"//":  # the long names of GNU
            names = member
        elif name.startswith(b"#1/"):  # those of BSD stand before the member
            name, member = member[: int(name[3:])], member[int(name[3:]) :]
        elif name[1:].isdigit():
            name = names[int(name[1:]) :].split(b"/\n", 1)[0]
        if name.startswith(b"zivi"):
            ours.append(member)
        place += 60 + size + size % 2
    (own,) = ours  # all in one: it is optimised as a whole
    return own


def archive_of(member: bytes, library: Path) -> None:
    """Write a static library of one object."""
    with tempfile.TemporaryDirectory(dir=OUT) as folder:
        Path(folder, "zivi.o").write_bytes(member)
        subprocess.run(["ar", "rcs", "new.a", "zivi.o"], check=True, cwd=folder)
        os.replace(Path(folder, "new.a"), library)


PRODUCTS: dict[str, Callable[[], None]] = {
    "c": c_library,
    "fmu": fmu,
    "fmu_loops": fmu_loops,
    "host": host,
}

PACKAGED = ("c", "fmu", "fmu_loops")
"""What is built when nothing is named."""

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
