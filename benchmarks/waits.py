"""What users wait for, beside what they would use instead: `python benchmarks/waits.py`.

With `--mechanisms` the rows of mechanical systems alone, with `--problems` those of complementarity
problems and balls, without a page of results.

Every row is a ratio of two times of the processor that were measured in turns in one run; below 1
zivi is the faster one. SciPy's `solve_ivp` restarts at events and gets stuck at a Zeno point: it is
compared where there is none. Rows of MuJoCo, Siconos, numba and a C compiler need these. Ratios
hold for the build of the wheels (thin LTO, one unit of code): others take up to four times as long
for complementarity problems.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.integrate
import scipy.optimize

import bench_mechanics
import flights_loop
import zivi
from mechanics_problems import PROBLEMS
from siconos_peer import TIMEOUT, interpreter

PAGE = Path(__file__).with_name("results") / "waits.md"
ROUNDS = 15
HEAD = """# What users wait for

Written by `make bench` (alone: `python benchmarks/waits.py`); do not edit. Ratios of times of the
processor, measured in turns in one run, the median of the rounds; below 1 zivi is faster. They
hold for one processor and the build of the wheels: on another the ratio to vectorised C or to NumPy
may be twice as large.

| what | zivi | beside | zivi (ms) | beside (ms) | ratio |
| --- | --- | --- | ---: | ---: | ---: |
"""


class Row(NamedTuple):
    """A pair of functions that do the same; `beside` may give its own seconds."""

    what: str
    ours: str
    theirs: str
    run: Callable[[], Any]
    beside: Callable[[], Any]
    times: int


def _fall() -> Row:
    """Let a ball fall to its first impact."""
    ball = zivi.ImpactSystem(lambda t, x, v: -9.81 - 0.1 * v, e=0.5)

    def lands(t: float, y: Any) -> float:
        return float(y[0])

    lands.terminal = True  # type: ignore[attr-defined]
    lands.direction = -1  # type: ignore[attr-defined]

    def beside() -> Any:
        return scipy.integrate.solve_ivp(
            lambda t, y: [y[1], -9.81 - 0.1 * y[1]],
            (0, 0.6),
            (1, 0),
            "DOP853",
            events=lands,
            rtol=1e-6,
            atol=1e-9,
        )

    return Row(
        "a ball with drag, one impact, a force in Python",
        "`simulate`",
        "`solve_ivp`, DOP853, one event, without the flight after it",
        lambda: zivi.simulate(ball, (0, 0.6), (1, 0)),
        beside,
        20,
    )


def _links() -> zivi.MechanicalSystem:
    """Give a double pendulum that meets nothing."""
    return zivi.symbolic.system(
        "a b",
        T="adot**2 + bdot**2/2 + adot*bdot*cos(a - b)",
        V="-2*g*cos(a) - g*cos(b)",
        gaps={"wall": "sin(a) + sin(b) + 10"},
        parameters={"g": 9.81},
        e=0.5,
    )


def _pendulum() -> Row:
    """Swing it."""
    system = _links()

    def slopes(t: float, y: Any) -> Any:
        a, b, u, w = y
        c, s = np.cos(a - b), np.sin(a - b)
        mass = np.array([[2.0, c], [c, 1.0]])
        force = [-s * w**2 - 2 * 9.81 * np.sin(a), s * u**2 - 9.81 * np.sin(b)]
        return [u, w, *np.linalg.solve(mass, force)]

    return Row(
        "a double pendulum, 1 s",
        "`simulate`, from its energies, compiled",
        "`solve_ivp`, DOP853, its equations by hand in NumPy",
        lambda: zivi.simulate(system, (0, 1), ([0.5, 0.5], [0, 0])),
        lambda: scipy.integrate.solve_ivp(
            slopes, (0, 1), (0.5, 0.5, 0, 0), "DOP853", rtol=1e-6, atol=1e-9
        ),
        5,
    )


def _mujoco() -> Row | None:
    """Swing a double pendulum that meets nothing, of MuJoCo's description."""
    try:
        import mujoco

        import zivi.interop.mujoco
    except ImportError:
        return None
    link = (
        '<joint name="{0}" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".03"/>'
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.002"><flag contact="disable"/></option><worldbody>'
        f'<body>{link.format("a")}<body pos="0 0 -.5">{link.format("b")}</body></body>'
        "</worldbody></mujoco>"
    )
    tree, data = zivi.interop.mujoco.tree(model, gaps=[]), mujoco.MjData(model)

    def beside() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = 0.5
        for _ in range(500):
            mujoco.mj_step(model, data)

    return Row(
        "two links that swing, 1 s, from MJCF",
        "`simulate`, `rtol` 1e-6",
        "MuJoCo, 500 of its default steps of 2 ms from Python, of first order",
        lambda: zivi.simulate(tree, (0, 1), ([0.5, 0.5], [0, 0])),
        beside,
        5,
    )


def _siconos() -> Row | None:
    """Let three balls fall on each other, until all rest."""
    python = interpreter()
    if python is None:
        return None
    name, end, step = "tower", 1.0, "5e-4"
    model, start = bench_mechanics.system(PROBLEMS[name]), PROBLEMS[name]["start"]
    script = Path(__file__).with_name("siconos_mechanics.py")

    def beside() -> float:
        done = subprocess.run(
            [python, script, name, step],
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=True,
        )
        (line,) = (it for it in done.stdout.splitlines() if it.startswith("FIGURES "))
        rows = json.loads(line.removeprefix("FIGURES "))
        return float(next(row["seconds"] for row in rows if row["end"] == end))

    return Row(
        "three balls that fall on each other, until they rest",
        "`simulate`, from their energies, compiled",
        "Siconos, `MoreauJeanOSI` and `LCP`, 2000 steps of .5 ms, of first order",
        lambda: zivi.simulate(model, (0, end), start),
        beside,
        1,
    )


def _by_hand(directory: Path) -> Row | None:
    """Count the impacts of an oscillator, as a loop in C does."""
    force = zivi.LinearForce(
        stiffness=1, damping=0.1, gravity=-1, amplitude=0.6, omega=0.9, phase=0
    )
    loop = flights_loop.in_c(force, 0.8, directory, ("-O3", "-march=native"))
    if loop is None:
        return None
    system, end = zivi.ImpactSystem(force, e=0.8), 3500.0
    ours = zivi.simulate(system, (0, end), (1, 0), t_eval=[])
    if len(ours.resolved_impacts) != loop(end)[0]:
        raise RuntimeError(f"{len(ours.resolved_impacts)} impacts, by hand {loop(end)[0]}")
    return Row(
        "501 periods of an oscillator, its impacts alone",
        "`simulate`, `t_eval=[]`",
        "a loop in C by hand, `-O3 -march=native`: steps of a twentieth of a period, then Newton",
        lambda: zivi.simulate(system, (0, end), (1, 0), t_eval=[]),
        lambda: loop(end) and None,
        5,
    )


def _drawn(read: bool) -> Row:
    """Sample a motion so that lines draw it."""
    force = zivi.LinearForce(stiffness=1, damping=0.05, gravity=0.2, amplitude=0.6, omega=0.9)
    system = zivi.ImpactSystem(force, e=0.7)

    def ours() -> Any:
        sol = zivi.simulate(system, (0, 349), (1, 0))
        return sol.x if read else sol

    return Row(
        f"50 periods of an oscillator, {'and the samples that draw them' if read else 'a run'}",
        "`simulate`, and `sol.x`" if read else "`simulate`",
        'the same with `samples="steps"`, `dense_output=False`',
        ours,
        lambda: zivi.simulate(system, (0, 349), (1, 0), samples="steps", dense_output=False),
        10,
    )


def _diagram() -> Row:
    """Make values of a bifurcation diagram."""
    table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    values = np.linspace(1.1, 1.5, 40)
    systems = [
        zivi.ImpactSystem(
            zivi.LinearForce(gravity=1.0, amplitude=float(a), phase=-np.pi / 2), e=0.5
        )
        for a in values
    ]
    starts = np.tile([0.3, 1.9], (len(values), 1))
    return Row(
        "40 values of a bifurcation diagram, up to 300 periods to settle and 64 noted",
        "`bifurcation_diagram`",
        "`simulate_batch` over all 364 periods, the ends alone",
        lambda: zivi.bifurcation_diagram(
            zivi.ImpactSystem(table, e=0.5),
            "amplitude",
            values,
            starts=(0.3, 1.9),
            threads=1,
            progress=False,
        ),
        lambda: zivi.simulate_batch(systems, (0, 364 * 2 * np.pi), starts, threads=1),
        2,
    )


def _orbits() -> list[Row]:
    """Find an orbit of a ball on a table, and follow it."""
    table = zivi.LinearForce(gravity=1.0, amplitude=1.3, phase=-np.pi / 2)
    system = zivi.ImpactSystem(table, e=0.5)
    orbit = zivi.periodic_orbit(system, [(0.6, 2.1)])
    branch = zivi.continue_orbit(orbit, "amplitude", (1.0, 1.6))

    def by_hand(amplitude: float, guess: Any) -> Any:
        def misses(y: Any) -> Any:
            phase, speed = y
            run = scipy.integrate.solve_ivp(
                lambda t, z: (z[1], amplitude * np.sin(t) - 1.0),
                (phase, phase + 2 * np.pi),
                (0.0, speed),
                "DOP853",
                rtol=1e-12,
                atol=1e-13,
            )
            x, xdot = run.y[:, -1]
            return x, speed + 0.5 * xdot

        return scipy.optimize.root(misses, guess, tol=1e-10).x

    found, mine = by_hand(1.3, (0.6, 2.1)), orbit.impacts[0]
    if not np.allclose(found, (mine["t"], mine["u"]), atol=1e-8):
        raise RuntimeError("the two orbits are not the same")
    impacts = [it.impacts[0] for it in branch.orbits]

    def all_by_hand() -> None:
        for value, it in zip(branch.values, impacts, strict=True):
            by_hand(value, (it["t"], it["u"]))

    hand = "`scipy.optimize.root`, flights by `solve_ivp`, DOP853, `rtol` 1e-12"
    return [
        Row(
            "a periodic orbit of a ball on a table, from a guess",
            "`periodic_orbit`, with multipliers, looked at by a simulation",
            hand,
            lambda: zivi.periodic_orbit(system, [(0.6, 2.1)]),
            lambda: by_hand(1.3, (0.6, 2.1)) is None,
            5,
        ),
        Row(
            f"{len(branch)} points of its branch over the amplitude",
            "`continue_orbit`, with its events located",
            f"{hand}, from the orbits there",
            lambda: zivi.continue_orbit(orbit, "amplitude", (1.0, 1.6)),
            all_by_hand,
            1,
        ),
    ]


def _mechanisms() -> list[Row]:
    """Run mechanical systems of arrays and functions, short and with many gaps."""
    floor, still = zivi.LinearGap([1.0], name="floor"), ([1.0], [0.0])
    one = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[floor], e=0.5)
    linear = zivi.LinearSystem([[1.0]], None, [[1.0]], gaps=[floor], e=0.5)
    rows = [
        _short("a mechanical system of arrays", one, still),
        _short("a `LinearSystem`", linear, still),
    ]
    for n in (1, 16):
        rows.append(_short(f"a `Tree` of {n} bodies", _chain(n), (np.full(n, 0.3), np.zeros(n))))
    rows += [_balls(n) for n in (8, 16, 32)]
    idle = [zivi.LinearGap([1.0], 10.0 + i, name=f"idle{i}") for i in range(255)]
    many = zivi.MechanicalSystem(mass=1.0, force=[-9.81], gaps=[floor, *idle], e=0.5)
    rows.append(
        Row(
            "a ball with 255 gaps that stay open",
            "`simulate`",
            "the same without these gaps",
            lambda: zivi.simulate(many, (0, 6), still),
            lambda: zivi.simulate(one, (0, 6), still),
            5,
        )
    )
    driven = zivi.MechanicalSystem(
        mass=1.0,
        force=lambda t, q, qdot: -q - 0.1 * qdot + 0.6 * np.cos(0.9 * t) - 1.0,
        gaps=[floor],
        e=0.8,
    )
    mass = zivi.ImpactSystem(lambda t, x, v: -x - 0.1 * v + 0.6 * np.cos(0.9 * t) - 1.0, e=0.8)
    rows.append(
        Row(
            "20 periods of an oscillator, a force in Python",
            "`MechanicalSystem` with a `LinearGap`",
            "`ImpactSystem`",
            lambda: zivi.simulate(driven, (0, 140), still),
            lambda: zivi.simulate(mass, (0, 140), (1, 0)),
            5,
        )
    )
    return rows


def _short(what: str, system: zivi.MechanicalSystem, start: Any) -> Row:
    return Row(
        f"{what} over a microsecond, one call",
        "`simulate`",
        "`solve_ivp`, RK45, a function that returns its argument, one step",
        lambda: zivi.simulate(system, (0, 1e-6), start),
        lambda: scipy.integrate.solve_ivp(lambda t, y: y, (0, 1e-9), (1.0, 1.0)),
        50,
    )


def _chain(n: int) -> zivi.Tree:
    """Return a chain of n links above a floor."""
    links = [
        zivi.mechanics.Body(
            f"link{i}",
            parent=f"link{i - 1}" if i else None,
            axis=[0, 1, 0],
            position=[0, 0, -1 if i else 0],
            mass=1.0,
            com=[0, 0, -0.5],
            inertia=0.1,
        )
        for i in range(n)
    ]
    end = zivi.mechanics.PlaneGap(f"link{n - 1}", point=[0, 0, -1], offset=-10.0 * n, name="floor")
    return zivi.Tree(links, gaps=[end], e=0.5)


def _balls(n: int) -> Row:
    """Drop n balls beside each other, as arrays and from their energies."""
    names = [f"x{i}" for i in range(n)]
    gaps = [zivi.LinearGap(row, name=name) for row, name in zip(np.eye(n), names, strict=True)]
    arrays = zivi.MechanicalSystem(mass=np.eye(n), force=np.full(n, -9.81), gaps=gaps, e=0.5)
    energies = zivi.symbolic.system(
        " ".join(names),
        T="+".join(f"{x}dot**2/2" for x in names),
        V="+".join(f"9.81*{x}" for x in names),
        gaps={name: name for name in names},
        e=0.5,
    )
    start = (1 + 0.1 * np.arange(n) / n, np.zeros(n))
    return Row(
        f"{n} balls beside each other, 6 s",
        "`MechanicalSystem` of arrays",
        "`zivi.symbolic.system`, compiled",
        lambda: zivi.simulate(arrays, (0, 6), start),
        lambda: zivi.simulate(energies, (0, 6), start),
        1,
    )


def _loop() -> Row:
    """Close a loop, and do the same by hand."""
    plant = zivi.ImpactSystem(-9.81, e=1 / 3)
    h, n = 1e-3, 2000

    def tracker() -> Any:
        return zivi.TwistingTracker(30, 17, h=h, e=1 / 3)

    def by_hand() -> None:
        controller = tracker()
        controller.reset(3.0, 3.0)
        x, v = 6.0, 5.0
        for _ in range(n):
            u = controller.step(x, v, force=-9.81, force_ref=-19.81)
            x, v = x + h * v, v + h * (u - 9.81)
            if x < 0.0 and v < 0.0:
                x, v = 0.0, -v / 3

    return Row(
        "2000 periods of a closed loop",
        "`simulate_closed_loop`, exact flights",
        "a loop in Python around `step`, Euler's step for the plant",
        lambda: zivi.simulate_closed_loop(
            plant, tracker(), (0, n * h), (6, 5), y_ref0=(3, 3), force_ref=-19.81
        ),
        by_hand,
        5,
    )


def _definite(n: int) -> tuple[Any, Any]:
    """Draw a symmetric problem with half of the unknowns active."""
    source = np.random.default_rng(1)
    a = source.standard_normal((n, n))
    return a @ a.T / n + np.eye(n), source.standard_normal(n)


def _skewed(n: int) -> tuple[Any, Any]:
    """Draw a monotone problem that is not symmetric."""
    source = np.random.default_rng(2)
    a = source.standard_normal((n, n))
    return a @ a.T / n + (a - a.T) / np.sqrt(n) + 0.1 * np.eye(n), source.standard_normal(n)


def _contacts(n: int, bodies: int) -> tuple[Any, Any]:
    """Draw n contacts of discs close to each other: their mobilities and approach speeds."""
    source = np.random.default_rng(n)
    side = int(np.ceil(np.sqrt(bodies)))
    places = np.array([(i % side, i // side) for i in range(bodies)], float)
    places += 0.2 * source.standard_normal((bodies, 2))
    first, second = np.triu_indices(bodies, 1)
    apart = np.linalg.norm(places[first] - places[second], axis=1)
    closest = np.argsort(apart)[:n]
    normals = np.zeros((len(closest), bodies, 2))
    for row, k in enumerate(closest):
        normal = (places[first[k]] - places[second[k]]) / apart[k]
        normals[row, first[k]], normals[row, second[k]] = normal, -normal
    rows = normals.reshape(len(closest), -1)
    return rows @ rows.T, 0.1 * rows @ source.standard_normal(2 * bodies)


def _lcps() -> list[Row]:
    """Solve complementarity problems of four families, and their linear systems."""
    families = {
        "symmetric": [_definite(n) for n in (10, 100, 400)],
        "not symmetric": [_skewed(n) for n in (10, 100, 400)],
        "contacts": [_contacts(n, n) for n in (30, 200, 400)],
        "dependent contacts": [_contacts(n, n // 3) for n in (30, 100, 400)],
    }
    rows = []
    for family, problems in families.items():
        for M, q in problems:
            rows += _lcp(family, M, q)
    return rows


def _lcp(family: str, M: Any, q: Any) -> list[Row]:
    def residual(x: Any) -> float:
        return float(np.max(np.abs(np.minimum(x, M @ x + q))))

    def ours() -> Any:
        return zivi.solve_lcp(M, q)

    what, times = f"a complementarity problem, {family}, n = {len(q)}", max(1, 2000 // len(q))
    if not residual(ours().x) < 1e-10:
        raise RuntimeError(f"{what}: {residual(ours().x)}")
    rows = []
    try:
        import numba_peers
    except ImportError:
        pass
    else:
        if not residual(numba_peers.lemke(M, q)) < 1e-10:
            raise RuntimeError(f"{what}, Lemke: {residual(numba_peers.lemke(M, q))}")
        peer = "Lemke's method on a tableau, numba, unchecked"
        rows.append(Row(what, "`solve_lcp`", peer, ours, lambda: numba_peers.lemke(M, q), times))
    if family != "dependent contacts" and len(q) >= 100:
        peer = "`numpy.linalg.solve` of the whole matrix, one thread"
        rows.append(Row(what, "`solve_lcp`", peer, ours, lambda: np.linalg.solve(M, q), times))
    return rows


def _balls_to_rest() -> Row | None:
    """Let many balls bounce until they rest, each with an e of its own."""
    try:
        import numba_peers
    except ImportError:
        return None
    e = np.linspace(0.3, 0.8, 20_000)
    ball, starts = zivi.ImpactSystem(-9.81, e=0.5), np.tile([1.0, 0.0], (len(e), 1))

    def ours() -> Any:
        return zivi.simulate_batch(ball, (0, 6), starts, parameters={"e": e}, threads=1)

    def beside() -> Any:
        return numba_peers.balls(e, 1.0, 9.81, 1e-7)

    if not np.allclose(ours().rest_time, beside(), rtol=1e-12):
        raise RuntimeError("the balls do not rest at the same times")
    return Row(
        f"{len(e)} balls until they rest",
        '`simulate_batch`, `parameters={"e": e}`',
        "the recursion, numba, one number for each ball",
        ours,
        lambda: beside() is None,
        1,
    )


def _calls() -> list[Row]:
    """Make the shortest calls."""
    ball = zivi.ImpactSystem(-9.81, e=0.5)
    links = _links()
    A, b = np.eye(5) + 0.5 * np.eye(5, k=1), np.array([-1.0, 2.0, 3.0, -1.0, 2.0])
    M, q = A.T @ A, -A.T @ b
    if not np.allclose(zivi.solve_lcp(M, q).x, scipy.optimize.nnls(A, b)[0]):
        raise RuntimeError("the two problems are not the same")
    nothing = "`solve_ivp`, RK45, a function that returns its argument, one step"

    def beside() -> Any:
        return scipy.integrate.solve_ivp(lambda t, y: y, (0, 1e-9), (1.0, 1.0))

    return [
        Row(
            "a ball that bounces until it rests, one call",
            "`simulate`",
            nothing,
            lambda: zivi.simulate(ball, (0, 3), (1, 0)),
            beside,
            50,
        ),
        Row(
            "a compiled mechanical system over a step, one call",
            "`simulate`",
            nothing,
            lambda: zivi.simulate(links, (0, 1e-9), ([0.5, 0.5], [0, 0])),
            beside,
            50,
        ),
        Row(
            "a complementarity problem, n = 5, which is one of least squares",
            "`solve_lcp`",
            "`scipy.optimize.nnls`",
            lambda: zivi.solve_lcp(M, q),
            lambda: scipy.optimize.nnls(A, b),
            50,
        ),
    ]


def _python(*arguments: str) -> None:
    """Run Python on modules that are compiled once, as those of an installed package."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    kept["PYTHONPYCACHEPREFIX"] = str(Path(tempfile.gettempdir()) / "zivi_waits")
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL, env=kept)


def _import(other: str) -> Row:
    def start(program: str) -> Callable[[], Any]:
        return lambda: _python("-c", program)

    ours, theirs = "from zivi import simulate", f"import {other}"
    return Row(f"`{ours}`", "a fresh process", f"`{theirs}`", start(ours), start(theirs), 1)


def _help() -> Row:
    return Row(
        "`zivi --help`",
        "a fresh process",
        "`import numpy`",
        lambda: _python("-m", "zivi", "--help"),
        lambda: _python("-c", "import numpy"),
        1,
    )


def measured(row: Row) -> tuple[float, float, float]:
    """Give both times (ms) and the median of the ratios."""
    children = row.ours == "a fresh process"
    clock = _of_children if children else time.process_time
    pairs = []
    for k in range(ROUNDS + 1):
        times = []
        for run in (row.run, row.beside):
            start = clock()
            for _ in range(row.times):
                told = run()
            took = (clock() - start) / row.times
            times.append(told if isinstance(told, float) else took)
        if k:
            pairs.append(times)
    ours, theirs = (1e3 * min(column) for column in zip(*pairs, strict=True))
    return ours, theirs, statistics.median(a / b for a, b in pairs)


def _of_children() -> float:
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def write() -> str:
    """Measure every row into the page of results."""
    with tempfile.TemporaryDirectory() as directory:
        rows = [*_calls(), _fall(), _pendulum(), _mujoco(), _siconos(), _by_hand(Path(directory))]
        rows += [_drawn(read=False), _drawn(read=True), *_orbits(), _diagram()]
        rows += [_loop(), *_lcps(), _balls_to_rest(), *_mechanisms()]
        rows += [_import("numpy"), _import("scipy.integrate"), _help()]
        return _written([row for row in rows if row is not None])


def _written(rows: list[Row]) -> str:
    text = HEAD + _told(rows)
    PAGE.write_text(text)
    return text


def _told(rows: list[Row]) -> str:
    """Measure rows, print them, and return them as those of a table."""
    text = ""
    for row in rows:
        ours, theirs, ratio = measured(row)
        line = f"| {row.what} | {row.ours} | {row.theirs} "
        text += f"{line}| {ours:.3g} | {theirs:.3g} | {ratio:.2g} |\n"
        print(f"{row.what}: {ours:.3g} ms, {theirs:.3g} ms, {ratio:.2g}", flush=True)
    return text


if __name__ == "__main__":
    if "--mechanisms" in sys.argv:
        _told(_mechanisms())
    elif "--problems" in sys.argv:
        _told([row for row in [*_lcps(), _balls_to_rest()] if row is not None])
    else:
        write()
