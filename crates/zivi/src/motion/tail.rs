//! The infinitely many flights that a jump skips, evaluated when they are requested.
//!
//! The bouncing gap follows the flights `Y(t)` of [`crate::Tail`]. The system follows the motion
//! `c(t)` that it would have in contact, and is moved out of it along the direction `r(t)` in which
//! the impulses act,
//!
//! ```text
//! x = c(t) + r(t) Y(t)      x' = c'(t) + r'(t) Y(t) + r(t) Y'(t)                         (1)
//! ```
//!
//! with `c` the polynomial of degree 5 through position, velocity and acceleration at both ends,
//! and `r` the line. A channel that every impact stops slips along each flight, from rest. With its slip
//! `S(t)` and the directions `p(t)` in which the impulses that stop it act, (1) has the terms `p S` and
//! `p' S + p S'` more, and `c` ends where these leave it.
//!
//! The defect of the equation of motion is one more term `D(t)`, zero at the Zeno point: the forces
//! depend on `Y` and `Y'`, `c` and `r` are no polynomials, friction works along flights and in
//! impacts. On the flight `m`, with `q = e^m`, `h` its length and `theta` the part of it that is over,
//!
//! ```text
//! D'' = sum_jk A_jk q^k theta^j      D'(q e) = D'(q) + h int D'' dtheta + sum_k J_k q^k        (2)
//! ```
//!
//! with `A` from the forces at [`POINTS`] of a few flights, and `J` from the impacts at their ends.
//! `D'` and `D` at the starts of flights are also polynomials in `q`.

use crate::kinetics::mode::{Key, Limit};
use crate::kinetics::{Kinetics, Model};
use crate::motion::state::MechanicalState;
use crate::numeric::bernstein::{quintic, Bernstein};
use crate::numeric::dense::largest;
use crate::record::gap_set::{ContactMode, GapSet};
use crate::record::status::Failure;
use crate::switched::SwitchedRk;
use crate::system::dynamics::{Dynamics, Layout};
use crate::zeno::arc::TailArc;
use crate::zeno::chain::Chain;
use crate::zeno::table::ExtrapolatedEnd;
use crate::zeno::tail::Tail;

/// Largest number of flights of a polynomial in `e^m`.
pub(crate) const ORDERS: usize = 4;
/// Parts of a flight at which the forces are evaluated: Lobatto's points.
pub(crate) const POINTS: [f64; 4] = [0.0, 0.276_393_202_250_021, 0.723_606_797_749_979, 1.0];

/// Coefficients of a polynomial in `q = e^m`, the constant first.
pub(crate) type InPowers = [f64; ORDERS + 1];

/// The polynomial of limited degree with these values at `q`.
pub(crate) fn through<const N: usize>(q: &[f64], values: &[f64]) -> [f64; N] {
    let mut d = values.to_vec();
    for level in 1..q.len() {
        for i in (level..q.len()).rev() {
            d[i] = (d[i] - d[i - 1]) / (q[i] - q[i - level]);
        }
    }
    // from the Newton form to powers
    let mut a = [0.0; N];
    for (q, d) in q.iter().zip(&d).rev() {
        for k in (1..N).rev() {
            a[k] = a[k - 1] - q * a[k];
        }
        a[0] = d - q * a[0];
    }
    a
}

fn value(a: &[f64], q: f64) -> f64 {
    a.iter().rev().fold(0.0, |sum, a| sum * q + a)
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut all = vec![0.0; a.len() + b.len() - 1];
    for (i, a) in a.iter().enumerate() {
        b.iter().enumerate().for_each(|(k, b)| all[i + k] += a * b);
    }
    all
}

/// A part of a flight: its number, `e^m`, its length and the part that is over.
pub(crate) type PartOfArc = (usize, f64, f64, f64);

/// A channel that every impact of the flights stops.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StoppedSlip {
    /// How a unit of it moves the components, at both ends.
    pub(crate) ways: [Vec<f64>; 2],
    /// Its acceleration at the starts and ends of flights.
    pub(crate) accelerations: [InPowers; 2],
}

impl StoppedSlip {
    /// How far it is, and its speed.
    fn at(&self, tail: &Tail, part: Option<PartOfArc>) -> (f64, f64) {
        let [a, b] = &self.accelerations;
        let mean: Vec<f64> = a.iter().zip(b).map(|(a, b)| a / 3.0 + b / 6.0).collect();
        let before = tail.sum_over_arcs(&mean, 2, part.map(|part| part.0));
        let Some((_, q, h, theta)) = part else { return (before, 0.0) };
        let [a, b] = [value(a, q), value(b, q) - value(a, q)];
        let along = h * h * theta * theta * (a / 2.0 + b * theta / 6.0);
        (before + along, h * theta * (a + b * theta / 2.0))
    }

    /// The speed along a flight.
    pub(crate) fn speed(&self, (_, q, h, theta): PartOfArc) -> f64 {
        let [a, b] = self.accelerations.each_ref().map(|of| value(of, q));
        h * theta * (a + (b - a) * theta / 2.0)
    }

    fn acceleration(&self, (_, q, _, theta): PartOfArc) -> f64 {
        let [a, b] = self.accelerations.each_ref().map(|of| value(of, q));
        a + theta * (b - a)
    }
}

/// `D` of a component, equation (2).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Correction {
    pub(crate) component: usize,
    /// `A`, by the power of `theta`.
    pub(crate) accelerations: [InPowers; POINTS.len()],
    /// `J`.
    pub(crate) jumps: InPowers,
    /// `D` and `D'` at the starts of flights.
    starts: [Vec<f64>; 2],
}

impl Correction {
    pub(crate) fn new(
        component: usize,
        (accelerations, jumps): ([InPowers; POINTS.len()], InPowers),
        tail: &Tail,
    ) -> Self {
        let (mut mean, mut moment) = ([0.0; ORDERS + 1], [0.0; ORDERS + 1]);
        for (j, of) in accelerations.iter().enumerate() {
            let j = j as f64;
            for (k, a) in of.iter().enumerate() {
                mean[k] += a / (j + 1.0);
                moment[k] += a / ((j + 1.0) * (j + 2.0));
            }
        }
        let lengths = tail.lengths();
        let before = |change: Vec<f64>| -> Vec<f64> {
            tail.sum_of_arcs_from(&change).iter().map(|left| -left).collect()
        };
        let mut change = product(&lengths, &mean);
        change.iter_mut().zip(jumps).for_each(|(change, jump)| *change += jump);
        let velocity = before(change);
        let mut change = product(&lengths, &velocity);
        let bent = product(&product(&lengths, &lengths), &moment);
        change.iter_mut().zip(bent).for_each(|(change, bent)| *change += bent);
        Self { component, accelerations, jumps, starts: [before(change), velocity] }
    }

    /// `D` and `D'`.
    pub(crate) fn at(&self, (_, q, h, theta): PartOfArc) -> (f64, f64) {
        let (mut along, mut rate) = (0.0, 0.0);
        for (j, of) in self.accelerations.iter().enumerate().rev() {
            let (j, a) = (j as f64, value(of, q));
            rate = theta * rate + a / (j + 1.0);
            along = theta * along + a / ((j + 1.0) * (j + 2.0));
        }
        let [x, v] = [0, 1].map(|of| value(&self.starts[of], q));
        let passed = h * theta;
        (x + passed * (v + passed * along), v + passed * rate)
    }
}

/// One end of the skipped flights: coordinates and gaps in contact, their rates and accelerations,
/// and which way the bounces move them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EndOfArcs {
    pub(crate) x: Vec<f64>,
    pub(crate) v: Vec<f64>,
    pub(crate) acceleration: Vec<f64>,
    pub(crate) way: Vec<f64>,
}

/// The motion between the last computed impact and a Zeno point.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SkippedArcs {
    pub(crate) start: f64,
    pub(crate) end: f64,
    /// The flights of the bouncing gap; none for the motion in contact alone.
    pub(crate) arcs: Option<Box<Tail>>,
    /// By component: the coefficients of `c`, then both ends of `r`.
    pub(crate) rows: Vec<[f64; 8]>,
    /// The channels that slip along the flights.
    pub(crate) slips: Vec<StoppedSlip>,
    /// Contributions of forces and impacts.
    pub(crate) corrections: Vec<Correction>,
}

impl SkippedArcs {
    /// Where the system does not move any more but for its flights.
    pub(crate) fn of_rows(start: f64, end: f64, rows: Vec<[f64; 8]>) -> Self {
        Self { start, end, arcs: None, rows, slips: vec![], corrections: vec![] }
    }

    /// The flights of an impact sequence that ends at `zeno`.
    pub(crate) fn of_chain(chain: &Chain<Vec<f64>, Key>, zeno: f64, ends: [EndOfArcs; 2]) -> Self {
        let arcs = chain.tail(zeno, 1.0);
        let start = arcs.start();
        Self { arcs: Some(Box::new(arcs)), ..Self::between(start, zeno, ends) }
    }

    /// Tails of components without requested samples: only their impacts.
    pub(crate) fn undrawn(chain: &Chain<Vec<f64>, Key>, zeno: f64, size: usize) -> Self {
        let arcs = chain.tail(zeno, 1.0);
        let rest = Self::of_rows(arcs.start(), zeno, vec![[0.0; 8]; size]);
        Self { arcs: Some(Box::new(arcs)), ..rest }
    }

    /// The motion in contact between two times.
    pub(crate) fn between(start: f64, end: f64, [first, last]: [EndOfArcs; 2]) -> Self {
        Self::of_rows(start, end, rows_between(end - start, &first, &last))
    }

    /// Sets the motion in contact from its ends, with the additions along the flights; of the work,
    /// which is a component without a place, from its velocities.
    pub(crate) fn end_at(&mut self, first: &EndOfArcs, last: &EndOfArcs, work: Option<usize>) {
        let (h, mut first, mut last) = (self.end - self.start, first.clone(), last.clone());
        let Some(tail) = &self.arcs else { return };
        for slip in &self.slips {
            let (way, [from, to]) = (slip.at(tail, None).0, &slip.ways);
            for (c, (from, to)) in from.iter().zip(to).enumerate() {
                last.x[c] -= to * way;
                last.v[c] -= (to - from) / h * way;
            }
        }
        for it in &self.corrections {
            let (x, v) = it.at((0, 1.0, 0.0, 0.0));
            first.x[it.component] -= if work == Some(it.component) { 0.0 } else { x };
            first.v[it.component] -= v;
        }
        self.rows = rows_between(h, &first, &last);
    }

    /// Start and end of a flight, unless it is too short to be told from its ends.
    pub(crate) fn arc(&self, m: usize) -> Option<(f64, f64)> {
        self.arcs.as_ref()?.arc(m).map(|arc| (arc.start, arc.end))
    }

    /// Equations (1) at `t`; at an impact, after it.
    pub(crate) fn at(&self, t: f64, x: &mut [f64], v: &mut [f64]) {
        self.on(t, self.arcs.as_ref().and_then(|arcs| arcs.numbered_arc_at(t)), x, v);
    }

    /// The same on the flight `m`, before the impact at its end.
    pub(crate) fn at_before(&self, t: f64, m: usize, x: &mut [f64], v: &mut [f64]) {
        let arc = self.arcs.as_ref().and_then(|arcs| arcs.arc(m));
        self.on(t, arc.map(|arc| (m, arc)), x, v);
    }

    fn on(&self, t: f64, arc: Option<(usize, TailArc)>, x: &mut [f64], v: &mut [f64]) {
        let part =
            arc.map(|(m, arc)| (m, ((t - arc.start) / (arc.end - arc.start)).clamp(0.0, 1.0)));
        let bounce = arc.map_or((0.0, 0.0), |(_, arc)| {
            let at = arc.at(t);
            (at.x, at.xdot)
        });
        self.combine(t, bounce, x, v);
        self.add(t, part.and_then(|(m, theta)| self.part_of(m, theta)), x, v);
    }

    /// The state after a part of a flight, the time and the accelerations there but for the corrections.
    pub(crate) fn after(&self, part: PartOfArc, [x, v, a]: [&mut [f64]; 3]) -> Option<f64> {
        let (number, _, _, theta) = part;
        let arc = self.arcs.as_ref()?.arc(number)?;
        let (at, (t, acceleration)) = (arc.after(theta), arc.acceleration_after(theta));
        self.combine(t, (at.x, at.xdot), x, v);
        self.add(t, Some(part), x, v);
        let (h, over) = (self.end - self.start, self.part(t));
        for (a, row) in a.iter_mut().zip(&self.rows) {
            let (motion, [.., r0, r1]) = (Bernstein::new(&row[..6]), *row);
            let way = r0 + over * (r1 - r0);
            let turn = 2.0 * (r1 - r0) / h * at.xdot;
            *a = motion.derivative().slope(over) / (h * h) + turn + way * acceleration;
        }
        for slip in &self.slips {
            let (rate, [from, to]) = (slip.at(self.arcs.as_ref()?, Some(part)).1, &slip.ways);
            for (a, (from, to)) in a.iter_mut().zip(from.iter().zip(to)) {
                let way = from + over * (to - from);
                *a += 2.0 * (to - from) / h * rate + way * slip.acceleration(part);
            }
        }
        Some(t)
    }

    /// A part of a flight that can be told from its ends.
    pub(crate) fn part_of(&self, m: usize, theta: f64) -> Option<PartOfArc> {
        let tail = self.arcs.as_ref()?;
        tail.arc(m).map(|arc| (m, tail.power(m), arc.length, theta))
    }

    /// The line between two numbers of a component at both ends.
    pub(crate) fn part_of_way(&self, [from, to]: &[Vec<f64>; 2], c: usize, t: f64) -> f64 {
        from[c] + self.part(t) * (to[c] - from[c])
    }

    /// `r` of a component.
    pub(crate) fn way(&self, c: usize, t: f64) -> f64 {
        let [.., r0, r1] = self.rows[c];
        r0 + self.part(t) * (r1 - r0)
    }

    /// How far corrections are from others at flights of these numbers, in these scales of `x` and `x'`.
    pub(crate) fn distance(&self, others: &[Correction], scales: &[f64], numbers: &[usize]) -> f64 {
        let size = self.rows.len();
        let mut worst = 0.0_f64;
        for &number in numbers {
            for part in POINTS.into_iter().filter_map(|theta| self.part_of(number, theta)) {
                for (k, other) in others.iter().enumerate() {
                    let (x, v) = other.at(part);
                    let (known_x, known_v) =
                        self.corrections.get(k).map_or((0.0, 0.0), |it| it.at(part));
                    let c = other.component;
                    for (change, scale) in
                        [(x - known_x, scales[c]), (v - known_v, scales[size + c])]
                    {
                        let part = change.abs() / scale;
                        worst = if part > worst || part.is_nan() { part } else { worst };
                    }
                }
            }
        }
        worst
    }

    /// Adds the slips and corrections after a part of a flight, or after all flights for `None`.
    fn add(&self, t: f64, part: Option<PartOfArc>, x: &mut [f64], v: &mut [f64]) {
        let Some(tail) = &self.arcs else { return };
        let (h, theta) = (self.end - self.start, self.part(t));
        for slip in &self.slips {
            let ((s, rate), [from, to]) = (slip.at(tail, part), &slip.ways);
            for (c, (from, to)) in from.iter().zip(to).enumerate() {
                let way = from + theta * (to - from);
                x[c] += way * s;
                v[c] += way * rate + if h > 0.0 { (to - from) / h * s } else { 0.0 };
            }
        }
        let Some(part) = part else { return };
        for it in &self.corrections {
            let (along, rate) = it.at(part);
            x[it.component] += along;
            v[it.component] += rate;
        }
    }

    /// The part of the time that is over.
    fn part(&self, t: f64) -> f64 {
        let h = self.end - self.start;
        if h > 0.0 {
            ((t - self.start) / h).clamp(0.0, 1.0)
        } else {
            1.0
        }
    }

    /// Equations (1) with `Y` and `Y'` given.
    pub(crate) fn combine(&self, t: f64, (y, u): (f64, f64), x: &mut [f64], v: &mut [f64]) {
        let (h, theta) = (self.end - self.start, self.part(t));
        for (c, row) in self.rows.iter().enumerate() {
            let (motion, [.., r0, r1]) = (Bernstein::new(&row[..6]), *row);
            let way = r0 + theta * (r1 - r0);
            x[c] = motion.at(theta) + way * y;
            let rate = if h > 0.0 { (motion.slope(theta) + (r1 - r0) * y) / h } else { 0.0 };
            v[c] = rate + way * u;
        }
    }
}

/// The rows of the motion in contact between two ends, after a time `h`.
fn rows_between(h: f64, first: &EndOfArcs, last: &EndOfArcs) -> Vec<[f64; 8]> {
    let row = |c: usize| {
        let at = |end: &EndOfArcs| [end.x[c], end.v[c], end.acceleration[c]];
        let [c0, c1, c2, c3, c4, c5] = quintic(at(first), at(last), h);
        [c0, c1, c2, c3, c4, c5, first.way[c], last.way[c]]
    };
    (0..first.x.len()).map(row).collect()
}

// The mechanism after an impact and its validity ahead, for the extrapolation of an accumulation.

/// Speeds below which a corner is reached for any pattern and slips after an accumulation vanish,
/// relative to `1 + |q'|` and in tolerances.
const FLOOR: (f64, f64) = (1e-12, 1e-2);
/// A jump requires all other gaps to be farther away than this number of its estimated errors.
pub(crate) const CLEAR: f64 = 100.0;

/// A mechanical system at its state, and evaluated elsewhere.
pub(crate) struct Mechanism<'r, 'm, D> {
    pub(crate) settings: &'r SwitchedRk,
    /// Restitutions by gap.
    pub(crate) e: &'r [f64],
    pub(crate) state: &'r mut MechanicalState,
    /// The mechanics where they were evaluated last, away from the state.
    pub(crate) aside: &'r mut Kinetics,
    pub(crate) model: &'r mut Model<'m, D>,
}

/// The tolerances of the time of a jump and of the state after it. Slips and the work of friction come
/// of the rest.
pub(crate) fn scales(settings: &SwitchedRk, state: &MechanicalState, of_time: f64) -> Vec<f64> {
    let Layout { n, m, .. } = state.layout();
    let of = |values: &[f64], atol: f64| -> Vec<f64> {
        let scale = |(c, value): (usize, &f64)| match c < n + m {
            true => atol + settings.rtol * value.abs(),
            false => f64::INFINITY,
        };
        values.iter().enumerate().map(scale).collect()
    };
    let (now, [atol_x, atol_v]) = (state.now(), settings.atol);
    [vec![of_time], of(&now.x, atol_x), of(&now.xdot, atol_v)].concat()
}

/// A speed below all tolerances.
pub(crate) fn slow(settings: &SwitchedRk, state: &MechanicalState) -> f64 {
    let speed = largest(&state.now().xdot[..state.layout().n]);
    FLOOR.0.max(FLOOR.1 * settings.rtol) * (1.0 + speed)
}

impl<D> Mechanism<'_, '_, D> {
    /// Whether the gaps outside of a mode stay open on the way to the touchdown: the cubic between
    /// both ends stays clear of zero; and whether what slips in it slips at both ends.
    pub(crate) fn is_clear(
        &self,
        landing: &ExtrapolatedEnd<Vec<f64>>,
        mode: impl Into<ContactMode>,
    ) -> bool {
        let mode = mode.into();
        let (Layout { n, m, .. }, now) = (self.state.layout(), self.state.now());
        let (set, size) = (mode.closed, now.x.len());
        let (h, z, errors) = (landing.t - now.t, landing.state(), landing.errors());
        let kinetics = self.state.kinetics();
        let slips = |channel: usize| {
            if let Some(other) = kinetics.other_of(channel) {
                let of = |values: &[f64], from: usize| {
                    [channel, other].map(|channel| values[from + n + m + channel])
                };
                let [[x, y], [a, b]] = [of(&now.xdot, 0), of(z, size)];
                let [p, q] = of(errors, size);
                return a * x + b * y > 0.0 && a.hypot(b) > CLEAR * p.hypot(q);
            }
            let (c, sign) = (n + m + channel, mode.sign(channel));
            sign * now.xdot[c] > 0.0 && sign * z[size + c] > CLEAR * errors[size + c]
        };
        mode.slipping().iter().all(slips)
            && (0..m).filter(|&k| !set.has(k)).all(|k| {
                let (c, error) = (n + k, errors[n + k]);
                let (first, last) = (now.x[c], z[c]);
                let (slope, end) = (h * now.xdot[c], h * z[size + c]);
                let p = Bernstein::hermite((first, slope), (last, end));
                p.coefficients().iter().all(|&c| c > CLEAR * error)
            })
    }

    /// Whether the forces keep all gaps of a set closed along the way to the touchdown, and those
    /// that stay closed while another one bounces also without it, and under its impacts.
    pub(crate) fn stays_closed<E>(
        &mut self,
        landing: &ExtrapolatedEnd<Vec<f64>>,
        mode: impl Into<ContactMode>,
        meanwhile: impl Into<ContactMode>,
    ) -> Result<bool, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (mode, meanwhile) = (mode.into(), meanwhile.into());
        let (Layout { n, .. }, closed) = (self.state.layout(), self.state.closed());
        let (set, size) = (mode.closed, self.state.now().x.len());
        let (now, z, at) = (self.state.now(), landing.state(), &mut *self.aside);
        for part in [0.25, 0.5, 0.75, 1.0] {
            let on_the_way = |from: &[f64], to: &[f64]| -> Vec<f64> {
                from.iter().zip(to).map(|(a, b)| a + part * (b - a)).collect()
            };
            let q = on_the_way(&now.x[..n], &z[..n]);
            let w = on_the_way(&now.xdot[..n], &z[size..][..n]);
            let t = now.t + part * (landing.t - now.t);
            match at.evaluate(self.model, t, &q, &w) {
                Err(Failure::Status(_)) => return Ok(false),
                evaluated => evaluated?,
            }
            at.turn(&on_the_way(&now.xdot[n..], &z[size + n..]));
            if at.contact(mode).is_err() {
                return Ok(false);
            }
            let pushes = |at: &mut Kinetics, i: usize| {
                // bodies in free fall touch without a force
                let none = if closed.has(i) { -at.noise(i) / at.d(i, i) } else { 0.0 };
                at.lambda[i] > none || (closed.has(i) && at.lambda[i] >= none)
            };
            if !set.iter().all(|i| pushes(at, i)) || !holds(at, mode) {
                return Ok(false);
            }
            if at.contact(meanwhile).is_err()
                || !meanwhile.closed.iter().all(|i| pushes(at, i))
                || !holds(at, meanwhile)
            {
                return Ok(false);
            }
            let hit = set.without(meanwhile.closed);
            if !at.bounces_hold(hit, mode, self.e) {
                return Ok(false);
            }
            if !meanwhile.closed.is_empty() && !at.impacts_press(hit, mode)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// One end of the flights that a jump skips: the motion in contact, at a time and a state, `x`
    /// before `x'`. The system is evaluated aside there.
    pub(crate) fn end_of_arcs<E>(
        &mut self,
        t: f64,
        z: &[f64],
        mode: impl Into<ContactMode>,
    ) -> Result<EndOfArcs, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let (mode, n, size) = (mode.into(), self.aside.coordinates(), z.len() / 2);
        let (x, v) = z.split_at(size);
        self.aside.evaluate(self.model, t, &x[..n], &v[..n])?;
        self.aside.turn(&v[n..]);
        self.aside.contact(mode)?;
        let mut acceleration = self.aside.accelerations();
        if let Some(power) = acceleration.get_mut(n + self.aside.layout.rows()) {
            *power = self.aside.friction_power(mode, &v[n..]);
        }
        Ok(EndOfArcs { x: x.to_vec(), v: v.to_vec(), acceleration, way: vec![0.0; size] })
    }

    /// The end of the flights at the present state.
    pub(crate) fn end_here<E>(
        &mut self,
        mode: impl Into<ContactMode>,
    ) -> Result<EndOfArcs, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let now = self.state.now();
        let (t, z) = (now.t, [&now.x[..], &now.xdot[..]].concat());
        self.end_of_arcs(t, &z, mode)
    }

    /// Moves to a touchdown, after which the gaps of a mode are closed, and maybe others with them:
    /// all of these. The system is evaluated there.
    pub(crate) fn move_to<E>(
        &mut self,
        landing: &ExtrapolatedEnd<Vec<f64>>,
        mode: impl Into<ContactMode>,
    ) -> Result<GapSet, Failure<E>>
    where
        D: Dynamics<E>,
    {
        let t = landing.t.max(self.state.now().t);
        let (to, rounding) = ((t, landing.state()), self.settings.rounding());
        let closed = self.state.move_to(to, mode.into(), rounding, self.model)?;
        let size = self.state.now().x.len();
        let slow = slow(self.settings, self.state);
        self.state.take_slips(Some((&landing.errors()[size..], slow)));
        Ok(closed)
    }
}

/// Whether friction maintains sticking and no sliding contact is close to the Painlevé paradox, for
/// the computed forces.
fn holds(at: &mut Kinetics, mode: ContactMode) -> bool {
    mode.is_frictionless()
        || at.limits(mode).iter().all(|level| match level.limit {
            Limit::Force(_) | Limit::Law(_) => true,
            Limit::Stick(..) | Limit::Margin | Limit::Regularity => level.value > 0.0,
        })
}
