"""Three systems with dry friction, as numbers: any interpreter can read them.

M q'' + K q = F + sum lambda_i N_i^T + sum f_i B_i^T       0 <= lambda_i  perp  N_i q + b_i >= 0
f_i in -mu lambda_i Sign(B_i q')
"""

import math

G = 9.81
SLOPE, MU = 0.3, 0.35
MS, MM, JS, JM, C = 0.0045, 0.0003, 7e-7, 5e-9, 0.0056
R0, RM, HM, LM, LG, HS, LS = 0.0025, 0.0031, 0.0058, 0.01, 0.015, 0.02, 0.0201

_BLOCK = {
    "mass": [[1.0, 0.0], [0.0, 1.0]],
    "stiffness": [[0.0, 0.0], [0.0, 0.0]],
    "force": [G * math.sin(SLOPE), -G * math.cos(SLOPE)],
    "normals": [[0.0, 1.0]],
    "offsets": [0.0],
    "tangents": [[1.0, 0.0]],
    "mu": [MU],
    "end": 4.0,
}
_DECELERATION = G * (MU * math.cos(SLOPE) - math.sin(SLOPE))

PROBLEMS = {
    "slide": _BLOCK
    | {
        "what": "a block thrown down a slope: it slides, and sticks",
        "e": [0.0],
        "start": [[0.0, 0.0], [1.0, 0.0]],
        "truth": [0.5 / _DECELERATION, 0.0, 0.0, 0.0],
    },
    "bounce": _BLOCK
    | {
        "what": "the same, dropped: it bounces, slides, sticks",
        "e": [0.5],
        "start": [[0.0, 0.4], [1.0, 0.0]],
        "truth": [1.452010166028599, 0.0, 0.0, 0.0],
    },
    "woodpecker": {
        "what": "the woodpecker toy, two turns",
        "mass": [
            [MS + MM, MS * LM, MS * LG],
            [MS * LM, JM + MS * LM**2, MS * LM * LG],
            [MS * LG, MS * LM * LG, JS + MS * LG**2],
        ],
        "stiffness": [[0.0, 0.0, 0.0], [0.0, C, -C], [0.0, -C, C]],
        "force": [-(MS + MM) * G, -MS * LM * G, -MS * LG * G],
        "normals": [[0.0, 0.0, -HS], [0.0, HM, 0.0], [0.0, -HM, 0.0]],
        "offsets": [LM + LG - LS - R0, RM - R0, RM - R0],
        "tangents": [[1.0, LM, LG - LS], [1.0, RM, 0.0], [1.0, RM, 0.0]],
        "mu": [0.3, 0.3, 0.3],
        "e": [0.5, 0.0, 0.0],
        "start": [[0.0, -0.10344827586206896, -0.2788], [-0.3411, 0.0, -7.4583]],
        "end": 0.3,
        "truth": [
            -0.04132741608343129, -0.10344827586206896, -0.34237385510784453,
            -0.25918492260468466, 0.0, -8.342824143713949,
        ],
    },
}  # fmt: skip
"""What they are, and the states (q, q') at the end: by hand; the others by a computation with 28
digits (tests/data/friction_references.json)."""

STEPS = {
    "slide": (1e-2, 1e-3, 1e-4),
    "bounce": (1e-2, 1e-3, 1e-4),
    "woodpecker": (1e-3, 1e-4, 2.5e-5),
}
"""Steps of the time stepping."""
