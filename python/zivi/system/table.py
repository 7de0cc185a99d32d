"""Tables of time: excitations, wall motions and inputs given at breakpoints."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

import zivi._zivi as _zivi
from zivi.base.check import Array, finite, real_array
from zivi.base.habits import hinted

# Columns of tables in files and in objects of pandas.


def of_pandas(series: Any) -> tuple[Any, Any]:
    """Read index and columns of a Series or a DataFrame."""
    if not (hasattr(series, "index") and hasattr(series, "to_numpy")):
        raise TypeError("values must be given, unless times is a pandas.Series or DataFrame")
    index = series.index
    if hasattr(index, "total_seconds"):
        return index.total_seconds().to_numpy(), series.to_numpy()
    if hasattr(index, "tz_localize"):
        raise TypeError(
            "times must be seconds, got dates: series.index - series.index[0] has the time since "
            "the first one"
        )
    return index.to_numpy(), series.to_numpy()


def is_number(text: str) -> bool:
    """Whether a text is one number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def mistake_in(path: str | PathLike[str], delimiter: str, error: ValueError) -> str:
    """Return what keeps a file from being read as a table: the first line that is none."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        lines = [(k, line.strip()) for k, line in enumerate(file, 1) if line.strip()]
    first = len(lines[0][1].split(delimiter)) if lines else 0
    for k, line in lines:
        entries = [it.strip() for it in line.split(delimiter)]
        wrong = next((it for it in entries if not is_number(it)), None)
        if (wrong is None or k == lines[0][0]) and len(entries) == first:
            continue
        others = [it for it in (";", "\t", ",", " ") if it != delimiter and it in line]
        if others and len(entries) == 1:
            remedy = f"; use delimiter={others[0]!r}"
        elif wrong and is_number(wrong.replace(",", ".")):
            remedy = "; write decimal points, not commas"
        else:
            remedy = ""
        got = f"{wrong[:40]!r}" if wrong else f"{len(entries)} columns instead of {first}"
        return f"must hold numbers parted by {delimiter!r}, got {got} in line {k}{remedy}"
    return f"must hold numbers parted by {delimiter!r}: {error}"


def column(name: str, given: Any, names: list[str], count: int) -> int:
    """Return the place of a column."""
    if isinstance(given, str):
        if given not in names:
            known = ", ".join(names) or "none: the file has no line of names"
            raise ValueError(f"{name} must be a column of the file, got {given!r}; it has {known}")
        return names.index(given)
    if not -count <= given < count:
        raise ValueError(f"{name} must be a column of the file, got {given}; it has {count}")
    return int(given) % count


# Tables of time: excitations, motions of walls and inputs that are known at knots.

Kind: TypeAlias = Literal["linear", "cubic", "hold", "monotone"]
Extend: TypeAlias = Literal["hold", "periodic", "error"]

KINDS = ("linear", "cubic", "hold", "monotone")
EXTENDS = ("hold", "periodic", "error")

SMOOTH = ("cubic", "monotone")
"""Kinds without jumps of the velocity."""

ROUNDING = 64 * np.finfo(float).eps
"""By how much a periodic table may miss its start, relative to its largest value."""


@hinted("Table")
class Table:
    r"""Interpolated values at given times: an excitation, the motion of a wall, or an input.

    Accepted by `LinearForce` and `LinearSystem` (``excitation=``), `ImpactSystem` (``wall=``),
    `LinearGap` (``motion=``) and `MechanicalSystem` (``inputs=``). Runs of `SwitchedRK` end steps
    at the times: they need not be given as ``tstops``.

    Parameters
    ----------
    times : array_like or pandas.Series or pandas.DataFrame
        Increasing times (s), shape (k,), k >= 2. Of pandas the index, in seconds or a
        `TimedeltaIndex`; its columns are the values then.
    values : array_like
        Values at the times, shape (k,), or (k, n) for n columns.
    kind : {"linear", "cubic", "hold", "monotone"}
        What is between them: lines; a cubic spline (not-a-knot, periodic if it repeats itself),
        which overshoots jumps of the data; each value from its time up to the next; cubic
        polynomials that do not overshoot (PCHIP).
    extend : {"hold", "periodic", "error"}
        Extension outside the given times: the first and the last value are held; the table is
        repeated; or a run outside them is an error.
    offset, scale : float
        The values are ``offset + scale*values``.

    Attributes
    ----------
    times, values : ndarray
        Times and values, the latter with offset and scale.
    kind, extend : str
        As given.

    Raises
    ------
    ValueError
        If the times do not increase, a number is not finite, a shape or a name is another one, or
        the first and last values of a periodic table differ by more than rounding (but for
        ``"hold"``, which does not come to the last one).
    TypeError
        If times or values hold no real numbers.

    See Also
    --------
    Pulse : rectangular pulses.
    Harmonic : harmonic loads.

    Notes
    -----
    Values between the times are piecewise polynomials of degree 1 or 3, evaluated without Python in
    :math:`O(\log k)` for k times. Steps of `SwitchedRK` end at the times, where derivatives jump.

    Examples
    --------
    >>> table = zivi.Table([0.0, 1.0, 3.0], [0.0, 2.0, 0.0])
    >>> table([0.5, 2.0, 9.0])
    array([1., 1., 0.])
    >>> steps = zivi.Table([0.0, 1.0], [5.0, -5.0], kind="hold")
    >>> steps([0.5, 1.0])
    array([ 5., -5.])
    """

    def __init__(
        self,
        times: Any,
        values: ArrayLike | None = None,
        kind: Kind = "linear",
        extend: Extend = "hold",
        *,
        offset: float = 0.0,
        scale: float = 1.0,
    ) -> None:
        if values is None:
            times, values = of_pandas(times)
        self.kind, self.extend = kind, extend
        for name, given, known in (("kind", kind, KINDS), ("extend", extend, EXTENDS)):
            if given not in known:
                names = ", ".join(repr(it) for it in known)
                raise ValueError(f"{name} must be one of {names}, got {given!r}")
        self.times = _times(times)
        data = real_array("values", values)
        if data.ndim not in (1, 2) or len(data) != len(self.times) or not data.size:
            k = len(self.times)
            raise ValueError(f"values must have shape ({k},) or ({k}, n), got {data.shape}")
        if not np.all(np.isfinite(data)):
            raise ValueError("values must be finite")
        self.values = finite("offset", offset) + finite("scale", scale) * data
        if not np.all(np.isfinite(self.values)):
            raise ValueError("offset and scale must leave the values finite")
        self._core = self._prepare()

    def _prepare(self) -> _zivi.TimeTable:
        columns = self.values.reshape(len(self.times), -1)
        periodic = self.extend == "periodic"
        if periodic and self.kind != "hold":
            size = np.max(np.abs(columns), axis=0)
            if np.any(np.abs(columns[0] - columns[-1]) > ROUNDING * size):
                raise ValueError(
                    "values of a periodic table must end as they begin, "
                    f"got {self.values[0].tolist()} and {self.values[-1].tolist()}"
                )
            columns[-1] = columns[0]
        try:
            with np.errstate(all="ignore"):
                powers = _powers(self.times, columns, self.kind, periodic)
            fits = bool(np.all(np.isfinite(powers)))
        except ValueError:  # of SciPy, for slopes that are not finite
            fits = False
        if not fits:
            raise ValueError(
                "values must have finite slopes between the times, got values up to "
                f"{np.max(np.abs(columns)):.3g} at times as close as "
                f"{np.min(np.diff(self.times)):.3g} s; use other units"
            )
        order, _, width = powers.shape
        flat = np.ascontiguousarray(powers.transpose(1, 2, 0)).ravel()
        ends = None if periodic else (columns[0].copy(), columns[-1].copy())
        return _zivi.TimeTable(self.times, flat, order=order, width=width, ends=ends)

    @classmethod
    def from_csv(
        cls,
        path: str | PathLike[str],
        *,
        time: str | int = 0,
        columns: str | int | list[str] | list[int] | None = None,
        delimiter: str = ",",
        **settings: Any,
    ) -> Table:
        r"""Read a table from a file of comma separated values, with or without a line of names.

        Parameters
        ----------
        path : str or path
            The file.
        time : str or int
            The column of times, by its name or its place.
        columns : str, int or list of them, optional
            The columns of values; one gives values of shape (k,). By default all other columns; a
            single column has shape (k,).
        delimiter : str
            What parts the columns.
        **settings
            As for `Table`: ``kind``, ``extend``, ``offset``, ``scale``.

        Raises
        ------
        ValueError
            If a column is not there or an entry is no number; it names the line and, where another
            one parts the columns, the delimiter.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "ground.csv"
        >>> _ = file.write_text("t,a\n0,0\n0.5,2\n1,0\n")
        >>> zivi.Table.from_csv(file)
        Table(3 times from 0 to 1 s, kind='linear', extend='hold')
        """
        with open(path, newline="", encoding="utf-8-sig") as file:
            first = [it.strip() for it in next(csv.reader(file, delimiter=delimiter), [])]
        header = not all(is_number(it) for it in first)
        names: list[str] = first if header else []
        try:
            data = np.loadtxt(
                path, delimiter=delimiter, skiprows=int(header), ndmin=2, encoding="utf-8-sig"
            )
        except ValueError as error:
            raise ValueError(f"{path} {mistake_in(path, delimiter, error)}") from None
        at = column("time", time, names, data.shape[1])
        if columns is None:
            rest = [k for k in range(data.shape[1]) if k != at]
            chosen: list[int] | int = rest[0] if len(rest) == 1 else rest
        elif isinstance(columns, list | tuple):
            chosen = [column("columns", it, names, data.shape[1]) for it in columns]
        else:
            chosen = column("columns", columns, names, data.shape[1])
        return cls(data[:, at], data[:, chosen], **settings)

    @property
    def width(self) -> int | None:
        """How many values there are at a time; None for scalar values."""
        return None if self.values.ndim == 1 else int(self.values.shape[1])

    def __call__(self, t: ArrayLike, derivative: int = 0) -> Array:
        """Evaluate the table.

        Parameters
        ----------
        t : array_like
            Times (s). At a jump the value after it is given.
        derivative : int
            0, 1 or 2 for the value, its first or its second derivative.

        Raises
        ------
        ValueError
            For a time outside the table with ``extend="error"``, or another derivative.
        """
        if derivative not in (0, 1, 2):
            raise ValueError(f"derivative must be 0, 1 or 2, got {derivative!r}")
        at = real_array("t", t)
        if at.size:
            self._check_span((float(at.min()), float(at.max())), "t")
        found: Array = self._core.values(at.ravel(), int(derivative))
        return found.reshape(at.shape + self.values.shape[1:])

    def _at(self, t: float) -> tuple[float, float, float]:
        """Position, velocity and acceleration of a wall."""
        w, wdot, wddot = self._core.motion(t)
        return w, wdot, wddot

    def _spec(self) -> _zivi.Wall:
        return _zivi.Wall.table(self._core)

    def _scalar(self, name: str) -> Table:
        """Return the table itself, of one value at a time; the error names the argument."""
        if self.width not in (None, 1):
            raise ValueError(f"{name} must be a zivi.Table of one value, got {self.width} columns")
        return self

    def _wall(self, name: str) -> Table:
        """Return the table itself if a wall can move so."""
        if self.kind not in SMOOTH:
            raise ValueError(
                f"{name} must be a zivi.Table of kind 'cubic' or 'monotone', got {self.kind!r}: "
                "the velocity of such a wall jumps, and its acceleration is undefined"
            )
        return self._scalar(name)

    def _check_span(self, span: tuple[float, float], name: str = "t_span") -> None:
        """Reject times outside the table."""
        first, last = float(self.times[0]), float(self.times[-1])
        if self.extend == "error" and not (first <= span[0] and span[1] <= last):
            raise ValueError(
                f"{name} must be within the times of the table, from {first:g} to {last:g} s, "
                f"with extend='error', got {span}"
            )

    def _check_motion(self, span: tuple[float, float]) -> None:
        """Reject a wall whose velocity jumps within a run."""
        self._check_span(span)
        if self.extend != "hold":
            return
        for end, reached in ((0, span[0] < self.times[0]), (-1, span[1] > self.times[-1])):
            near = self.times[0] if end == 0 else np.nextafter(self.times[-1], -np.inf)
            speed, rate = abs(self._at(float(near))[1]), np.ptp(self.values)
            if reached and speed > 1e-9 * rate / (self.times[-1] - self.times[0]):
                raise ValueError(
                    f"t_span must be within the times of a wall that moves at their end, "
                    f"{self.times[end]:g} s: with extend='hold' its velocity would jump there, "
                    f"got {span}"
                )

    def _breaks(self, span: tuple[float, float]) -> Array:
        """Return the times within a span at which the table is not smooth."""
        if self.extend != "periodic":
            return self.times[slice(*_within(self.times, span))]
        first, knots = self.times[0], self.times[:-1]
        period = self.times[-1] - first
        low, high = (math.floor((t - first) / period) for t in span)
        periods = np.arange(low - 1, high + 2, dtype=np.float64) * period
        all_of_them = np.unique(knots + periods[:, None])
        return cast("Array", all_of_them[slice(*_within(all_of_them, span))])

    def __repr__(self) -> str:
        width = "" if self.width is None else f" of {self.width} values"
        first, last = float(self.times[0]), float(self.times[-1])
        return (
            f"Table({len(self.times)} times{width} from {first:g} to {last:g} s, "
            f"kind={self.kind!r}, extend={self.extend!r})"
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Table):
            return NotImplemented
        same = (self.kind, self.extend) == (other.kind, other.extend)
        pairs = ((self.times, other.times), (self.values, other.values))
        return same and all(np.array_equal(a, b) for a, b in pairs)

    def __hash__(self) -> int:
        return hash((self.kind, self.extend, self.times.tobytes(), self.values.tobytes()))

    def __getstate__(self) -> dict[str, Any]:
        names = ("times", "values", "kind", "extend")
        return {name: getattr(self, name) for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        Table.__init__(self, **state)


class Pulse(Table):
    """Rectangular pulses: `height` from each time `t` for `width`, 0 otherwise.

    A `Table` that is held between its times: taken wherever a table of one value is. Steps of
    `SwitchedRK` end at the edges, so that no pulse is missed, however short.

    Parameters
    ----------
    t : float or array_like
        Start of the pulse or of each pulse (s), finite, with differences greater than `width`.
    width : float
        Duration (s), > 0.
    height : float
        Value during a pulse. Default 1.

    Raises
    ------
    ValueError
        If a number is out of range or pulses overlap.

    See Also
    --------
    Square : a periodic pulse.
    Table : other excitations of time.

    Notes
    -----
    Pulses are declared discontinuities: a step ends at each edge, so that none is missed however
    short it is. The cost is two more steps for each pulse.

    Examples
    --------
    >>> push = zivi.Pulse(60.0, 1.0, 3.0)
    >>> push([59.9, 60.0, 60.9, 61.0])
    array([0., 3., 3., 0.])
    >>> cart = zivi.ImpactSystem(zivi.LinearForce(excitation=push), e=0.5)
    >>> float(zivi.simulate(cart, (0, 100), (1, 0)).xdot[-1])
    3.0
    """

    def __init__(self, t: ArrayLike, width: float, height: float = 1.0) -> None:
        starts = np.unique(real_array("t", t))
        duration, value = finite("width", width), finite("height", height)
        if not duration > 0.0:
            raise ValueError(f"width must be > 0, got {width!r}")
        if not starts.size or not np.all(np.isfinite(starts)):
            raise ValueError(f"t must be one finite time or more, got {t!r}")
        if np.any(np.diff(starts) <= duration) or np.any(starts + duration <= starts):
            raise ValueError(f"t must have differences > width = {duration:g} s, got {t!r}")
        edges = np.stack([starts, starts + duration], axis=1).ravel()
        values = np.tile([value, 0.0], len(starts))
        times = np.concatenate([[starts[0] - duration], edges])
        super().__init__(times, np.concatenate([[0.0], values]), "hold")

    def __repr__(self) -> str:
        starts = self.times[1::2].tolist()
        width = float(self.times[2] - self.times[1])
        t = starts[0] if len(starts) == 1 else starts
        return f"Pulse({t}, width={width:.6g}, height={float(self.values[1]):.6g})"


class Square(Table):
    """A square wave: `height` for the part `duty` of each period, then 0.

    A periodic `Table` that is held between its times, as `Pulse`.

    Parameters
    ----------
    period : float
        Period (s), > 0.
    duty : float
        Part of the period with the value `height`, in (0, 1). Default 0.5.
    height : float
        Value during that part. Default 1.
    start : float
        Time at which one of the periods begins (s). Default 0.

    Raises
    ------
    ValueError
        If a number is out of range.

    See Also
    --------
    Pulse : single pulses.

    Notes
    -----
    As for `Pulse`, a step ends at each edge.

    Examples
    --------
    >>> zivi.Square(2.0, duty=0.25)([0.0, 0.4, 0.5, 1.9, 2.0])
    array([1., 1., 0., 0., 1.])
    """

    def __init__(
        self, period: float, duty: float = 0.5, height: float = 1.0, *, start: float = 0.0
    ) -> None:
        length, part = finite("period", period), finite("duty", duty)
        if not length > 0.0:
            raise ValueError(f"period must be > 0, got {period!r}")
        if not 0.0 < part < 1.0:
            raise ValueError(f"duty must be in (0, 1), got {duty!r}")
        first, value = finite("start", start), finite("height", height)
        times = first + np.array([0.0, part * length, length])
        super().__init__(times, [value, 0.0, value], "hold", "periodic")

    def __repr__(self) -> str:
        first, edge, last = self.times.tolist()
        numbers = f"{last - first:.6g}, duty={(edge - first) / (last - first):.6g}"
        return f"Square({numbers}, height={float(self.values[0]):.6g}, start={first:.6g})"


@dataclasses.dataclass(frozen=True)
class TableMotion:
    """The motion of a wall by a table, called as the other walls are."""

    table: Table

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Position (m), velocity (m/s) and acceleration (m/s^2) of the wall at `t` (s)."""
        at = real_array("t", t)
        rows = (self.table._core.values(at.ravel(), k).reshape(at.shape) for k in range(3))
        w, wdot, wddot = rows
        return w, wdot, wddot


def motion_of(wall: Any) -> Any:
    """Return the motion ``wall(t)`` of a wall of any kind."""
    return TableMotion(wall) if isinstance(wall, Table) else wall


def declared_breaks(
    span: tuple[float, float], inputs: Sequence[Any], walls: Sequence[Any]
) -> Array:
    """Return the knots within a span of those that are tables; an error if the span leaves one."""
    breaks: list[Array] = []
    for table in inputs:
        if isinstance(table, Table):
            table._check_span(span)
            breaks.append(table._breaks(span))
    for wall in walls:
        if isinstance(wall, Table):
            wall._check_motion(span)
            breaks.append(wall._breaks(span))
    if len(breaks) == 1:
        return breaks[0]
    return np.unique(np.concatenate(breaks)) if breaks else np.empty(0)


def _within(times: Array, span: tuple[float, float]) -> tuple[int, int]:
    """Return where increasing times enter and leave a span, whose ends are in it."""
    return int(times.searchsorted(span[0])), int(times.searchsorted(span[1], side="right"))


def refuse_tables(system: Any, what: str) -> None:
    """Reject a mass whose force or wall is a table, where its knots would not be steps."""
    for given in (getattr(system.force, "excitation", None), system.wall):
        if isinstance(given, Table):
            raise TypeError(
                f"{what} does not support zivi.Table, got {given!r}: use zivi.simulate, "
                "zivi.simulate_batch or zivi.sensitivity of an ImpactSystem"
            )


def _times(given: Any) -> Array:
    times = real_array("times", given)
    if times.ndim != 1 or len(times) < 2:
        raise ValueError(f"times must have shape (k,) with k >= 2, got {times.shape}")
    if not np.all(np.isfinite(times)):
        raise ValueError("times must be finite")
    if np.any(gaps := np.diff(times) <= 0):
        k = int(np.argmax(gaps))
        raise ValueError(f"times must increase, got {times[k]} before {times[k + 1]}")
    return times


def _powers(times: Array, values: Array, kind: str, periodic: bool) -> Array:
    """Return the coefficients of each interval, constant first, shape (order, k - 1, n)."""
    if kind == "hold":
        return values[None, :-1]
    if kind == "linear":
        return np.stack([values[:-1], np.diff(values, axis=0) / np.diff(times)[:, None]])
    from scipy import interpolate

    if kind == "cubic":
        ends = "periodic" if periodic else "not-a-knot"
        spline = interpolate.CubicSpline(times, values, axis=0, bc_type=ends)
        return cast("Array", spline.c[::-1])
    if not periodic:
        return cast("Array", interpolate.PchipInterpolator(times, values, axis=0).c[::-1])
    # its slopes are those of the table between two others
    period, k = times[-1] - times[0], len(times) - 1
    around = np.concatenate([times[:-1] - period, times[:-1], times + period])
    several = np.concatenate([values[:-1], values[:-1], values])
    found = interpolate.PchipInterpolator(around, several, axis=0).c[::-1, k : 2 * k]
    return cast("Array", found)
