"""SciPy: ``solve_ivp`` from event to event, as a careful user would write it. One gap, no friction.

A gap whose impact is slower than a guard is closed from there on; closed gaps are constraints,
until their force vanishes. Impacts and contact forces are small complementarity problems, solved
by trying the patterns.
"""

import itertools

from ..problem import Motion

NAME = "SciPy solve_ivp, restarts"
LEVELS = (1e-5, 1e-8, 1e-11)
CAP = 0.02
"""Longest flight from a gap before it is watched (s)."""
STEP = 0.1
"""Longest step (s), so that no contact is jumped over."""
TOUCH = 1e-7
MOST = 600
"""Restarts after which a run is given up."""


def missing():
    """Say what is missing."""
    try:
        import numpy  # noqa: F401
        import scipy.integrate  # noqa: F401
    except ImportError as error:
        return str(error)
    return None


def refuses(problem):
    """Take one gap, without friction."""
    if problem.joints or any("mu" in gap for gap in problem.gaps):
        return "no friction in this adapter"
    if len(problem.gaps) > 1:
        return "several gaps: this script loses some of these motions"
    return None


def patterns(d, w, e):
    """Solve 0 <= p perp d p + w + e >= 0 by trying all subsets; the first that holds."""
    import numpy as np

    m, best = len(w), None
    for count in range(m + 1):
        for held in itertools.combinations(range(m), count):
            at, p = list(held), np.zeros(m)
            if at:
                p[at] = np.linalg.lstsq(d[np.ix_(at, at)], -(w + e)[at], rcond=None)[0]
            wrong = max([0.0, *(-p), *(-(d @ p + w + e))])
            if best is None or wrong < best[0]:
                best = wrong, p
            if wrong <= 1e-12 * (1 + np.abs(w).max()):
                return p
    return best[1]


class Script:
    """One run."""

    def __init__(self, problem, tol):
        import numpy as np

        self.np, self.problem, self.tol, self.guard = np, problem, tol, max(tol, 1e-9)
        self.value, self.gradient = problem.part("value"), problem.part("gradient")
        self.rate, self.curvature = problem.part("rate"), problem.part("curvature")
        self.n, self.m = problem.n, len(problem.gaps)
        self.e = np.array(problem.e)
        self.closed, self.zeno, self.steps, self.hits = [], [], 0, []
        self.settings = {"method": "DOP853", "rtol": tol, "atol": tol, "max_step": STEP}

    def halves(self, y):
        """Split a state."""
        return y[: self.n].tolist(), y[self.n :].tolist()

    def gap(self, t, y):
        """Give all gaps."""
        return self.np.array(self.value(t, *self.halves(y)))

    def speeds(self, t, y):
        """Give the rates of all gaps."""
        q, v = self.halves(y)
        rates = self.np.array(self.rate(t, q, v))
        return self.np.array(self.gradient(t, q, v)).reshape(self.m, self.n) @ v + rates

    def matrices(self, t, y):
        """M^-1 F, M^-1 N^T, N, and the curvatures of all gaps."""
        np = self.np
        q, v = self.halves(y)
        rows = np.array(self.gradient(t, q, v)).reshape(self.m, self.n)
        both = np.column_stack([self.problem.force(t, q, v), rows.T])
        solved = np.linalg.solve(np.array(self.problem.mass(t, q, v)), both)
        return solved[:, 0], solved[:, 1:], rows, np.array(self.curvature(t, q, v))

    def contact(self, t, y):
        """Acceleration, and the forces of the closed gaps."""
        free, answer, rows, bend = self.matrices(t, y)
        at = self.closed
        if not at:
            return free, []
        d = rows[at] @ answer[:, at]
        forces = self.np.linalg.solve(d, -(rows[at] @ free + bend[at]))
        return free + answer[:, at] @ forces, forces

    def field(self, t, y):
        """Give the right-hand side."""
        return self.np.concatenate([y[self.n :], self.contact(t, y)[0]])

    def stay(self, t, y, candidates):
        """Which of the gaps at rest stay closed: their forces press."""
        free, answer, rows, bend = self.matrices(t, y)
        at = list(candidates)
        if not at:
            return []
        d, w = rows[at] @ answer[:, at], rows[at] @ free + bend[at]
        forces = patterns(d, w, self.np.zeros(len(at)))
        return [i for i, force in zip(at, forces, strict=True) if force > 0]

    def impact(self, t, y):
        """Newton's law at the closed gaps and those that touch; slow ones close."""
        np = self.np
        before, near = self.speeds(t, y), np.abs(self.gap(t, y)) < TOUCH
        at = [i for i in range(self.m) if i in self.closed or (near[i] and before[i] < self.guard)]
        hit = [i for i in at if i not in self.closed and before[i] < 0]
        slow = [i for i in hit if -before[i] * self.e[i] < self.guard]
        e = np.where([i in slow for i in at], 0.0, self.e[at])
        _, answer, rows, _ = self.matrices(t, y)
        w = before[at]
        p = patterns(rows[at] @ answer[:, at], w, e * w)
        y = np.concatenate([y[: self.n], y[self.n :] + answer[:, at] @ p])
        after = self.speeds(t, y)
        resting = [i for i in at if abs(after[i]) < self.guard]
        held = self.stay(t, y, resting)
        self.zeno += [t] if set(held) - set(self.closed) else []
        self.closed = held
        self.hits += [(t, float(after[i])) for i in hit if i not in slow]
        return y

    def release(self, t, y):
        """Open the gap whose force vanished; the others stay as they press."""
        forces = self.contact(t, y)[1]
        least = int(self.np.argmin(forces)) if len(forces) else None
        self.closed = self.stay(t, y, [i for k, i in enumerate(self.closed) if k != least])

    def events(self, watched):
        """Watch gaps that are open, and forces of those that are closed."""
        found = []
        for i in watched:
            event = lambda t, y, i=i: self.gap(t, y)[i]  # noqa: E731
            event.terminal, event.direction = True, -1.0
            found.append(event)
        for k in range(len(self.closed)):
            event = lambda t, y, k=k: self.contact(t, y)[1][k]  # noqa: E731
            event.terminal, event.direction = True, -1.0
            found.append(event)
        return found

    def leg(self, t, y, until, watched):
        """Integrate to the first event; gives whether there was one."""
        from scipy.integrate import solve_ivp

        sol = solve_ivp(self.field, (t, until), y, events=self.events(watched), **self.settings)
        self.steps += len(sol.t) - 1
        return float(sol.t[-1]), sol.y[:, -1], sol.status == 1

    def fly(self, t, y, until):
        """Leave the gaps that were just hit for half an arc before they are watched."""
        speeds, gaps = self.speeds(t, y), self.gap(t, y)
        leaving = (gaps < TOUCH) & (speeds > -self.guard)
        fresh = [i for i in range(self.m) if i not in self.closed and leaving[i]]
        if fresh:
            a = self.contact(t, y)[0]
            _, _, rows, bend = self.matrices(t, y)
            pull = -(rows @ a + bend)
            half = min([CAP, *(speeds[i] / pull[i] for i in fresh if pull[i] > 0 < speeds[i])])
            rest = [i for i in range(self.m) if i not in self.closed and i not in fresh]
            t, y, met = self.leg(t, y, min(t + half, until), rest)
            if met or t >= until:
                return t, y, met
        return self.leg(t, y, until, [i for i in range(self.m) if i not in self.closed])

    def follow(self, t, y, stops, hits=None):
        """Give the states at the stops; ends after so many impacts, if said."""
        np = self.np
        y, states = np.array(y, dtype=float), []
        touching = np.flatnonzero((self.gap(t, y) < TOUCH) & (np.abs(self.speeds(t, y)) < 1e-12))
        self.closed = self.stay(t, y, touching.tolist())
        restarts = 0
        for stop in stops:
            while t < stop:
                t, y, met = self.fly(t, y, stop)
                restarts += 1
                if restarts > MOST:
                    return states + [None] * (len(stops) - len(states))
                if met:
                    near = (np.abs(self.gap(t, y)) < TOUCH) & (self.speeds(t, y) < 0)
                    near[self.closed] = False
                    if near.any():
                        y = self.impact(t, y)
                    else:
                        self.release(t, y)
                if hits is not None and len(self.hits) >= hits:
                    return states
            states.append(self.halves(y))
        return states


def orbit(problem, tol):
    """Solve for time and speed after an impact that come again after the period."""
    from scipy.optimize import root

    truth = problem.truth["orbit"]
    count, period = len(truth["times"]), float(truth["period"])
    steps, hits = 0, []

    def miss(z):
        nonlocal steps, hits
        script = Script(problem, tol)
        script.follow(z[0], [0.0, z[1]], [z[0] + 2 * period], hits=count)
        steps, hits = steps + script.steps, script.hits
        return [hits[-1][0] - period - z[0], hits[-1][1] - z[1]]

    found = root(miss, [problem.t0, problem.v0[0]], tol=tol, options={"eps": 1e-7})
    miss(found.x)
    hits = [tuple(found.x), *hits[:-1]]
    return [float(t) for t, _ in hits] + [float(u) for _, u in hits], steps


def run(problem, level):
    """Follow the motion with this tolerance."""
    problem.calls = 0
    if problem.is_orbit:
        found, steps = orbit(problem, level)
        return Motion([], [], problem.calls, steps, found)
    script = Script(problem, level)
    states = script.follow(problem.t0, [*problem.q0, *problem.v0], problem.times)
    return Motion(states, script.zeno, problem.calls, script.steps)
