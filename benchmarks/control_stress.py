"""Exact rest of the tracker under everything at once: random plants, gains, periods and troubles.

Restitution .02 to .97, mu1 5 to 160, mu2/mu1 .1 to .9, periods 1e-4 to 1e-2 s, forces -15 to 3; an
unknown force of up to 0.8 min(U, D), noise up to (3e-3 m, .1 m/s), coarse sensors, delays, an e
that is believed wrong by up to 20 %, actuator limits. The reference rests. Runs at exact rest at
the end, with landing and by the paper's law; for each that is not, what it was.

Run as ``python benchmarks/control_stress.py [runs of each kind]``: 20 take some seconds.
"""

import math
import sys
import warnings
from typing import Any

import numpy as np

import zivi
from control_landing import accelerations, settling

KINDS = (
    "none", "d const out", "d const in", "d sine", "noise", "quantised", "delay 1", "delay 3",
    "e model", "limits",
)  # fmt: skip


def draw(kind: str, seed: int) -> dict[str, Any]:
    """Draw a run."""
    rng = np.random.default_rng((KINDS.index(kind), seed))
    e, mu1, h = rng.uniform(0.02, 0.97), 5 * 32 ** rng.random(), 10 ** rng.uniform(-4, -2)
    mu2, force = mu1 * rng.uniform(0.1, 0.9), rng.uniform(-15, 3)
    up, down = accelerations(mu1, mu2, e)
    most = 0.8 * rng.random() * min(up, down) * (kind[0] == "d" and kind[1] == " ")
    x, v = rng.uniform(0, 2), rng.uniform(-4, 4)
    believed, tracker, loop = e, {}, {}
    true: Any = force + {"d const out": most, "d const in": -most}.get(kind, 0.0)
    if kind == "d sine":
        omega, phase = 2 * np.pi * 10 ** rng.uniform(-0.5, 1.5), rng.uniform(0, 6)
        true = zivi.LinearForce(gravity=-force, amplitude=most, omega=omega, phase=phase)
    elif kind == "noise":
        loop = {"noise": (3e-3 * rng.random(), 0.1 * rng.random()), "seed": seed}
    elif kind == "quantised":
        loop["quantization"] = (3e-3 * rng.random(), 0.1 * rng.random())
    elif kind.startswith("delay"):
        loop["delay"] = int(kind[-1])
        tracker["ahead"] = 1 + loop["delay"]
    elif kind == "e model":
        believed = min(e * rng.uniform(0.8, 1.2), 0.99)
    elif kind == "limits":
        # at least what presses it down and brakes it
        tracker["u_limits"] = -force - down * rng.uniform(1, 3), -force + down * rng.uniform(1, 3)
    # the time of the settling formula at the worst of the unknown force, and what sampling adds
    slow = settling(x, v, mu1, mu2, e) * (1 + 2 * most / (min(up, down) - most + 1e-9))
    late = slow + 3 * (1 + loop.get("delay", 0)) * h * (2 / (1 - e)) * max(1, up / down) + 20 * h
    if kind == "limits":
        late *= 10  # the mass may rise against little more than D
    return {
        "plant": zivi.ImpactSystem(true, e=e), "gains": (mu1, mu2), "h": h, "e": believed,
        "tracker": tracker, "loop": loop, "y0": (x, v), "force": force, "end": 1.5 * late + 0.2,
        "ratio": e * math.sqrt((down + most) / (up - most)),
    }  # fmt: skip


def rests(it: dict[str, Any], *, landing: bool) -> bool:
    """Tell whether a run is at exact rest at the end."""
    settings = (
        it["tracker"] if landing else {k: v for k, v in it["tracker"].items() if k != "ahead"}
    )
    tracker = zivi.TwistingTracker(
        *it["gains"], h=it["h"], e=it["e"], landing=landing, **settings
    )  # fmt: skip
    given = {
        "y_ref0": (0, 0), "force_ref": -9.81, "force_model": it["force"], **it["loop"],
    }  # fmt: skip
    if "noise" in given:
        run = zivi.simulate_closed_loop(
            it["plant"], tracker, (0, it["end"]), it["y0"], dense_output=False, **given
        )
        return bool(run.x[-1] == 0 and run.xdot[-1] == 0)
    batch = zivi.simulate_closed_loop_batch(
        it["plant"], tracker, (0, it["end"]), it["y0"], threads=1, **given
    )
    return bool(batch.x[0] == 0 and batch.xdot[0] == 0 and batch.rest_time[0] <= batch.t[0])


def main(runs: int = 20) -> None:
    """Print the counts."""
    warnings.simplefilter("ignore", zivi.ModelWarning)
    print(f"at rest of {runs}: the paper's law -> landing")
    for kind in KINDS:
        # a mass that the worst force keeps bouncing is not meant to rest; nor are longer runs
        draws = (draw(kind, seed) for seed in range(100 * runs))
        fit = (it for it in draws if it["ratio"] < 0.95 and it["end"] < 5e4 * it["h"])
        several = [it for it, _ in zip(fit, range(runs), strict=False)]
        landed = [rests(it, landing=True) for it in several]
        paper = sum(rests(it, landing=False) for it in several)
        print(f"  {kind:12} {paper:3d} -> {sum(landed):3d} of {len(several)}", flush=True)
        for it, good in zip(several, landed, strict=True):
            if not good:
                print("     not at rest:", {k: v for k, v in it.items() if k != "plant"})


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
