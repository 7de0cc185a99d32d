"""An arm of two links that taps a table while its tip swings, with one thing wrong at a time."""

import numpy as np

import zivi
from mechanical_arms import angles, tapping_tip, tracker, two_links


def _believed(**parameters):
    return {"system": two_links().replace(**parameters)}


def _seen(noise, rate):
    return {"noise": (noise, rate), "seed": 1}


ROWS = {
    "exact": ({}, {}, 2.0e-6, 3e-5),
    "masses +20 %": (_believed(m1=1.2, m2=0.96), {}, 2.2e-6, 1.5e-3),
    "masses -20 %": (_believed(m1=0.8, m2=0.64), {}, 1.9e-6, 2.1e-3),
    "links +1 %": (_believed(l1=0.505, l2=0.4545), {}, 4.8e-3, 6.9e-3),
    "e believed 0.55": (_believed(e=0.55), {}, 2.0e-6, 3e-5),
    "e believed 0.7": (_believed(e=0.7), {}, 2.2e-6, 3e-5),
    "floor +0.1 mm": (_believed(d=0.3001), {}, 9.7e-5, 1.4e-4),
    "floor -0.1 mm": (_believed(d=0.2999), {}, 9.7e-5, 1.4e-4),
    "noise 1e-6, 1e-4": ({}, _seen(1e-6, 1e-4), 1.0e-6, 3e-5),
    "noise 1e-5, 1e-3": ({}, _seen(1e-5, 1e-3), 4.5e-6, 3e-5),
    "the same, horizon 3": ({"horizon": 3.0}, _seen(1e-5, 1e-3), 9.5e-6, 3e-5),
    "noise 1e-4, 1e-2, horizon 5": ({"horizon": 5.0}, _seen(1e-4, 1e-2), 6.9e-5, 1.1e-4),
    "encoder 1e-5": ({}, {"quantization": 1e-5}, 1.7e-6, 3e-5),
    "delay 2": ({}, {"delay": 2}, 5.7e-4, 8e-4),
    "delay 2, predicted": ({"delay": 2}, {"delay": 2}, 2.0e-6, 3e-5),
    "delay 5, predicted": ({"delay": 5}, {"delay": 5}, 2.0e-6, 3.1e-5),
    "start 10, 5 cm off": ({}, {"off": np.array([0.05, 0.15])}, 2.0e-6, 2e-4),
}
"""What is believed, what is wrong, and the errors of an independent prototype: root mean squares of
the gap (m) and of the angles (rad) from 0.4 to 1 s. Where its tip swung is not known."""


def robust(name):
    """Give the loop of a row."""
    settings, asked, *_ = ROWS[name]
    asked = dict(asked)
    start = angles(0.35, -0.05) + asked.pop("off", np.zeros(2))
    return zivi.simulate_closed_loop(
        two_links(),
        tracker(**settings),
        (0, 1.5),
        (start, np.zeros(2)),
        reference=tapping_tip(),
        method=zivi.RKPeriod(),
        **asked,
    )


def posture_error(run):
    """The root mean square error of the angles while the gap bounces."""
    part = (run.t > 0.4) & (run.t < 1.0)
    return float(np.sqrt(np.mean((run.q - run.q_ref)[part] ** 2)))
