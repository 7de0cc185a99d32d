"""Compilation of source to machine code, and exceptions raised in compiled functions."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import hashlib
import importlib
import os
import shlex
import shutil
import stat
import subprocess
import sys
import sysconfig
import tempfile
import threading
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

import zivi._zivi as _zivi
from zivi.base.extras import have
from zivi.base.status import Status

# Locks that a fork leaves open: the thread that held one may not exist in the child.


class ForkLock:
    """A lock of a module, a new one in each forked child.

    There is one for the whole life of a module: what it registers is never taken back.
    """

    def __init__(self) -> None:
        self._renew()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self._renew)

    def _renew(self) -> None:
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


# Source to machine code: a C compiler and a cache of libraries, or numba.

COMPILERS = ("auto", "c", "numba")
"""What can make machine code."""

SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, *4 * [ctypes.c_void_p])
"""``int model(double t, double *q, double *w, double *out, void *parameters)``."""

# no contraction: the same numbers on every processor
FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared", "-x", "c")


@dataclasses.dataclass(frozen=True, eq=False)
class Native:
    """A compiled model.

    Parameters
    ----------
    address : int
        Where it is.
    owner : object
        What keeps it there.
    """

    address: int
    owner: object

    @property
    def function(self) -> Any:
        """The model as a function of ctypes."""
        return SIGNATURE(self.address)


_build_lock = ForkLock()
_known: dict[tuple[str, str], Native] = {}


def compile_model(sources: dict[str, str], compiler: str = "auto") -> Native:
    """Compile a model, once in a process; with C, once on a machine.

    Parameters
    ----------
    sources : dict
        The same function in C (``"c"``) and in Python (``"numba"``).
    compiler : {"auto", "c", "numba"}
        With ``"auto"`` the C compiler, whose libraries are cached; numba if none is installed.

    Raises
    ------
    RuntimeError
        If there is neither, or the compiler fails.
    """
    chosen = _chosen(compiler)
    key = chosen, sources[chosen]
    with _build_lock:
        if key not in _known:
            _known[key] = (_by_c if chosen == "c" else _by_numba)(sources[chosen])
        return _known[key]


def _chosen(compiler: str) -> str:
    if compiler not in COMPILERS:
        raise ValueError(f"compiler must be one of {', '.join(COMPILERS)}, got {compiler!r}")
    there = {"c": c_compiler() is not None, "numba": compiler != "c" and have("numba")}
    for name in ("c", "numba") if compiler == "auto" else (compiler,):
        if there[name]:
            return name
    wanted = {"auto": "a C compiler or numba", "c": "a C compiler", "numba": "numba"}[compiler]
    raise RuntimeError(
        f"compiled systems need {wanted}, which is missing: install a C compiler that is found "
        "as cc or named by the environment variable CC, or pip install numba"
    )


def c_compiler() -> list[str] | None:
    """Find the C compiler: ``CC``, that of Python's build, ``cc``, ``gcc``, ``clang``."""
    for told in (os.environ.get("CC"), sysconfig.get_config_var("CC"), "cc", "gcc", "clang"):
        words = shlex.split(told or "")
        if words and shutil.which(words[0]):
            return words
    return None


def _by_c(source: str) -> Native:
    command = [*(c_compiler() or ["cc"]), *FLAGS]
    digest = hashlib.sha256("\0".join([source, sys.platform, *command]).encode()).hexdigest()
    name = f"model-{digest[:32]}{sysconfig.get_config_var('SHLIB_SUFFIX') or '.so'}"
    for folder in _folders():
        library = folder / name
        with contextlib.suppress(OSError):  # absent, or not as it was written
            return _loaded(library)
        with contextlib.suppress(OSError):  # a folder that cannot be written
            _compile(command, source, library)
            return _loaded(library)
    raise RuntimeError(
        "cannot write a compiled model to any cache folder; set ZIVI_CACHE to a writable folder"
    )


def shared_library(source: str) -> bytes:
    """Compile functions in C, as `compile_model` does, to a library, for programs without Python.

    Raises
    ------
    RuntimeError
        Without a C compiler, or if it fails.
    """
    if (compiler := c_compiler()) is None:
        raise RuntimeError("a C compiler is needed, found as cc or named by the variable CC")
    with tempfile.TemporaryDirectory(prefix="zivi-") as folder:
        library = Path(folder) / "library"
        _compile([*compiler, *FLAGS], source, library)
        return library.read_bytes()


def _loaded(library: Path) -> Native:
    """Load a library after a checksum test: loading a damaged one would crash the process."""
    if _content(_seal_of(library)) != _sealed(library.name, _content(library)):
        raise OSError(f"{library} does not match its checksum")
    owner = ctypes.CDLL(str(library))
    if not hasattr(owner, "model"):
        raise RuntimeError(f"{library} does not contain the function model")
    address = ctypes.cast(owner.model, ctypes.c_void_p).value
    assert address is not None
    return Native(address, owner)


def _seal_of(library: Path) -> Path:
    return library.with_name(f"{library.name}.sha256")


def _sealed(name: str, content: bytes) -> bytes:
    """Return the text of a library's checksum file: its digest and its name."""
    return hashlib.sha256(name.encode() + b"\0" + content).hexdigest().encode() + b"\n"


def _content(file: Path) -> bytes:
    """Read a file that nobody else can have written."""
    # neither follow a link nor wait for a pipe
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    with open(os.open(file, flags | getattr(os, "O_BINARY", 0)), "rb") as opened:
        found = os.fstat(opened.fileno())
        if not stat.S_ISREG(found.st_mode) or _open_to_others(found):
            raise OSError(f"{file} may belong to another user")
        return opened.read()


def _compile(command: list[str], source: str, library: Path) -> None:
    """Compile into a temporary file and rename it, so that others never see a partial file."""
    with tempfile.TemporaryDirectory(dir=library.parent) as folder:
        (code := Path(folder) / "model.c").write_text(source, encoding="ascii")
        made = Path(folder) / library.name
        done = subprocess.run(
            [*command, "-o", str(made), str(code), "-lm"],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise RuntimeError(f"the C compiler, {command[0]}, failed: {last}")
        made.chmod(0o700)
        (seal := Path(folder) / "seal").write_bytes(_sealed(library.name, made.read_bytes()))
        seal.chmod(0o600)
        os.replace(made, library)
        os.replace(seal, _seal_of(library))


def _folders() -> Iterator[Path]:
    """Folders for compiled models, of this user alone: the cache first, then a temporary one."""
    told, root = os.environ.get("ZIVI_CACHE"), os.environ.get("XDG_CACHE_HOME")
    with contextlib.suppress(RuntimeError, OSError):  # nobody's home, no room in it
        base = Path(told) if told else (Path(root) if root else Path.home() / ".cache") / "zivi"
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        if (why := _not_ours(base)) is None:
            yield base
        elif str(base) not in _refused:
            _refused.add(str(base))
            warnings.warn(
                f"compiled models are not kept in {base}: {why}, who could put code there that "
                "runs as yours; give ZIVI_CACHE a folder of your own",
                RuntimeWarning,
                stacklevel=2,
            )
    if not _own_folder:
        _own_folder.append(tempfile.TemporaryDirectory(prefix="zivi-", ignore_cleanup_errors=True))
    yield Path(_own_folder[0].name)


def _not_ours(folder: Path) -> str | None:
    """Return the reason why other users could write into a folder; None if they cannot."""
    found = os.stat(folder)
    if _is_foreign(found):
        return f"it belongs to another user (number {found.st_uid})"
    if _open_to_others(found):
        return f"others may write into it (mode {stat.S_IMODE(found.st_mode):o})"
    for parent in folder.resolve().parents:
        mode = os.stat(parent).st_mode
        # with the sticky bit (/tmp has it) other users cannot replace the folder
        if os.name == "posix" and mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            return f"others may write into {parent}"
    return None


def _is_foreign(found: os.stat_result) -> bool:
    return os.name == "posix" and found.st_uid not in (os.geteuid(), 0)


def _open_to_others(found: os.stat_result) -> bool:
    others = stat.S_IWGRP | stat.S_IWOTH
    return _is_foreign(found) or (os.name == "posix" and bool(found.st_mode & others))


_refused: set[str] = set()
_own_folder: list[tempfile.TemporaryDirectory[str]] = []


def _by_numba(source: str) -> Native:
    numba: Any = importlib.import_module("numba")
    names: dict[str, Any] = {}
    exec(compile(source, "<zivi model>", "exec"), names)
    doubles = numba.types.CPointer(numba.float64)
    signature = numba.int32(numba.float64, doubles, doubles, doubles, doubles)
    model = numba.cfunc(signature, error_model="numpy")(names["model"])
    return Native(model.address, model)


# Exceptions in compiled forces: C cannot propagate them, so a hook catches them.
#
# ctypes, numba and Cython report an exception raised in a function that C calls to
# `sys.unraisablehook` and return a meaningless number. During a run with such a force zivi installs
# its own hook: the evaluation counts as NaN, and the exception reaches the caller of the run.

CALLBACKS = ("ctypes callback", "cffi callback")
"""What the message of a report speaks of if it is one of these libraries'."""


class CallbackErrors:
    """Collects exceptions raised in the compiled forces of a run.

    Parameters
    ----------
    thread : int or None
        The thread that computes the run, None where several do.
    """

    def __init__(self, thread: int | None) -> None:
        self.thread = thread
        self.error: BaseException | None = None

    def __enter__(self) -> Self:
        _open(self)
        return self

    def __exit__(self, *_: object) -> None:
        _close(self)

    def ends(self, success: bool) -> BaseException | None:
        """Return the exception that ended a run; None if the method avoided it (at x < 0)."""
        return None if success and isinstance(self.error, Exception) else self.error


_hook_lock = ForkLock()
_ears: list[CallbackErrors] = []
_before: Any = None
"""The hook before ours, while there are ears."""


_DEAF = contextlib.nullcontext(CallbackErrors(None))
"""For runs without a compiled force: nothing can be heard in them."""


def listening(
    specs: Iterable[_zivi.Force | _zivi.ImpactLaw], *, threads: bool = False
) -> contextlib.AbstractContextManager[CallbackErrors]:
    """Listen to the compiled forces among some while they are run, in this thread or in several."""
    for spec in specs:
        if spec.is_compiled:
            return listening_always(threads=threads)
    return _DEAF


def listening_always(*, threads: bool = False) -> contextlib.AbstractContextManager[CallbackErrors]:
    """Listen whatever is run: a mechanical system may have compiled parts."""
    return CallbackErrors(None if threads else threading.get_ident())


ENDED = (int(Status.FORCE_NOT_FINITE), int(Status.STATE_NOT_FINITE), int(Status.IMPACT_NOT_SOLVED))
"""How runs end in which a function has no value."""


def tell(ear: CallbackErrors, status: NDArray[np.uint8]) -> None:
    """Warn of exceptions that ended runs of a batch; re-raise KeyboardInterrupt and the like."""
    ended = int(np.count_nonzero(np.isin(status, ENDED)))
    if not isinstance(error := ear.ends(not ended), Exception | None):
        raise error
    if error is not None:
        warnings.warn(
            f"a compiled force raised {error!r}; {ended} runs ended with FORCE_NOT_FINITE"
            if np.any(status == ENDED[0])
            else f"an impact law raised {error!r}; it ended {ended} runs",
            RuntimeWarning,
            stacklevel=3,
        )


def _open(ear: CallbackErrors) -> None:
    global _before
    with _hook_lock:
        if not _ears:
            _before, sys.unraisablehook = sys.unraisablehook, _hook
        _ears.append(ear)


def _close(ear: CallbackErrors) -> None:
    with _hook_lock:
        _ears.remove(ear)
        # whoever took the hook meanwhile keeps it
        if not _ears and sys.unraisablehook is _hook:
            sys.unraisablehook = _before


def _hook(report: Any) -> None:
    own = threading.get_ident()
    ears = [ear for ear in list(_ears) if ear.thread == own]
    ears = ears or [ear for ear in list(_ears) if ear.thread is None]
    if not (ears and _of_a_function(report)):
        (_before or sys.__unraisablehook__)(report)
        return
    _zivi.force_raised()
    for ear in ears:
        ear.error = report.exc_value or report.exc_type()


def _of_a_function(report: Any) -> bool:
    """Whether a function that C called raised, not a finaliser."""
    told = report.err_msg or ""
    return isinstance(report.object, str) or any(name in told for name in CALLBACKS)
