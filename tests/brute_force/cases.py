"""Mechanical systems with impacts that are computed by brute force."""

PLANE = "m*(xdot**2 + ydot**2)/2"
DOUBLE = {
    "q": "a b",
    "T": "(m1 + m2)*l1**2*adot**2/2 + m2*l2**2*bdot**2/2 + m2*l1*l2*adot*bdot*cos(a - b)",
    "V": "-(m1 + m2)*G*l1*cos(a) - m2*G*l2*cos(b)",
    "Q": ["-cd*adot", "-cd*bdot"],
}
CASES = {
    "stop": {  # a driven pendulum and a stop
        "q": "a",
        "T": "m*l**2*adot**2/2",
        "V": "-m*G*l*cos(a)",
        "Q": ["-cd*adot + A*sin(om*t)"],
        "gaps": ["a + d"],
        "parameters": {"m": 1.2, "l": 0.8, "G": 9.81, "cd": 0.1, "A": 6.0, "om": 2.5, "d": -0.35},
        "e": [0.55],
        "start": ([1.1], [0.0]),
        "end": 6,
    },
    "bumps": {  # a mass that slides over a road of bumps and takes off
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["-cd*xdot + f", "-cd*ydot"],
        "gaps": ["y - a*sin(k*x) - b*cos(2*k*x/3)"],
        "parameters": {
            "m": 1.5, "G": 9.81, "cd": 0.15, "f": 2.0, "a": 0.14, "b": 0.11, "k": 3.0
        },
        "e": [0.45],
        "start": ([-0.3, 0.5], [2.6, 0.0]),
        "end": 4,
    },
    "frame": {  # two walls at right angles in a frame that moves
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y + m*fx*x",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["x - A*sin(om*t)", "y - B*cos(2*om*t)"],
        "parameters": {"m": 0.7, "G": 9.81, "fx": 3.0, "cd": 0.05, "A": 0.11, "B": 0.06, "om": 5.0},
        "e": [0.5, 0.35],
        "start": ([0.3, 0.4], [-0.4, 0.2]),
        "end": 3,
    },
    "acute": {  # a ball in a wedge that is not symmetric, with a different law at each wall
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["y*cos(a1) + x*sin(a1)", "y*cos(a2) - x*sin(a2)"],
        "parameters": {"m": 1.0, "G": 9.81, "cd": 0.1, "a1": 1.15, "a2": 0.8},
        "e": [0.3, 0.6],
        "start": ([-0.15, 0.9], [0.5, 0.0]),
        "end": 2.5,
    },
    "obtuse": {
        "q": "x y",
        "T": PLANE,
        "V": "m*G*y",
        "Q": ["-cd*xdot", "-cd*ydot"],
        "gaps": ["y*cos(a1) + x*sin(a1)", "y*cos(a2) - x*sin(a2)"],
        "parameters": {"m": 1.0, "G": 9.81, "cd": 0.2, "a1": 0.55, "a2": 0.7},
        "e": [0.35, 0.5],
        "start": ([0.25, 0.8], [0.1, 0.0]),
        "end": 3.5,
    },
    "tower": {
        "q": "x y z",
        "T": "(m0*xdot**2 + m1*ydot**2 + m2*zdot**2)/2",
        "V": "G*(m0*x + m1*y + m2*z)",
        "gaps": ["x - A*sin(om*t)", "y - x", "z - y"],
        "parameters": {"m0": 1.6, "m1": 0.9, "m2": 0.5, "G": 9.81, "A": 0.03, "om": 11.0},
        "e": [0.4, 0.25, 0.5],
        "start": ([0.3, 0.55, 0.9], [0.0, 0.1, -0.2]),
        "end": 1.6,
    },
    "block": {  # a rocking block of another slenderness, pushed
        "q": "y th",
        "T": "m*ydot**2/2 + J*thdot**2/2",
        "V": "m*G*y",
        "Q": ["A*sin(om*t)", "B*sin(om*t)"],
        "gaps": ["y - hh*cos(th) + b*sin(th)", "y - hh*cos(th) - b*sin(th)"],
        "parameters": {
            "m": 1.3, "J": 0.6, "G": 9.81, "hh": 0.4, "b": 1.1, "A": 8.0, "B": 9.0, "om": 3.0
        },
        "e": [0.4, 0.3],
        "start": ([0.75, 0.12], [0.0, 0.2]),
        "end": 2.5,
    },
    "bar": {  # a bar that falls on a floor and against a wall
        "q": "x y th",
        "T": "m*(xdot**2 + ydot**2)/2 + J*thdot**2/2",
        "V": "m*G*y",
        "Q": ["f", 0, 0],
        "gaps": ["y + l*sin(th)", "y - l*sin(th)", "d - x - l*cos(th)"],
        "parameters": {"m": 1.1, "J": 0.15, "G": 9.81, "l": 0.6, "d": 1.0, "f": 1.3},
        "e": [0.45, 0.3, 0.4],
        "start": ([0.1, 0.6, 0.25], [0.2, 0.0, 0.1]),
        "end": 2.2,
    },
    "rail": {  # a cart with a pendulum between two buffers
        "q": "x phi",
        "T": "(mc + mp)*xdot**2/2 + mp*l**2*phidot**2/2 + mp*l*xdot*phidot*cos(phi)",
        "V": "-mp*G*l*cos(phi)",
        "Q": ["-cx*xdot - f", "-cp*phidot"],
        "gaps": ["x", "d - x"],
        "parameters": {
            "mc": 1.0, "mp": 0.6, "l": 0.5, "G": 9.81, "cx": 0.05, "cp": 0.02, "f": 1.6, "d": 0.35
        },
        "e": [0.4, 0.6],
        "start": ([0.2, 1.6], [0.0, 0.0]),
        "end": 4,
    },
    "bowl": {  # a mass in a bowl, with a wall
        "q": "x y z",
        "T": "m*(xdot**2 + ydot**2 + zdot**2)/2",
        "V": "m*G*z",
        "Q": ["-cd*xdot", "-cd*ydot", "-cd*zdot"],
        "gaps": ["z - c*x**2 - k*y**2", "d - x"],
        "parameters": {"m": 1.0, "G": 9.81, "cd": 0.25, "c": 0.6, "k": 0.4, "d": 0.12},
        "e": [0.5, 0.4],
        "start": ([-0.5, 0.3, 0.9], [0.6, -0.4, 0.0]),
        "end": 3,
    },
    "swing": DOUBLE | {  # a double pendulum and a wall for its tip
        "gaps": ["l1*sin(a) + l2*sin(b) + d"],
        "parameters": {
            "m1": 0.8, "m2": 1.0, "l1": 0.9, "l2": 0.8, "G": 9.81, "cd": 0.05, "d": -0.1
        },
        "e": [0.3],
        "start": ([0.7, 0.4], [0.0, 0.3]),
        "end": 4,
    },
    "elbow": DOUBLE | {  # and one for its elbow too
        "gaps": ["l1*sin(a) + l2*sin(b) + d", "l1*sin(a) + c"],
        "parameters": {
            "m1": 1.1, "m2": 0.7, "l1": 1.0, "l2": 0.6, "G": 9.81, "cd": 0.1, "d": -0.15, "c": -0.1
        },
        "e": [0.4, 0.5],
        "start": ([0.8, 0.9], [0.0, 0.0]),
        "end": 3,
    },
    "hang": DOUBLE | {  # that comes to rest in the corner of two walls
        "gaps": ["l1*sin(a) + c", "l1*sin(a) + l2*sin(b) + d"],
        "parameters": {
            "m1": 0.9, "m2": 1.2, "l1": 0.8, "l2": 0.9, "G": 9.81, "cd": 0.15, "d": -0.25, "c": -0.3
        },
        "e": [0.3, 0.45],
        "start": ([0.9, 0.5], [0.0, 0.0]),
        "end": 4,
    },
    "leg": {  # a hopper whose leg has a longest and a shortest length
        "q": "y0 y1",
        "T": "mf*y0dot**2/2 + mb*y1dot**2/2",
        "V": "mf*G*y0 + mb*G*y1 + k*(l0 - y1 + y0)**2/2",
        "Q": ["c*(y1dot - y0dot) - A*sin(om*t)", "-c*(y1dot - y0dot) + A*sin(om*t)"],
        "gaps": ["y0", "y1 - y0 - s", "r - y1 + y0"],
        "parameters": {
            "mf": 0.5, "mb": 1.8, "k": 200.0, "c": 2.0, "l0": 0.5, "G": 9.81, "A": 50.0, "om": 6.0,
            "s": 0.36, "r": 0.56,
        },
        "e": [0.3, 0.4, 0.5],
        "start": ([0.15, 0.66], [0.0, 0.0]),
        "end": 2.5,
    },
    "row": {  # two masses on springs between two walls
        "q": "x y",
        "T": "m1*xdot**2/2 + m2*ydot**2/2",
        "V": "k*x**2/2 + k*(y - x - r)**2/2",
        "Q": ["-f + A*sin(om*t) - cd*xdot", "f - cd*ydot"],
        "gaps": ["x", "y - x - s", "d - y"],
        "parameters": {
            "m1": 1.0, "m2": 0.6, "k": 4.0, "r": 0.5, "s": 0.2, "d": 1.0, "f": 5.0, "A": 6.0,
            "om": 2.0, "cd": 0.2,
        },
        "e": [0.35, 0.5, 0.45],
        "start": ([0.3, 0.8], [-1.0, 0.5]),
        "end": 5,
    },
}  # fmt: skip
"""Own cases, none of which is in the other files of references."""
