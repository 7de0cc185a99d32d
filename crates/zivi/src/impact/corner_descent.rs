//! Motion into a corner: the log of its impacts, the way down, and the nested accumulations that end it.
//!
//! The way into a corner, drawn: the motion in contact, moved out of it by the heights of all gaps.
//!
//! ```text
//! x = c(t) + sum_i r_i(t) Y_i(tau(t))       tau = (t - t_0) + kappa (t - t_0)^2           (1)
//! ```
//!
//! with `c` of degree 5 through both ends as for one bouncing gap, `r_i` the line of the directions
//! in which gap `i` alone is moved, and `Y` the parabolas of [`NestedAccumulation`]. `kappa` makes the last
//! of them end in the corner, which is known better. Where one gap bounces with a ratio that friction
//! makes, each flight has two halves, under the friction of its rise and of its fall.

use std::ops::Deref;

use crate::kinetics::lcp;
use crate::kinetics::mode::State;
use crate::motion::path::{Curve, Flight};
use crate::motion::state::MechanicalState;
use crate::motion::tail::{Mechanism, SkippedArcs};
use crate::numeric::bernstein::{quintic, Bernstein};
use crate::numeric::tableau::Powers;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::table::{ExtrapolatedEnd, ZenoTable};

/// Most flights of two halves.
const HALVES: usize = 2048;
/// Largest relative change of the times of the flights so that they end in the corner.
const STRETCH: f64 = 0.3;
/// Where the floor exceeds `COARSE` relative tolerances of the fastest speed, flights end at `FLOOR` of one of these
/// instead.
const COARSE: f64 = 300.0;
const FLOOR: f64 = 1e-2;

/// A gap that bounces alone, and the two halves of its flights: mode and acceleration towards the wall.
type Halves = (usize, [(ContactMode, f64); 2]);

/// The state before a corner: what a jump starts from.
pub(crate) struct CornerEntry {
    t: f64,
    /// Coordinates and gaps, and their rates.
    x: Vec<f64>,
    v: Vec<f64>,
    set: GapSet,
    /// The directions `r_i` there, by gap of the set.
    directions: Vec<Vec<f64>>,
    /// Mode of friction there.
    mode: ContactMode,
    /// The gap that bounces alone, and the two halves of its flights: mode and acceleration towards the wall.
    halves: Option<Halves>,
}

impl CornerEntry {
    /// Initial data of an extrapolation into the corner of a set, at the last evaluation of the
    /// system.
    pub(crate) fn new<E>(set: GapSet, state: &mut MechanicalState) -> Result<Self, Failure<E>> {
        let (directions, mode) = (impulse_directions(set, state)?, state.mode());
        let bouncing = set.without(state.closed());
        let halves = match (mode.is_frictionless(), bouncing.len()) {
            (false, 1) => halves(bouncing, state)?,
            _ => None,
        };
        let now = state.now();
        let (t, x, v) = (now.t, now.x.clone(), now.xdot.clone());
        Ok(Self { t, x, v, set, directions, mode, halves })
    }
}

/// The halves of the flights of a gap that bounces alone: a slip that reverses within a flight has the opposite sign
/// in the second.
fn halves<E>(bouncing: GapSet, state: &mut MechanicalState) -> Result<Option<Halves>, Failure<E>> {
    let Some(gap) = bouncing.iter().next() else { return Ok(None) };
    let (rise, u, slips) = (state.mode(), state.gap(gap).1, state.slips().to_vec());
    let kinetics = state.parts().0;
    let n = kinetics.coordinates();
    kinetics.contact(rise)?;
    let pull = -kinetics.acceleration[n + gap];
    let mut fall = rise;
    for channel in rise.slipping().iter() {
        let row = kinetics.row(channel);
        let sign = rise.sign(channel);
        let later = slips[channel] + kinetics.acceleration[n + row] * 2.0 * u / pull;
        if kinetics.coupling(gap, row) != 0.0 && sign * later <= 0.0 {
            fall = fall.with_channel(channel, -sign);
        }
    }
    kinetics.contact(fall)?;
    let pulls = [(rise, pull), (fall, -kinetics.acceleration[n + gap])];
    Ok(pulls.iter().all(|(_, pull)| *pull > 0.0).then_some((gap, pulls)))
}

/// The halves of the flights of a gap from the speed `u` on, with the restitution `e`, down to a speed.
fn half_arcs([rise, fall]: [f64; 2], mut u: f64, e: f64, floor: f64) -> Vec<NestedArc> {
    let (mut arcs, mut start) = (Vec::new(), 0.0);
    let mut push = |length: f64, y: f64, v: f64, a: f64| {
        let closed = GapSet::EMPTY;
        arcs.push(NestedArc { start, length, y: vec![y], v: vec![v], a: vec![a], closed });
        start += length;
    };
    for _ in 0..HALVES {
        if u <= floor {
            break;
        }
        let top = 0.5 * u * u / rise;
        push(u / rise, 0.0, u, -rise);
        push((2.0 * top / fall).sqrt(), top, 0.0, -fall);
        u = e * (2.0 * top * fall).sqrt();
    }
    arcs
}

/// How coordinates and gaps move where one gap of a set does, by its impulses; by gap.
fn impulse_directions<E>(
    set: GapSet,
    state: &mut MechanicalState,
) -> Result<Vec<Vec<f64>>, Failure<E>> {
    let kinetics = state.parts().0;
    let one = |gap: usize| move |i: usize| if i == gap { 1.0 } else { 0.0 };
    Ok(set.iter().map(|i| kinetics.displacement(set, one(i))).collect::<Result<_, _>>()?)
}

/// The way from the entry to the corner that was reached, where the system was evaluated last:
/// its flights down to the given speed, then the motion in contact.
pub(crate) fn descent<E, D: Dynamics<E>>(
    entry: &CornerEntry,
    floor: f64,
    at: &mut Mechanism<'_, '_, D>,
) -> Result<Vec<Flight>, Failure<E>> {
    let Layout { n, .. } = at.state.layout();
    let (set, t) = (entry.set, at.state.now().t);
    let h = t - entry.t;
    if h <= 0.0 {
        return Ok(Vec::new());
    }
    let to = impulse_directions(set, at.state)?;
    let ways = ImpulseDirections { from: &entry.directions, to, h };
    let of = |values: &[f64]| -> Vec<f64> { set.iter().map(|i| values[n + i]).collect() };
    let (y, v) = (of(&entry.x), of(&entry.v));
    // flights that end too early make the others longer: slow flights need a lower floor
    let fastest = set.iter().fold(0.0_f64, |most, i| most.max(entry.v[n + i].abs()));
    let rtol = at.settings.rtol;
    let is_coarse = floor > COARSE * rtol * fastest && floor < fastest;
    let floor = if is_coarse { FLOOR * rtol * fastest } else { floor };
    let mut arcs = match &entry.halves {
        Some((gap, [(_, rise), (_, fall)])) if set.len() == 1 && y[0] == 0.0 => {
            half_arcs([*rise, *fall], v[0], at.e[*gap], floor)
        }
        _ => nest(set, at).arcs(y.clone(), v.clone(), floor),
    };
    let time = arcs.last().map_or(h, |last| last.start + last.length);
    if (time - h).abs() > STRETCH * h {
        arcs.clear();
    }
    let kappa = if arcs.is_empty() { 0.0 } else { (time - h) / (h * h) };
    let none = || vec![0.0; set.len()];
    let still = || [none(), none(), none()];
    let start = if arcs.is_empty() { still() } else { [y, v, none()] };
    let on_the_way = |closed: GapSet, half: usize| match entry.halves {
        Some((_, halves)) => ContactMode { closed, ..halves[half % 2].0 },
        None => ContactMode { closed, ..entry.mode },
    };
    let base = in_contact(entry, &ways, &start, at)?;
    let shortest = 4.0 * f64::EPSILON * t.abs();
    let mut flights: Vec<Flight> = Vec::new();
    let mut s = 0.0;
    for (number, arc) in arcs.iter().enumerate() {
        let [from, to] = [0.0, arc.length].map(|tau| state_at(arc, tau, kappa));
        if to.0 - from.0 <= shortest || h - to.0 <= shortest {
            break;
        }
        s = to.0;
        let closed: GapSet = arc.closed.iter().filter_map(|row| set.iter().nth(row)).collect();
        flights
            .push(Flight { curve: ways.curve(&base, from, to), mode: on_the_way(closed, number) });
    }
    let curve = ways.curve(&base, (s, still()), (h, still()));
    flights.push(Flight { curve, mode: on_the_way(set, 0) });
    Ok(flights)
}

/// Equations of the impacts as they are where the system was evaluated last.
fn nest<D>(set: GapSet, at: &mut Mechanism<'_, '_, D>) -> NestedAccumulation {
    let kinetics = at.state.parts().0;
    let pairs = set.iter().flat_map(|i| set.iter().map(move |j| (i, j)));
    let d = pairs.map(|(i, j)| kinetics.coupling(i, j)).collect();
    let b = set.iter().map(|i| kinetics.b(i)).collect();
    NestedAccumulation { d, b, e: set.iter().map(|i| at.e[i]).collect() }
}

/// The motion in contact, from the part of the state that the heights at the entry leave.
fn in_contact<E, D: Dynamics<E>>(
    entry: &CornerEntry,
    ways: &ImpulseDirections<'_>,
    heights: &Heights,
    at: &mut Mechanism<'_, '_, D>,
) -> Result<SkippedArcs, Failure<E>> {
    let (Layout { n, .. }, size) = (at.state.layout(), entry.x.len());
    let mut state = [&entry.x[..], &entry.v[..]].concat();
    for c in 0..size {
        let [x, v, _] = ways.out(c, 0.0, heights);
        (state[c], state[size + c]) = (state[c] - x, state[size + c] - v);
    }
    for i in entry.set.iter() {
        (state[n + i], state[size + n + i]) = (0.0, 0.0);
    }
    // what slipped in the last flight slips on, but for what turned round or stopped since
    let mut mode = ContactMode { closed: entry.set, ..entry.mode };
    let first = at.end_of_arcs(entry.t, &state, mode)?;
    for channel in entry.mode.slipping().iter() {
        match at.state.slips()[channel] {
            0.0 => {
                mode = mode.without_channel(channel);
                mode.stick = mode.stick.with(GapSet::of(channel));
            }
            slip => mode = mode.with_channel(channel, slip.signum()),
        }
    }
    let last = at.end_here(mode)?;
    Ok(SkippedArcs::between(entry.t, at.state.now().t, [first, last]))
}

/// Heights, speeds and accelerations of the gaps of a corner.
type Heights = [Vec<f64>; 3];

/// The time since the entry, and the heights there, at `tau` of a flight, with scaled times.
fn state_at(arc: &NestedArc, tau: f64, kappa: f64) -> (f64, Heights) {
    let at = arc.start + tau;
    let s = 2.0 * at / (1.0 + (1.0 + 4.0 * kappa * at).sqrt());
    let (rate, bend) = (1.0 + 2.0 * kappa * s, 2.0 * kappa);
    let speed = |i: usize| arc.v[i] + tau * arc.a[i];
    let of = |value: &dyn Fn(usize) -> f64| (0..arc.y.len()).map(value).collect();
    let heights = [
        of(&|i| (arc.y[i] + tau * (arc.v[i] + 0.5 * tau * arc.a[i])).max(0.0)),
        of(&|i| rate * speed(i)),
        of(&|i| rate * rate * arc.a[i] + bend * speed(i)),
    ];
    (s, heights)
}

/// The directions `r_i` at both ends of a time `h`.
struct ImpulseDirections<'r> {
    from: &'r [Vec<f64>],
    to: Vec<Vec<f64>>,
    h: f64,
}

impl ImpulseDirections<'_> {
    /// `sum_i r_i Y_i` of a component and its first two derivatives.
    fn out(&self, c: usize, s: f64, [y, u, a]: &Heights) -> [f64; 3] {
        let mut out = [0.0; 3];
        for (i, (from, to)) in self.from.iter().zip(&self.to).enumerate() {
            let turn = (to[c] - from[c]) / self.h;
            let way = from[c] + s * turn;
            out[0] += way * y[i];
            out[1] += way * u[i] + turn * y[i];
            out[2] += way * a[i] + 2.0 * turn * u[i];
        }
        out
    }

    /// Equation (1) between two times since the entry, of which the heights are of degree 4.
    fn curve(
        &self,
        base: &SkippedArcs,
        (s0, from): (f64, Heights),
        (s1, to): (f64, Heights),
    ) -> Curve {
        let length = s1 - s0;
        let row = |c: usize| {
            let motion = Bernstein::new(&base.rows[c][..6]);
            let motion = motion.split(s1 / self.h).0.split(s0 / s1).1;
            let (first, last) = (self.out(c, s0, &from), self.out(c, s1, &to));
            let out = quintic(first, last, length);
            let x: Vec<f64> =
                motion.coefficients().iter().zip(out).map(|(motion, out)| motion + out).collect();
            [Bernstein::new(&x), Bernstein::new(&derivative(&x, length))]
        };
        let rows = (0..base.rows.len()).map(row).collect();
        Curve::of_rows(base.start + s0, length, rows)
    }
}

/// The derivative, as a polynomial of the same degree.
fn derivative(x: &[f64], h: f64) -> Vec<f64> {
    let n = x.len() - 1;
    let slope = |k: usize| n as f64 * (x[k + 1] - x[k]) / h;
    (0..=n)
        .map(|k| {
            let part = k as f64 / n as f64;
            let before = if k > 0 { part * slope(k - 1) } else { 0.0 };
            before + if k < n { (1.0 - part) * slope(k) } else { 0.0 }
        })
        .collect()
}

// The last impacts of several gaps, and the corner that they approach.

/// Columns of the tables of Zeno points after the first: with 4 in 120 random runs 3 % more impacts
/// are needed before the jumps.
pub(crate) const COLUMNS: usize = 5;
/// Longest pattern, in events.
pub(crate) const LONGEST: usize = 6;
/// Periods over which it must repeat.
const REPEATS: usize = 3;
/// Events of one phase in a table: fewest and most.
const PHASE: (usize, usize) = (4, 7);
/// Largest ratio, and how far the last two may differ, relative to `1 - r`.
const RATIO: (f64, f64) = (0.98, 0.1);

/// An event of an accumulation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Mark {
    pub(crate) hit: GapSet,
    /// The gaps that were closed, or those that were opened.
    pub(crate) with: GapSet,
    pub(crate) t: f64,
    pub(crate) z: Vec<f64>,
}

impl Mark {
    /// A row of the table (1): the time since `start`, then the state.
    fn row_since(&self, start: f64) -> Vec<f64> {
        std::iter::once(self.t - start).chain(self.z.iter().copied()).collect()
    }
}

/// The last events: older ones are given up together.
#[derive(Clone, Debug, Default)]
pub(crate) struct Marks {
    all: Vec<Mark>,
    /// The first that counts.
    first: usize,
    /// The gaps that they hit.
    hit: GapSet,
    /// Memory of others that were given up.
    spare: Vec<Vec<f64>>,
}

impl Deref for Marks {
    type Target = [Mark];

    fn deref(&self) -> &[Mark] {
        &self.all[self.first..]
    }
}

impl Marks {
    const MOST: usize = LONGEST * PHASE.1;

    fn clear(&mut self) {
        if self.all.is_empty() {
            return;
        }
        self.spare.extend(self.all.drain(..).skip(self.first).map(|mark| mark.z));
        (self.first, self.hit) = (0, GapSet::EMPTY);
    }

    fn push(&mut self, hit: GapSet, with: GapSet, now: &State) {
        let (mut z, lost) = if self.len() < Self::MOST {
            (self.spare.pop().unwrap_or_default(), hit)
        } else {
            let oldest = &mut self.all[self.first];
            let taken = (std::mem::take(&mut oldest.z), oldest.hit);
            self.first += 1;
            if self.first == Self::MOST {
                self.all.drain(..self.first);
                self.first = 0;
            }
            taken
        };
        z.clear();
        z.reserve_exact(now.x.len() + now.xdot.len());
        z.extend_from_slice(&now.x);
        z.extend_from_slice(&now.xdot);
        self.all.push(Mark { hit, with, t: now.t, z });
        self.hit = match lost == hit {
            true => self.hit.with(hit),
            false => gaps_of(self),
        };
    }
}

/// The gaps that events hit.
fn gaps_of(marks: &[Mark]) -> GapSet {
    marks.iter().fold(GapSet::EMPTY, |gaps, mark| gaps.with(mark.hit))
}

#[cfg(test)]
impl From<Vec<Mark>> for Marks {
    fn from(all: Vec<Mark>) -> Self {
        Self { hit: gaps_of(&all), all, ..Self::default() }
    }
}

/// The last impacts, and the last of them that opened contacts.
#[derive(Clone, Debug, Default)]
pub(crate) struct CornerLog {
    pub(crate) impacts: Marks,
    pub(crate) openings: Marks,
    /// All gaps that were hit, including those whose impacts are no longer stored.
    hit: GapSet,
    /// Impacts between which friction in a joint or at a closed contact changes: in a fixed
    /// part of each flight, so that even those of one gap have a ratio of their own.
    kicks: usize,
}

impl CornerLog {
    pub(crate) fn clear(&mut self) {
        self.impacts.clear();
        self.openings.clear();
        self.hit = GapSet::EMPTY;
        self.kicks = 0;
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.impacts.all.is_empty() && self.openings.all.is_empty()
    }

    /// Later impacts repeat no earlier ones except those that opened contacts.
    pub(crate) fn clear_impacts(&mut self) {
        self.impacts.clear();
    }

    /// The impact that follows is one of those between which friction changes, or is not.
    pub(crate) fn note_kick(&mut self, changes: bool) {
        self.kicks = if changes { self.kicks + 1 } else { 0 };
    }

    /// How many gaps take part in an accumulation with a ratio of its own, at least.
    pub(crate) fn fewest(&self) -> usize {
        if self.kicks >= PHASE.0 {
            1
        } else {
            2
        }
    }

    /// Appends an impact.
    pub(crate) fn note(&mut self, hit: GapSet, closed: GapSet, opened: GapSet, now: &State) {
        self.hit = self.hit.with(hit);
        self.impacts.push(hit, closed, now);
        if !opened.is_empty() {
            self.openings.push(hit, opened, now);
        }
    }

    /// The gaps of the last impacts.
    pub(crate) fn recent(&self) -> GapSet {
        self.impacts.hit
    }

    /// The gaps of all impacts.
    pub(crate) fn hit(&self) -> GapSet {
        self.hit
    }
}

/// The shortest pattern with at least this number of gaps: its length and gaps.
pub(crate) fn pattern(marks: &[Mark], fewest: usize) -> Option<(usize, GapSet)> {
    let n = marks.len();
    let same = |a: &Mark, b: &Mark| a.hit == b.hit && a.with == b.with;
    let repeats = |&p: &usize| {
        n > REPEATS * p && (n - (REPEATS - 1) * p - 1..n).all(|k| same(&marks[k], &marks[k - p]))
    };
    let p = (1..=LONGEST).find(repeats)?;
    let gaps = marks[n - p..].iter().fold(GapSet::EMPTY, |set, it| set.with(it.hit));
    (gaps.len() >= fewest).then_some((p, gaps))
}

/// The events of the phase of the last one, that first, and the ratio of their times.
fn of_last_phase(marks: &[Mark], p: usize) -> Option<(Vec<&Mark>, f64)> {
    let phase: Vec<&Mark> = marks.iter().rev().step_by(p).take(PHASE.1).collect();
    if phase.len() < PHASE.0 {
        return None;
    }
    let gap = |k: usize| phase[k].t - phase[k + 1].t;
    let (r, previous) = (gap(0) / gap(1), gap(1) / gap(2));
    let steady = (r - previous).abs() < RATIO.1 * (1.0 - r);
    (r > 0.0 && r < RATIO.0 && steady).then_some((phase, r))
}

/// The sum of the geometric series of the times: where the corner of a set is, without the state. Events that
/// hit other gaps lead elsewhere: a gap comes to rest within each flight of another, long before that does.
pub(crate) fn time_of_corner(marks: &[Mark], fewest: usize, set: GapSet) -> Option<f64> {
    let (p, gaps) = pattern(marks, fewest)?;
    if !gaps.without(set).is_empty() {
        return None;
    }
    let (phase, r) = of_last_phase(marks, p)?;
    Some(phase[0].t + (phase[0].t - phase[1].t) * r / (1.0 - r))
}

/// Equation (1) for the phase of the last event.
pub(crate) fn landing(
    marks: &[Mark],
    p: usize,
    scales: &[f64],
) -> Option<ExtrapolatedEnd<Vec<f64>>> {
    let (phase, r) = of_last_phase(marks, p)?;
    let first = phase[phase.len() - 1].t;
    let mut table = ZenoTable::new(scales.len(), COLUMNS);
    for mark in &phase {
        table.push(&mark.row_since(first));
    }
    let found = table.landing(first, phase[0].t, Powers { ratio: r, first: r }, scales);
    found.filter(|found| found.size <= 1.0)
}

// The impacts of several gaps that come to rest together in a corner, each computed: with the
// mobilities and forces of the corner, which the motion approaches,
//
// ```text
// y'' = b + D lambda,  0 <= lambda  perp  y'' >= 0 on contacts        y+' = y-' + D P       (1)
// ```
//
// All flights are parabolas. Where a gap has become slow compared with the others, its last impact is
// plastic: under constant forces that leaves them as the rest of its bounces would.

/// Data of equations (1): `D` row by row, `b` and the restitutions of the gaps of a corner.
pub(crate) struct NestedAccumulation {
    pub(crate) d: Vec<f64>,
    pub(crate) b: Vec<f64>,
    pub(crate) e: Vec<f64>,
}

/// Between two impacts: heights and speeds at the start, accelerations.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct NestedArc {
    pub(crate) start: f64,
    pub(crate) length: f64,
    pub(crate) y: Vec<f64>,
    pub(crate) v: Vec<f64>,
    pub(crate) a: Vec<f64>,
    /// By the order of the gaps in the corner.
    pub(crate) closed: GapSet,
}

/// Most flights of a corner.
const MOST: usize = 4096;
/// A gap is slow below this part of the speeds of the nest.
const SLOW: f64 = 1e-5;
/// Gaps that are hit within this fraction of a flight are hit together.
const TOGETHER: f64 = 1e-13;

impl NestedAccumulation {
    /// The flights from heights and speeds, at time zero, until all speeds are below `floor`; empty
    /// where they do not come to rest.
    pub(crate) fn arcs(&self, mut y: Vec<f64>, mut v: Vec<f64>, floor: f64) -> Vec<NestedArc> {
        let (mut arcs, mut t) = (Vec::new(), 0.0);
        while arcs.len() < MOST {
            let speed = self.speed(&y, &v);
            if speed <= floor {
                return arcs;
            }
            let Some((closed, a)) = self.contacts(&y, &v) else { break };
            let ends: Vec<f64> = (0..y.len())
                .map(|i| if closed.has(i) { f64::INFINITY } else { flight(y[i], v[i], a[i]) })
                .collect();
            let length = ends.iter().fold(f64::INFINITY, |a, &b| a.min(b));
            if !length.is_finite() {
                break;
            }
            arcs.push(NestedArc {
                start: t,
                length,
                y: y.clone(),
                v: v.clone(),
                a: a.clone(),
                closed,
            });
            t += length;
            let hit: GapSet =
                (0..y.len()).filter(|&i| ends[i] <= length * (1.0 + TOGETHER)).collect();
            for i in 0..y.len() {
                y[i] = (y[i] + length * (v[i] + 0.5 * length * a[i])).max(0.0);
                v[i] += length * a[i];
                if closed.has(i) || hit.has(i) {
                    y[i] = 0.0;
                }
                if closed.has(i) {
                    v[i] = 0.0;
                }
            }
            if self.strike(&mut v, closed, hit, SLOW * speed).is_none() {
                break;
            }
        }
        Vec::new()
    }

    /// The largest speed with which a gap is or will be hit.
    fn speed(&self, y: &[f64], v: &[f64]) -> f64 {
        let of = |i: usize| (v[i] * v[i] + 2.0 * y[i] * self.b[i].abs()).sqrt();
        (0..y.len()).map(of).fold(0.0, f64::max)
    }

    /// `D` of some gaps, row by row.
    fn part(&self, set: GapSet) -> Vec<f64> {
        let k = self.b.len();
        set.iter()
            .flat_map(|i| set.iter().map(move |j| (i, j)))
            .map(|(i, j)| self.d[i * k + j])
            .collect()
    }

    /// The gaps that are closed and pressed, and the accelerations.
    fn contacts(&self, y: &[f64], v: &[f64]) -> Option<(GapSet, Vec<f64>)> {
        let k = y.len();
        let touching: GapSet = (0..k).filter(|&i| y[i] == 0.0 && v[i] == 0.0).collect();
        let b: Vec<f64> = touching.iter().map(|i| self.b[i]).collect();
        let found = lcp::solve(&self.part(touching), &b)?;
        let mut closed = GapSet::EMPTY;
        let mut a = self.b.clone();
        for (row, j) in touching.iter().enumerate() {
            if found.positive.has(row) {
                closed = closed.with(GapSet::of(j));
            }
            (0..k).for_each(|i| a[i] += self.d[i * k + j] * found.z[row]);
        }
        closed.iter().for_each(|i| a[i] = 0.0);
        Some((closed, a))
    }

    /// The speeds after an impact.
    fn strike(&self, v: &mut [f64], closed: GapSet, hit: GapSet, slow: f64) -> Option<()> {
        let (k, set) = (v.len(), closed.with(hit));
        let e = |i: usize| if -self.e[i] * v[i] <= slow { 0.0 } else { self.e[i] };
        let before: Vec<f64> = set.iter().map(|i| -e(i) * v[i]).collect();
        let right: Vec<f64> = set.iter().map(|i| (1.0 + e(i)) * v[i]).collect();
        let found = lcp::solve(&self.part(set), &right)?;
        for (row, j) in set.iter().enumerate() {
            (0..k).for_each(|i| v[i] += self.d[i * k + j] * found.z[row]);
        }
        for (row, i) in set.iter().enumerate() {
            v[i] = if found.positive.has(row) { before[row] } else { v[i].max(before[row]) };
        }
        Some(())
    }
}

/// When `y + v t + a t^2/2` falls to zero, for `y >= 0`; infinite if it never does.
fn flight(y: f64, v: f64, a: f64) -> f64 {
    let root = (v * v - 2.0 * a * y).sqrt();
    if y == 0.0 && v <= 0.0 {
        return if a < 0.0 || v < 0.0 { 0.0 } else { f64::INFINITY };
    }
    if v > 0.0 {
        if a < 0.0 {
            (v + root) / -a
        } else {
            f64::INFINITY
        }
    } else if root.is_nan() || root == v {
        f64::INFINITY
    } else {
        2.0 * y / (root - v)
    }
}

#[cfg(test)]
mod corner_descent_tests {
    use super::*;

    /// A ball with the accelerations 5 and 2 while rising and falling, from 3 m/s: v^2/2 = acceleration * height.
    #[test]
    fn half_arcs_are_parabolas_with_the_pull_of_their_half() {
        let arcs = half_arcs([5.0, 2.0], 3.0, 0.5, 0.4);
        let heights = |k: usize, tau: f64| {
            let NestedArc { y, v, a, .. } = &arcs[k];
            [y[0] + tau * (v[0] + 0.5 * tau * a[0]), v[0] + tau * a[0]]
        };
        let (mut t, mut u) = (0.0, 3.0_f64);
        for k in (0..arcs.len()).step_by(2) {
            let top = u * u / 10.0;
            let down = 2.0 * top.sqrt() / 2.0_f64.sqrt() / 2.0_f64.sqrt();
            let speed = (2.0 * 2.0 * top).sqrt();
            for (half, length, end) in [(k, u / 5.0, [top, 0.0]), (k + 1, down, [0.0, -speed])] {
                assert!((arcs[half].start - t).abs() < 1e-15 * (1.0 + t), "{half}");
                assert!((arcs[half].length - length).abs() < 1e-15, "{half}");
                for (ours, theirs) in heights(half, length).into_iter().zip(end) {
                    assert!((ours - theirs).abs() < 1e-15, "{half} {ours} {theirs}");
                }
                t += length;
            }
            u = 0.5 * speed;
        }
        // each flight returns with .5 sqrt(2/5) of its speed: 3, .949, .3 m/s, the last too slow
        assert_eq!(arcs.len(), 4);
    }

    /// tau = s + kappa s^2 at the time s: the heights and their rates are those of the chain rule.
    #[test]
    fn stretched_arcs_keep_their_heights() {
        let one = |x: f64| vec![x];
        let (start, length, closed) = (0.7, 0.4, GapSet::EMPTY);
        let arc = NestedArc { start, length, y: one(0.2), v: one(1.5), a: one(-3.0), closed };
        let kappa = 0.15;
        for tau in [0.0, 0.13, 0.4] {
            let (s, [y, u, a]) = state_at(&arc, tau, kappa);
            assert!((s + kappa * s * s - (start + tau)).abs() < 1e-15);
            let height = |s: f64| {
                let tau = s + kappa * s * s - start;
                0.2 + tau * (1.5 - 1.5 * tau)
            };
            assert!((y[0] - height(s)).abs() < 1e-15);
            let d = 1e-3;
            let (before, after) = (height(s - d), height(s + d));
            assert!(((after - before) / (2.0 * d) - u[0]).abs() < 1e-5, "{tau}");
            assert!(((after + before - 2.0 * height(s)) / (d * d) - a[0]).abs() < 1e-5, "{tau}");
        }
    }

    #[test]
    fn a_derivative_of_the_same_degree_has_the_slopes() {
        let (h, n) = (0.4, 5);
        // t^3 over [0, h] in Bernstein form of degree 5: h^3 (k over 3)/(5 over 3)
        let choose = |k: usize| (k * k.saturating_sub(1) * k.saturating_sub(2)) as f64 / 6.0;
        let x: Vec<f64> = (0..=n).map(|k| h * h * h * choose(k) / 10.0).collect();
        let slope = Bernstein::new(&derivative(&x, h));
        for k in 0..=8 {
            let t = h * f64::from(k) / 8.0;
            assert!((slope.at(t / h) - 3.0 * t * t).abs() < 1e-15, "{t}");
        }
    }
}

#[cfg(test)]
mod corner_log_tests {
    use super::*;

    #[test]
    fn a_corner_is_extrapolated_with_the_ratio_of_its_times() {
        // t = 2 - q - 0.2 q^2, z = 1 + q - 0.5 q^2, q = 0.3^k; gaps 0 and 1 in turn
        let mark = |k: i32| {
            let q = 0.3f64.powi(k / 2) * if k % 2 == 0 { 1.0 } else { 0.6 };
            let (hit, with) = (GapSet::of((k % 2) as usize), GapSet::EMPTY);
            Mark { hit, with, t: 2.0 - q - 0.2 * q * q, z: vec![1.0 + q - 0.5 * q * q] }
        };
        let marks: Vec<Mark> = (0..14).map(mark).collect();
        assert_eq!(pattern(&marks, 2), Some((2, GapSet::of_bits(3))));
        assert_eq!(pattern(&marks[..6], 2), None);
        let found = landing(&marks, 2, &[1e-5, 1e-5]).unwrap();
        let errors = [(found.t - 2.0).abs(), (found.state()[0] - 1.0).abs()];
        assert!(errors[0] < 1e-6 && errors[1] < 1e-6, "{found:?}");
        assert!(errors[0] <= found.size * 1e-5 && errors[1] <= found.errors()[0], "{found:?}");
        assert_eq!(landing(&marks, 2, &[1e-14, 1e-14]), None);
        // one gap that bounces is an impact sequence, and times without a ratio are no corner
        let alone = |mark: &Mark| Mark { hit: GapSet::of(0), ..mark.clone() };
        assert_eq!(pattern(&marks.iter().map(alone).collect::<Vec<_>>(), 2), None);
        let mut uneven = marks.clone();
        uneven[11].t += 0.5 * (marks[13].t - marks[11].t);
        assert_eq!(landing(&uneven, 2, &[1e9, 1e9]), None);
        // without the table: one geometric series
        let sum = time_of_corner(&marks, 2, GapSet::of_bits(3)).unwrap();
        assert!((sum - 2.0).abs() < 1e-5 && marks[13].t < 2.0 - 1e-4, "{sum}");
        assert_eq!(time_of_corner(&marks, 2, GapSet::of(0)), None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In a wedge with `e < c^2 (1 + e)` the gaps come to rest alternately, `c^2` faster each pair.
    #[test]
    fn a_ball_in_an_obtuse_wedge() {
        let c = 2f64.cos().abs();
        let nest =
            NestedAccumulation { d: vec![1.0, c, c, 1.0], b: vec![-1.0, -1.0], e: vec![0.1, 0.1] };
        let arcs = nest.arcs(vec![0.0, 0.0], vec![1.0, 0.0], 1e-9);
        // each contact that an impact opens comes to rest before the next impact of the other gap
        let opened: Vec<f64> = arcs
            .windows(2)
            .filter(|pair| !pair[0].closed.is_empty() && pair[1].closed.is_empty())
            .map(|pair| pair[1].start)
            .collect();
        let end = arcs.last().map_or(0.0, |arc| arc.start + arc.length);
        let ratios: Vec<f64> = opened.windows(3).map(|t| (end - t[2]) / (end - t[0])).collect();
        assert!(ratios.len() > 12, "{opened:?}");
        assert!(ratios[..8].iter().all(|ratio| (ratio - c * c).abs() < 1e-6), "{ratios:?}");
        // energy L = g'.D^-1 g'/2 + lambda.g, lambda = 1/(1 + c), falls from flight to flight
        let depth = |arc: &NestedArc| {
            let [v, w] = [arc.v[0], arc.v[1]];
            let kinetic = (v * v - 2.0 * c * v * w + w * w) / (2.0 * (1.0 - c * c));
            kinetic + (arc.y[0] + arc.y[1]) / (1.0 + c)
        };
        assert!(arcs.windows(2).all(|pair| depth(&pair[1]) <= depth(&pair[0]) * (1.0 + 1e-12)));
    }

    #[test]
    fn one_gap_is_a_ball() {
        let nest = NestedAccumulation { d: vec![1.0], b: vec![-2.0], e: vec![0.5] };
        let arcs = nest.arcs(vec![0.0], vec![1.0], 1e-6);
        let end = arcs.last().map_or(0.0, |arc| arc.start + arc.length);
        assert!((end - 2.0).abs() < 1e-5 && arcs[1].start == 1.0 && arcs[1].v == [0.5], "{arcs:?}");
    }
}
