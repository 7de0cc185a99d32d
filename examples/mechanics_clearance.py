r"""A slider-crank with half a millimetre of play at the pin of the slider.

The pin of the rod moves within the bush of the slider: the gap is the clearance less the distance
of their centres, with restitution and dry friction. The crank turns uniformly, prescribed by an
equality row. The pin comes to rest on the bush by infinitely many
impacts and then rolls and slides along it.

The numbers in brackets are from the two equations of motion between impacts, by DOP853 of SciPy
with events, and from Newton's and Coulomb's laws at the impacts.

Run as ``python examples/mechanics_clearance.py [out.png]``.
"""

import sys

import numpy as np
from scipy.integrate import solve_ivp

import zivi

R, L, ROD, SLIDER, OMEGA = 0.05, 0.15, 0.3, 0.5, 30.0
CLEARANCE, PIN, MU, E, T, BEFORE = 5e-4, 0.01, 0.1, 0.5, 0.25, 3
X0 = R + L - 0.2 * CLEARANCE

DX, DY = f"({R}*cos(th) + {L}*cos(ph) - x)", f"({R}*sin(th) + {L}*sin(ph))"
FAR = f"sqrt({DX}**2 + {DY}**2)"
VX, VY = (
    f"(-{R}*sin(th)*thdot - {L}*sin(ph)*phdot - xdot)",
    f"({R}*cos(th)*thdot + {L}*cos(ph)*phdot)",
)
INERTIA = ROD * L**2 / 3
TWIST = f"{ROD * R * L / 2}*thdot*phdot*cos(th - ph)"

SYSTEM = zivi.symbolic.system(
    "th ph x",
    T=f"{ROD * R**2 / 2}*thdot**2 + {INERTIA / 2}*phdot**2 + {TWIST} + {SLIDER / 2}*xdot**2",
    gaps={"bush": f"{CLEARANCE} - {FAR}"},
    slips={"bush": f"({DX}*{VY} - {DY}*{VX})/{FAR} + {PIN}*phdot"},
    mu={"bush": MU},
    e=E,
    equalities={"drive": f"th - {OMEGA}*t"},
)


def run(tol: float = 1e-10) -> zivi.MechanicalTrajectory:
    """Turn the crank for more than a turn."""
    start = [0.0, 0.0, X0], [OMEGA, -OMEGA * R / L, 0.0]
    return zivi.simulate(SYSTEM, (0, T), start, zivi.SwitchedRK(rtol=tol, atol=1e-3 * tol))


def place(t: float, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where the pin is in the bush, and the direction across the rod."""
    th = OMEGA * t
    pin = R * np.array([np.cos(th), np.sin(th)]) + L * np.array([np.cos(y[0]), np.sin(y[0])])
    return pin - [y[1], 0.0], np.array([-np.sin(y[0]), np.cos(y[0])])


def strike(t: float, y: np.ndarray) -> np.ndarray:
    """Return the state after an impact, by Newton's and Coulomb's laws."""
    d, across = place(t, y)
    n, th = d / np.hypot(*d), OMEGA * t
    along = np.array([-n[1], n[0]])
    rows = np.array([[-L * n @ across, n[0]], [L * along @ across + PIN, -along[0]]])
    crank = R * OMEGA * np.array([-np.sin(th), np.cos(th)])
    before = rows @ y[2:] + [-n @ crank, along @ crank]
    push = rows / [INERTIA, SLIDER]
    mobility = rows @ push.T
    p = -np.linalg.solve(mobility, [(1 + E) * before[0], before[1]])
    if abs(p[1]) > MU * p[0]:
        edge = np.array([1.0, -MU * np.sign(before[1])])
        p = -(1 + E) * before[0] / (mobility[0] @ edge) * edge
    return np.array([*y[:2], *(y[2:] + p @ push)])


def reference() -> list[float]:
    """Return the times of the first impacts, by SciPy."""

    def slopes(t: float, y: np.ndarray) -> list[float]:
        return [y[2], y[3], ROD * L / 2 * R * OMEGA**2 * np.sin(OMEGA * t - y[0]) / INERTIA, 0.0]

    @zivi.event(terminal=True, direction=-1)
    def gap(t: float, y: np.ndarray) -> float:
        return float(CLEARANCE - np.hypot(*place(t, y)[0]))

    t, y, times = 0.0, np.array([0.0, X0, -OMEGA * R / L, 0.0]), []
    for _ in range(BEFORE):
        settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "max_step": 1e-3}
        sol = solve_ivp(slopes, (t, T), y, events=gap, **settings)
        t, y = float(sol.t[-1]), strike(sol.t[-1], sol.y[:, -1])
        times.append(t)
    return times


def main(path: str | None) -> None:
    """Turn the crank, print beside what is expected, and draw if a path is given."""
    sol = run()
    print(repr(sol))
    for found, t in zip(sol.impacts["t"], reference(), strict=False):
        print(f"impact at {found:.10f} s ({t:.10f})")
    rough = run(1e-7)
    print(f"slider at the end: {sol.q[-1, 2]:.8f} m ({rough.q[-1, 2]:.8f}, with rtol=1e-7)")
    if path is not None:
        draw(path, sol)


def draw(path: str, sol: zivi.MechanicalTrajectory) -> None:
    """Draw the path of the pin in the bush, the force in it, and the speed of the slider."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 3, layout="constrained", figsize=(10.4, 3.2))
    fine = sol.resample(n=6001)
    places = [place(t, q[1:]) for t, q in zip(fine.t, fine.q, strict=True)]
    way = 1e3 * np.array([it[0] for it in places])
    axes[0].plot(*way.T, lw=0.8)
    turn = np.linspace(0, 2 * np.pi, 200)
    axes[0].plot(*(1e3 * CLEARANCE * np.array([np.cos(turn), np.sin(turn)])), color="0.6", lw=0.8)
    axes[0].set(xlabel="pin in the bush, $x$ (mm)", ylabel="$y$ (mm)", aspect="equal")
    axes[1].plot(fine.t, fine.reactions[:, 0], lw=0.9)
    axes[1].set(xlabel="time $t$ (s)", ylabel="force at the pin (N)")
    axes[2].plot(fine.t, fine.qdot[:, 2], lw=0.9)
    axes[2].set(xlabel="time $t$ (s)", ylabel="speed of the slider (m/s)")
    figure.suptitle("A slider-crank with play: pin in the bush, force, slider")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
