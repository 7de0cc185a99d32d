//! Flights of linear systems, free and in contact, by power series: to rounding.
//!
//! Steps have one length, a fraction of the time of the fastest mode or load ([`crate::motion::propagation`]); the
//! gaps and the contact forces in each are power series whose first roots end it ([`first_root`]).
//! Events are handled like those of all mechanical systems. A system of one coordinate flies as its gaps do
//! ([`crate::motion::one_coordinate`]); a part of a step is summed by the widest registers of the processor.

use std::f64::consts::TAU;
use std::sync::Arc;

use crate::kinetics::mode::{Limit, Next, State};
use crate::kinetics::{Model, Undetermined};
use crate::motion::one_coordinate::{OneCoordinate, Pull};
use crate::motion::path::Curve;
use crate::motion::propagation::{
    contact_forces, factored_mobility, free_acceleration, solve_rows, wall_accelerations, Free,
    Functional, Propagation,
};
use crate::motion::state::MechanicalState;
use crate::numeric::coordinates::LinearMap;
use crate::numeric::dense::{axpy, dot, sum_of_products};
use crate::numeric::power_series::{
    stretch, value, value_and_slope, values_and_slopes, Series, TERMS,
};
use crate::record::gap_set::GapSet;
use crate::record::status::Failure;
use crate::switched::flight::series;
use crate::system::dynamics::Dynamics;
use crate::system::force::Smooth;
use crate::system::linear_system::LinearSystem;
use crate::Status;
use pulp::{Simd, WithSimd};

/// A step is shorter than the period of the fastest mode or load (per radian) by this factor.
const ANGLE: f64 = 2.0;
/// Halvings of the steps until the series converge.
const HALVINGS: usize = 12;
/// By how much a gap is larger than all that may be taken from it, if it certainly stays open.
const CERTAIN: f64 = 1.0 + 1e-9;
/// Gaps that close within this fraction of a flight close together.
const TOGETHER: f64 = 1e-13;
/// Rounding of the time.
const ULPS: f64 = 4.0 * f64::EPSILON;
/// Rounding of an acceleration or a force, relative to its terms.
const NOISE: f64 = 256.0 * f64::EPSILON;
/// Size of the cache for the last sets of closed gaps (numbers).
const KEPT: usize = 1 << 23;
/// Closed gaps at this distance from zero, relative to their terms, are projected again.
const DRIFT: f64 = 64.0 * f64::EPSILON;

/// The flights of a linear system.
#[derive(Clone, Debug)]
pub(crate) struct LinearFlight {
    free: Arc<Free>,
    /// The length of a step (s), and its maximum.
    h: f64,
    longest: f64,
    known: Vec<(GapSet, Arc<Propagation>)>,
    /// By gap the weights of the drives in the speed of its wall, times `h`.
    wall_rates: Vec<Vec<f64>>,
    /// By gap one before it that moves the other way, as that of a stop on the other side.
    opposite: Vec<Option<usize>>,
    /// `(q, h q', d)` where a step begins, and `(q, h q')` where it ends.
    y: Vec<f64>,
    end: Vec<f64>,
    /// By gap: the gap, or its force.
    series: Vec<Series>,
    /// By gap: what that is where the step ends, and its slope there.
    ends: Vec<[f64; 2]>,
    curve: Option<Curve>,
    /// The free flights of one coordinate.
    one: Option<Box<OneCoordinate>>,
    /// When the contact force vanishes that ends the last step, where that is known.
    lift_off: Option<f64>,
}

/// Event that ends a step.
#[derive(Clone, Copy)]
enum LinearEvent {
    Closing(usize),
    Release(usize),
}

/// Where a flight may go.
pub(crate) struct Bounds {
    /// The end (s).
    pub(crate) t_end: f64,
    /// The longest step (s).
    pub(crate) longest: f64,
    /// From when on the motion within steps is requested (s).
    pub(crate) dense_from: f64,
}

impl LinearFlight {
    /// None where the system is no linear one, or its mass matrix not definite.
    pub(crate) fn of<E, D: Dynamics<E>>(dynamics: &D) -> Option<Box<Self>> {
        let system = dynamics.linear()?;
        let free = Free::new(system)?;
        let fastest = free.rate().max(free.drives.highest());
        let one = OneCoordinate::of(system).map(Box::new);
        let h = if fastest > 0.0 { ANGLE / fastest } else { 1.0 };
        let h = one.as_ref().map_or(h, |one| one.h());
        let (y, end) = (vec![0.0; free.size()], vec![0.0; 2 * free.n]);
        let series = vec![[0.0; TERMS]; system.gaps.len()];
        let free = Arc::new(free);
        let wall_rates = wall_rates(&free, h);
        let opposite = (0..free.gaps()).map(|i| (0..i).find(|&j| free.is_opposite(i, j))).collect();
        Some(Box::new(Self {
            free,
            h,
            longest: h,
            known: vec![],
            wall_rates,
            opposite,
            y,
            end,
            ends: vec![[0.0; 2]; series.len()],
            series,
            curve: None,
            one,
            lift_off: None,
        }))
    }

    /// The time of the fastest mode or load (s).
    pub(crate) fn period(&self) -> f64 {
        self.one.as_ref().map_or(TAU / ANGLE * self.longest, |one| one.period())
    }

    /// Whether gaps are recomputed from the coordinates at the start of a flight.
    pub(crate) fn anchors_gaps(&self) -> bool {
        self.one.is_none()
    }

    /// The motion within the last step up to an event, if requested.
    pub(crate) fn curve(&self) -> Option<&Curve> {
        self.curve.as_ref()
    }

    /// The motion with a set of gaps closed.
    fn propagation<E>(&mut self, set: GapSet) -> Result<Arc<Propagation>, Failure<E>> {
        if let Some((_, known)) = self.known.iter().find(|(of, _)| *of == set) {
            return Ok(known.clone());
        }
        for _ in 0..HALVINGS {
            if let Some(new) = Propagation::new(&self.free, set, self.h)? {
                let new = Arc::new(new);
                if self.known.len() * new.len() > KEPT {
                    self.known.remove(0);
                }
                self.known.push((set, new.clone()));
                return Ok(new);
            }
            self.h *= 0.5;
            self.known.clear();
            self.wall_rates = wall_rates(&self.free, self.h);
        }
        Err(Failure::Status(Status::StepSizeTooSmall))
    }

    /// One step or its part up to an event: returns the next operation and the length.
    pub(crate) fn fly<E, D: Dynamics<E>>(
        &mut self,
        bounds: &Bounds,
        state: &mut MechanicalState,
        model: &mut Model<'_, D>,
    ) -> Result<(Next, f64), Failure<E>> {
        let set = state.closed();
        let motion = self.propagation(set)?;
        if let Some(mut one) = self.one.take_if(|_| set.is_empty()) {
            let flown = self.fly_one(&mut one, bounds, state, (&motion, model.smooth));
            self.one = Some(one);
            return flown;
        }
        self.begin(state, model.smooth.nearest(state.now().t));
        if self.has_drifted(state) {
            state.project_gaps(set, model)?;
            self.begin(state, model.smooth.nearest(state.now().t));
        }
        self.anchor(state, None);
        let left = (bounds.t_end - state.now().t) - state.now().late;
        let reach = (left.min(bounds.longest) / self.h).min(1.0);
        let (part, event) = self.first_event(&motion, reach, state);
        let length = part * self.h;
        let (start, dense) = (state.now().t, state.now().t + length > bounds.dense_from);
        let arrives = event.is_none() && length >= left;
        self.end_of(&motion, part, set, (start, dense));
        let gap = match event {
            Some(LinearEvent::Closing(gap)) => Some(gap),
            _ => None,
        };
        self.move_state(part, gap, state);
        state.pass((length, bounds.t_end), arrives);
        if let Some(LinearEvent::Release(_)) = event {
            let now = state.parts().1;
            (now.t, now.late) = self.lift_off.map_or((now.t, now.late), |t| (t, 0.0));
        }
        let is_finite = |of: &[f64]| of.iter().fold(true, |all, it| all & it.is_finite());
        if !(is_finite(&state.now().x) && is_finite(&state.now().xdot)) {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        let next = match event {
            None => Next::Step,
            Some(LinearEvent::Closing(gap)) => Next::LocatedEvent(hit_together(gap, length, state)),
            Some(LinearEvent::Release(gap)) => {
                Next::Release { limit: Limit::Force(gap), h: self.h }
            }
        };
        Ok((next, length))
    }

    /// Takes the state at the start of a step.
    fn begin(&mut self, state: &MechanicalState, t: f64) {
        let (n, h, now) = (self.free.n, self.h, state.now());
        self.y[..n].copy_from_slice(&now.x[..n]);
        for (y, v) in self.y[n..2 * n].iter_mut().zip(&now.xdot) {
            *y = h * v;
        }
        self.free.drives.write(t, h, &mut self.y[2 * n..]);
    }

    /// A gap and its rate as the coordinates have them, and the sums of the sizes of their terms.
    #[inline(always)]
    fn told(&self, i: usize) -> [(f64, f64); 2] {
        let (n, h, free) = (self.free.n, self.h, &self.free);
        let sum = |weights: &[f64], of: &[f64]| {
            weights.iter().zip(of).fold((0.0, 0.0), |(sum, size), (weight, y)| {
                let term = weight * y;
                (sum + term, size + term.abs())
            })
        };
        let (normal, drives) = (free.normal(i), &self.y[2 * n..]);
        let position = sum(normal, &self.y[..n]);
        let of_wall = sum(free.wall(i), drives);
        let rate = sum(normal, &self.y[n..2 * n]);
        let of_rate = sum(&self.wall_rates[i], drives);
        [
            (position.0 - of_wall.0, position.1 + of_wall.1),
            ((rate.0 - of_rate.0) / h, (rate.1 + of_rate.1) / h),
        ]
    }

    /// The same without the sizes.
    fn told_alone(&self, i: usize) -> (f64, f64) {
        let (n, h, free) = (self.free.n, self.h, &self.free);
        let (drives, sum) = (&self.y[2 * n..], sum_of_products);
        let rate = free.along_normal(i, &self.y[n..2 * n]) - sum(&self.wall_rates[i], drives);
        (free.along_normal(i, &self.y[..n]) - sum(free.wall(i), drives), rate / h)
    }

    /// Whether rounding has opened a closed gap.
    fn has_drifted(&self, state: &MechanicalState) -> bool {
        if state.closed().is_empty() {
            return false;
        }
        let fast = state.now().xdot[..self.free.n].iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        state.closed().iter().any(|i| {
            let [(gap, size), (rate, speed)] = self.told(i);
            gap.abs() > DRIFT * size || rate.abs() > DRIFT * speed.max(fast)
        })
    }

    /// Recomputes all gaps except `but` from the coordinates, if that has enough digits.
    fn anchor(&self, state: &mut MechanicalState, but: Option<usize>) {
        let (closed, size) = (state.closed(), state.size());
        for i in 0..self.series.len() {
            // one that was just hit is left as it is
            if !closed.has(i) && but != Some(i) && state.gap(i).0 > 0.0 {
                state.anchor_beside(size, i, self.told_alone(i));
            }
        }
    }

    /// The first event up to a part of the step, after which part, or that part without one.
    fn first_event(
        &mut self,
        motion: &Propagation,
        reach: f64,
        state: &MechanicalState,
    ) -> (f64, Option<LinearEvent>) {
        self.read_series(motion, state);
        let (mut first, mut event) = (1.0, None);
        self.lift_off = None;
        // a gap that was just hit is most often the next one
        let (count, set) = (self.series.len(), state.closed());
        let last = (0..count).find(|&i| !set.has(i) && self.series[i][0] == 0.0);
        for i in last.into_iter().chain((0..count).filter(|&i| Some(i) != last)) {
            let closed = set.has(i);
            let known = if closed { self.lift_off_of(i, state) } else { None };
            let zeros = if closed { 0 } else { self.zeros_at_start(i, state) };
            let whole = &self.series[i];
            let mut part;
            let a = if reach != 1.0 || closed {
                part = *whole;
                stretch(&mut part, reach);
                part[0] = if closed { part[0].max(0.0) } else { part[0] };
                &part
            } else {
                whole
            };
            let found = if let Some(at) = known {
                self.lift_off = at;
                let s = at.map(|t| (t - state.now().t) / (self.h * reach));
                s.filter(|&s| s <= 1.0).map(|s| (s.max(0.0), LinearEvent::Release(i)))
            } else if closed {
                let size = whole.iter().fold(0.0_f64, |most, a| most.max(a.abs()));
                let none = a.iter().all(|a| a.abs() <= NOISE * size);
                // bodies in free fall touch without a force
                if none {
                    None
                } else {
                    first_root(a, 0).map(|s| (s, LinearEvent::Release(i)))
                }
            } else if event.is_some() && stays_above(a, first) {
                None
            } else {
                first_root(a, zeros).map(|s| (s, LinearEvent::Closing(i)))
            };
            if let Some((s, what)) = found {
                let comes_first = match event {
                    None => s <= first,
                    // of two at once the one with the lower number
                    Some(LinearEvent::Closing(j) | LinearEvent::Release(j)) => {
                        s < first || (s == first && i < j)
                    }
                };
                if comes_first {
                    (first, event) = (s, Some(what));
                }
            }
        }
        (first * reach, event)
    }

    /// The gaps, and the forces of closed ones, over the step.
    fn read_series(&mut self, motion: &Propagation, state: &MechanicalState) {
        let set = state.closed();
        for (i, functional) in motion.gaps.iter().enumerate() {
            let closed = set.has(i);
            let (before, rest) = self.series.split_at_mut(i);
            let Some(a) = rest.first_mut() else { break };
            match self.opposite[i].filter(|&j| !closed && !set.has(j)) {
                // no zero gets a sign
                Some(j) => a.iter_mut().zip(&before[j]).for_each(|(a, b)| *a = 0.0 - b),
                None => functional.series_to(&self.y, a),
            }
            if !closed {
                let (gap, rate) = state.gap(i);
                (a[0], a[1]) = (gap, self.h * rate);
            }
        }
    }

    /// How often a gap is zero where the step begins: once after an impact, three times after a
    /// lift-off, whose acceleration is zero but for rounding.
    fn zeros_at_start(&self, i: usize, state: &MechanicalState) -> usize {
        let a = &self.series[i];
        if a[0] != 0.0 {
            return 0;
        }
        if a[1] != 0.0 {
            return 1;
        }
        let terms = self.acceleration_terms(i, state.now().t);
        if state.left().has(i) && a[2].abs() <= NOISE * terms {
            3
        } else {
            2
        }
    }

    /// The size of the terms of `h^2/2 g''` where the step begins.
    fn acceleration_terms(&self, i: usize, t: f64) -> f64 {
        self.free.acceleration_terms(i, (t, self.h), &self.y)
    }

    /// Moves a state to the end of a part of the step, where a gap closes, if one does.
    fn move_state(&mut self, part: f64, closing: Option<usize>, state: &mut MechanicalState) {
        let (n, h, closed) = (self.free.n, self.h, state.closed());
        let now = state.parts().1;
        now.x[..n].copy_from_slice(&self.end[..n]);
        for (v, end) in now.xdot[..n].iter_mut().zip(&self.end[n..]) {
            *v = end / h;
        }
        let Self { series, ends, .. } = self;
        values_and_slopes(series, part, ends);
        for (i, [x, v]) in ends.iter().enumerate().filter(|&(i, _)| !closed.has(i)) {
            now.x[n + i] = if closing == Some(i) { 0.0 } else { *x };
            now.xdot[n + i] = v / h;
        }
    }
}

/// By gap the weights of the drives in the speed of its wall, times `h`.
fn wall_rates(free: &Free, h: f64) -> Vec<Vec<f64>> {
    let rate = |i: usize| {
        let mut weights = free.wall(i).to_vec();
        free.drives.differentiate(h, &mut weights);
        weights
    };
    (0..free.gaps()).map(rate).collect()
}

/// Whether a series certainly stays above zero up to a part of its interval.
fn stays_above(a: &Series, part: f64) -> bool {
    let sizes: Series = std::array::from_fn(|k| if k == 0 { 0.0 } else { a[k].abs() });
    a[0] > CERTAIN * value(&sizes, part)
}

/// The gap and those that close at the same time, to rounding of the flight's length.
fn hit_together(gap: usize, flight: f64, state: &MechanicalState) -> GapSet {
    let near = TOGETHER * flight + ULPS * state.now().t.abs();
    let is_hit = |i: usize| {
        let (x, v) = state.gap(i);
        v < 0.0 && x <= -v * near
    };
    state.open_gaps().filter(|&i| i == gap || is_hit(i)).collect()
}

// The flights of a linear system of one coordinate, by those of its gaps.

impl LinearFlight {
    /// Acceleration towards its wall of a gap of one coordinate that was hit alone.
    pub(crate) fn pull(&self, hit: GapSet, state: &MechanicalState) -> Option<Pull> {
        let gap = hit.iter().next().filter(|_| hit.len() == 1 && state.closed().is_empty())?;
        self.one.as_ref().map(|one| one.pull(gap, state))
    }

    /// When the force of a gap vanishes, where that is known.
    fn lift_off_of(&mut self, gap: usize, state: &MechanicalState) -> Option<Option<f64>> {
        let alone = state.closed() == GapSet::of(gap);
        self.one.as_mut().filter(|_| alone)?.lift_off(gap, state)
    }

    /// A free step of one coordinate, or the part of it up to an impact.
    fn fly_one<E>(
        &mut self,
        one: &mut OneCoordinate,
        bounds: &Bounds,
        state: &mut MechanicalState,
        (motion, smooth): (&Propagation, Smooth),
    ) -> Result<(Next, f64), Failure<E>> {
        self.begin(state, smooth.nearest(state.now().t));
        let lead = one.lead(state);
        self.anchor(state, Some(lead));
        let zeros: Vec<usize> = (0..self.series.len())
            .map(|i| {
                self.series[i] = motion.gaps[i].series(&self.y);
                (self.series[i][0], self.series[i][1]) = state.gap(i);
                self.zeros_at_start(i, state)
            })
            .collect();
        let start = state.now().t;
        let flown = one.fly(bounds.t_end, |i| zeros[i], state);
        let each: Vec<_> = (0..zeros.len()).map(|i| one.series(i)).collect();
        self.series.iter_mut().zip(&each).for_each(|(series, [whole, _])| *series = *whole);
        self.curve = (flown.t > bounds.dense_from && flown.length > 0.0).then(|| {
            let q = one.coordinate_series(&each[lead][1], start, flown.length);
            let gaps = each.iter().flat_map(|[_, part]| part);
            Curve::of_powers(start, flown.length, q.iter().chain(gaps).copied().collect())
        });
        state.pass((flown.length, bounds.t_end), flown.arrives);
        let now = state.parts().1;
        (now.t, now.late) = (flown.t, flown.late);
        [now.x[0], now.xdot[0]] = one.coordinate(flown.t);
        for (i, &[x, v]) in one.ends().iter().enumerate() {
            (now.x[1 + i], now.xdot[1 + i]) = (if flown.closing == Some(i) { 0.0 } else { x }, v);
        }
        if !now.x.iter().chain(&now.xdot).all(|it| it.is_finite()) {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        let next = flown
            .closing
            .map_or(Next::Step, |gap| Next::LocatedEvent(hit_together(gap, flown.length, state)));
        Ok((next, flown.length))
    }
}

// The motion of a linear system after a part of a step: by the series of its coordinates, where these are
// kept, else term by term, by the widest registers of the processor.

/// Terms below this fraction of a sum are rounding.
const NEGLIGIBLE: f64 = 1e-18;

/// Up to these parts of a step 12 and 16 terms are enough: the others are below `.2^12/12! = 9e-18` and
/// `.5^16/16! = 7e-19`.
const SHORT: [f64; 2] = [0.1, 0.25];

/// The terms of the series of `q` in the part of the step, if requested.
type Terms<'a> = Option<&'a mut Vec<f64>>;

impl Propagation {
    /// `(q, h q')` after a part of the step from `y`, whose memory is used up.
    fn part(
        &self,
        free: &Free,
        step: (f64, f64),
        y: &mut [f64],
        out: &mut [f64],
        terms: Terms<'_>,
    ) {
        let arch = pulp::Arch::new();
        match &self.coordinates {
            Some(coordinates) => {
                arch.dispatch(Reading { coordinates, part: step.1, y, out, terms });
            }
            None => arch.dispatch(Sum { motion: self, free, step, y, out, terms }),
        }
    }
}

impl LinearFlight {
    /// Computes `(q, h q')` after a part of the step, and the motion up to there if that is wanted.
    fn end_of(
        &mut self,
        motion: &Propagation,
        part: f64,
        closed: GapSet,
        (start, dense): (f64, bool),
    ) {
        self.curve = None;
        if part == 1.0 && !dense {
            motion.whole(&self.y, &mut self.end);
            return;
        }
        // the same end whether the motion up to there is wanted or not
        let end = (part == 1.0).then(|| {
            motion.whole(&self.y, &mut self.end);
            self.end.clone()
        });
        let mut terms = vec![];
        let wanted = dense.then_some(&mut terms);
        motion.part(&self.free, (self.h, part), &mut self.y, &mut self.end, wanted);
        if let Some(end) = end {
            self.end = end;
        }
        if !dense || part <= 0.0 {
            return;
        }
        let n = self.free.n;
        let mut powers = Vec::with_capacity((n + self.series.len()) * TERMS);
        for i in 0..n {
            powers.extend((0..TERMS).map(|k| terms[k * n + i]));
        }
        for (i, series) in self.series.iter().enumerate() {
            let mut power = if closed.has(i) { 0.0 } else { 1.0 };
            for a in series {
                powers.push(a * power);
                power *= part;
            }
        }
        self.curve = Some(Curve::of_powers(start, part * self.h, powers));
    }
}

/// The series of the coordinates, read.
struct Reading<'a> {
    coordinates: &'a [Functional],
    part: f64,
    y: &'a [f64],
    out: &'a mut [f64],
    terms: Terms<'a>,
}

impl WithSimd for Reading<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { coordinates, part, y, out, mut terms } = self;
        let n = coordinates.len();
        if let Some(terms) = &mut terms {
            terms.resize(n * TERMS, 0.0);
        }
        for (i, coordinate) in coordinates.iter().enumerate() {
            // whether its terms are wanted or not
            let few = if part <= SHORT[0] {
                of_few::<12>(coordinate, y, part)
            } else if part <= SHORT[1] {
                of_few::<16>(coordinate, y, part)
            } else {
                None
            };
            if let Some(few) = few.filter(|_| terms.is_none()) {
                [out[i], out[n + i]] = few;
                continue;
            }
            let a = coordinate.series_by_columns(y);
            [out[i], out[n + i]] = few.unwrap_or_else(|| value_and_slope(&a, part));
            let Some(terms) = &mut terms else { continue };
            let mut power = 1.0;
            for (k, a) in a.iter().enumerate() {
                terms[k * n + i] = power * a;
                power *= part;
            }
        }
    }
}

/// A coordinate and its rate by the first terms, where these are quick to compute alone.
#[inline(always)]
fn of_few<const FEW: usize>(coordinate: &Functional, y: &[f64], part: f64) -> Option<[f64; 2]> {
    coordinate.first_terms::<FEW>(y).map(|a| value_and_slope(&a, part))
}

/// The sum of the terms `y_(k+1) = part/(k + 1) Y y_k`.
struct Sum<'a> {
    motion: &'a Propagation,
    free: &'a Free,
    step: (f64, f64),
    y: &'a mut [f64],
    out: &'a mut [f64],
    terms: Terms<'a>,
}

impl WithSimd for Sum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { motion, free, step: (h, part), y, out, mut terms } = self;
        let n = free.n;
        let mut acceleration = vec![0.0; n];
        out.copy_from_slice(&y[..2 * n]);
        for k in 0..TERMS {
            if let Some(terms) = &mut terms {
                terms.extend_from_slice(&y[..n]);
            }
            if k + 1 == TERMS {
                break;
            }
            motion.advance(free, (h, part / (k + 1) as f64), y, &mut acceleration);
            let mut negligible = true;
            for (out, y) in out.iter_mut().zip(&*y) {
                negligible &= y.abs() <= NEGLIGIBLE * out.abs();
                *out += y;
            }
            if negligible && terms.is_none() && k > 1 {
                break;
            }
        }
    }
}

// Where a power series on `[0, 1]` that begins above zero first falls below it.

/// Largest relative change of the slope of a steadily decreasing function.
const CHANGE: f64 = 0.5;
/// Largest multiple of the fall of the line, above `1/(1 - CHANGE)`.
const REACH: f64 = 2.2;
/// A flight is searched up to this multiple of the length of its parabola.
const ARC: f64 = 1.5;
/// Newton iterations of a root.
const ITERATIONS: usize = 16;

/// The first root of `p` after the given number of roots at zero, which are divided out.
pub(super) fn first_root(p: &Series, at_zero: usize) -> Option<f64> {
    let mut a = [0.0; TERMS];
    a[..TERMS - at_zero].copy_from_slice(&p[at_zero..]);
    pulp::Arch::new().dispatch(Search(&a))
}

/// The search for the first root, by the widest registers of the processor.
struct Search<'a>(&'a Series);

impl WithSimd for Search<'_> {
    type Output = Option<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Option<f64> {
        let Self(a) = self;
        if a[0] < 0.0 {
            return Some(0.0);
        }
        if let Some(root) = steady_fall(a) {
            return Some(root);
        }
        let rest: f64 = a[1..].iter().map(|a| a.abs()).sum();
        if a[0] > rest {
            return None;
        }
        // a short flight is far below what rounding leaves of the whole step
        let arc = ARC * fall_of_parabola(a);
        if arc < 1.0 {
            let mut part = *a;
            let mut power = 1.0;
            for a in &mut part {
                *a *= power;
                power *= arc;
            }
            if let Some(root) = series::first_fall(&part) {
                return Some(polished(a, root * arc));
            }
        }
        series::first_fall(a).map(|root| polished(a, root))
    }
}

/// When `a_0 + a_1 s + a_2 s^2` comes to zero, infinite if it never does.
#[inline(always)]
fn fall_of_parabola(a: &Series) -> f64 {
    let root = a[1] * a[1] - 4.0 * a[0] * a[2];
    if a[2] >= 0.0 || root.is_nan() {
        return f64::INFINITY;
    }
    let (root, pull) = (root.sqrt(), -2.0 * a[2]);
    if a[1] >= 0.0 {
        (a[1] + root) / pull
    } else {
        2.0 * a[0] / (root - a[1])
    }
}

/// The root of one that falls from its start as a line does to within half of its slope: up to
/// [`REACH`] times where that line comes to zero it falls at least half as fast, and is below zero there.
#[inline(always)]
fn steady_fall(a: &Series) -> Option<f64> {
    let first = -a[0] / a[1];
    if !(a[1] < 0.0 && REACH * first <= 1.0) {
        return None;
    }
    let sizes: Series = std::array::from_fn(|k| if k < 2 { 0.0 } else { a[k].abs() });
    let [_, change] = value_and_slope(&sizes, REACH * first);
    (change <= CHANGE * -a[1]).then(|| polished(a, first))
}

/// The root that is near, to rounding.
#[inline(always)]
fn polished(a: &Series, near: f64) -> f64 {
    let (mut s, mut last) = (near, f64::INFINITY);
    for _ in 0..ITERATIONS {
        let [p, slope] = value_and_slope(a, s);
        let step = p / slope;
        let next = s - step;
        // where it touches zero rounding decides
        if !(step.abs() < last && (0.0..=1.0).contains(&next)) {
            break;
        }
        (s, last) = (next, step.abs());
        if step.abs() <= f64::EPSILON * s {
            break;
        }
    }
    s
}

// Derivatives of the motion along the flights, by its start and by parameters.
//
// For `dy/ds = Y y` a column satisfies `du/ds = Y u + Y_p y` with the derivative `Y_p` with
// respect to its parameter, if any. Both are power series with one recurrence,
//
// ```text
// u_(k+1) = (Y u_k + Y_p y_k)/(k + 1)      y_(k+1) = Y y_k/(k + 1)
// ```
//
// and a gap or a force `r . y` has the series of `r . u + r_p . y`. With `D F = W` of equation (1) of
// [`crate::motion::propagation`] the forces have the derivative `F_p = D^-1 (W_p - D_p F)`.

/// A step that was flown, or the part of it up to an event.
#[derive(Clone, Copy)]
pub(crate) struct FlownPart<'a> {
    pub(crate) from: &'a State,
    /// The time where it begins, at which the system is evaluated.
    pub(crate) t: f64,
    pub(crate) closed: GapSet,
    /// Its length (s).
    pub(crate) length: f64,
}

/// How the parameters move the flights.
#[derive(Clone, Debug)]
pub(crate) struct FlightRates {
    /// Derivatives of the system without contacts, by parameter.
    free: Vec<Free>,
    /// Their effect on the motion with a set of closed gaps, by parameter, for steps of length `h`.
    known: Vec<(GapSet, Vec<Arc<ParameterVariation>>)>,
    h: f64,
}

impl FlightRates {
    /// Of a system whose numbers have these derivatives by its parameters.
    pub(crate) fn new<'a>(
        flight: &LinearFlight,
        system: &LinearSystem,
        rates: impl Iterator<Item = &'a LinearSystem>,
    ) -> Self {
        let free = rates.map(|rate| flight.free.rates(system, rate)).collect();
        Self { free, known: vec![], h: 0.0 }
    }

    fn variations(
        &mut self,
        flight: &LinearFlight,
        set: GapSet,
    ) -> Result<Vec<Arc<ParameterVariation>>, Undetermined> {
        if self.h != flight.h {
            (self.h, self.known) = (flight.h, vec![]);
        }
        if let Some((_, known)) = self.known.iter().find(|(of, _)| *of == set) {
            return Ok(known.clone());
        }
        let new =
            self.free.iter().map(|rate| ParameterVariation::new(&flight.free, rate, set, self.h));
        let new: Vec<_> = new.map(|it| it.map(Arc::new)).collect::<Result<_, _>>()?;
        self.known.push((set, new.clone()));
        Ok(new)
    }
}

/// How a parameter moves the motion with a set of gaps closed.
#[derive(Clone, Debug)]
struct ParameterVariation {
    /// The rows of `Y_p`, times `h`, that give accelerations.
    acceleration: LinearMap,
    /// By gap the weights `r` of `y` in its value or force, and `r_p`.
    gaps: Vec<[Vec<f64>; 2]>,
}

impl ParameterVariation {
    fn new(free: &Free, rate: &Free, set: GapSet, h: f64) -> Result<Self, Undetermined> {
        let (n, size, count) = (free.n, free.size(), set.len());
        let closed: Vec<usize> = set.iter().collect();
        let forces = contact_forces(free, set, h)?;
        let factor = factored_mobility(free, &closed)?;
        let (rows, by_rate) = (free_acceleration(free, h), free_acceleration(rate, h));
        let mut turned = wall_accelerations((free, rate), &closed, h);
        for (wall, &i) in turned.iter_mut().zip(&closed) {
            let of_drives = &mut wall[2 * n..];
            rate.drives.add_differentiated_twice(&free.drives, h, free.wall(i), of_drives);
            for c in 0..n {
                axpy(wall, -free.normal(i)[c], &by_rate[c]);
                axpy(wall, -rate.normal(i)[c], &rows[c]);
            }
            wall.iter_mut().for_each(|it| *it /= h * h);
            for (&j, force) in closed.iter().zip(&forces) {
                let mobility =
                    dot(rate.normal(i), free.mobility(j)) + dot(free.normal(i), rate.mobility(j));
                axpy(wall, -mobility, force);
            }
        }
        solve_rows(&factor, count, &mut turned);
        let mut acceleration = by_rate;
        for ((&gap, force), by) in closed.iter().zip(&forces).zip(&turned) {
            for (c, row) in acceleration.iter_mut().enumerate() {
                axpy(row, h * h * rate.mobility(gap)[c], force);
                axpy(row, h * h * free.mobility(gap)[c], by);
            }
        }
        let mut pressed = forces.into_iter().zip(turned);
        let gaps = (0..free.gaps()).map(|i| match set.has(i) {
            true => pressed.next().map_or([vec![], vec![]], |(force, by)| [force, by]),
            false => [free.gap(i), rate.gap(i)],
        });
        Ok(Self {
            gaps: gaps.collect(),
            acceleration: LinearMap::new(n, size, |i, j| acceleration[i][j]),
        })
    }
}

impl LinearFlight {
    /// Propagates the derivatives `x` of coordinates and gaps and `v` of their rates over a
    /// completed step, with respect to a parameter if given.
    pub(crate) fn differentiate<E>(
        &mut self,
        flown: FlownPart<'_>,
        rates: &mut FlightRates,
        parameter: Option<usize>,
        (x, v): (&mut [f64], &mut [f64]),
    ) -> Result<(), Failure<E>> {
        let FlownPart { t, closed, length, .. } = flown;
        if length <= 0.0 {
            return Ok(());
        }
        let motion = self.propagation(closed)?;
        let (n, h) = (self.free.n, self.h);
        let part = length / h;
        let mut u = vec![0.0; self.free.size()];
        u[..n].copy_from_slice(&x[..n]);
        u[n..2 * n].iter_mut().zip(&*v).for_each(|(u, v)| *u = h * v);
        let series = match parameter {
            None => {
                let series = motion.gaps.iter().map(|gap| gap.series(&u)).collect();
                match part == 1.0 {
                    true => motion.whole(&u, &mut self.end),
                    false => motion.part(&self.free, (h, part), &mut u, &mut self.end, None),
                }
                series
            }
            Some(parameter) => {
                let variation = &rates.variations(self, closed)?[parameter];
                let rate = &rates.free[parameter];
                rate.drives.write_rates(&self.free.drives, t, h, &mut u[2 * n..]);
                self.moved(flown, (&motion, variation, rate), &mut u)
            }
        };
        x[..n].copy_from_slice(&self.end[..n]);
        v[..n].iter_mut().zip(&self.end[n..]).for_each(|(v, end)| *v = end / h);
        for (i, mut a) in series.into_iter().enumerate().filter(|&(i, _)| !closed.has(i)) {
            // gaps are carried along, as in the motion
            (a[0], a[1]) = (x[n + i], h * v[n + i]);
            let [value, slope] = value_and_slope(&a, part);
            (x[n + i], v[n + i]) = (value, slope / h);
        }
        Ok(())
    }

    /// The series of the gaps for a column by a parameter, whose end is in `self.end` then.
    fn moved(
        &mut self,
        FlownPart { from, t, length, .. }: FlownPart<'_>,
        (motion, variation, rate): (&Propagation, &ParameterVariation, &Free),
        u: &mut [f64],
    ) -> Vec<Series> {
        let (n, h, free) = (self.free.n, self.h, &self.free);
        let part = length / h;
        let mut y = vec![0.0; u.len()];
        y[..n].copy_from_slice(&from.x[..n]);
        y[n..2 * n].iter_mut().zip(&from.xdot).for_each(|(y, v)| *y = h * v);
        free.drives.write(t, h, &mut y[2 * n..]);
        let mut series = vec![[0.0; TERMS]; variation.gaps.len()];
        let (mut acceleration, mut more, mut power) = (vec![0.0; n], vec![0.0; n], 1.0);
        self.end.fill(0.0);
        for k in 0..TERMS {
            self.end.iter_mut().zip(&*u).for_each(|(end, u)| *end += power * u);
            for (a, [row, by]) in series.iter_mut().zip(&variation.gaps) {
                a[k] = dot(row, u) + dot(by, &y);
            }
            let factor = 1.0 / (k + 1) as f64;
            power *= part;
            more.fill(0.0);
            variation.acceleration.add(&y, &mut more);
            motion.advance(free, (h, factor), u, &mut acceleration);
            axpy(&mut u[n..2 * n], factor, &more);
            rate.drives.add_advance(h, factor, &y[2 * n..], &mut u[2 * n..]);
            motion.advance(free, (h, factor), &mut y, &mut acceleration);
        }
        series
    }

    /// The gap in the last step, by the part of a step of full length.
    pub(crate) fn series(&self, gap: usize) -> &Series {
        &self.series[gap]
    }

    /// The length of a step (s).
    pub(crate) fn step(&self) -> f64 {
        self.h
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;
    use crate::kinetics::mode::Contacts;
    use crate::system::dynamics::Layout;
    use crate::system::force::Friction;
    use crate::system::linear_dynamics::LinearDynamics;
    use crate::system::linear_system::{GapMotion, LinearGap, LinearSystem, LoadWave};
    use crate::HarmonicWall;

    /// Two coordinates, `3 q_1 - 2 q_2 + .7` over a wall that vibrates, and a load that is faster.
    fn flight() -> Box<LinearFlight> {
        let wall = HarmonicWall { amplitude: 0.4, omega: 5.0, phase: 0.6, offset: 0.2 };
        let motion = GapMotion::Harmonic(wall);
        let system = LinearSystem {
            mass: vec![2.0, 0.3, 0.3, 1.0],
            damping: vec![0.1, 0.0, 0.0, 0.1],
            stiffness: vec![1.0, 0.2, 0.2, 3.0],
            load: vec![0.5, -0.5],
            waves: vec![LoadWave { amplitude: vec![1.0, 0.0], omega: 40.0, phase: 0.0 }],
            tables: vec![],
            gaps: vec![LinearGap { normal: vec![3.0, -2.0], offset: 0.7, motion }],
        };
        let dynamics = LinearDynamics::new(Arc::new(system));
        LinearFlight::of::<Infallible, _>(&dynamics).unwrap()
    }

    #[test]
    fn the_period_is_that_of_the_fastest_load() {
        assert!((flight().period() - TAU / 40.0).abs() < 1e-15);
    }

    #[test]
    fn a_gap_is_told_with_the_sizes_of_its_terms() {
        let mut flight = flight();
        let (h, t, q, v) = (flight.h, 0.9, [0.3, -1.2], [0.5, 0.8]);
        flight.y[..4].copy_from_slice(&[q[0], q[1], h * v[0], h * v[1]]);
        let LinearFlight { free, y, .. } = &mut *flight;
        free.drives.write(t, h, &mut y[4..]);
        let (sin, cos) = (5.0 * t + 0.6).sin_cos();
        let [gap, rate] = flight.told(0);
        let near =
            |found: f64, exact: f64| assert!((found - exact).abs() < 1e-14, "{found} {exact}");
        near(gap.0, 3.0 * q[0] - 2.0 * q[1] + 0.7 - 0.2 - 0.4 * cos);
        near(gap.1, 3.0 * q[0] - 2.0 * q[1] + 0.7 - 0.2 + 0.4 * cos.abs());
        near(rate.0, 3.0 * v[0] - 2.0 * v[1] + 2.0 * sin);
        // both parts of a wave count, whichever is zero
        assert!(rate.1 >= 3.0 * v[0] + 2.0 * v[1] + 2.0 * sin.abs() - 1e-14);
    }

    #[test]
    fn a_closed_gap_has_drifted_with_a_height_or_a_speed_that_is_more_than_rounding() {
        let mut flight = flight();
        let (h, t, q, v) = (flight.h, 0.9, -1.2, 0.8);
        let (sin, cos) = (5.0_f64 * t + 0.6).sin_cos();
        let mut state = MechanicalState::new(Layout::smooth(2, 1), Friction::none());
        let mut has_drifted = |height: f64, speed: f64, closed: GapSet| {
            let q = [(height + 2.0 * q - 0.7 + 0.2 + 0.4 * cos) / 3.0, q];
            let v = [(speed + 2.0 * v - 2.0 * sin) / 3.0, v];
            flight.y[..4].copy_from_slice(&[q[0], q[1], h * v[0], h * v[1]]);
            let LinearFlight { free, y, .. } = &mut *flight;
            free.drives.write(t, h, &mut y[4..]);
            state.enter(Contacts { mode: closed.into(), ..Contacts::default() });
            flight.has_drifted(&state)
        };
        let closed = GapSet::of(0);
        assert!(!has_drifted(0.0, 0.0, closed));
        for sign in [-1.0, 1.0] {
            assert!(has_drifted(sign * 1e-12, 0.0, closed));
            assert!(has_drifted(0.0, sign * 1e-12, closed));
            assert!(!has_drifted(sign * 1e-12, sign * 1e-12, GapSet::EMPTY));
        }
    }

    #[test]
    fn the_terms_of_an_acceleration_count_whatever_their_signs() {
        let flight = flight();
        let (h, q, v) = (flight.h, [0.3, -1.2], [0.5, 0.8]);
        let mut y = vec![0.0; flight.free.size()];
        y[..4].copy_from_slice(&[q[0], q[1], h * v[0], h * v[1]]);
        flight.free.drives.write(0.0, h, &mut y[4..]);
        // M^-1 = [1, -.3; -.3, 2]/1.91
        let inverse = [[1.0, -0.3], [-0.3, 2.0]].map(|row| row.map(|entry: f64| entry / 1.91));
        let (stiffness, damping) = ([[1.0, 0.2], [0.2, 3.0]], [[0.1, 0.0], [0.0, 0.1]]);
        let (load, wave, normal) = ([0.5, -0.5], [1.0, 0.0], [3.0, -2.0_f64]);
        let mut exact = 0.0;
        for i in 0..2 {
            let by = |of: [f64; 2]| inverse[i][0] * of[0] + inverse[i][1] * of[1];
            let mut terms = by(load).abs() + by(wave).abs();
            for j in 0..2 {
                terms += (by([stiffness[0][j], stiffness[1][j]]) * q[j]).abs();
                terms += (by([damping[0][j], damping[1][j]]) * v[j]).abs();
            }
            exact += 0.5 * h * h * normal[i].abs() * terms;
        }
        let found = |t: f64| flight.free.acceleration_terms(0, (t, h), &y);
        assert!((found(0.0) / exact - 1.0).abs() < 1e-14, "{} {exact}", found(0.0));
        // later the phase of the wave has rounding
        assert!(found(1e3) > 2.0 * exact);
    }
}

#[cfg(test)]
mod first_root_tests {
    use super::*;

    /// `scale prod (1 - s/root)` times `s^zeros`.
    fn with_roots(roots: &[f64], zeros: usize) -> Series {
        let mut a = [0.0; TERMS];
        a[zeros] = 1.0;
        for root in roots {
            for k in (1..TERMS).rev() {
                a[k] -= a[k - 1] / root;
            }
        }
        a
    }

    #[test]
    fn the_first_root_is_found_whatever_comes_after_it() {
        for first in [1e-12, 1e-5, 0.013, 0.3, 0.77, 0.999] {
            for more in [&[][..], &[1.7], &[1.0 + 1e-3, 3.0], &[-0.5, 1.5, 9.0]] {
                for zeros in 0..4 {
                    let roots: Vec<f64> = more.iter().copied().chain([first]).collect();
                    let a = with_roots(&roots, zeros);
                    let root = first_root(&a, zeros).unwrap();
                    // what rounding of the terms moves it by
                    let (mut size, mut power) = (0.0, 1.0);
                    for a in &a {
                        size += a.abs() * power;
                        power *= first;
                    }
                    let noise =
                        4.0 * f64::EPSILON * (size / value_and_slope(&a, first)[1].abs() + first);
                    assert!((root - first).abs() <= noise, "{first} {more:?} {root}");
                }
            }
        }
    }

    #[test]
    fn a_parabola_falls_to_its_root_whichever_way_it_starts() {
        // 2 (1 + s/a)(1 - s/b): rising first where b > a
        for (a, b) in [(0.2, 0.7), (3.0, 1.1), (1e9, 0.4), (0.5, 0.5)] {
            let mut p = [0.0; TERMS];
            (p[0], p[1], p[2]) = (2.0, 2.0 / a - 2.0 / b, -2.0 / (a * b));
            assert!((fall_of_parabola(&p) - b).abs() < 1e-14, "{a} {b}");
        }
        let mut p = [0.0; TERMS];
        for (a, b, c) in [(1.0, 1.0, 1.0), (1.0, -2.0, 0.5), (1.0, 0.3, f64::NAN)] {
            (p[0], p[1], p[2]) = (a, b, c);
            assert_eq!(fall_of_parabola(&p), f64::INFINITY);
        }
    }

    #[test]
    fn short_arcs_from_above_zero_have_their_own_scale() {
        for length in [1e-11, 1e-8, 1e-4, 0.1] {
            // 3e-20 above zero, upwards first, beside coefficients of one
            let mut a = with_roots(&[length, -1e-3 * length, 1.9, -4.0], 0);
            a.iter_mut().for_each(|a| *a *= length * length);
            let root = first_root(&a, 0).unwrap();
            assert!((root - length).abs() <= 1e-12 * length, "{length} {root}");
        }
    }

    #[test]
    fn what_stays_above_zero_has_none() {
        assert_eq!(first_root(&with_roots(&[1.001], 0), 0), None);
        assert_eq!(first_root(&with_roots(&[-0.3, 2.0], 1), 1), None);
        // a minimum of 1e-9 at one half, and one of -1e-9
        let mut a = [0.0; TERMS];
        (a[0], a[1], a[2]) = (0.25 + 1e-9, -1.0, 1.0);
        assert_eq!(first_root(&a, 0), None);
        a[0] -= 2e-9;
        let root = first_root(&a, 0).unwrap();
        assert!((root - (0.5 - 1e-9_f64.sqrt())).abs() < 1e-10);
        a[0] = -1.0;
        assert_eq!(first_root(&a, 0), Some(0.0));
    }
}
