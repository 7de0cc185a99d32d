"""Positions, impacts and events in the tails of accumulations against quadruple precision.

    python benchmarks/tails.py [draws] [seed]

A mass that is thrown up from the wall, under a number, a callable and a linear force, and as
mechanical systems: the largest errors of each family by `e` and `rtol`, in `rtol` of the first apex
(of speeds in `rtol` of the first), and what of it the steps before the tail had brought along. The
reference (tails_oracle.c, which needs gcc with libquadmath) follows impact by impact by Taylor
series.
"""

import math
import subprocess
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from random import Random

import numpy as np

import zivi

V0, MOST_IMPACTS = 4.0, 300_000
LOOKS = (1.0, 0.95, 0.5, 0.3, 0.1, 0.03, 0.01, 1e-3)
"""What is left of a tail where it is looked at."""


@dataclass(frozen=True)
class Law:
    """``x'' = -stiffness x - damping x' - gravity + amplitude cos(omega t + phase)``."""

    stiffness: float = 0.0
    damping: float = 0.0
    gravity: float = 9.81
    amplitude: float = 0.0
    omega: float = 0.0
    phase: float = 0.0

    @classmethod
    def random(cls, random, e):
        """Draw one; the excitation changes over an accumulation, not many times."""
        lasting = 2 * V0 / 9.81 / (1 - e)
        return cls(
            stiffness=random.choice([0, 10 ** random.uniform(-2, 1)]),
            damping=random.choice([0, random.uniform(0.1, 1) / lasting]),
            amplitude=random.choice([0, random.uniform(0.1, 3)]),
            omega=random.uniform(0.2, 3) / lasting,
            phase=random.uniform(0, 6),
        )

    def linear(self):
        """Give it as a force known by its numbers."""
        return zivi.LinearForce(**self.__dict__)

    def force(self, t, x, v):
        """Give it as a function."""
        wave = self.amplitude * math.cos(self.omega * t + self.phase)
        return -self.stiffness * x - self.damping * v - self.gravity + wave


class Reference:
    """The motion impact by impact."""

    def __init__(self, law, e, program):
        self.head, self.program = [*law.__dict__.values(), e, V0], program

    def __call__(self, times, impacts=0, level=0.0):
        """Positions and velocities at times, impacts, crossings of a level."""
        n = len(times)
        head = [*self.head, n, impacts, level]
        sent = np.concatenate([head, times]).astype(float).tobytes()
        found = np.frombuffer(
            subprocess.run(self.program, input=sent, capture_output=True, check=True).stdout
        )
        states, hits, crossings = np.split(found, [2 * n, 2 * n + 2 * impacts])
        return states.reshape(n, 2), hits.reshape(impacts, 2), crossings[crossings > 0]


def systems(law):
    """Give each family: a system, its start, settings, and what is its position."""
    plain = law == Law()
    forces = {"callable": law.force, "linear": law.linear()} | (
        {"number": -law.gravity} if plain else {}
    )
    for name, force in forces.items():
        for flights in ("auto",) if name == "callable" else ("auto", "rk"):
            make = lambda e, force=force: zivi.ImpactSystem(force, e=e)  # noqa: E731
            yield f"{name} {flights}", make, (0, V0), {"flights": flights}, lambda state: state[0]

    def one(e):
        push = lambda t, q, v: [2 * law.force(t, q[0], v[0])]  # noqa: E731
        return zivi.MechanicalSystem(mass=[[2.0]], force=push, e=e, gaps=[zivi.LinearGap([1.0])])

    # q1 + q2 is the gap and moves as the mass, q1 - q2 does not move
    def two(e):
        def push(t, q, v):
            f = law.force(t, q[0] + q[1], v[0] + v[1])
            return [0.5 * f, 0.5 * f]

        return zivi.MechanicalSystem(
            mass=np.eye(2), force=push, e=e, gaps=[zivi.LinearGap([1.0, 1.0])]
        )

    yield "one coordinate", one, ([0], [V0]), {}, lambda state: state[0][..., 0]
    yield (
        "two coordinates",
        two,
        ([0, 0], [V0 / 2, V0 / 2]),
        {},
        lambda state: state[0].sum(axis=-1),
    )


def errors(law, e, rtol, program):
    """Errors of positions, impacts and events of each family."""
    exact, flight = Reference(law, e, program), 2 * V0 / law.gravity
    apex = exact(np.linspace(0.01, 0.99, 99) * flight)[0][:, 0].max()
    for name, make, start, settings, position in systems(law):
        method = zivi.SwitchedRK(rtol=rtol, atol=rtol / 1000, **settings)

        def run(make=make, start=start, method=method, **more):
            span = (0, 1.6 * flight / (1 - e))
            return zivi.simulate(make(e), span, start, method, dense_output=True, **more)

        sol = run()
        mass = isinstance(sol, zivi.Trajectory)
        zeno = sol.zeno_times if mass else sol.zeno["t"]
        if not len(zeno):
            yield name, {"no tail": math.inf}
            continue
        computed = sol.resolved_impacts["t"]
        before = computed[computed < zeno[0]]
        last, end = before[-1], zeno[0]
        t, u = exact([], len(before))[1][-1]
        times = [end - (end - last) * left * np.linspace(0.9999, 0.97, 97) for left in LOOKS]
        # what needs more impacts than the reference shall follow is left out
        times = np.sort(np.concatenate(times))
        times = times[np.log1p(-times / end) > MOST_IMPACTS * math.log(e)]
        if not len(times):
            continue
        states = exact(times)[0]
        found = {"position": abs(position(sol(times)) - states[:, 0]).max() / apex / rtol}
        found["before the tail"] = abs(last - t) * u / apex / rtol
        if mass:
            late = sol.impacts_down_to(max(5e-3, e**MOST_IMPACTS) * V0, limit=MOST_IMPACTS)
            hits = exact([], len(late))[1]
            # a later impact moves what follows by its speed
            off = abs(late["t"] - hits[:, 0]) * late["xdot_after"]
            found["impacts"] = off.max() / apex / rtol
            found["speeds"] = abs(late["xdot_after"] - hits[:, 1]).max() / V0 / rtol
        if e <= 0.999:
            speed = np.sqrt(
                2 * law.gravity * 0.3 * position(sol(np.linspace(last, end, 4001))).max()
            )
            level = speed**2 / 2 / law.gravity
            fast = int(math.log(speed / V0) / math.log(e) * 1.3) + 20
            where = (lambda t, x, v: x) if mass else lambda t, q, v, of=position: of((q,))
            events = [lambda t, x, v, where=where, level=level: where(t, x, v) - level]
            seen = run(events=events).t_events[0]
            crossings = exact([], 3 * fast, level)[2]
            seen, crossings = seen[seen > last], crossings[crossings > last]
            same = len(seen) == len(crossings)
            # those of the last arc that is just higher are badly known
            off = abs(seen - crossings)[:-2] * speed if same else np.array([math.inf])
            found["events"] = off.max(initial=0.0) / apex / rtol
        yield name, found


def main(draws=3, seed=1):
    random, worst = Random(seed), defaultdict(dict)
    with tempfile.TemporaryDirectory() as folder:
        program = f"{folder}/oracle"
        source = str(Path(__file__).with_name("tails_oracle.c"))
        subprocess.run(
            ["gcc", "-O2", "-std=gnu99", source, "-o", program, "-lquadmath", "-lm"], check=True
        )
        for e in (0.9, 0.95, 0.99, 0.995, 0.999, 0.9999, 0.99999):
            laws = [Law()] + [Law.random(random, e) for _ in range(draws if e < 0.9999 else 1)]
            for rtol in (1e-4, 1e-7, 1e-9, 1e-11):
                for law in laws:
                    for name, found in errors(law, e, rtol, program):
                        kind = "constant" if law == Law() else "varying"
                        for what, size in found.items():
                            row = worst[kind, name, what]
                            row[e, rtol] = max(size, row.get((e, rtol), 0.0))
    for group, row in sorted(worst.items()):
        print(*group)
        for (e, rtol), size in row.items():
            print(f"    e = {e:<8} rtol {rtol:.0e}: {size:.3g}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
