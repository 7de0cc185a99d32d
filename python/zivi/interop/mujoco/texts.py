"""Files and texts of models, read and compiled by MuJoCo."""

from __future__ import annotations

import math
import os
import re
import warnings
from typing import Any

import numpy as np

from zivi.base.extras import needed
from zivi.base.status import ModelWarning

# Checks of the size of a model before MuJoCo reads it, since that cannot be interrupted.

ELEMENTS = 100_000
"""Elements of a model, with all copies of those that are repeated."""
LARGEST = 50_000_000
"""Characters of all files of a model."""
LIMITS: dict[tuple[str, ...], int] = {
    ("nrow", "ncol"): 10_000_000,
    ("width", "height"): 100_000_000,
    ("gridsize",): 1_000_000,
    ("dim",): 1_000_000,
}
"""Attributes whose product is a size, and the largest."""
SIZE = 10_000
"""Largest number in an element ``size``, of data for each body, joint or the like."""
STACK = ("nstack", "njmax", "nconmax")
"""Numbers in an element ``size`` of which MuJoCo takes memory for a simulation only."""
STACK_SIZE = 100_000_000
"""The largest of these."""

TAG = re.compile(r"""<(/?)([A-Za-z_][\w.-]*+)((?:[^<>"']++|"[^"]*+"|'[^']*+')*+)>""")
ATTRIBUTE = re.compile(r"""([\w-]++)\s*+=\s*+(?:"([^"]*+)"|'([^']*+)')""")


def read_text(path: str) -> str:
    """Read a model file; raise a ValueError with the reason if that fails."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            return file.read(LARGEST + 1)
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path} must be a text in UTF-8, got the byte {error.object[error.start]:#04x}; save "
            "it in UTF-8"
        ) from None


def check_sizes(text: str, folder: str) -> None:
    """Raise a ValueError for a model, with the files that it includes, that is too large."""
    _charge(text, folder, 1, [LARGEST, ELEMENTS], ())


def _charge(text: str, folder: str, copies: int, left: list[int], files: tuple[str, ...]) -> None:
    """Subtract the size of a text, times its copies, from the allowed size."""
    left[0] -= len(text)
    if left[0] < 0:
        raise ValueError(f"a model must have at most {LARGEST // 10**6} MB of text")
    inside: list[int] = [copies]
    for end, tag, rest in TAG.findall(_without_comments(text)):
        if end:
            if tag == "replicate" and len(inside) > 1:
                inside.pop()
            continue
        given = {name: one or other for name, one, other in ATTRIBUTE.findall(rest)}
        times = math.prod(map(_whole, given.get("count", "").split()))
        left[1] -= inside[-1] * times
        if left[1] < 0:
            raise ValueError(
                f"a model must have at most {ELEMENTS} elements with all copies, got more at "
                f"<{tag}>; lower its count"
            )
        _check_sizes(tag, given)
        file = os.path.join(folder, given.get("file", ""))
        if tag in ("include", "model") and os.path.isfile(file):
            if file in files:
                raise ValueError(f"{file} must not include itself")
            _charge(read_text(file), folder, inside[-1], left, (*files, file))
        if tag == "replicate" and not rest.endswith("/"):
            inside.append(inside[-1] * times)


def _without_comments(text: str) -> str:
    parts, at = [], 0
    while (start := text.find("<!--", at)) >= 0:
        parts.append(text[at:start])
        end = text.find("-->", start + 4)
        at = len(text) if end < 0 else end + 3
    return "".join([*parts, text[at:]])


def _check_sizes(tag: str, given: dict[str, str]) -> None:
    limits = LIMITS
    if tag == "size":
        limits = {(name,): STACK_SIZE if name in STACK else SIZE for name in given}
    for names, limit in limits.items():
        sizes = [_whole(it) for name in names for it in given.get(name, "").split()]
        if sizes and math.prod(sizes) > limit:
            told = " x ".join(names)
            raise ValueError(f"<{tag}> must have {told} <= {limit}, got {math.prod(sizes)}")


def _whole(text: str) -> int:
    """Return a whole number > 0 that a text has; 1 for any other text, which MuJoCo refuses."""
    return max(1, int(text)) if text.isdecimal() and len(text) < 20 else 1


# Models as MuJoCo compiles them.


def compiled(given: Any, caller: str) -> Any:
    """Return a model of a file, a text, an MjSpec or an MjModel, with bodies as written."""
    mujoco = needed("mujoco", "models in MJCF and URDF")
    if isinstance(given, mujoco.MjModel):
        return given
    with _Warnings(caller):
        spec = _spec(given, caller)
        spec.compiler.fusestatic = False
        return spec.compile()


def compiled_urdf(given: Any, bound: float) -> Any:
    """Return a model of URDF in which masses and inertias are at least `bound`.

    Inertias that violate the triangle inequality become their mean, and visual geometry is left
    out: MuJoCo's ``balanceinertia``, ``boundmass``, ``boundinertia`` and ``discardvisual``.
    """
    mujoco = needed("mujoco", "models in MJCF and URDF")
    if isinstance(given, mujoco.MjModel):
        return given
    with _Warnings("from_urdf") as told:
        spec = _spec(given, "from_urdf")
        settings = spec.compiler
        settings.fusestatic = False
        settings.balanceinertia = settings.discardvisual = True
        settings.boundmass = max(settings.boundmass, bound)
        settings.boundinertia = max(settings.boundinertia, bound)
        model = spec.compile()
        told += [
            f"the inertia of link {body.name!r} violates the triangle inequality; its mean is taken"
            for body in spec.bodies
            if _is_balanced(body, np.sort(model.body(body.name).inertia), bound)
        ]
    return model


def _is_balanced(body: Any, inertia: Any, bound: float) -> bool:
    """Whether principal inertias, sorted, are not those that a body was given."""
    full = np.array(body.fullinertia)
    if not body.explicitinertial or np.isnan(full[0]):
        return False
    xx, yy, zz, xy, xz, yz = full
    given = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return bool(np.max(np.abs(inertia - given)) > 2 * bound + 1e-9 * np.max(np.abs(given)))


class _Warnings:
    """Keeps what MuJoCo warns of, and warns of it at the end.

    Without it MuJoCo leaves a file MUJOCO_LOG.TXT.
    """

    def __init__(self, caller: str) -> None:
        self.caller, self._before = caller, None
        self._said: list[str] = []

    def __enter__(self) -> list[str]:
        mujoco = needed("mujoco", "models in MJCF and URDF")
        self._before = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(lambda words: self._said.append(f"MuJoCo warns: {words}"))
        return self._said

    def __exit__(self, kind: Any, *_: object) -> None:
        needed("mujoco", "models in MJCF and URDF").set_mju_user_warning(self._before)
        for words in dict.fromkeys(self._said) if kind is None else ():
            warnings.warn(f"{self.caller}: {words.strip()}", ModelWarning, stacklevel=4)


def _spec(given: Any, caller: str) -> Any:
    """Read a specification that may be changed."""
    mujoco = needed("mujoco", "models in MJCF and URDF")
    text = os.fspath(given) if isinstance(given, str | os.PathLike) else None
    if text is None and isinstance(given, mujoco.MjSpec):
        return given.copy()
    if not isinstance(text, str):
        raise TypeError(
            f"path of {caller} must be a path, a text, a mujoco.MjSpec or a mujoco.MjModel, "
            f"got {given!r}"
        )
    is_text = text.lstrip().startswith("<")
    if not is_text and not os.path.exists(text):
        raise FileNotFoundError(f"{caller}: file {text!r} does not exist")
    check_sizes(text if is_text else read_text(text), "" if is_text else os.path.dirname(text))
    return (mujoco.MjSpec.from_string if is_text else mujoco.MjSpec.from_file)(text)
