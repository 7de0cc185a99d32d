"""Mechanical systems whose periodic orbits are known, and what is known of them."""

import json
from pathlib import Path

import numpy as np

import zivi
from zivi import LinearGap

REFERENCES = json.loads((Path(__file__).parent / "data" / "mechanical_orbits.json").read_text())


def numbers(name, key="params"):
    return {k: float(v) for k, v in REFERENCES[name][key].items() if v != "unknown"}


def listed(name, key):
    return np.array([float(it) for it in REFERENCES[name][key]])


def multipliers(name):
    return np.array([complex(float(a), float(b)) for a, b in REFERENCES[name]["mult"]])


def springs(values):
    n = len(values) - 1
    own = np.diag([values[i] + values[i + 1] for i in range(n)])
    return own - np.diag(values[1:n], 1) - np.diag(values[1:n], -1)


def sine(load, omega):
    return zivi.Harmonic(load, omega, -np.pi / 2)


def chain2(kc=2.0, F=1.0, w=0.9, d=0.3, e=0.8):
    return zivi.LinearSystem(
        np.diag([1, 1.5]),
        [[0.1, -0.05], [-0.05, 0.1]],
        [[1 + kc, -kc], [-kc, kc]],
        excitation=sine([0, F], w),
        gaps=[LinearGap([-1, 0], d, name="stop")],
        e=e,
    )


def chain3(k2, F, d0, d1, e0, e1, w):
    return zivi.LinearSystem(
        np.diag([1, 0.8, 1.2]),
        springs([0.08, 0.06, 0.04, 0.08]),
        springs([1, 1.5, k2, 1]),
        excitation=sine([0, 0, F], w),
        gaps=[LinearGap([-1, 0, 0], d0, name="a"), LinearGap([0, 1, -1], d1, name="b")],
        e=[e0, e1],
    )


def chain4(k3, F, d0, d1, e0, e1, w):
    return zivi.LinearSystem(
        np.diag([1, 0.5, 0.7, 1.1]),
        springs([0.05, 0.1, 0.08, 0.06, 0.05]),
        springs([1, 2, 1.5, k3, 0.6]),
        excitation=sine([0, F, 0, 0], w),
        gaps=[LinearGap([1, 0, 0, 0], d0, name="a"), LinearGap([0, 0, 0, -1], d1, name="b")],
        e=[e0, e1],
    )


def sym2(k, ka, d, e, w, F):
    return zivi.LinearSystem(
        np.diag([1, 0.4]),
        [[0.15, -0.05], [-0.05, 0.05]],
        [[k + ka, -ka], [-ka, ka]],
        excitation=zivi.Harmonic([F, 0], w),
        gaps=[LinearGap([-1, 0], d, name="right"), LinearGap([1, 0], d, name="left")],
        e=e,
    )


def rest2(A=1.25, e=0.4, k=3.0, c=0.1, mm=0.3, w=1.0):
    road = zivi.HarmonicWall(A, w, -np.pi / 2)
    return zivi.LinearSystem(
        np.diag([1, mm]),
        [[c, -c], [-c, c]],
        [[k, -k], [-k, k]],
        excitation=[-1, -mm],
        gaps=[LinearGap([1, 0], 0, road, name="road")],
        e=e,
    )


def shaker(A, e=0.5, k=0.0, mm=0.0, c=0.0):
    """A mass on a shaken road, alone or with another one on a spring."""
    road = LinearGap(
        [1.0, 0.0][: 1 + (mm > 0)], 0, zivi.HarmonicWall(A, 1, -np.pi / 2), name="road"
    )
    if not mm:
        return zivi.LinearSystem([[1]], [[0]], [[0]], excitation=[-1.0], gaps=[road], e=e)
    pair = np.array([[1, -1], [-1, 1]])
    masses = np.diag([1, mm])
    return zivi.LinearSystem(masses, c * pair, k * pair, excitation=[-1, -mm], gaps=[road], e=e)


def duffing2(kc, a, F, w, d, e):
    def force(t, q, v):
        x, y = q
        return np.array(
            [
                -(0.5 + kc) * x + kc * y - 0.15 * v[0] + 0.05 * v[1] - a * x**3 + F * np.cos(w * t),
                -kc * (y - x) + 0.05 * v[0] - 0.1 * v[1] - 0.2 * a * y**3,
            ]
        )

    gap = LinearGap([-1, 0], d, name="stop")
    return zivi.MechanicalSystem(mass=np.diag([1, 0.8]), force=force, gaps=[gap], e=e)


def vdp2(mu, kc, c, d, e):
    def force(t, q, v):
        x, y = q
        return np.array([mu * (1 - x * x) * v[0] - (1 + kc) * x + kc * y, kc * (x - y) - c * v[1]])

    gap = LinearGap([-1, 0], d, name="stop")
    return zivi.MechanicalSystem(mass=np.diag([1, 1.3]), force=force, gaps=[gap], e=e)
