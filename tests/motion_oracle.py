"""A run put back into the equations of motion: what its samples and its dense output violate.

Nothing here knows how a run is made. The equations are those of docs/friction.md:

    M q'' = F + sum lambda_i N_i^T + sum f_c B_c^T,    0 <= g  perp  lambda >= 0,    g'' = N q'' + h
    slip:  f = -mu lambda sign(w)    stick:  w = 0, w' = B q'' + k = 0, |f| <= mu_s lambda
"""

import dataclasses
from collections.abc import Callable

import numpy as np

BALANCE = 1e-9
"""Of forces, relative to the sizes of their parts."""
SLOWEST = 1e-8
"""Lists of impacts that go on to slower ones are complete (m/s)."""


@dataclasses.dataclass
class Oracle:
    """A run of a mechanism and its system; `tol` is an error of states that the run may have."""

    system: object
    sol: object
    tol: float
    push: Callable[[float], np.ndarray] | None = None
    """Forces on the coordinates that the system does not have: those of a controller."""
    jumps: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    """Times at which they jump."""
    faults: list = dataclasses.field(default_factory=list)
    worst: float = 0.0
    """Largest residual of forces, relative."""

    def fault(self, t, text, size=np.nan):
        self.faults.append(f"t = {t:.9g}: {text} ({size:.3g})")

    def events(self):
        """Give the times at which the motion is not smooth."""
        sol = self.sol
        names = "resolved_impacts", "impacts", "zeno", "liftoffs", "openings", "transitions"
        lists = [getattr(sol, it)["t"] for it in (*names, "corners")]
        return np.sort(np.concatenate([*lists, self.jumps]))

    def force(self, t, here):
        return here.force if self.push is None else here.force + self.push(t)

    def tails(self):
        """Give the parts of accumulations whose impacts are not listed, being too slow."""
        listed = np.sort(np.concatenate([self.sol.impacts["t"], self.sol.resolved_impacts["t"]]))
        for end in [*self.sol.zeno["t"], *self.sol.corners["t"]]:
            before = listed[listed < end]
            yield (before.max() if before.size else self.sol.t[0]), end

    def smooth(self, times, near):
        """Keep the times that are further than `near` from all events, and not in a tail's end."""
        events = self.events()
        if len(events):
            times = times[np.abs(times[:, None] - events).min(axis=1) > near]
        for start, end in self.tails():
            times = times[(times < start) | (times > end)]
        return times

    def forces(self, times):
        """The forces that are reported obey the laws, and keep what is closed and what sticks."""
        sol = self.sol.resample(times)
        system, rough = self.system, len(sol.channel_names)
        gap_of = [sol.channel_gaps[c] for c in range(rough)]
        for k, t in enumerate(sol.t):
            here = system.at(t, sol.q[k], sol.qdot[k])
            load, rub = sol.reactions[k], sol.friction_forces[k] if rough else np.zeros(0)
            mass = np.linalg.inv(here.mass)
            normals, tangents = np.atleast_2d(here.gradients), np.atleast_2d(here.tangents)
            parts = [self.force(t, here), *(load[:, None] * normals), *(rub[:, None] * tangents)]
            moved = np.array([mass @ part for part in parts])
            weight = np.abs(np.array(parts)).max()
            for i in range(len(load)):
                self.contact(t, sol, k, i, here, normals[i], load[i], moved, weight)
            for c in range(rough):
                lam = 1.0 if gap_of[c] is None else load[gap_of[c]]
                if gap_of[c] is not None and not sol.contacts[k, gap_of[c]]:
                    if rub[c] != 0 or sol.modes[k, c] != 2:
                        self.fault(t, f"channel {c} of an open gap has a force", rub[c])
                    continue
                self.channel(t, sol, k, c, here, tangents[c], lam, rub[c], moved, weight)

    def small(self, t, what, first, moved, row):
        """A sum that must vanish, ``first + row @ moved``, beside the sizes of its terms."""
        terms = abs(first) + (np.abs(moved) @ np.abs(row)).sum()
        size = abs(first + (moved @ row).sum()) / max(terms, 1e-300)
        self.worst = max(self.worst, size)
        if size > BALANCE:
            self.fault(t, what, size)

    def contact(self, t, sol, k, i, here, normal, load, moved, weight):
        g, unit = here.gaps[i], np.linalg.norm(normal)
        if load < -BALANCE * weight:
            self.fault(t, f"reaction of gap {i} pulls", load)
        if g < -self.tol * unit:
            self.fault(t, f"gap {i} is penetrated", g)
        if not sol.contacts[k, i]:
            if load != 0:
                self.fault(t, f"reaction of open gap {i}", load)
            return
        if abs(g) > self.tol * unit:
            self.fault(t, f"closed gap {i} is open", g)
        self.small(t, f"g'' of closed gap {i}", here.curvatures[i], moved, normal)

    def channel(self, t, sol, k, c, here, tangent, lam, rub, moved, weight):
        mode, w = sol.modes[k, c], sol.slips[k, c]
        slip = tangent @ sol.qdot[k] + here.slip_rates[c]
        if abs(w - slip) > self.tol * np.linalg.norm(tangent):
            self.fault(t, f"slip of channel {c} is not that of the state", w - slip)
        slack = BALANCE * weight / np.linalg.norm(tangent)
        if mode == 0:
            if w != 0:
                self.fault(t, f"channel {c} sticks and slips", w)
            if abs(rub) > here.static_limits[c] * lam * (1 + BALANCE) + slack * 1e-3:
                self.fault(t, f"channel {c} sticks beyond its limit", rub / lam if lam else rub)
            first = here.slip_curvatures[c]
            self.small(t, f"w' of sticking channel {c}", first, moved, tangent)
        else:
            if mode * w < -self.tol:
                self.fault(t, f"channel {c} slips the other way", w)
            if abs(rub + mode * here.limits[c] * lam) > BALANCE * here.limits[c] * lam + slack:
                self.fault(t, f"force of slipping channel {c}", rub + mode * here.limits[c] * lam)

    def motion(self, times, step):
        """Differences of the dense output are the velocity and what the forces accelerate by."""
        sol = self.sol.resample(times)
        for k, t in enumerate(sol.t):
            here = self.system.at(t, sol.q[k], sol.qdot[k])
            push = self.force(t, here) + sol.reactions[k] @ np.atleast_2d(here.gradients)
            if len(sol.channel_names):
                push = push + sol.friction_forces[k] @ np.atleast_2d(here.tangents)
            a = np.linalg.solve(here.mass, push)
            before, after = (np.array(self.sol(t + s)).reshape(2, -1) for s in (-step, step))
            v = (after[0] - before[0]) / (2 * step)
            found = (after[1] - before[1]) / (2 * step)
            size = 1 + np.abs(sol.qdot[k]).max() + np.abs(a).max()
            allowed = (self.tol / step + 30 * step**2) * size
            for name, off in (("q'", v - sol.qdot[k]), ("q''", found - a)):
                if np.abs(off).max() > allowed:
                    self.fault(t, f"{name} of the dense output", np.abs(off).max())

    def displacements(self):
        """Coordinates move by the integral of the velocity, also in tails that are extrapolated.

        Within a step it varies by what forces accelerate by, and by bounces, which are no faster
        than what the velocity changes by up to its end.
        """
        sol = self.sol
        for k in np.flatnonzero(np.diff(sol.t) > 0):
            here, h = self.system.at(sol.t[k], sol.q[k], sol.qdot[k]), sol.t[k + 1] - sol.t[k]
            push = self.force(sol.t[k], here) + sol.reactions[k] @ np.atleast_2d(here.gradients)
            if len(sol.channel_names):
                push = push + sol.friction_forces[k] @ np.atleast_2d(here.tangents)
            a = np.abs(np.linalg.solve(here.mass, push)).max()
            turn = np.abs(np.diff(sol.qdot[k : k + 2], axis=0)).max()
            mean = (sol.qdot[k] + sol.qdot[k + 1]) / 2
            off = np.abs(sol.q[k + 1] - sol.q[k] - h * mean).max()
            if off > h * (3 * turn + 10 * h * (1 + a)) + self.tol:
                self.fault(sol.t[k], f"coordinates do not move for {h:.3g} s", off)

    def dissipation(self, energy, times):
        """The energy of a system that nothing drives never grows, but for flagged impacts."""
        if "energy_gain" in self.sol.flags["kind"]:
            return
        sol = self.sol.resample(np.sort(times))
        values = np.array([energy(q, v) for q, v in zip(sol.q, sol.qdot, strict=True)])
        size = 1 + np.abs(values).max()
        for t, rise in zip(sol.t[1:], np.diff(values), strict=True):
            if rise > 10 * self.tol * size:
                self.fault(t, "energy grows", rise)

    def unlisted(self, rows):
        """Give the losses along normals of impacts whose ratio friction makes: few are listed.

        They fall geometrically where forces are constant.
        """
        losses, left = -rows["impulse"] * (rows["speed_before"] + rows["speed_after"]) / 2, 0.0
        for t, gap in self.sol.zeno[["t", "gap"]]:
            hits = rows[(rows["gap"] == gap) & (rows["t"] < t) & (rows["speed_before"] < 0)][-3:]
            if len(hits) < 3 or hits["speed_before"][-1] > -SLOWEST:
                continue
            first, second = np.diff(hits["t"])
            if second >= first:
                continue
            ahead = second**2 / (first - second)
            if abs(t - hits["t"][-1] - ahead) > 1e-3 * ahead:
                continue
            before, last = (losses[rows["group"] == it].sum() for it in hits["group"][1:])
            left += last**2 / (before - last)
        return left

    def losses(self, energy, start):
        """All energy is lost to friction, in ``dissipated``, or to impacts, by their rows.

        Of an impact at the start the first sample is the state after it.
        """
        sol = self.sol
        if len(sol.corners) or not sol.success:
            return
        rows = sol.impacts_down_to(1e-9)
        normal = -np.sum(rows["impulse"] * (rows["speed_before"] + rows["speed_after"])) / 2
        normal += self.unlisted(rows)
        first, last = energy(*start), energy(sol.q[-1], sol.qdot[-1])
        rubbed = sol.dissipated[-1] if len(sol.channel_names) else 0.0
        left = first - last - rubbed - normal
        if abs(left) > 20 * self.tol * (1 + abs(first) + abs(rubbed) + abs(normal)):
            self.fault(sol.t[-1], "energy is neither kept nor accounted for", left)


def check(system, sol, rng, tol, energy=None, start=None, count=20, **push):
    """Give the oracle of a run, with its faults: at random times, and in the samples themselves."""
    it = Oracle(system, sol, tol, **push)
    t0, t1 = sol.t[0], sol.t[-1]
    if t1 == t0:
        return it
    step = 1e-4 * min(1.0, t1 - t0)
    times = it.smooth(np.sort(rng.uniform(t0 + step, t1 - step, count)), 2 * step)
    it.forces(it.smooth(np.unique(sol.t), 1e-12 * (t1 - t0)))
    it.displacements()
    if len(times):
        it.forces(times)
        it.motion(times, step)
    if energy is not None:
        it.dissipation(energy, rng.uniform(t0, t1, count))
        it.losses(energy, start)
    return it


def check_mass(sol, rng, tol, force, e, count=40, jumps=()):
    """Give the faults of a run of one mass, `force` its relative acceleration at (t, x, x')."""
    faults = []
    t0, t1 = sol.t[0], sol.t[-1]
    step = 1e-4 * min(1.0, t1 - t0)
    hits = sol.impacts["t"]
    events = np.concatenate([hits, sol.zeno["t"], sol.liftoffs["t"], jumps])
    for t in rng.uniform(t0 + step, t1 - step, count):
        if np.abs(events - t).min(initial=1.0) < 2 * step:
            continue
        if any(hits[hits < end].max(initial=t0) <= t <= end for end in sol.zeno["t"]):
            continue
        (x, v), before, after = (np.array(sol(it)).ravel() for it in (t, t - step, t + step))
        pull, size = force(t, x, v), 1 + abs(v) + abs(force(t, x, v))
        rate = (after - before) / (2 * step)
        if x == 0 and v == 0 and not before.any() and not after.any():
            if pull > tol * size:
                faults.append(f"t = {t:.9g}: rests though it is pulled away ({pull:.3g})")
        elif np.abs(rate - [v, pull]).max() > (tol / step + 30 * step**2) * size:
            faults.append(f"t = {t:.9g}: x'' of the dense output ({rate - [v, pull]})")
        if x < -tol:
            faults.append(f"t = {t:.9g}: behind the wall ({x:.3g})")
    off = sol.impacts["speed_after"] + e * sol.impacts["speed_before"]
    if np.abs(off).max(initial=0.0) > tol:
        faults.append(f"an impact is not by its law ({np.abs(off).max():.3g})")
    return faults
