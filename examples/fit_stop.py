r"""A fit of a stop that a structure hits: stiffnesses, restitution and clearance.

Two storeys are released with a velocity of the lower one; the upper one hits a stop. A sensor
measures the lower storey only, with 2 mm of noise. From a start that is far away, the growing
windows of `zivi.fit` find the optimum, while least squares on the whole record stop in a local
minimum: over one stiffness the sum of squares of the first second has one minimum, of the whole
record many, since impacts appear and vanish. In brackets: true values.

Run as ``python examples/fit_stop.py [out.png]``.
"""

import sys

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import zivi

TRUTH = {"k1": 10.0, "k12": 20.0, "e": 0.6, "d": 0.1}
START = {"k1": 20.0, "k12": 45.0, "e": 0.3, "d": 0.06}
BOUNDS = {"k1": (1, 40), "k12": (1, 60), "e": (0, 1), "d": (0.02, 0.3)}
TIMES = np.linspace(0.06, 6.0, 100)
NOISE, Y0 = 2e-3, ([0.0, 0.0], [1.0, 0.0])


def build(k1: float, k12: float, d: float) -> zivi.LinearSystem:
    """Build the structure: unit masses (kg), stiffnesses (N/m), clearance (m)."""
    K = [[k1 + k12, -k12], [-k12, k12]]
    stop = zivi.LinearGap([0.0, -1.0], d, name="stop")
    return zivi.LinearSystem(np.eye(2), None, K, gaps=[stop], e=0.5, coordinates=["low", "high"])


SYSTEM = zivi.ParametricSystem(build, {"k1": 1.0, "k12": 1.0, "d": 1.0})


def measured(seed: int = 0) -> zivi.Record:
    """Measure the lower storey."""
    run = zivi.simulate(SYSTEM.replace(**TRUTH), (0, 6), Y0, zivi.SwitchedRK(rtol=1e-10))
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(TIMES))
    return zivi.Record(TIMES, run(TIMES)[0][:, 0] + noise, sigma=NOISE, of="low")


def whole_record(record: zivi.Record) -> float:
    """Return the cost of least squares on the whole record from the same start."""
    f = zivi.interop.run_function(
        SYSTEM.replace(**START), (0, 6), Y0, tuple(TRUTH), "positions", times=TIMES
    )

    def misfit(p: np.ndarray) -> np.ndarray:
        return (np.asarray(f.evaluate(p).value)[:, 0] - record.values) / NOISE

    def slopes(p: np.ndarray) -> np.ndarray:
        return f.evaluate(p).derivative[:, 0] / NOISE

    bounds = np.transpose(list(BOUNDS.values()))
    start = list(START.values())
    return float(least_squares(misfit, start, slopes, tuple(bounds), x_scale="jac").cost)


def squares(record: zivi.Record, k12: NDArray[np.float64], end: float) -> NDArray[np.float64]:
    """Return mean squares of the residuals up to a time, over one stiffness."""
    early = record.t <= end
    systems = [SYSTEM.replace(**TRUTH | {"k12": float(it)}) for it in k12]
    runs = [zivi.simulate(it, (0, 6), Y0)(record.t[early])[0][:, 0] for it in systems]
    return np.mean(((np.array(runs) - record.values[early]) / NOISE) ** 2, axis=1)


def minima(values: NDArray[np.float64]) -> int:
    """Count the local minima of a curve."""
    inner = values[1:-1]
    return int(np.count_nonzero((inner < values[:-2]) & (inner < values[2:])))


def main(path: str | None) -> None:
    """Fit, print the result with the true values, and draw if a path is given."""
    record = measured()
    found = zivi.fit(SYSTEM.replace(**START), record, tuple(TRUTH), y0=Y0, bounds=BOUNDS, starts=1)
    for name, true in TRUTH.items():
        print(f"{name:3} {found.values[name]:8.4f} +- {found.std[name]:.4f} ({true})")
    print(f"cost {found.cost:.1f}; least squares on the whole record {whole_record(record):.0f}")
    k12 = np.linspace(1.0, 60.0, 237)
    curves = {end: squares(record, k12, end) for end in (1.0, 6.0)}
    for end, values in curves.items():
        print(f"first {end:.0f} s: minima over k12: {minima(values)}")
    if path is not None:
        draw(path, record, found, k12, curves)


def draw(
    path: str,
    record: zivi.Record,
    found: zivi.Fit,
    k12: NDArray[np.float64],
    curves: dict[float, NDArray[np.float64]],
) -> None:
    """Draw data and fit, and the sums of squares over one stiffness."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    plt.style.use("zivi.plot.figures")
    figure, (left, right) = plt.subplots(1, 2, layout="constrained", figsize=(9.6, 3.6))
    t = np.linspace(0.0, 6.0, 601)
    left.plot(record.t, record.values, ".", color="0.6", label="lower storey, measured")
    left.plot(t, found.trajectory(t)[0][:, 0], color=zivi.plot.BLUE, label="fit")
    left.set(xlabel="time $t$ (s)", ylabel="displacement (m)", title="a structure hits a stop")
    for (end, values), colour in zip(
        curves.items(), (zivi.plot.ORANGE, zivi.plot.BLUE), strict=True
    ):
        right.semilogy(k12, values, color=colour, lw=1.0, label=f"first {end:.0f} s")
    right.set(xlabel="stiffness $k_{12}$ (N/m)", ylabel="mean square / $\\sigma^2$")
    right.set_title("local minima")
    for ax in (left, right):
        ax.legend(frameon=False)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
