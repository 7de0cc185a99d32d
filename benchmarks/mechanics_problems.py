"""Two mechanical systems with constant matrices, as numbers: any interpreter can read them.

M q'' + C q' = F + H^T lambda,        0 <= lambda  perp  H q + b >= 0,  and e of each gap
"""

import math

G = 9.81
A1, A2 = 1.15, 0.8

PROBLEMS = {
    "wedge": {
        "what": "a ball in a wedge, an acute angle, with drag",
        "mass": [[1.0, 0.0], [0.0, 1.0]],
        "damping": [[0.1, 0.0], [0.0, 0.1]],
        "force": [0.0, -G],
        "normals": [[math.sin(A1), math.cos(A1)], [-math.sin(A2), math.cos(A2)]],
        "offsets": [0.0, 0.0],
        "e": [0.3, 0.6],
        "start": [[-0.15, 0.9], [0.5, 0.0]],
    },
    "tower": {
        "what": "three balls that fall on each other and on the floor",
        "mass": [[1.6, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 0.5]],
        "damping": [[0.0] * 3] * 3,
        "force": [-1.6 * G, -0.9 * G, -0.5 * G],
        "normals": [[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]],
        "offsets": [0.0, 0.0, 0.0],
        "e": [0.4, 0.25, 0.5],
        "start": [[0.3, 0.55, 0.9], [0.0, 0.1, -0.2]],
    },
}

TRUTH = {
    "wedge": {
        0.75: [
            0.009293851101061081, 0.016785098706716885, -0.82104670130287735, -0.70246135710140025,
        ],
        1.5: [0.0, 0.0, 0.0, 0.0],
    },
    "tower": {
        0.4: [
            0.004430147353768622, 0.011854586402839827, 0.0352,
            -0.37742883290776936, -0.00955146314517814, -4.124,
        ],
        1.0: [0.0] * 6,
    },
}  # fmt: skip
"""States (q, q') after some impacts, and after all accumulations: by brute force with 45 digits
(tests/brute_force)."""

STEPS = (2e-3, 5e-4, 1.25e-4)
"""Steps of the time stepping."""
