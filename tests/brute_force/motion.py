"""Motion with impacts by the extrapolated midpoint rule, every impact until it is slow."""

import itertools

from equations import System, complementary, dot, solved
from mpmath import mp, mpf

SLOW, CORNER = mpf(10) ** -19, mpf(10) ** -15
"""A gap whose impacts are slower is closed; gaps that all are slower than this are in a corner."""
ACCURACY = mpf(10) ** -26
LONGEST = mpf(1) / 25
COLUMNS = 16


def together(events):
    """Accumulations of several gaps in turn end in one corner: their closings are one event."""
    found = []
    for event in events:
        last = found[-1] if found else ["", "0"]
        same = abs(mpf(event[1]) - mpf(last[1])) < mpf(10) ** -13
        if event[0] == "zeno" and last[0] in ("zeno", "corner") and same:
            found[-1] = ["corner", event[1], sorted([*last[2], *event[2]]), event[3]]
        else:
            found.append(event)
    return found


class Run:
    """A run, as far as it has come."""

    def __init__(self, case):
        self.system = System(case)
        self.t = mpf(0)
        self.q, self.w = ([mpf(str(x)) for x in part] for part in case["start"])
        self.end = mpf(str(case["end"]))
        self.closed = ()
        self.events = []
        self.impacts = 0
        self.struck = []
        self.length = LONGEST

    # --- steps

    def step(self, h):
        """The state after h, by the extrapolated midpoint rule, and whether it is accurate."""
        n, size = self.system.n, 2 * self.system.n
        y0 = [*self.q, *self.w]
        limit = ACCURACY * (1 + max(abs(y) for y in y0))

        def slope(t, y):
            return [*y[n:], *self.system.motion(t, y[:n], y[n:], self.closed)[0]]

        first = slope(self.t, y0)
        table = []
        for k in range(1, COLUMNS + 1):
            parts = 2 * k
            d = h / parts
            before, now = y0, [a + d * b for a, b in zip(y0, first, strict=True)]
            for i in range(1, parts):
                f = slope(self.t + i * d, now)
                before, now = now, [a + 2 * d * b for a, b in zip(before, f, strict=True)]
            row = [now]
            for j, old in enumerate(table, start=1):
                factor = mpf(1) / ((mpf(k) / (k - j)) ** 2 - 1)
                row.append([a + (a - b) * factor for a, b in zip(row[-1], old, strict=True)])
            if k > 2:
                error = max(abs(row[-1][i] - row[-2][i]) for i in range(size))
                if error < limit:
                    return row[-1], True
            table = row
        return row[-1], False

    def set(self, h, y):
        self.t += h
        self.q, self.w = y[: self.system.n], y[self.system.n :]

    def project(self, closed):
        """Coordinates and velocities along the impulses onto closed gaps."""
        for _ in range(3):
            mass, _, gaps, normals, _, rates = self.system.at(self.t, self.q, self.w)
            ways = {i: solved(mass, normals[i]) for i in closed}
            matrix = [[dot(normals[i], ways[j]) for j in closed] for i in closed]
            for name, off in (
                ("q", [-gaps[i] for i in closed]),
                ("w", [-dot(normals[i], self.w) - rates[i] for i in closed]),
            ):
                value = getattr(self, name)
                for i, size in zip(closed, solved(matrix, off), strict=True):
                    value = [a + size * b for a, b in zip(value, ways[i], strict=True)]
                setattr(self, name, value)

    def state(self):
        return [mp.nstr(x, 26) for x in (*self.q, *self.w)]

    def note(self, kind, gaps):
        self.events.append([kind, mp.nstr(self.t, 26), list(gaps), self.state()])

    # --- what is seen in a step of length h that ends in y

    def lowest(self, h, y):
        """Where a gap first is below zero: by the quintic through both ends, at many points."""
        n, s = self.system.n, self.system
        g0, v0 = s.gaps(self.t, self.q, self.w)
        a0 = s.second(self.t, self.q, self.w, self.closed)
        g1, v1 = s.gaps(self.t + h, y[:n], y[n:])
        a1 = s.second(self.t + h, y[:n], y[n:], self.closed)
        first = None
        for i in range(s.m):
            if i in self.closed:
                continue
            b = [g0[i], g0[i] + h * v0[i] / 5, 0, 0, g1[i] - h * v1[i] / 5, g1[i]]
            b[2] = 2 * b[1] - b[0] + h * h * a0[i] / 20
            b[3] = 2 * b[4] - b[5] + h * h * a1[i] / 20
            if all(x > 0 for x in b[1:]):
                continue
            for k in range(1, 65):
                x = mpf(k) / 64
                row = b
                while len(row) > 1:
                    row = [(1 - x) * p + x * r for p, r in itertools.pairwise(row)]
                if row[0] < 0:
                    if first is None or x < first[0]:
                        first = (x, i)
                    break
        return first

    def below(self, h, y, hit):
        """Another open gap that is below zero."""
        n = self.system.n
        gaps, _ = self.system.gaps(self.t + h, y[:n], y[n:])
        others = (i for i in range(self.system.m) if i not in (*self.closed, hit))
        return next((i for i in others if gaps[i] < -(mpf(10) ** -30)), None)

    def hit(self, i, h):
        """Newton's iteration for the time of an impact near h."""
        n = self.system.n
        low = mpf(0)
        g, v = (part[i] for part in self.system.gaps(self.t, self.q, self.w))
        if abs(g) < mpf(10) ** -36:  # from an impact: the other root
            a = self.system.second(self.t, self.q, self.w, self.closed)[i]
            guess = -2 * v / a if a < 0 else h
            low = guess / 2 if guess < h else low
            h = min(h, guess) if guess > 0 else h
        for _ in range(60):
            y, _ = self.step(h)
            g, v = (part[i] for part in self.system.gaps(self.t + h, y[:n], y[n:]))
            away = h * mpf("-0.1") if g < 0 else h * mpf("0.05")
            change = -g / v if v < 0 else away
            h = max(h + change, (low + h) / 2)
            if abs(change) < mpf(10) ** -32 + mpf(10) ** -22 * h:
                break
        y, _ = self.step(h)
        return h, y

    def released(self, h, y):
        """The closed gap whose force vanishes in a step, and when."""
        n = self.system.n
        after = self.system.motion(self.t + h, y[:n], y[n:], self.closed)[1]
        negative = [i for i in self.closed if after[i] < 0]
        if not negative:
            return None
        best = None
        for i in negative:
            a, fa = mpf(0), self.system.motion(self.t, self.q, self.w, self.closed)[1][i]
            b, fb = h, after[i]
            for _ in range(100):
                x = b - fb * (b - a) / (fb - fa)
                if not 0 <= x <= h:
                    x = (a + b) / 2
                z, _ = self.step(x)
                a, fa = b, fb
                b, fb = x, self.system.motion(self.t + x, z[:n], z[n:], self.closed)[1][i]
                if abs(b - a) < mpf(10) ** -24 or fb == fa:
                    break
            if best is None or b < best[0]:
                best = (b, i)
        return best

    # --- events

    def strike(self, i):
        s = self.system
        speeds = s.gaps(self.t, self.q, self.w)[1]
        touched = sorted({*self.closed, i})
        mass, _, _, normals, _, _ = s.at(self.t, self.q, self.w)
        ways = {j: solved(mass, normals[j]) for j in touched}
        matrix = [[dot(normals[j], ways[k]) for k in touched] for j in touched]
        before = [mpf(0) if j in self.closed else speeds[j] for j in touched]
        right = [(1 + s.e[j]) * v for j, v in zip(touched, before, strict=True)]
        p, positive = complementary(matrix, right)
        for j, size in zip(touched, p, strict=True):
            self.w = [a + size * b for a, b in zip(self.w, ways[j], strict=True)]
        self.impacts += 1
        if -speeds[i] > mpf("1e-3"):
            self.events.append(["impact", mp.nstr(self.t, 26), [i], [mp.nstr(-speeds[i], 26)]])
        stays = []
        for j, pushed in zip(touched, positive, strict=True):
            after = s.gaps(self.t, self.q, self.w)[1][j]
            resting = j != i and pushed
            slow = j == i and after < SLOW
            if resting or slow or after < mpf(10) ** -30:
                stays.append(j)
        opened = [j for j in self.closed if j not in stays]
        self.struck = [*self.struck[-7:], i]
        self.close(stays)
        if opened:
            self.note("open", opened)
        self.corner()

    def close(self, stays):
        """The gaps that stay closed, as far as the forces press on them."""
        before = self.closed
        if stays:
            self.project(stays)
        mass, force, _, normals, curvature, _ = self.system.at(self.t, self.q, self.w)
        free = solved(mass, force)
        ways = {j: solved(mass, normals[j]) for j in stays}
        matrix = [[dot(normals[j], ways[k]) for k in stays] for j in stays]
        right = [dot(normals[j], free) + curvature[j] for j in stays]
        _, positive = complementary(matrix, right)
        self.closed = tuple(j for j, on in zip(stays, positive, strict=True) if on)
        new = [j for j in self.closed if j not in before]
        for j in new:
            self.note("zeno", [j])
        if new:
            self.struck = []

    def corner(self):
        """Whether several gaps accumulate together and are as good as closed."""
        s = self.system
        gaps, speeds = s.gaps(self.t, self.q, self.w)
        near = [
            j
            for j in range(s.m)
            if j in self.closed or (abs(speeds[j]) < CORNER and abs(gaps[j]) < CORNER * CORNER)
        ]
        if len([j for j in near if j not in self.closed]) < 1 or len(near) < 2:
            return
        opened = any(set(e[2]) & set(near) for e in self.events[-30:] if e[0] == "open")
        if not opened and len(set(self.struck) & set(near)) < 2:
            return
        forces = s.motion(self.t, self.q, self.w, tuple(near))[1]
        if all(force > 0 for force in forces.values()):
            self.closed = tuple(near)
            self.project(near)
            self.note("corner", near)

    def go(self):
        while self.t < self.end:
            h = min(self.length, self.end - self.t)
            y, accurate = self.step(h)
            if not accurate:
                self.length = h / 2
                continue
            hit = self.lowest(h, y)
            release = self.released(h, y) if self.closed else None
            if hit is not None:
                gap, (length, y) = hit[1], self.hit(hit[1], hit[0] * h)
                while (other := self.below(length, y, gap)) is not None:  # it was hit before
                    gap, (length, y) = other, self.hit(other, length)
                if length > h * mpf("1.01"):
                    raise RuntimeError(f"impact outside of the step: {length} {h}")
                if release is None or length <= release[0]:
                    if self.t + length >= self.end:
                        raise RuntimeError("the run ends near an impact")
                    self.set(length, y)
                    self.strike(gap)
                    self.length = LONGEST
                    continue
            if release is not None:
                length, i = release
                y, _ = self.step(length)
                self.set(length, y)
                self.project(self.closed)
                self.closed = tuple(j for j in self.closed if j != i)
                self.note("lift", [i])
                # off the root at zero, where all vanish
                y, _ = self.step(mpf("1e-3"))
                self.set(mpf("1e-3"), y)
                continue
            self.set(h, y)
            if self.closed:
                self.project(self.closed)
            self.length = LONGEST

    def result(self):
        return {
            "state": self.state(),
            "active": list(self.closed),
            "n_impacts": self.impacts,
            "events": together(self.events),
        }
