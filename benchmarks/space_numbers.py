"""Four problems with friction in two directions, as numbers: any interpreter can read them.

A ball of radius R, or a puck, on a slope; x points down the slope, z along its normal. States at
the end are closed forms, that of the ball that is thrown has 20 digits from tests/data/space.json.
"""

import math

G, R, MASS = 9.81, 0.2, 1.3


def stop(speed, fall, friction):
    """Return when a slip stops that falls by `fall` and is slowed by `friction`, and its path.

    v' = a cos(phi) - b and v phi' = -a sin(phi): v sin(phi) is proportional to tan(phi/2)^(b/a).
    """
    v, phi = math.hypot(*speed), math.atan2(speed[1], speed[0])
    if fall == 0.0:
        return v / friction, *(0.5 * v / friction * it for it in speed)
    a, b, p, u = fall, friction, friction / fall, math.tan(phi / 2)
    t = v * (b + a * math.cos(phi)) / (b * b - a * a)
    c = (v * math.sin(phi) * u**-p) ** 2
    x = c / (4 * a) * (u ** (2 * p - 2) / (2 * p - 2) - u ** (2 * p + 2) / (2 * p + 2))
    y = c / (2 * a) * (u ** (2 * p - 1) / (2 * p - 1) + u ** (2 * p + 1) / (2 * p + 1))
    return t, x, y


def puck(slope, mu, speed, end):
    """Return a puck that slides and stops."""
    t, x, y = stop(speed, G * math.sin(slope), mu * G * math.cos(slope))
    assert t < end
    truth = [x, y, 0.0, 0.0]
    return {"slope": slope, "mu": mu, "e": 0.0, "height": 0.0, "v": [*speed, 0.0],
            "turns": False, "omega": [0.0] * 3, "end": end, "truth": truth}  # fmt: skip


def rolling(slope, mu, v, omega, end):
    """Return a ball on the slope: it slips like a puck with 7/2 of the friction, then rolls."""
    fall, friction = G * math.sin(slope), mu * G * math.cos(slope)
    slip = v[0] - R * omega[1], v[1] + R * omega[0]
    t, *path = stop(slip, fall, 3.5 * friction)
    left, truth = end - t, []
    assert left > 0
    speeds = []
    for k, a in enumerate((fall, 0.0)):
        # v - v0 - a t = (W - W0 - a t) 2/7
        at_stop = v[k] + a * t + (0.0 - slip[k] - a * t) / 3.5
        place = v[k] * t + a * t * t / 2 + (path[k] - slip[k] * t - a * t * t / 2) / 3.5
        truth.append(place + at_stop * left + 5 / 7 * a * left * left / 2)
        speeds.append(at_stop + 5 / 7 * a * left)
    return {"slope": slope, "mu": mu, "e": 0.0, "height": 0.0, "v": [*v, 0.0], "turns": True,
            "omega": omega, "end": end, "truth": truth + speeds}  # fmt: skip


PROBLEMS = {
    "puck": {"what": "a puck that is pushed up a slope: its path turns, and it stops"}
    | puck(0.35, 0.6, (-1.5, 2.0), 2.0),
    "level": {"what": "a ball with spin on a level floor: it slides, then rolls"}
    | rolling(0.0, 0.3, (1.0, -0.5), [3.0, 14.0, 7.0], 1.0),
    "slope": {"what": "a ball across a slope: its slip turns and stops, then it rolls"}
    | rolling(0.35, 0.25, (-0.5, 1.5), [4.0, -6.0, 3.0], 1.5),
    "thrown": {
        "what": "a ball that is thrown on a slope: it bounces, slides and rolls",
        "slope": 0.1,
        "mu": 0.08,
        "e": 0.7,
        "height": 0.2,
        "v": [1.0, 2.0, 0.0],
        "turns": True,
        "omega": [10.0, 5.0, 1.0],
        "end": 4.0,
        "truth": [9.767067215299839562, 4.308273817292721404, 3.798188049443954783, 6 / 7],
    },
}
