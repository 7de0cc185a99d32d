"""The paper's tracking loop in python-control, and an actuator with a lag from its library.

A plant with impacts, the tracker and the forces that it is told are blocks with the sampling
period as ``dt``; `control.interconnect` joins them by the names of their signals, and
`control.input_output_response` runs the loop. Between samples the plant moves exactly: the result
is that of `zivi.simulate_closed_loop`, to the last bit. So is the one with a delay of a period,
``1/z`` between tracker and plant.

What `simulate_closed_loop` does not have is an actuator: here one with a first-order lag,
``tau u_a' = u - u_a``, discretised by `control.c2d`.

Run as ``python examples/python_control.py [out.png]`` (needs python-control).
"""

import sys

import control as ct
import numpy as np

import zivi
from zivi.control import ClosedLoop
from zivi.interop import controller_block, force_block, impact_plant, state_vector

H, GRAVITY, GRAVITY_REF = 1e-3, -9.81, -19.81
TIMES = np.arange(2001) * H
PLANT = zivi.ImpactSystem(GRAVITY, kappa=0.5)
START, START_REF = (6.0, 5.0), (3.0, 3.0)
LAGS = (1e-3, 2e-3, 5e-3, 1e-2)
"""Time constants of the actuator (s)."""
SIGNALS = ("x", "xdot", "u", "x_ref")
"""What is looked at; u is what acts on the plant."""


def tracker() -> zivi.TwistingTracker:
    """Make the paper's tracker, its reference at the start."""
    made = zivi.TwistingTracker(30, 17, h=H, kappa=0.5)
    made.reset(*START_REF)
    return made


def response(actuator: ct.InputOutputSystem | None = None) -> ct.TimeResponseData:
    """Run the loop in python-control, with an actuator ``u -> acting`` if there is one."""
    plant, controller = impact_plant(PLANT, H), tracker()
    blocks = [
        plant,
        controller_block(controller),
        force_block(GRAVITY, H),
        force_block(GRAVITY_REF, H, inputs=("x_ref", "xdot_ref"), output="force_ref"),
    ]
    start = [*START, *state_vector(controller)]
    if actuator is not None:
        plant.update_names(inputs=["acting"])
        blocks.append(actuator)
        start += [0.0] * len(actuator.state_labels)
    outputs = ["x", "xdot", *plant.input_labels, "x_ref"]
    loop = ct.interconnect(blocks, inputs=[], outputs=outputs)
    return ct.input_output_response(loop, TIMES, 0, X0=start)


def delay() -> ct.InputOutputSystem:
    """Make an actuator that acts a period later."""
    return ct.ss([[0.0]], [[1.0]], [[1.0]], [[0.0]], H, inputs=["u"], outputs=["acting"])


def lag(tau: float) -> ct.InputOutputSystem:
    """Make an actuator with the time constant `tau` (s)."""
    continuous = ct.ss([[-1 / tau]], [[1 / tau]], [[1.0]], [[0.0]])
    return ct.c2d(continuous, H, "zoh", inputs=["u"], outputs=["acting"])


def with_zivi(delay: int = 0) -> ClosedLoop:
    """Run the same loop in zivi."""
    return zivi.simulate_closed_loop(
        PLANT, tracker(), (0, TIMES[-1]), START, force_ref=GRAVITY_REF, delay=delay
    )


def difference(found: ct.TimeResponseData, run: ClosedLoop) -> float:
    """Largest difference of any signal of two runs at any sample (SI units)."""
    signals = zip(SIGNALS, found.outputs, strict=True)
    # zivi's last control is a repetition
    return max(float(np.abs(y - getattr(run, name))[:-1].max()) for name, y in signals)


def times_of(run: ct.TimeResponseData) -> tuple[float, float]:
    """Tell when the reference is last 1 cm away, and when the mass last moves (s)."""
    x, xdot, _, x_ref = run.outputs
    away, moving = np.abs(x - x_ref) > 1e-2, (x != 0.0) | (xdot != 0.0)
    return float(TIMES[np.flatnonzero(away)[-1]]), float(TIMES[np.flatnonzero(moving)[-1]])


def main(path: str | None = None) -> None:
    """Print the differences and what the lag costs; draw the figure into `path`."""
    plain = response()
    print(f"same loop in zivi: differs by {difference(plain, with_zivi()):g} at most")
    late = difference(response(delay()), with_zivi(delay=1))
    print(f"1/z before the plant, delay=1 in zivi: differs by {late:g} at most")
    found = {tau: response(lag(tau)) for tau in LAGS}
    for tau, run in found.items():
        reached, rests = times_of(run)
        print(
            f"lag of {1e3 * tau:2g} ms: within 1 cm of the reference from {reached:.3f} s on, "
            f"at rest from {rests:.3f} s on"
        )
    if path is not None:
        draw(plain, found, path)


def draw(plain: ct.TimeResponseData, found: dict[float, ct.TimeResponseData], path: str) -> None:
    """Draw positions and controls without a lag and with the longest one."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    from zivi.plot import BLUE, GREEN, ORANGE

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.2), layout="constrained")
    tau = max(LAGS)
    for run, color, label in (
        (plain, BLUE, "no lag"),
        (found[tau], ORANGE, f"lag of {1e3 * tau:g} ms"),
    ):
        x, _, u, x_ref = run.outputs
        left.plot(TIMES, x, color=color, label=f"$x$, {label}")
        right.step(TIMES, u, where="post", color=color, lw=0.8, label=label)
    left.plot(TIMES, x_ref, color=GREEN, ls="--", label="$x_r$")
    left.set(xlabel="time $t$ (s)", ylabel="position $x$ (m)", xlim=(0, 2))
    right.set(xlabel="time $t$ (s)", ylabel="control $u$ (m/s$^2$)", xlim=(0, 2))
    left.legend(loc="upper left", bbox_to_anchor=(1, 1))
    right.legend(loc="upper left", bbox_to_anchor=(1, 1))
    figure.suptitle("A loop in python-control, without and with a lag of the actuator")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(*sys.argv[1:2])
