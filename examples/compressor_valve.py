r"""A reed valve of a compressor: when it opens, how hard it touches down, how long it bounces.

The reed, a mass on a spring, lies on its seat under the preload y0; a pulse of the pressure lifts
it by x. Per unit mass

    x'' = -omega0^2 (x + y0) - 2 zeta omega0 x' + P exp(-((t - tp)/tau)^2),      x >= 0

and the seat returns the share e of the speed. It opens when the pulse exceeds the preload, at

    t = tp - tau sqrt(log(P/(omega0^2 y0)))

The speed of the first contact and the energy that the seat takes,
``E = sum of (1 - e^2)/2 x'^2`` over all impacts, decide how long reed and seat live. Restitution
changes neither the opening nor the first contact, but the bounces and the time until the valve is
shut; the preload changes all of them; damping makes the touchdown soft.

Left out: the stop that limits the lift (a second contact), and what the valve does to the pressure.

It touches down with 1 m/s at 0.4164 of the critical damping. In brackets: the expected values.

Run as ``python examples/compressor_valve.py [out.png]``.
"""

import dataclasses
import math
import sys

import numpy as np

import zivi

OMEGA0 = 2 * math.pi * 150.0
"""Natural frequency of the reed (rad/s)."""
PULSE, PEAK, WIDTH = 2000.0, 5e-3, 1.5e-3
"""P (m/s^2), tp and tau (s)."""
T_END, AUDIBLE = 0.03, 0.02
"""End of a cycle (s), and the smallest speed that counts as a bounce (m/s)."""
METHOD = zivi.SwitchedRK(rtol=1e-10, atol=1e-13, max_step=WIDTH / 2)
"""At rest a pulse is only seen by steps that are not longer than it."""


@dataclasses.dataclass(frozen=True)
class Valve:
    """A valve.

    Attributes
    ----------
    e : float
        Restitution of the seat.
    preload : float
        y0 (m).
    zeta : float
        Share of the critical damping.
    """

    e: float = 0.3
    preload: float = 0.5e-3
    zeta: float = 0.1

    def force(self, t: float, x: float, xdot: float) -> float:
        """Force per unit mass (m/s^2)."""
        pulse = PULSE * math.exp(-(((t - PEAK) / WIDTH) ** 2))
        return pulse - OMEGA0**2 * (x + self.preload) - 2 * self.zeta * OMEGA0 * xdot

    @property
    def opening(self) -> float:
        """Time of the opening in closed form (s)."""
        return PEAK - WIDTH * math.sqrt(math.log(PULSE / (OMEGA0**2 * self.preload)))

    def cycle(self) -> zivi.Trajectory:
        """Open and close it once."""
        system = zivi.ImpactSystem(self.force, e=self.e)
        return zivi.simulate(system, (0, T_END), (0, 0), METHOD)


@dataclasses.dataclass(frozen=True)
class Landing:
    """What matters of a cycle.

    Attributes
    ----------
    opens, lands, shut : float
        Times of the opening, of the first contact, and from which the valve stays shut (s).
    lift : float
        Largest lift (m).
    speed : float
        Speed of the first contact (m/s).
    bounces : int
        Impacts that leave at least `AUDIBLE`.
    energy : float
        What the seat takes per unit mass (J/kg).
    """

    opens: float
    lands: float
    shut: float
    lift: float
    speed: float
    bounces: int
    energy: float


def landing(valve: Valve) -> Landing:
    """Run a cycle and measure it."""
    sol = valve.cycle()
    first = sol.impacts[0]
    impacts = sol.impacts_down_to(1e-9)
    return Landing(
        opens=float(sol.liftoff_times[0]),
        lands=float(first["t"]),
        shut=float(sol.rest_time),
        lift=float(sol(np.linspace(0, T_END, 3001))[0].max()),
        speed=float(-first["xdot_before"]),
        bounces=int(np.sum(impacts["xdot_after"] >= AUDIBLE)),
        energy=float((1 - valve.e**2) / 2 * np.sum(impacts["xdot_before"] ** 2)),
    )


def damping_for(speed: float) -> float:
    """Bisect for the damping with which the first contact has a speed."""
    low, high = 0.0, 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        softer = landing(Valve(zeta=middle)).speed < speed
        low, high = (low, middle) if softer else (middle, high)
    return 0.5 * (low + high)


def main(path: str | None) -> None:
    """Measure, print beside what is expected, and draw if a path is given."""
    valves = [Valve(e=e) for e in (0.0, 0.2, 0.4, 0.6)]
    valves += [Valve(preload=preload) for preload in (0.2e-3, 1.0e-3, 1.5e-3)]
    for valve in valves:
        m = landing(valve)
        print(
            f"e = {valve.e}, preload {valve.preload * 1e3:.1f} mm: opens at {m.opens * 1e3:.6f} ms "
            f"({valve.opening * 1e3:.6f}), lift {m.lift * 1e3:.3f} mm, lands with {m.speed:.4f} m/s"
            f" at {m.lands * 1e3:.3f} ms, {m.bounces} bounces, shut at {m.shut * 1e3:.3f} ms, "
            f"the seat takes {m.energy:.4f} J/kg"
        )
    zeta = damping_for(1.0)
    soft = landing(Valve(zeta=zeta))
    print(f"it lands with {soft.speed:.6f} m/s (1) if the damping is {zeta:.4f} of the critical")
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw the lift, and the touchdown over the restitution and over the preload."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(11.5, 3.5))
    times = np.linspace(0, 0.02, 2001)
    for e, color in [(0.0, "0.5"), (0.3, zivi.plot.BLUE), (0.6, zivi.plot.ORANGE)]:
        x, _ = Valve(e=e).cycle()(times)
        axes[0].plot(times * 1e3, x * 1e3, color=color, label=f"$e = {e}$", lw=1.2)
    axes[0].set(xlabel="time $t$ (ms)", ylabel="lift $x$ (mm)")
    axes[0].set_title(r"preload 0.5 mm, $\zeta = 0.1$", fontsize="medium")
    axes[0].legend()

    restitutions = np.linspace(0.0, 0.7, 29)
    landings = [landing(Valve(e=e)) for e in restitutions]
    bouncing = [(m.shut - m.lands) * 1e3 for m in landings]
    axes[1].plot(restitutions, bouncing, color=zivi.plot.BLUE, label="time of bouncing (ms)")
    count = [m.bounces for m in landings]
    axes[1].step(
        restitutions, count, where="mid", color=zivi.plot.ORANGE, label="number of bounces"
    )
    axes[1].set(xlabel="restitution $e$")
    axes[1].set_title(r"preload 0.5 mm, $\zeta = 0.1$", fontsize="medium")
    axes[1].legend()

    preloads = np.linspace(0.1e-3, 2.0e-3, 39)
    for zeta, style in [(0.1, "-"), (0.4, "--")]:
        landings = [landing(Valve(preload=preload, zeta=zeta)) for preload in preloads]
        for values, color, label in [
            ([m.speed for m in landings], zivi.plot.BLUE, "touchdown speed (m/s)"),
            ([m.energy for m in landings], zivi.plot.ORANGE, "energy (J/kg)"),
        ]:
            label = f"{label}, $\\zeta = {zeta}$"
            axes[2].plot(preloads * 1e3, values, color=color, ls=style, label=label)
    axes[2].set(xlabel="preload $y_0$ (mm)", ylim=(0, 3.6))
    axes[2].set_title("$e = 0.3$", fontsize="medium")
    axes[2].legend(fontsize="small")
    figure.suptitle("A compressor valve: lift, bounces, touchdown speed")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
