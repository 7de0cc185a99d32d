"""Motions and impacts that obey the laws of contact and friction at a state: linear programs.

Each site is open, sticks, or slips one way; for a pattern of them the laws are linear in the
accelerations (or the velocities after an impact) and the forces:

    M a = F + sum lambda N + sum f B     N a + n >= 0  perp  lambda >= 0     |f| <= mu_s lambda, L_s

Whether a run of `metamorphic.py` ends early because of its laws; all of a campaign that do:

    python tests/contact_patterns.py --runs 1000 --seed 83       --only 17 is one of them
"""

import argparse
import dataclasses
import itertools

import numpy as np
from scipy.optimize import linprog

import metamorphic
import zivi


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
    kept: float = 0.0
    """The least normal impulse of Poisson's restitution: what an open gap has."""

    def ways(self):
        if self.tangent is None:
            return ["open", "closed"]
        if self.kept > 0:
            return [(place, slip) for place in ("open", "closed") for slip in (0, 1, -1)]
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
        place, slip = way if isinstance(way, tuple) else (way, way)
        if site.normal is None:
            self.equal.append((pressed, 1.0))
        elif place == "open":
            self.equal.append((pressed, site.kept))
            self.most.append((-self.row(site.normal), site.shift))
        else:
            self.equal.append((self.row(site.normal), -site.shift))
            self.most.append((-pressed, -site.kept))
        self.rub(site, slip, pressed, pulled)

    def rub(self, site, way, pressed, pulled):
        """Add the law of friction of a way."""
        if way in ("open", "closed"):
            self.equal.append((pulled, 0.0))
        elif way == 0:
            self.equal.append((self.row(site.tangent), -site.slip_shift))
            self.most += [(sign * pulled - site.limits[1] * pressed, 0.0) for sign in (1, -1)]
        else:
            self.equal.append((pulled + way * site.limits[0] * pressed, 0.0))
            if not site.slip:
                self.most.append((-way * self.row(site.tangent), way * site.slip_shift))

    def extreme(self, direction):
        """Give motion and forces, the motion least along a direction; None where none obeys."""
        (rows, right), most = zip(*self.equal, strict=True), list(zip(*self.most, strict=True))
        more = {"A_ub": np.array(most[0]), "b_ub": np.array(most[1])} if most else {}
        found = linprog(self.row(direction), A_eq=rows, b_eq=right, bounds=(None, None), **more)
        return found.x if found.status == 0 else None


def motions(mass, right, sites, seed=0):
    """Give motions that obey the laws: of each pattern one, or the ends of those it leaves open."""
    return [it[: len(right)] for it in solutions(mass, right, sites, seed)]


def solutions(mass, right, sites, seed=0):
    """Give these motions with their forces."""
    rng, found = np.random.default_rng(seed), []
    for pattern in itertools.product(*(site.ways() for site in sites)):
        program = Program(mass, right, sites, pattern)
        direction = rng.normal(size=len(right))
        ends = [program.extreme(sign * direction) for sign in (1, -1)]
        found += [end for end in ends if end is not None]
    return found


def at_the_end(system, sol, qdot=None, fastest=1e-7, still=1e-8):
    """Give what decides at the last sample: mass, forces, sites that touch, their numbers."""
    qdot = sol.qdot[-1] if qdot is None else qdot
    here = system.at(sol.t[-1], sol.q[-1], qdot)
    channel = {gap: c for c, gap in enumerate(sol.channel_gaps) if gap is not None}
    rates = np.reshape(here.gradients @ qdot + here.rates, -1)
    slips = np.reshape(here.tangents @ qdot + here.slip_rates, -1)
    signs = [0 if abs(slip) < still else int(np.sign(slip)) for slip in slips]
    gaps = [i for i, gap in enumerate(here.gaps) if abs(gap) < 1e-7 and rates[i] < fastest]
    joints = [c for c, gap in enumerate(sol.channel_gaps) if gap is None]
    return here, gaps, joints, channel, rates, slips, signs


def accelerations(system, sol, qdot=None):
    """Give the accelerations that obey the laws at the end of a run."""
    here, gaps, joints, channel, _, _, signs = at_the_end(system, sol, qdot)

    def friction(c):
        limits = here.limits[c], here.static_limits[c]
        return here.tangents[c], here.slip_curvatures[c], limits, signs[c]

    sites = []
    for i in gaps:
        rough = friction(channel[i]) if i in channel else (None,)
        sites.append(Site(here.gradients[i], here.curvatures[i], *rough))
    sites += [Site(None, 0.0, *friction(c)) for c in joints]
    return motions(here.mass, here.force, sites)


def impacts(system, sol, e, e_t, mu, law="newton", qdot=None, fastest=1e-7):
    """Give the velocities after an impact that obey its law, by gap and channel numbers."""
    here, gaps, _, channel, rates, slips, _ = at_the_end(system, sol, qdot, fastest)
    sites, qdot = [], sol.qdot[-1] if qdot is None else qdot
    for i in gaps:
        back = 0.0 if law == "poisson" else e[i]
        shift = here.rates[i] + back * min(rates[i], 0.0)
        if (c := channel.get(i)) is None:
            sites.append(Site(here.gradients[i], shift, None))
            continue
        back = 0.0 if law == "poisson" else e_t[c]
        row, slip_shift = here.tangents[c], here.slip_rates[c] + back * slips[c]
        sites.append(Site(here.gradients[i], shift, row, slip_shift, (mu[c], mu[c])))
    n, found = len(qdot), solutions(here.mass, here.mass @ qdot, sites)
    if law != "poisson":
        return [it[:n] for it in found]
    expanded = []
    for it in found:
        kept = [max(e[i] * it[n + 2 * k], 0.0) for k, i in enumerate(gaps)]
        again = [
            dataclasses.replace(site, kept=more if more > 1e-12 else 0.0)
            for site, more in zip(sites, kept, strict=True)
        ]
        expanded += motions(here.mass, here.mass @ it[:n], again)
    return expanded


# --------------------------------------------------------------------------------- early ends

MORE = 200_000
"""Steps after which a run that needs more than usual has come to its end, or is stuck."""


def impacts_of(model, sol, qdot=None, *, approached=False):
    """Give the velocities after an impact at the end of a run of a model."""
    mu = [c.limit(0.0) if hasattr(c, "mu") else c.limit for c in model.channels]
    e_t = [getattr(c, "e_t", 0.0) for c in model.channels]
    e, touch = [c.e for c in model.contacts], -1e-9 if approached else 1e-7
    return impacts(model.system(), sol, e, e_t, mu, model.law, qdot, touch)


def judge(model, sol):
    """Say why a run of a model ends early: "honest: ...", or "fault: ..."."""
    if sol is None:
        return refused(model)
    status = sol.status.name
    if status == "STEP_BUDGET":
        method = zivi.SwitchedRK(rtol=metamorphic.TOL, atol=model.atol, max_steps=MORE)
        more = zivi.simulate(model.system(), model.span, model.start(), method)
        if more.success:
            return f"honest: {len(more.resolved_impacts)} impacts until the end"
        stuck = more.status.name == "STEP_BUDGET"
        return "fault: steps without an end" if stuck else judge(model, more)
    if status == "INCONSISTENT_IMPACT":
        found = impacts_of(model, sol)
        return f"fault: {len(found)} impacts" if found else "honest: no impact obeys the laws"
    if status == "CONTACT_NOT_SOLVED" and (again := repeats(model, sol)):
        return f"honest: {again} impacts at one instant come back to the same velocities"
    qdot = after_impact(model.system(), sol)
    found = accelerations(model.system(), sol, qdot)
    count = "no motion" if not found else "one motion"
    if found and np.ptp(found, axis=0).max() > 1e-3:
        count = "several motions"
    expected = {"INCONSISTENT_CONTACT": "no motion", "INDETERMINATE_CONTACT": "several motions"}
    if expected.get(status) == count:
        return f"honest: {count}"
    return f"fault: {count}"


def after_impact(system, sol):
    """Give the velocities at the end of a run, after an impact there."""
    t, q, qdot = sol.t[-1], sol.q[-1], sol.qdot[-1]
    rows = sol.impacts[(sol.impacts["t"] == t)]
    rows = rows[rows["group"] == rows["group"].max(initial=-1)]
    here = system.at(t, q, qdot)
    rates = (here.gradients @ qdot + here.rates)[rows["gap"]]
    off = [np.abs(rates - rows[name]).sum() for name in ("speed_before", "speed_after")]
    if off[0] >= off[1]:
        return qdot
    push = rows["impulse"] @ here.gradients[rows["gap"]]
    channel = {gap: c for c, gap in enumerate(sol.channel_gaps) if gap is not None}
    for row in rows:
        if row["gap"] in channel:
            push = push + row["tangential_impulse"] * here.tangents[channel[row["gap"]]]
    return qdot + np.linalg.solve(here.mass, push)


def repeats(model, sol, most=300):
    """Give after how many impacts on the gaps that are approached the velocities come back.

    Each of them is the only one that obeys the laws; 0 if they do not come back.
    """
    qdot, seen = sol.qdot[-1], []
    for _ in range(most):
        seen.append(qdot)
        found = impacts_of(model, sol, qdot, approached=True)
        if not found or np.ptp(found, axis=0).max() > 1e-6:
            return 0
        qdot = found[0]
        near = [np.abs(qdot - before).max() < 1e-6 for before in seen]
        if any(near):
            return len(seen) - near.index(True)
    return 0


def refused(model):
    """Say whether two gaps are the same, which is what a model without a run must have."""
    fixed = [c for c in model.contacts if c.motion is None]
    rows = [np.append(c.normal, c.offset) / np.linalg.norm(c.normal) for c in fixed]
    for one, other in itertools.combinations(rows, 2):
        if np.allclose(one, other, rtol=0, atol=1e-12):
            return "honest: two gaps are the same"
    return "fault: refused"


def early(seed, index, name="friction"):
    """Give the status and the verdict of a run of a campaign, None where it is complete."""
    model = metamorphic.FAMILIES[name].draw(np.random.default_rng([seed, index, *name.encode()]))
    run = metamorphic.simulate(model)
    if run.status == "COMPLETED":
        return None
    return run.status, judge(model, run.parts[-1] if run.parts else None)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--family", default="friction")
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, default=None)
    given = parser.parse_args()
    ends = 0
    for index in range(given.runs) if given.only is None else [given.only]:
        if found := early(given.seed, index, given.family):
            ends += 1
            print(given.seed, index, *found, flush=True)
    print(f"{given.family}: {given.runs} runs, {ends} end early")


if __name__ == "__main__":
    main()
