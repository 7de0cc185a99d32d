"""Loops of the tracker of gaps of all kinds, each by one call, for tests that compare laws."""

import numpy as np

import zivi
from mechanical_arms import START, follow, tapping, tracker, two_links


def _linear(gaps, inputs, *, e=0.5, mass=None, **settings):
    """A loop of bodies without curvature that land."""
    n = len(gaps[0])
    system = zivi.MechanicalSystem(
        mass=np.diag(np.arange(1.0, n + 1)) if mass is None else mass,
        force=-9.81 * np.arange(1.0, n + 1),
        gaps=[zivi.LinearGap(row, name=f"g{i}") for i, row in enumerate(gaps)],
        e=e,
        inputs=inputs,
    )
    gains = dict.fromkeys(system.gap_names, (40, 22))
    ctl = zivi.GapTracker(system, h=1e-3, gains=gains, **settings)
    q = np.linalg.lstsq(np.array(gaps, dtype=float), 0.1 + 0.05 * np.arange(len(gaps)))[0]
    start = (q, np.linspace(0.3, -0.2, n))
    return zivi.simulate_closed_loop(
        system, ctl, (0, 0.8), start, reference="rest", method=zivi.RKPeriod()
    )


def _lift_off():
    reference = zivi.reference_run(
        two_links(),
        (0, 1.6),
        (START, np.zeros(2)),
        virtual={"floor": lambda t: -9.81 if t < 1.3 else 5.0},
        tstops=[1.3],
    )
    return follow(tracker(), reference=reference)


LOOPS = {
    "arm": lambda: follow(tracker()),
    "noise": lambda: follow(tracker(horizon=3.0), noise=(1e-5, 1e-3), seed=1),
    "shift": lambda: follow(tracker(shift=True), quantization=1e-5),
    "limits": lambda: follow(tracker(u_limits=[(-14, 14), (-5, 5)])),
    "predicted": lambda: follow(tracker(delay=2), delay=2),
    "positions": lambda: follow(
        tracker(horizon=3.0),
        noise=(1e-5, 0.0),
        seed=2,
        observer=zivi.JointObserver(two_links(), noise=1e-5),
    ),
    "lift-off": _lift_off,
    "swinging force": lambda: follow(tracker(force={"floor": lambda t: 10.0 + t})),
    "landing": lambda: follow(
        tracker(), reference={"floor": "rest", "posture": np.array([0.3, -1.3])}
    ),
    "drop": lambda: follow(
        tracker(),
        reference={
            "floor": zivi.simulate(zivi.ImpactSystem(-9.81, e=0.6), (0, 1.6), (0.12, 0)),
            "posture": lambda t: tapping()(t)[0],
        },
    ),
    "obtuse": lambda: _linear([[1, 0], [0.6, 0.8]], np.eye(2), e=[0.6, 0.5]),
    "acute": lambda: _linear(
        [[1, 0], [-0.5, 0.9]], np.eye(2), e=0.4, force={"g0": 10.0, "g1": 5.0}
    ),
    "three gaps": lambda: _linear([[1, 0, 0], [0.1, 1, 0], [0, 0.2, 1]], np.eye(3)),
    "fewer controls": lambda: _linear([[1, 0, 0.5]], [[1.0, 0], [0, 1], [0, 0.3]]),
    "more controls": lambda: _linear(
        [[1, 0]], [[1.0, 0, 1], [0, 1, -1]], u_limits=[(-30, 30), (-40, 40), (-9, 9)]
    ),
}
"""By name."""
