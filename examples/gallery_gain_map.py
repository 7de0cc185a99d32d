r"""Gain map of the tracker: how long until the mass is within a centimetre of its reference.

The paper's problem: a mass under gravity (``F = -9.81``, e = 1/3) from ``(6, 5)`` follows a ball
that falls with ``F_r = -19.81`` from ``(3, 3)``, bounces and rests; sampled with 1 ms. A study over
the gains: ``settling`` is the last time at which ``|x - x_ref| > 1 cm``.

In one map the controller knows the force. In the other ``M = 9.81`` outward is missing from its
model, ``-9.81 - M``. For a force of at most M that is not known the gains should satisfy

    M < mu2 < mu1 - M

Under this force all 861 pairs inside settle, outside 450 of 864 do within 12 s. (What suffices for
any force up to M has ``M (1 + e)/(2 e)`` in place of M: at e = 0.1 gains of 30 and 17 are 93 m off
under the same 9.81.) With a known force (M = 0) all gains that a tracker takes, 0 < mu2 < mu1,
settle.

Run as ``python examples/gallery_gain_map.py [out.png]``.
"""

import functools
import math
import sys
from typing import TYPE_CHECKING

import numpy as np

import zivi

if TYPE_CHECKING:
    import xarray

GRAVITY, KAPPA, H = 9.81, 0.5, 1e-3
CLOSE = 0.01
"""Distance from the reference that is sought (m)."""
T_END, LIMIT = 16.0, 12.0
"""End of the runs, and the latest time that counts as settled: it stays close to the end (s)."""
MISSING = (0.0, 9.81)
"""Forces outward that the controller does not know (m/s^2)."""
GAINS = {"mu1": np.arange(1.0, 61.0), "mu2": np.arange(1.0, 51.0)}
SLOW = 5.0
"""Later times are drawn alike (s)."""
PAPER = {"mu1": 30.0, "mu2": 17.0}


def settling(mu1: float, mu2: float, missing: float) -> float:
    """Time until the reference is reached (s): inf if it is not, NaN where there is no tracker."""
    if not mu2 < mu1:
        return math.nan
    run = zivi.simulate_closed_loop(
        zivi.ImpactSystem(-GRAVITY, kappa=KAPPA),
        zivi.TwistingTracker(mu1, mu2, h=H, kappa=KAPPA, landing=False),  # the law alone
        (0, T_END),
        (6, 5),
        y_ref0=(3, 3),
        force_ref=-19.81,
        force_model=-GRAVITY - missing,
    )
    last = float(run.t[np.abs(run.error) > CLOSE][-1])
    return last if last <= LIMIT else math.inf


@functools.cache
def gain_map() -> "xarray.DataArray":
    """Settling times over mu1, mu2 and the missing force."""
    study = zivi.sweep(
        settling,
        {**GAINS, "missing": MISSING},
        executor="threads",
        units={"mu1": "m/s^2", "mu2": "m/s^2", "missing": "m/s^2", "value": "s"},
    )
    return study.value


def main(path: str | None = None) -> None:
    """Print how many settle, and draw if a path is given."""
    times = gain_map()
    print(f"30, 17: {float(times.sel({**PAPER, 'missing': 0})):.3f} s (1.210)")
    mu1, mu2 = np.meshgrid(*GAINS.values(), indexing="ij")
    for bound in MISSING:
        settled = np.isfinite(times.sel(missing=bound).values)
        inside = (bound < mu2) & (mu2 < mu1 - bound)
        outside = (mu2 < mu1) & ~inside
        print(
            f"missing {bound} m/s^2: inside the condition {settled[inside].sum()} of "
            f"{inside.sum()} settle, outside {settled[outside].sum()} of {outside.sum()}"
        )
    if path is not None:
        draw(path)


def draw(path: str) -> None:
    """Draw a map for each missing force, with the condition."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.colors import LogNorm

    plt.style.use("zivi.plot.figures")
    figure, axes = plt.subplots(1, 2, layout="constrained", figsize=(10.6, 4.4), sharey=True)
    colors = mpl.colormaps["viridis_r"].with_extremes(over="0.55")
    meshes = []
    for ax, bound in zip(axes, MISSING, strict=True):
        times = gain_map().sel(missing=bound)
        shown = np.where(np.isinf(times), 2 * SLOW, np.minimum(times, SLOW))
        meshes.append(
            ax.pcolormesh(*GAINS.values(), shown.T, cmap=colors, norm=LogNorm(0.85, SLOW))
        )
        corner = 2 * bound + 1e-9
        border = {"color": zivi.plot.ORANGE, "lw": 1.6}
        ax.plot([60.5, corner, 60.5], [bound, bound, 60.5 - bound], **border)
        ax.plot(*PAPER.values(), "o", mec="k", mfc="w", ms=6)
        ax.set(xlabel="$\\mu_1$ (m/s$^2$)", xlim=(0.5, 60.5), ylim=(0, 50.5))
    time = float(gain_map().sel({**PAPER, "missing": 0}))
    axes[0].annotate(f"{time:.2f} s", tuple(PAPER.values()), (6, -12), textcoords="offset points")
    axes[0].set_ylabel("$\\mu_2$ (m/s$^2$)")
    axes[0].set_title("force known", fontsize="medium")
    axes[1].set_title(f"{MISSING[1]} m/s$^2$ outward not known", fontsize="medium")
    ticks = [1, 1.2, 1.5, 2, 3, SLOW]
    bar = figure.colorbar(meshes[-1], ax=axes, extend="max", ticks=ticks)
    bar.minorticks_off()
    bar.ax.set_yticklabels([*(f"{tick:g}" for tick in ticks[:-1]), f"{SLOW:g} .. {LIMIT:g}"])
    bar.set_label("last time more than 1 cm away (s); grey: later")
    figure.savefig(path, dpi=160)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
