"""Time per ball and step of `zivi.simulate_batch`, beside hand-written C loops."""

from __future__ import annotations

import ctypes
import dataclasses
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

import cball
import timing
import zivi

SOURCE = Path(__file__).with_name("batch.c")
NATIVE = ("-O3", "-march=native")
NO_TRAPS = (*NATIVE, "-fno-trapping-math")
FLAGS = {
    "-O3 -march=native": NATIVE,
    "-O3 -march=native -fno-trapping-math": NO_TRAPS,
    "-O3 -march=native -fno-trapping-math, fused": (*NO_TRAPS, "-ffp-contract=fast"),
    "not vectorised": (*NATIVE, "-fno-tree-vectorize"),
}
"""Compiler flags by name."""
PLAIN = "-O3 -march=native"
"""The build that the goal is about, and that results are compared with."""

BALLS, STEPS, REPETITIONS = 4096, 4000, 15
Scene: TypeAlias = tuple[float, bool]
"""The step (s), and whether the balls are in random order."""
SCENES: dict[str, Scene] = {
    "to rest, T = 4 s": (1e-3, False),
    "moving, T = 2.4 s": (6e-4, False),
    "moving, in random order": (6e-4, True),
}
States: TypeAlias = NDArray[np.float64]


class Problem(ctypes.Structure):
    """`batch_problem` of `batch.c`."""

    _fields_ = (
        *((name, ctypes.c_double) for name in ("h", "kappa", "f")),
        ("balls", ctypes.c_size_t),
        ("steps", ctypes.c_size_t),
    )


class DrivenProblem(ctypes.Structure):
    """`driven_problem` of `batch.c`."""

    _fields_ = (
        *(
            (name, ctypes.c_double)
            for name in ("h", "kappa", "gravity", "stiffness", "damping", "amplitude", "omega")
        ),
        ("balls", ctypes.c_size_t),
        ("steps", ctypes.c_size_t),
    )


DRIVEN = {
    "a wave": {"gravity": 9.81, "amplitude": 5.0, "omega": 7.0},
    "spring and damper": {"gravity": 9.81, "stiffness": 20.0, "damping": 0.3},
    "both": {
        **{"gravity": 9.81, "stiffness": 20.0, "damping": 0.3},
        **{"amplitude": 5.0, "omega": 7.0},
    },
}
"""Linear forces, by name: their coefficients."""


@dataclasses.dataclass(frozen=True)
class CBatch:
    """One build of `batch.c`."""

    flags: str
    library: ctypes.CDLL
    vectorised: bool
    """Whether the compiler says so."""

    def run(self, s: States, v: States, h: float, steps: int) -> None:
        """Move the balls from `(s, v)`, in place."""
        posed = Problem(h, cball.KAPPA, cball.FORCE, len(s), steps)
        pointer = ctypes.POINTER(ctypes.c_double)
        self.library.batch_run(
            ctypes.byref(posed), s.ctypes.data_as(pointer), v.ctypes.data_as(pointer)
        )

    def driven(self, s: States, v: States, h: float, steps: int, force: dict[str, float]) -> None:
        """Move the balls from `(s, v)` under a linear force, in place."""
        posed = DrivenProblem(h=h, kappa=cball.KAPPA, balls=len(s), steps=steps, **force)
        pointer = ctypes.POINTER(ctypes.c_double)
        self.library.batch_driven(
            ctypes.byref(posed), s.ctypes.data_as(pointer), v.ctypes.data_as(pointer)
        )


def build(directory: Path) -> list[CBatch]:
    """Compile `batch.c` with each set of `FLAGS` into `directory`."""
    cc = cball.compiler()
    if cc is None:
        raise SystemExit("the benchmarks need a C compiler (cc, or the variable CC)")
    builds = []
    for number, (name, flags) in enumerate(FLAGS.items()):
        target = directory / f"batch{number}.so"
        checks = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-fopt-info-vec")
        command = (cc, *checks, *flags, "-shared", "-fPIC", "-o", target, SOURCE, "-lm")
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        said = "loop vectorized" in done.stderr + done.stdout
        builds.append(CBatch(name, ctypes.CDLL(str(target)), said))
    return builds


def starts(balls: int = BALLS, shuffled: bool = False) -> States:
    """Put balls at 1 to 1.4 m, thrown up at 6 m/s."""
    heights = np.linspace(1.0, 1.4, balls)
    if shuffled:
        heights = np.random.default_rng(1).permutation(heights)
    return np.column_stack([heights, np.full(balls, cball.START[1])])


def lifted(states: States) -> tuple[States, States]:
    """Return `s` and `v` of states that move away from the wall."""
    return states[:, 0].copy(), states[:, 1] / (1.0 - cball.KAPPA)


def simulate(
    states: States,
    h: float,
    threads: int = 1,
    save: str | int = "final",
    *,
    systems: zivi.ImpactSystem | list[zivi.ImpactSystem] | None = None,
    method: zivi.ThetaGamma | zivi.MoreauJean | None = None,
) -> zivi.Batch:
    """Run the balls for `STEPS` steps."""
    return zivi.simulate_batch(
        systems or zivi.ImpactSystem(cball.FORCE, kappa=cball.KAPPA),
        (0.0, STEPS * h),
        states,
        method=method or zivi.ThetaGamma(h),
        save=save,
        threads=threads,
        progress=False,
    )


@dataclasses.dataclass(frozen=True)
class Agreement:
    """How far the batch and the C loop are apart."""

    rest_times: tuple[float, float]
    """The first and the last ball's (s)."""
    same: int
    """Balls that come to rest in the same step."""
    steps_apart: int
    """Most steps between the rest of a ball here and there."""
    position: float
    """Largest difference of the positions after half a second and at 1.2 s (m)."""
    one_thread_is_two: bool
    """Whether one and two threads give the same bits."""
    batch_is_simulate: bool
    """Whether some of the balls end as `zivi.simulate` ends them, to the last bit."""

    def check(self) -> None:
        """Refuse to time two programs that do not compute the same."""
        assert self.rest_times[0] == 2.444, self
        # where a sum is rounded otherwise, the last steps before rest may be
        assert self.steps_apart <= 1, self
        assert self.position < 1e-9, self
        assert self.one_thread_is_two, self
        assert self.batch_is_simulate, self


def agreement(plain: CBatch) -> Agreement:
    """Run both and compare."""
    h, states = 1e-3, starts()
    every = 100
    ours, again = simulate(states, h, 1, every), simulate(states, h, 2, every)
    s, v = lifted(states)
    rest_step = np.zeros(len(s), int)
    positions = []
    for k in range(1, STEPS + 1):
        plain.run(s, v, h, 1)
        rest_step[(rest_step == 0) & (s == 0.0) & (v == 0.0)] = k
        if k in (500, 1200):
            assert ours.sample_x is not None
            positions.append(np.abs(s - ours.sample_x[:, k // every]).max())
    steps = np.rint(ours.rest_time / h).astype(int)
    apart = np.abs(steps - rest_step)
    return Agreement(
        rest_times=(float(np.round(ours.rest_time[0], 9)), float(ours.rest_time[-1])),
        same=int((apart == 0).sum()),
        steps_apart=int(apart.max()),
        position=float(max(positions)),
        one_thread_is_two=_bits(ours) == _bits(again),
        batch_is_simulate=all(
            (sol.x[-1], sol.xdot[-1], sol.rest_time) == (ours.x[i], ours.xdot[i], ours.rest_time[i])
            and np.array_equal(sol.x[::every], ours.sample_x[i])
            for i in range(0, BALLS, BALLS // 8)
            for sol in [_alone(states[i], h)]
        ),
    )


def _alone(state: States, h: float) -> zivi.Trajectory:
    system = zivi.ImpactSystem(cball.FORCE, kappa=cball.KAPPA)
    return zivi.simulate(system, (0.0, STEPS * h), state, method=zivi.ThetaGamma(h))


def _bits(batch: zivi.Batch) -> list[bytes]:
    arrays = (getattr(batch, field.name) for field in dataclasses.fields(batch))
    return [array.tobytes() for array in arrays if isinstance(array, np.ndarray)]


@dataclasses.dataclass(frozen=True)
class Times:
    """Figures of one scene, ns per ball and step."""

    zivi: float
    c: dict[str, float]
    one_by_one: float
    """The C loop of `ball.c`, ball after ball."""
    ratio: dict[str, float]
    """Time of zivi to that of each C loop."""
    ratio_one_by_one: float


def times(builds: list[CBatch], single: cball.CBall, scene: Scene) -> Times:
    """Time zivi and every C loop, in turn."""
    h, shuffled = scene
    states = starts(shuffled=shuffled)
    contenders: dict[str, timing.Contender] = {}
    for build in builds:
        # zivi stands next to each C loop, so that each ratio is of neighbours
        contenders[f"zivi|{build.flags}"] = partial(simulate, states, h), timing.nothing
        contenders[build.flags] = partial(_c_run, build, states, h), timing.nothing
    contenders["zivi|one"] = partial(simulate, states, h), timing.nothing
    contenders["one"] = partial(_one_by_one, single, states[::64], h), timing.nothing
    took = timing.interleaved(contenders, REPETITIONS)
    # a 64th of the balls: the rest would take as long
    took["one"] = [64 * value for value in took["one"]]
    found = timing.medians(took, BALLS * STEPS)
    return Times(
        zivi=float(np.median([found[name] for name in found if name.startswith("zivi|")])),
        c={build.flags: found[build.flags] for build in builds},
        one_by_one=found["one"],
        ratio={it.flags: timing.ratio(took, f"zivi|{it.flags}", it.flags) for it in builds},
        ratio_one_by_one=timing.ratio(took, "zivi|one", "one"),
    )


def _c_run(build: CBatch, states: States, h: float) -> None:
    build.run(*lifted(states), h, STEPS)


def _one_by_one(single: cball.CBall, states: States, h: float) -> None:
    for s, v in zip(*lifted(states), strict=True):
        single.loop(cball.Problem(0.0, STEPS * h, h, cball.KAPPA, cball.FORCE, s, v, STEPS))


@dataclasses.dataclass(frozen=True)
class DrivenTimes:
    """Figures under linear forces, ns per ball and step, by their names."""

    zivi: dict[str, float]
    own_waves: dict[str, float]
    """Where every ball has a frequency of its own."""
    c: dict[str, float]
    ratio: dict[str, float]
    """Time of zivi to that of the C loop."""
    moreau: dict[str, float]
    """Moreau-Jean time stepping."""
    moreau_constant: float
    """The same under a constant force."""
    apart: float
    """Largest difference of the positions from those of the C loop (m) at 0.5 s."""


def driven(build: CBatch) -> DrivenTimes:
    """Time balls under linear forces, each kind beside the C loop, in turn."""
    h, states = 6e-4, starts()
    omegas = np.linspace(6.0, 8.0, len(states))
    moreau = zivi.MoreauJean(h)
    contenders: dict[str, timing.Contender] = {}
    apart = 0.0
    for name, numbers in DRIVEN.items():
        system = _driven_system(numbers)
        run = partial(simulate, states, h, systems=system)
        contenders[f"zivi|{name}"] = run, timing.nothing
        contenders[f"moreau|{name}"] = partial(run, method=moreau), timing.nothing
        contenders[f"c|{name}"] = partial(_c_driven, build, states, h, numbers), timing.nothing
        if "omega" in numbers:
            own = [_driven_system({**numbers, "omega": omega}) for omega in omegas]
            contenders[f"own|{name}"] = partial(simulate, states, h, systems=own), timing.nothing
        ours = simulate(states, 1.25e-4, systems=system)
        s, v = lifted(states)
        build.driven(s, v, 1.25e-4, STEPS, numbers)
        apart = max(apart, float(np.abs(ours.x - s).max()))
    # the same discretisation, but for the force of the step over the apex
    assert apart < 1e-3, apart
    contenders["moreau"] = partial(simulate, states, h, method=moreau), timing.nothing
    took = timing.interleaved(contenders, REPETITIONS)
    found = timing.medians(took, BALLS * STEPS)

    def of(kind: str) -> dict[str, float]:
        return {it: found[f"{kind}|{it}"] for it in DRIVEN if f"{kind}|{it}" in found}

    return DrivenTimes(
        zivi=of("zivi"),
        own_waves=of("own"),
        c=of("c"),
        ratio={name: timing.ratio(took, f"zivi|{name}", f"c|{name}") for name in DRIVEN},
        moreau=of("moreau"),
        moreau_constant=found["moreau"],
        apart=apart,
    )


def _driven_system(numbers: dict[str, float]) -> zivi.ImpactSystem:
    return zivi.ImpactSystem(zivi.LinearForce(**numbers), kappa=cball.KAPPA)


def _c_driven(build: CBatch, states: States, h: float, force: dict[str, float]) -> None:
    build.driven(*lifted(states), h, STEPS, force)


@dataclasses.dataclass(frozen=True)
class Scaling:
    """How many times faster two threads are than one."""

    zivi: float
    c: float
    """Two C loops side by side: what the machine gives."""
    work: float
    """Processor time of two threads to that of one."""


def scaling(build: CBatch, balls: int = 4 * BALLS) -> Scaling:
    """Time one and two threads, in turn."""
    h, states = 6e-4, starts(balls)
    halves = states[: balls // 2], states[balls // 2 :]
    with ThreadPoolExecutor(2) as pool:

        def two() -> None:
            list(pool.map(lambda half: _c_run(build, half, h), halves))

        contenders: dict[str, timing.Contender] = {
            "zivi 1": (partial(simulate, states, h, 1), timing.nothing),
            "zivi 2": (partial(simulate, states, h, 2), timing.nothing),
            "c 1": (partial(_c_run, build, states, h), timing.nothing),
            "c 2": (two, timing.nothing),
        }
        took = timing.interleaved(contenders, REPETITIONS)
    work = [_processor(states, h, 2) / _processor(states, h, 1) for _ in range(REPETITIONS)]
    return Scaling(
        zivi=timing.ratio(took, "zivi 1", "zivi 2"),
        c=timing.ratio(took, "c 1", "c 2"),
        work=float(np.median(work)),
    )


def _processor(states: States, h: float, threads: int) -> float:
    start = time.process_time()
    simulate(states, h, threads)
    return time.process_time() - start
