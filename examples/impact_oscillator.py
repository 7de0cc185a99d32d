r"""An oscillator that hits a wall: sticking, one period, chaos, and a wall at the equilibrium.

    x'' = -x - 2 zeta x' - p + F cos(omega t),    x >= 0

where p presses it against the wall. It rests there while ``F cos(omega t) < p``.

- Sticking: p = 0, F = 1, omega = 0.6, e = 0.5. Impacts accumulate, it rests, and it leaves when the
  cosine becomes positive, at ``omega t = 3 pi/2 + 2 pi k``.
- Pressed: p = 1, F = 0.5. The force never turns outward: one accumulation, then rest for good.
- One period: omega = 2.2, e = 0.7. A section by an event once a period is one point.
- Chaos: omega = 2.8, e = 0.8. The same section is a curve that folds.
- Wall at the equilibrium: p = F = 0. Half a period of a linear oscillator does not depend on its
  speed: every flight takes ``pi/sqrt(1 - zeta^2)``, and ``e exp(-zeta pi/sqrt(1 - zeta^2))`` of the
  speed is left after it. Infinitely many impacts and no accumulation: a method that takes small
  speeds for rest is wrong here.

Run as ``python examples/impact_oscillator.py [out.png]``.
"""

import math
import sys

import numpy as np

import zivi

ZETA = 0.05
STICK_ZENO = (6.260889503017929, 17.147152623930694, 27.61912813589667)
PRESSED_ZENO = 4.899637770736217
"""Computed in closed form between the impacts with 50 digits (s)."""
PERIODIC = (2.5350230410371397, 1.1762635553748877)
"""Time (s) and speed (m/s) after the impact, from the equations of the periodic orbit."""
TIGHT = zivi.SwitchedRK(rtol=1e-10, atol=1e-12)


def oscillator(e: float, omega: float, amplitude: float = 1.0, p: float = 0.0) -> zivi.ImpactSystem:
    """Oscillator of unit mass and stiffness."""
    force = zivi.LinearForce(
        stiffness=1.0, damping=2 * ZETA, gravity=p, amplitude=amplitude, omega=omega
    )
    return zivi.ImpactSystem(force, e=e)


def section(system: zivi.ImpactSystem, omega: float, periods: int, kept: int) -> np.ndarray:
    """State once a period, at ``omega t = 2 pi k``, for the last periods of a run."""

    def stroboscope(t: float, x: float, xdot: float) -> float:
        return math.sin(omega * t)

    stroboscope.direction = 1  # type: ignore[attr-defined]
    span = (0, (periods + 0.5) * 2 * math.pi / omega)
    sol = zivi.simulate(system, span, (1, 0), events=stroboscope, dense_output=False)
    return sol.y_events[0][-kept:]


def sticking() -> zivi.Trajectory:
    """Three accumulations, rests and lift-offs in 30 s."""
    return zivi.simulate(oscillator(0.5, 0.6), (0, 30), (0.5, 0), TIGHT)


def at_the_equilibrium(p: float = 0.0) -> zivi.Trajectory:
    """Nothing but the spring, the damper and, if asked for, a pressure on the wall."""
    relative = zivi.SwitchedRK(rtol=1e-9, atol=1e-30)  # the speeds fall to 1e-12 m/s
    return zivi.simulate(oscillator(0.5, 1.0, 0.0, p), (0, 100), (1, 0), relative)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    sol = sticking()
    left = [(1.5 + 2 * k) * math.pi / 0.6 for k in range(3)]
    for name, found, expected in [
        ("rests at", sol.zeno_times, STICK_ZENO),
        ("leaves at", sol.liftoff_times, left),
    ]:
        print(f"{name:10}", *(f"{a:.9f} ({b:.9f})" for a, b in zip(found, expected, strict=True)))
    pressed = zivi.simulate(oscillator(0.6, 2.0, 0.5, 1.0), (0, 20), (1, 0), TIGHT)
    print(f"pressed: rests from {pressed.rest_time:.9f} s on ({PRESSED_ZENO:.9f})")

    periodic = zivi.simulate(oscillator(0.7, 2.2), (0, 300), (1, 0), TIGHT).impacts[-1]
    period = 2 * math.pi / 2.2
    phase = periodic["t"] % period, PERIODIC[0] % period
    print(f"one period: impact at {phase[0]:.9f} s ({phase[1]:.9f})", end=", ")
    print(f"speed after it {periodic['xdot_after']:.9f} m/s ({PERIODIC[1]:.9f})")
    for omega, e in [(2.2, 0.7), (2.8, 0.8)]:
        points = section(oscillator(e, omega), omega, 600, 100)
        distinct = len(np.unique(np.round(points, 6), axis=0))
        print(f"omega = {omega}: {distinct} distinct points in 100 periods")

    sol = at_the_equilibrium()
    flights, speeds = np.diff(sol.impacts["t"]), sol.impacts["xdot_after"]
    flight = math.pi / math.sqrt(1 - ZETA**2)
    print(f"wall at the equilibrium: {len(speeds)} impacts, down to {speeds[-1]:.1e} m/s", end=", ")
    print(f"flights {flights.min():.6f} .. {flights.max():.6f} s ({flight:.6f})", end=", ")
    ratios = speeds[1:] / speeds[:-1]
    share = 0.5 * math.exp(-ZETA * flight)
    print(f"ratios {ratios.min():.6f} .. {ratios.max():.6f} ({share:.6f})", end=", ")
    print(f"Zeno points: {len(sol.zeno_times)}, rest: {sol.rest_time}")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the sticking motion, the section of the chaos, and speeds with and without a rest."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(11.5, 3.5))
    sol, times = sticking(), np.linspace(0, 30, 3001)
    axes[0].plot(times, sol(times)[0], color=zivi.plot.BLUE)
    ends = [*sol.liftoff_times, 30.0]
    for start, end in zip(sol.zeno_times, ends, strict=False):
        axes[0].axvspan(start, end, color="0.9")
    axes[0].text(0.2, 1.75, "grey: at rest", fontsize="small")
    axes[0].set_ylim(-0.08, 1.9)
    axes[0].set(xlabel="time $t$ (s)", ylabel="position $x$ (m)")
    axes[0].set_title("$\\omega = 0.6$, $e = 0.5$: sticks", fontsize="medium")

    points = section(oscillator(0.8, 2.8), 2.8, 6000, 5900)
    axes[1].plot(*points.T, ".", ms=0.8, color=zivi.plot.BLUE)
    axes[1].set(xlabel="position $x$ (m)", ylabel=r"velocity $\dot x$ (m/s)")
    axes[1].set_title("$\\omega = 2.8$, $e = 0.8$: once a period", fontsize="medium")

    for p, color, marker in [(0.0, zivi.plot.BLUE, "."), (0.02, zivi.plot.ORANGE, "x")]:
        impacts = at_the_equilibrium(p).impacts_down_to(1e-12)
        label = f"pressed with {p} m/s$^2$" if p else "wall at the equilibrium"
        axes[2].semilogy(
            impacts["t"], impacts["xdot_after"], marker, color=color, ms=4, label=label
        )
    axes[2].set(xlabel="time of the impact (s)", ylabel="speed after it (m/s)")
    axes[2].set_title("unforced, $e = 0.5$", fontsize="medium")
    axes[2].legend(fontsize="small")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
