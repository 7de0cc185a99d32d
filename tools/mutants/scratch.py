"""A copy of the tree in which the mutations are made, with a build folder of its own."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

# one build for all mutations: short, before fast tests
QUICK = {
    "CARGO_INCREMENTAL": "1",
    "CARGO_PROFILE_TEST_OPT_LEVEL": "1",
    "CARGO_PROFILE_TEST_DEBUG": "0",
    "CARGO_PROFILE_RELEASE_OPT_LEVEL": "1",
    "CARGO_PROFILE_RELEASE_LTO": "off",
    "CARGO_PROFILE_RELEASE_CODEGEN_UNITS": "16",
    "PROPTEST_MAX_SHRINK_ITERS": "0",
    # code that a mutation makes needless is no error
    "RUSTFLAGS": "--cap-lints=warn",
}
LATE = -1  # the code of a command that took too long


class Scratch:
    """The files of `root` that are not ignored, copied into the folder `into`."""

    def __init__(self, root: Path, into: Path):
        self.root = root
        self.tree, self.build = into.absolute() / "tree", into.absolute() / "build"
        self.build.mkdir(parents=True, exist_ok=True)
        path = os.pathsep.join(
            (str(self.tree / "python"), str(self.tree / "tests"), os.environ.get("PYTHONPATH", ""))
        )
        self.environment = {
            **os.environ,
            **QUICK,
            "PYTHONPATH": path,
            "PYO3_PYTHON": sys.executable,
            "PYTHONDONTWRITEBYTECODE": "1",
        }

    def copy(self, *, but: set[str]) -> None:
        """Bring the copy up to date, `but` for the files that are written otherwise.

        A file that is the same keeps its time: builds stay short.
        """
        listed = subprocess.run(
            ["git", "ls-files", "-co", "--exclude-standard", "-z"],
            cwd=self.root,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        files = {name for name in listed.split("\0") if name and (self.root / name).is_file()}
        for name in sorted(files - but):
            source, target = self.root / name, self.tree / name
            if not target.is_file() or source.read_bytes() != target.read_bytes():
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)
        for path in self.tree.rglob("*.*"):
            name = path.relative_to(self.tree).as_posix()
            if path.is_file() and name not in files | but and path.suffix in (".rs", ".py"):
                path.unlink()

    def put(self, path: Path, text: str) -> None:
        """Write a file, unless it is the same."""
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")

    def run(
        self,
        *command: str,
        timeout: float | None = None,
        cwd: str = ".",
        environment: Mapping[str, str] | None = None,
    ) -> tuple[int, str]:
        """Run `command` in the copy: its exit code (`LATE` if it took too long) and its output."""
        with subprocess.Popen(
            command,
            cwd=self.tree / cwd,
            env={**self.environment, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        ) as process:
            try:
                output, _ = process.communicate(timeout=timeout)
                return process.returncode, output
            except BaseException as error:
                os.killpg(process.pid, signal.SIGKILL)
                if isinstance(error, subprocess.TimeoutExpired):
                    return LATE, ""
                raise

    def cargo(self, command: str, *options: str) -> tuple[int, str]:
        """Run a command of cargo in the copy."""
        target = ("--target-dir", str(self.build))
        return self.run("cargo", command, "--locked", "--quiet", *options, *target)

    def extension(self, *, built: bool) -> None:
        """Put the Python extension into the copy: compiled there, or as the tree has it `built`."""
        name = "python/zivi/_zivi.abi3.so"
        if built:
            shutil.copyfile(self.root / name, self.tree / name)
            return
        code, output = self.cargo("build", "--release", "-p", "zivi-py")
        if code != 0:
            raise RuntimeError(f"the extension does not compile:\n{output[-3000:]}")
        (library,) = (
            path
            for path in (self.build / "release").iterdir()
            if path.name.startswith(("lib", "_zivi")) and path.suffix in (".so", ".dylib")
        )
        shutil.copyfile(library, self.tree / name)
