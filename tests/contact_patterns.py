"""Motions and impacts that obey the laws of contact and friction at a state: linear programs.

Each site is open, sticks, or slips one way; for a pattern of them the laws are linear in the
accelerations (or the velocities after an impact) and the forces:

    M a = F + sum lambda N + sum f B     N a + n >= 0  perp  lambda >= 0     |f| <= mu_s lambda, L_s
"""

import dataclasses
import itertools

import numpy as np
from scipy.optimize import linprog


@dataclasses.dataclass
class Site:
    """A gap, with friction or without, or a joint."""

    normal: np.ndarray | None
    shift: float
    tangent: np.ndarray | None
    slip_shift: float = 0.0
    limits: tuple = (0.0, 0.0)
    """In slip and in stick: coefficients of friction at gaps, forces in joints."""
    slip: int = 0
    """The sign of a slip that goes on."""

    def ways(self):
        if self.tangent is None:
            return ["open", "closed"]
        slips = [self.slip] if self.slip else [0, 1, -1]
        return slips if self.normal is None else ["open", *slips]


class Program:
    """The laws of one pattern: unknowns are the motion, then ``lambda`` and ``f`` of each site."""

    def __init__(self, mass, right, sites, pattern):
        self.n, self.size = len(right), len(right) + 2 * len(sites)
        self.equal, self.most = [], []
        for c in range(self.n):
            row = self.row(mass[c])
            for i, site in enumerate(sites):
                for k, direction in enumerate((site.normal, site.tangent)):
                    row[self.n + 2 * i + k] -= 0.0 if direction is None else direction[c]
            self.equal.append((row, right[c]))
        for i, (site, way) in enumerate(zip(sites, pattern, strict=True)):
            self.add(i, site, way)

    def row(self, motion=0.0):
        row = np.zeros(self.size)
        row[: self.n] = motion
        return row

    def add(self, i, site, way):
        pressed, pulled = self.row(), self.row()
        pressed[self.n + 2 * i], pulled[self.n + 2 * i + 1] = 1.0, 1.0
        if site.normal is None:
            self.equal.append((pressed, 1.0))
        elif way == "open":
            self.equal += [(pressed, 0.0), (pulled, 0.0)]
            self.most.append((-self.row(site.normal), site.shift))
            return
        else:
            self.equal.append((self.row(site.normal), -site.shift))
            self.most.append((-pressed, 0.0))
        if way == "closed":
            self.equal.append((pulled, 0.0))
        elif way == 0:
            self.equal.append((self.row(site.tangent), -site.slip_shift))
            self.most += [(sign * pulled - site.limits[1] * pressed, 0.0) for sign in (1, -1)]
        else:
            self.equal.append((pulled + way * site.limits[0] * pressed, 0.0))
            if not site.slip:
                self.most.append((-way * self.row(site.tangent), way * site.slip_shift))

    def extreme(self, direction):
        """Give a motion that is the least along a direction, None where none obeys the laws."""
        (rows, right), most = zip(*self.equal, strict=True), list(zip(*self.most, strict=True))
        more = {"A_ub": np.array(most[0]), "b_ub": np.array(most[1])} if most else {}
        found = linprog(self.row(direction), A_eq=rows, b_eq=right, bounds=(None, None), **more)
        return found.x[: self.n] if found.status == 0 else None


def motions(mass, right, sites, seed=0):
    """Give motions that obey the laws: of each pattern one, or the ends of those it leaves open."""
    rng, found = np.random.default_rng(seed), []
    for pattern in itertools.product(*(site.ways() for site in sites)):
        program = Program(mass, right, sites, pattern)
        direction = rng.normal(size=len(right))
        ends = [program.extreme(sign * direction) for sign in (1, -1)]
        found += [end for end in ends if end is not None]
    return found


def at_the_end(system, sol, touch=1e-7, still=1e-8):
    """Give what decides at the last sample: mass, forces, sites that touch, their numbers."""
    here = system.at(sol.t[-1], sol.q[-1], sol.qdot[-1])
    channel = {gap: c for c, gap in enumerate(sol.channel_gaps) if gap is not None}
    rates = np.reshape(here.gradients @ sol.qdot[-1] + here.rates, -1)
    slips = np.reshape(here.tangents @ sol.qdot[-1] + here.slip_rates, -1)
    signs = [0 if abs(slip) < still else int(np.sign(slip)) for slip in slips]
    gaps = [i for i, gap in enumerate(here.gaps) if abs(gap) < touch and rates[i] < touch]
    joints = [c for c, gap in enumerate(sol.channel_gaps) if gap is None]
    return here, gaps, joints, channel, rates, slips, signs


def accelerations(system, sol):
    """Give the accelerations that obey the laws at the end of a run."""
    here, gaps, joints, channel, _, _, signs = at_the_end(system, sol)

    def friction(c):
        limits = here.limits[c], here.static_limits[c]
        return here.tangents[c], here.slip_curvatures[c], limits, signs[c]

    sites = []
    for i in gaps:
        rough = friction(channel[i]) if i in channel else (None,)
        sites.append(Site(here.gradients[i], here.curvatures[i], *rough))
    sites += [Site(None, 0.0, *friction(c)) for c in joints]
    return motions(here.mass, here.force, sites)


def impacts(system, sol, e, e_t, mu):
    """Give the velocities after an impact that obey Newton's law, by gap and channel numbers."""
    here, gaps, _, channel, rates, slips, _ = at_the_end(system, sol)
    sites = []
    for i in gaps:
        shift = here.rates[i] + e[i] * min(rates[i], 0.0)
        if (c := channel.get(i)) is None:
            sites.append(Site(here.gradients[i], shift, None))
            continue
        back = here.slip_rates[c] + e_t[c] * slips[c]
        sites.append(Site(here.gradients[i], shift, here.tangents[c], back, (mu[c], mu[c])))
    return motions(here.mass, here.mass @ sol.qdot[-1], sites)
