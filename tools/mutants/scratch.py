"""A copy of the tree in which the mutations are made, with a build folder of its own."""

import os
import shutil
import signal
import subprocess
import sys

# compiled again for every mutation: short builds before fast tests
QUICK = {
    "CARGO_INCREMENTAL": "1",
    "CARGO_PROFILE_TEST_OPT_LEVEL": "1",
    "CARGO_PROFILE_TEST_DEBUG": "0",
    "CARGO_PROFILE_RELEASE_OPT_LEVEL": "1",
    "CARGO_PROFILE_RELEASE_LTO": "off",
    "CARGO_PROFILE_RELEASE_CODEGEN_UNITS": "16",
}
LATE = -1  # the code of a command that took too long


class Scratch:
    """The files of `root` that are not ignored, copied into the folder `into`."""

    def __init__(self, root, into, timeout):
        self.tree, self.build = into.absolute() / "tree", into.absolute() / "build"
        self.target = ["--target-dir", str(self.build)]
        self.timeout = timeout
        self.copy(root)
        path = os.pathsep.join((str(self.tree / "python"), str(self.tree / "tests")))
        # not the byte code of the file before the mutation, which may have the same time stamp
        self.environment = (
            os.environ
            | QUICK
            | {
                "PYTHONPATH": path,
                "PYO3_PYTHON": sys.executable,
                "PYTHONDONTWRITEBYTECODE": "1",
            }
        )

    def copy(self, root):
        """Bring the copy up to date; a file that is the same keeps its time: builds stay short."""
        listed = subprocess.run(
            ["git", "ls-files", "-co", "--exclude-standard", "-z"],
            cwd=root,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        files = {name for name in listed.split("\0") if name and (root / name).is_file()}
        for name in sorted(files):
            source, target = root / name, self.tree / name
            if not target.is_file() or source.read_bytes() != target.read_bytes():
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)
        for path in self.tree.rglob("*.*"):
            name = path.relative_to(self.tree).as_posix()
            if path.is_file() and name not in files and path.suffix in (".rs", ".py"):
                path.unlink()

    def run(self, *command):
        """Run `command` in the copy: its exit code (`LATE` if it took too long) and its output."""
        with subprocess.Popen(
            command,
            cwd=self.tree,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        ) as process:
            try:
                output, _ = process.communicate(timeout=self.timeout)
                return process.returncode, output
            except BaseException as error:
                os.killpg(process.pid, signal.SIGKILL)
                if isinstance(error, subprocess.TimeoutExpired):
                    return LATE, ""
                raise

    def cargo(self, command, *options, tests=()):
        """Run a command of cargo in the copy; `tests` are the names of the tests to run."""
        names = ["--", *tests] if tests else []
        return self.run("cargo", command, "--locked", "--quiet", *options, *self.target, *names)

    def extension(self):
        """Compile the Python extension into the copy: the compiler's complaint, or None."""
        code, output = self.cargo("build", "--release", "-p", "zivi-py")
        if code != 0:
            return output
        (library,) = (
            path
            for path in (self.build / "release").iterdir()
            if path.name.startswith(("lib", "_zivi")) and path.suffix in (".so", ".dylib")
        )
        shutil.copyfile(library, self.tree / "python" / "zivi" / "_zivi.abi3.so")
        return None
