"""Points of a study: grids, lists, samples; their seeds."""

from __future__ import annotations

import dataclasses
import hashlib
import keyword
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zivi.base.check import integer, real, unmasked
from zivi.base.habits import hinted

# Where a study is computed: points on a grid, in a list or drawn by a sampler.

RESERVED = ("point", "status", "message", "n_events", "events")
"""Names that a store needs for itself."""
MOST_POINTS = 10**9
"""Points of the largest study: their states alone fill a gigabyte."""
LONGEST_NAME = 200
"""Bytes of a name: file systems take 255."""
ENGINES = {"sobol": "Sobol", "halton": "Halton", "lhs": "LatinHypercube"}


@dataclasses.dataclass(frozen=True, eq=False)
class Design:
    """The points of a study, as `grid`, `points` and `sample` make them.

    Parameters
    ----------
    kind : str
        ``"grid"``, ``"list"`` or ``"sample"``.
    values : dict of ndarray
        For each parameter its values: along its own axis of a grid, else one per point.
    """

    kind: str
    values: dict[str, NDArray[Any]]

    def __len__(self) -> int:
        return math.prod(self.shape)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(self.values)

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each dimension of the study."""
        lengths = tuple(len(column) for column in self.values.values())
        return lengths if self.kind == "grid" else lengths[:1]

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return self.names if self.kind == "grid" else ("point",)

    def columns(self, indices: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """Return the parameters of some points, counted in the order of C."""
        if self.kind != "grid":
            return {name: column[indices] for name, column in self.values.items()}
        axes = np.unravel_index(indices, self.shape)
        pairs = zip(self.values.items(), axes, strict=True)
        return {name: column[axis] for (name, column), axis in pairs}

    def digest(self) -> str:
        """Return a digest of the values of all parameters."""
        found = hashlib.sha256()
        for name, column in self.values.items():
            found.update(f"{name} {column.dtype.str} {column.shape}\n".encode())
            found.update(np.ascontiguousarray(column).tobytes())
        return found.hexdigest()[:16]

    def __repr__(self) -> str:
        size = " x ".join(str(length) for length in self.shape)
        return f"<Design {self.kind} of {size} points: {', '.join(self.names)}>"


def grid(**axes: ArrayLike) -> Design:
    """Make a study of all combinations of some values.

    Parameters
    ----------
    **axes : array_like
        The values of each parameter: numbers or strings. The last one varies fastest.

    Returns
    -------
    Design
        What `sweep` takes; the results have one dimension per parameter.

    Raises
    ------
    ValueError, TypeError
        If a parameter has no values, or values that are neither numbers nor strings.

    See Also
    --------
    points : a list of points.
    sample : random or quasi-random points.
    sweep : evaluate a function at the points.

    Notes
    -----
    No point is stored: the values of a point are computed from its number.

    Examples
    --------
    >>> zivi.grid(e=np.linspace(0.1, 0.9, 9), h=[1e-3, 1e-2])
    <Design grid of 9 x 2 points: e, h>
    """
    return Design("grid", _parameter_columns(axes))


def points(**columns: ArrayLike) -> Design:
    """Make a study of listed points.

    Parameters
    ----------
    **columns : array_like
        For each parameter its value at every point: arrays of one length.

    Returns
    -------
    Design
        What `sweep` takes; the results have the dimension ``point``.

    Raises
    ------
    ValueError, TypeError
        If the lengths differ, or there is nothing.

    See Also
    --------
    grid : a full grid.
    sample : random or quasi-random points.
    sweep : evaluate a function at the points.

    Notes
    -----
    The arrays are stored; points are counted in their order.

    Examples
    --------
    >>> zivi.points(e=[0.2, 0.5], h=[1e-3, 1e-2])
    <Design list of 2 points: e, h>
    """
    return _list_design("list", columns)


@hinted("sample")
def sample(
    sampler: Any,
    n: int,
    bounds: Mapping[str, Sequence[float]],
    *,
    log: Sequence[str] = (),
    seed: int = 0,
) -> Design:
    """Draw the points of a study.

    Parameters
    ----------
    sampler : {"sobol", "lhs", "halton"} or scipy.stats.qmc.QMCEngine
        What draws: by name (scrambled, with `seed`), or an engine of as many dimensions as there
        are parameters, which then has a seed of its own and is advanced.
    n : int
        Number of points, >= 1; Sobol's are balanced for powers of 2.
    bounds : dict
        For each parameter its lower and upper bound.
    log : sequence of str
        Parameters that are drawn uniformly in their logarithm; their bounds must be > 0.
    seed : int
        Seed of a sampler that is given by name, >= 0.

    Returns
    -------
    Design
        What `sweep` takes; the results have the dimension ``point``.

    Raises
    ------
    ValueError, TypeError
        For an argument out of range.

    See Also
    --------
    grid : a full grid.
    points : a list of points.
    scipy.stats.qmc : the quasi-random generators.

    Notes
    -----
    Quasi-random points of ``sampler="sobol"`` cover the box evenly; powers of two keep their
    balance.

    References
    ----------
    M. D. McKay, R. J. Beckman and W. J. Conover, A comparison of three methods for selecting values
    of input variables in the analysis of output from a computer code, Technometrics 21, 1979.

    Examples
    --------
    >>> zivi.sample("sobol", 256, {"e": (0.1, 0.9), "h": (1e-4, 1e-2)}, log=["h"])
    <Design sample of 256 points: e, h>
    """
    if integer("n", n) < 1:
        raise ValueError(f"n must be >= 1, got {n}")
    if not isinstance(bounds, Mapping):
        raise TypeError(f"bounds must be a dict of pairs (low, high), got {bounds!r:.100}")
    if not isinstance(log, Iterable) or isinstance(log, str):
        raise TypeError(f"log must be a list of names, got {log!r:.100}")
    limits = {name: _bounds(name, pair, name in log) for name, pair in bounds.items()}
    unknown = set(log) - set(limits)
    if unknown:
        raise ValueError(
            f"log names parameters without bounds: {', '.join(sorted(map(str, unknown)))}"
        )
    if not limits:
        raise ValueError("bounds must have at least one parameter")
    unit = _engine(sampler, len(limits), seed).random(n)
    if unit.shape != (n, len(limits)):
        raise ValueError(
            f"the sampler draws {unit.shape[1]} numbers a point, "
            f"bounds has {len(limits)} parameters"
        )
    columns = {}
    for (name, (low, high)), draws in zip(limits.items(), unit.T, strict=True):
        scale = np.exp if name in log else np.asarray
        ends = (math.log(low), math.log(high)) if name in log else (low, high)
        columns[name] = np.clip(scale(ends[0] + draws * (ends[1] - ends[0])), low, high)
    return _list_design("sample", columns)


def design_of(given: Any) -> Design:
    """Understand what a user gave as the points of a study."""
    design = _design_of(given)
    if math.prod(design.shape) > MOST_POINTS:
        raise ValueError(
            f"a study can have at most {MOST_POINTS:.0e} points, got {math.prod(design.shape):.2e}"
        )
    return design


def _design_of(given: Any) -> Design:
    if isinstance(given, Design):
        return given
    if isinstance(given, Mapping):
        return Design("grid", _parameter_columns(given))
    if isinstance(given, Sequence) and given and all(isinstance(it, Mapping) for it in given):
        names = list(given[0])
        for number, one in enumerate(given):
            if set(one) != set(names):
                raise ValueError(
                    f"points[{number}] has the parameters {sorted(one)}, points[0] {sorted(names)}"
                )
        return _list_design("list", {name: [one[name] for one in given] for name in names})
    raise TypeError(
        "points must be a dict of values (a grid), a list of dicts, or a result of zivi.grid, "
        f"zivi.points or zivi.sample, got {type(given).__name__} {given!r:.100}"
    )


def _list_design(kind: str, columns: Mapping[str, ArrayLike]) -> Design:
    values = _parameter_columns(columns)
    lengths = {name: len(column) for name, column in values.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"listed parameters must have one length, got {lengths}")
    return Design(kind, values)


def _parameter_columns(given: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
    if not given:
        raise ValueError("a study needs at least one parameter")
    return {valid_name("parameter", name): _levels(name, values) for name, values in given.items()}


def valid_name(what: str, name: Any) -> str:
    """Return `name` if a parameter or a result can have it."""
    if not isinstance(name, str):
        raise TypeError(f"the name of a {what} must be a string, got {name!r}")
    if not name.isidentifier() or keyword.iskeyword(name):
        raise ValueError(f"the name of a {what} must be a Python name, got {name!r}")
    if len(name.encode()) > LONGEST_NAME:
        raise ValueError(
            f"the name of a {what} must have at most {LONGEST_NAME} bytes, as names of folders, "
            f"got {len(name.encode())}: {name[:20]}..."
        )
    if name in RESERVED:
        raise ValueError(f"a {what} cannot be named {name!r}: the store uses {', '.join(RESERVED)}")
    return name


def _levels(name: str, values: ArrayLike) -> NDArray[Any]:
    unmasked(name, values)
    try:
        column = np.asarray(values)
    except ValueError as error:  # ragged
        raise TypeError(f"{name} must hold numbers or strings: {error}") from None
    if column.ndim != 1 or not len(column):
        raise ValueError(f"{name} must be a sequence of values, got shape {column.shape}")
    mixed = column.dtype.kind == "U" and not all(
        isinstance(it, str) for it in np.asarray(values, object)
    )
    if mixed or column.dtype.kind not in "biufU":
        raise TypeError(f"{name} must hold numbers or strings only, got {values!r:.100}")
    kinds = {"b": np.bool_, "i": np.int64, "u": np.int64, "f": np.float64}
    if column.dtype.kind == "u" and column.max() > np.iinfo(np.int64).max:
        raise ValueError(f"{name} must fit into 64 bits with a sign, got {column.max()}")
    if column.dtype.kind == "U":
        # the narrowest dtype, which is also the one that a store returns
        return np.array(column.tolist())
    return column.astype(kinds[column.dtype.kind])


def _bounds(name: str, pair: Sequence[float], logarithmic: bool) -> tuple[float, float]:
    try:
        low, high = (real(f"bounds[{name!r}]", end) for end in pair)
    except (TypeError, ValueError):
        raise TypeError(f"bounds[{name!r}] must be two numbers (low, high), got {pair!r}") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise ValueError(f"bounds[{name!r}] must be finite with low < high, got {pair!r}")
    if logarithmic and not low > 0.0:
        raise ValueError(f"bounds[{name!r}] must be > 0 for a logarithm, got {pair!r}")
    return low, high


def _engine(sampler: Any, dimensions: int, seed: int) -> Any:
    if not isinstance(sampler, str):
        if callable(getattr(sampler, "random", None)):
            return sampler
        raise TypeError(
            f"sampler must be one of {', '.join(ENGINES)} or a scipy.stats.qmc engine, "
            f"got {sampler!r}"
        )
    if sampler not in ENGINES:
        raise ValueError(f"sampler must be one of {', '.join(ENGINES)}, got {sampler!r}")
    if integer("seed", seed) < 0:
        raise ValueError(f"seed must be >= 0, got {seed}")
    from zivi.base.extras import needed

    qmc = needed("scipy.stats.qmc", "sampled designs")
    return getattr(qmc, ENGINES[sampler])(dimensions, seed=seed)


# The seeds of the points of a study: children of its ``numpy.random.SeedSequence``.

# of numpy/random/bit_generator.pyx, whose results NumPy promises not to change (NEP 19)
INIT_A, MULT_A = 0x43B0D7E5, 0x931E8875
INIT_B, MULT_B = 0x8B51F9DD, 0x58F38DED
MIX_L, MIX_R = 0xCA01F9DD, 0x4973F715
WORDS = 4
"""Words of the pool of a sequence."""


def child(seed: int | None, point: int) -> np.random.SeedSequence:
    """Return ``SeedSequence(seed).spawn(n)[point]`` without spawning all."""
    return np.random.SeedSequence(seed, spawn_key=(point,))


def generators(seed: int | None, points: NDArray[np.int64]) -> list[np.random.Generator]:
    """Make the generators of some points."""
    return [np.random.default_rng(child(seed, point)) for point in points.tolist()]


def seeds(seed: int | None, points: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Return ``child(seed, point).generate_state(1, np.uint64)[0]`` for all points, < 2**32.

    A child mixes the number of its point, one more word of entropy, into the pool of its parent.
    """
    pool = np.asarray(np.random.SeedSequence(seed).pool, np.uint32)
    # the hash constants consumed by the parent's words: one for each, and for each pair
    factor = _product(INIT_A, MULT_A, WORDS * WORDS)
    state = []
    for word in pool[:2]:
        hashed, factor = _hashed(points.astype(np.uint32), factor, MULT_A)
        mixed = np.uint32(MIX_L) * np.full(1, word, np.uint32) - np.uint32(MIX_R) * hashed
        state.append(mixed ^ (mixed >> np.uint32(16)))
    low, factor = _hashed(state[0], INIT_B, MULT_B)
    high, _ = _hashed(state[1], factor, MULT_B)
    return low.astype(np.uint64) | (high.astype(np.uint64) << np.uint64(32))


def _hashed(
    words: NDArray[np.uint32], factor: int, multiplier: int
) -> tuple[NDArray[np.uint32], int]:
    after = _product(factor, multiplier, 1)
    words = (words ^ np.uint32(factor)) * np.uint32(after)
    return words ^ (words >> np.uint32(16)), after


def _product(start: int, multiplier: int, times: int) -> int:
    return start * pow(multiplier, times, 2**32) % 2**32
