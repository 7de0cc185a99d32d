//! Free flight: its next segment, and the motion over it.

pub(crate) mod series;

use std::sync::Arc;

use series::{FlightPart, Linear, Reach, SeriesFlight, Table};

use super::accumulation::Deviation;
use super::mode::{Counted, Mode, NextInFlight, Point, Stages};
use super::path::{DensePath, FlightCurve};
use super::settings::SwitchedRk;
use crate::numeric::bernstein::Bernstein;
use crate::numeric::grid::PulseProbes;
use crate::numeric::stages::{factor, Equation, StepError, FACTORS};
use crate::piecewise::flight::{StepDecision, StepRoot, SteppedFlight};
use crate::piecewise::steps::{Start, StepHistory, Steps};
use crate::record::status::Failure;
use crate::{Dependence, Force, Status};

pub(crate) use series::Arrival;

/// Steps of power series that are taken in one go where nobody samples their ends.
const AT_ONCE: usize = 1000;

/// Flights of a run: steps of an embedded pair; power series for a linear force.
#[derive(Clone, Debug)]
pub(super) struct FreeFlight {
    pair: PairSteps,
    series: Option<Box<SeriesFlight>>,
    /// Whether all ends of steps are inspected.
    by_steps: bool,
}

impl FreeFlight {
    pub(super) fn new(settings: &SwitchedRk) -> Self {
        Self { pair: PairSteps::new(settings), series: None, by_steps: false }
    }

    /// The steps, of whatever kind.
    #[inline]
    pub(super) fn steps(&self) -> &Steps<f64> {
        &self.pair.steps
    }

    /// The same, mutable, for step limits and inspection.
    #[inline]
    pub(super) fn steps_mut(&mut self) -> &mut Steps<f64> {
        &mut self.pair.steps
    }

    /// The last step of the pair, to have its polynomials computed.
    pub(super) fn last_mut(&mut self) -> &mut Stages {
        self.pair.last_mut()
    }

    /// The time from the start of that to the impact with which it ends.
    pub(super) fn landing(&self) -> Option<f64> {
        self.pair.landing()
    }

    /// From here on flights of a run are probed for pulses.
    pub(super) fn probe_pulses(&mut self, pulses: PulseProbes) {
        self.pair.pulses = pulses;
    }

    /// From here on the force is another one.
    pub(super) fn restart_probes(&mut self) {
        self.pair.pulses.restart();
    }

    /// Whether all ends of steps are inspected.
    pub(super) fn look_at_steps(&mut self, by_steps: bool) {
        self.by_steps = by_steps;
    }

    /// Another run starts: its last bits do not depend on those before.
    pub(super) fn start(&mut self) {
        self.series.iter_mut().for_each(|series| series.start());
    }

    /// Chooses the flight integrator for the settings and the force.
    pub(super) fn adopt<E, F: Force<E>>(&mut self, settings: &SwitchedRk, force: &F) {
        let law = settings.law_of(force);
        let same = match (&mut self.series, &law) {
            (Some(series), Some(law)) => series.under(law),
            (series, law) => series.is_none() && law.is_none(),
        };
        if !same {
            self.series = law.and_then(SeriesFlight::new).map(Box::new);
        }
    }

    /// The force by its numbers, if flights are power series.
    pub(super) fn linear(&self) -> Option<&Linear> {
        self.series.as_ref().map(|series| series.linear())
    }

    /// The force on the mass at rest at the wall.
    #[inline]
    pub(super) fn at_wall<E, F: Force<E>>(
        &self,
        now: Point,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let known = self.series.as_ref().and_then(|series| series.at_wall(now));
        known.filter(|f| f.is_finite()).map_or_else(|| force.at_wall(now.t), Ok)
    }

    /// The next lift-off if known in closed form; the inner value is `None` without one.
    pub(super) fn lift_off(&mut self, now: Point, t_end: f64) -> Option<Option<f64>> {
        self.series.as_mut()?.lift_off(now, t_end)
    }

    /// The next segment of a flight from x > 0 or from the wall, up to an impact if any.
    #[inline]
    pub(super) fn next<E, F: Force<E>>(
        &mut self,
        now: Point,
        mode: &mut Mode,
        obstacle: Option<Deviation>,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Arrival, Failure<E>> {
        match &mut self.series {
            Some(series) => {
                let most = if self.by_steps { 1 } else { AT_ONCE };
                by_series(series, &mut self.pair.steps, now, mode, (t_end, most))
            }
            None => self.pair.fly(now, mode, obstacle, t_end, force),
        }
    }

    /// Number of curves of the last segment.
    pub(super) fn curves(&self) -> usize {
        self.series.as_ref().map_or(1, |series| series.parts())
    }

    /// One of them, in order, up to the impact if there was one.
    pub(super) fn curve<E, F: Force<E>>(
        &mut self,
        k: usize,
        sigma: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<FlightCurve, Failure<E>> {
        match self.part(k) {
            Some((t, part, table)) => Ok(FlightCurve::of_part(t, sigma, &part, table)),
            None => self.pair.curve(sigma, force),
        }
    }

    /// Adds a segment to a path by its initial data; returns whether these determine it.
    #[inline]
    pub(super) fn keep(&self, k: usize, sigma: f64, path: &mut DensePath) -> bool {
        let part = self.part(k);
        if let Some((start, part, table)) = part {
            path.push_part(start, sigma, (part, table));
        }
        part.is_some()
    }

    /// The same of a piece that is one of them under a linear force.
    #[inline(always)]
    pub(super) fn keep_alone(&self, sigma: f64, path: &mut DensePath) -> bool {
        let Some(series) = &self.series else { return false };
        let Some((start, part)) = series.alone() else { return false };
        path.push_part(start, sigma, (part, series.table()));
        true
    }

    /// A segment by its initial time and data, which determine it under a linear force.
    pub(super) fn part(&self, k: usize) -> Option<(f64, FlightPart, &Arc<Table>)> {
        let series = self.series.as_ref()?;
        let (t, part) = series.part(k);
        Some((t, part, series.table()))
    }
}

/// Up to a number of power-series steps.
#[inline]
fn by_series<E>(
    series: &mut SeriesFlight,
    counts: &mut Steps<f64>,
    now: Point,
    mode: &mut Mode,
    (t_end, most): (f64, usize),
) -> Result<Arrival, Failure<E>> {
    let steps = most.min(counts.left()?);
    let known = match *mode {
        Mode::Flight(NextInFlight::Leave { order }) => order,
        _ => usize::from(now.x == 0.0),
    };
    let reach = Reach { t_end, look: counts.dense_from(), steps };
    let mut arrival = series.fly(now, known, reach);
    if !(arrival.end.x.is_finite() && arrival.end.xdot.is_finite()) {
        if arrival.steps == 1 {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        // a run that samples every step ends with the last finite one: so does this, next time
        let Arrival { from, steps, .. } = arrival;
        arrival = Arrival { from, end: from, lands: false, steps: steps - 1 };
    }
    counts.count(arrival.steps);
    if !arrival.lands {
        *mode = Mode::FLIGHT;
    }
    Ok(arrival)
}

// Free flight by steps of an embedded pair, each searched for the first impact.

/// Defect of the polynomials, relative to the tolerances, that shows a feature of the force.
const DEFECT: f64 = 100.0;
/// The same, relative to that, that shows a pulse.
const PULSE: f64 = 100.0;
/// The same up to which they tell an impact as well as a step onto it.
const RESOLVED: f64 = 0.3;
/// The same up to which they do once the residual is integrated.
const NEARLY_RESOLVED: f64 = 30.0;
/// Gauss's four nodes and weights on `[0, 1]`.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];
/// The speed of an impact that they tell, relative to the largest at the ends of the step: of
/// slower ones the time depends on the position like a root.
const STEEP: f64 = 0.1;

/// A step that locates an impact without evaluation at its apex is not longer than the last;
/// otherwise it may be longer by this factor.
const GREW: f64 = 2.0;
/// Ratio of a step that falls onto the wall to the fall under a constant force: the part with x < 0
/// is irrelevant, and the polynomials of a short step locate an impact.
const FALL: f64 = 1.2;

/// Steps of a pair.
#[derive(Clone, Debug)]
struct PairSteps {
    steps: Steps<f64>,
    /// The impact within or shortly after the last step, if it ends on the wall.
    landing: Option<ImpactStep>,
    /// How many steps had been given up when the flight began.
    rejected: u64,
    /// The probes for pulses.
    pub(super) pulses: PulseProbes,
}

/// An impact by the start of the step onto it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ImpactStep {
    /// Time from there (s).
    length: f64,
    /// Velocity before the impact (m/s).
    xdot: f64,
}

impl PairSteps {
    fn new(settings: &SwitchedRk) -> Self {
        let (limits, pair) = (settings.limits(settings.tolerances()), settings.order.pair());
        let steps = Steps::new(limits, pair, 1, None);
        Self { steps, landing: None, rejected: 0, pulses: PulseProbes::default() }
    }

    /// The last step.
    fn last_mut(&mut self) -> &mut Stages {
        self.steps.last_mut()
    }

    /// The time from the start of the last step to the impact with which it ends.
    fn landing(&self) -> Option<f64> {
        self.landing.map(|landing| landing.length)
    }

    /// One step, or the part of it up to an impact.
    fn fly<E, F: Force<E>>(
        &mut self,
        now: Point,
        mode: &mut Mode,
        obstacle: Option<Deviation>,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Arrival, Failure<E>> {
        let slope = if mode.continues() {
            self.last_mut().slope_at_end(force)?
        } else {
            force.at(now.t, now.x, now.xdot)?
        };
        let mut longest = obstacle.map_or(f64::INFINITY, |obstacle| obstacle.longest_step(now.t));
        let (_, rejected) = self.steps.counts();
        if !mode.continues() {
            self.rejected = rejected;
        }
        // where a step was given up there is more to see than a fall
        if self.steps.limits().adaptive && rejected == self.rejected {
            longest = fall(now, slope).map_or(longest, |fall| longest.min(FALL * fall));
        }
        let end = self.pulses.end(now.t, t_end);
        if end < t_end {
            longest = longest.min(end - now.t);
        }
        let plan = self.steps.plan((&now, &slope), 0..1, longest, t_end, force)?;
        let shortest = 8.0 * f64::EPSILON * now.t.abs();
        FlyingStep { pair: self, now, slope, mode, t_end, force }.fly(plan, shortest)
    }

    /// The polynomials of the last step, up to its impact if there was one.
    fn curve<E, F: Force<E>>(
        &mut self,
        sigma: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<FlightCurve, Failure<E>> {
        let last = self.steps.last_mut();
        let [mut x, mut xdot] = last.polynomials(force)?;
        let (from, mut h) = (last.from, last.h);
        if let Some(ImpactStep { length, xdot: incoming }) = self.landing {
            x = x.split(length / h).0.with_ends(from.x, 0.0);
            xdot = xdot.split(length / h).0.with_ends(from.xdot, incoming);
            h = length;
        }
        Ok(FlightCurve::polynomials(from.t, h, sigma, [x, xdot]))
    }
}

/// Time of the fall onto the wall from x > 0 under a constant force, if it points to the wall.
#[inline]
fn fall(now: Point, slope: f64) -> Option<f64> {
    let (speed, pull) = (now.xdot, -slope);
    if !(now.x > 0.0 && pull > 0.0) {
        return None;
    }
    let at_wall = (speed * speed + 2.0 * pull * now.x).sqrt();
    // without cancellation
    let fall = if speed < 0.0 { 2.0 * now.x / (at_wall - speed) } else { (speed + at_wall) / pull };
    // of shorter ones rounding of the time is a part
    (fall > 16.0 * f64::EPSILON * now.t.abs()).then_some(fall)
}

/// A step in progress.
struct FlyingStep<'r, 'f, F> {
    pair: &'r mut PairSteps,
    now: Point,
    slope: f64,
    mode: &'r mut Mode,
    t_end: f64,
    force: &'r mut Counted<'f, F>,
}

impl<E, F: Force<E>> SteppedFlight<f64, E> for FlyingStep<'_, '_, F> {
    /// The mass reaches the wall, with this velocity if the polynomials tell.
    type Event = Option<f64>;
    type Piece = Arrival;

    #[inline(always)]
    fn steps(&mut self) -> &mut Steps<f64> {
        &mut self.pair.steps
    }

    #[inline(always)]
    fn parts(&mut self) -> (&mut Steps<f64>, Start<'_, f64>, impl Equation<f64, Failure<E>>) {
        (&mut self.pair.steps, (&self.now, &self.slope), &mut *self.force)
    }

    #[inline(always)]
    fn search(&mut self, growth: f64) -> Result<StepDecision<Option<f64>>, Failure<E>> {
        let leaves = self.mode.leaves();
        if leaves && !self.pair.steps.last().rises(0) {
            return Ok(StepDecision::TOO_LONG);
        }
        let contact = if leaves { None } else { self.first_root(0)? };
        let seen = self.look_at_the_apex(contact)?;
        if let Some(excess) = seen.map(|defect| defect / DEFECT).filter(|&excess| excess > 1.0) {
            // the shorter step is examined again
            if let Mode::Flight(NextInFlight::Step { experience, .. }) = self.mode {
                *experience = StepHistory::NONE;
            }
            let factor = factor(excess, self.pair.steps.last().order_of_error()).max(FACTORS.0);
            return Ok(StepDecision::Shorten(factor, Status::StepSizeTooSmall));
        }
        if let Some(length) = self.missed_pulse(contact.unwrap_or(1.0))? {
            let factor = length / self.pair.steps.last().h;
            return Ok(StepDecision::Shorten(factor, Status::StepSizeTooSmall));
        }
        if let Some(theta) = contact {
            let told = self.told_by_polynomials(theta, seen)?;
            let (theta, xdot) = told.map_or((theta, None), |(theta, xdot)| (theta, Some(xdot)));
            return Ok(StepDecision::Stop(theta, xdot));
        }
        if self.pair.steps.last().end.t > self.pair.steps.dense_from() {
            // with its polynomials, or not at all
            self.complete()?;
        }
        Ok(StepDecision::Take(growth))
    }

    /// Ends the step with the impact after the time `length`. If the polynomials do not tell it, a
    /// second step ends there; no impact if that one passes the wall closely.
    #[inline(always)]
    fn stop(&mut self, length: f64, told: Option<f64>) -> Result<Option<Arrival>, Failure<E>> {
        let from = self.now;
        let (length, xdot) = match told {
            Some(xdot) => (length, xdot),
            None => {
                let Some(root) = self.step_onto(0, length, 1.0)? else { return Ok(None) };
                let h = self.pair.steps.last().h;
                match root {
                    StepRoot::Near { delta, xdot } => (h + delta, xdot),
                    StepRoot::Within(theta) => {
                        let [_, xdot] = self.pair.steps.last().polynomials_of(0);
                        (theta * h, xdot.at(theta).min(0.0))
                    }
                }
            }
        };
        if from.t + length > self.pair.steps.dense_from() {
            self.complete()?;
        }
        self.pair.steps.accept();
        self.pair.landing = Some(ImpactStep { length, xdot });
        let mut end = from.after(length.max(0.0), 0.0, xdot);
        if end.t > self.t_end {
            (end.t, end.late) = (self.t_end, 0.0);
        }
        Ok(Some(Arrival { from, end, lands: true, steps: 1 }))
    }

    #[inline(always)]
    fn take(&mut self) -> Result<Arrival, Failure<E>> {
        let PairSteps { steps, landing, .. } = &mut *self.pair;
        steps.accept();
        let mut end = steps.last().end;
        if steps.reaches(self.t_end) {
            (end.t, end.late) = (self.t_end, 0.0);
        }
        *landing = None;
        self.mode.step(steps.last().h);
        Ok(Arrival { from: self.now, end, lands: false, steps: 1 })
    }
}

impl<F> FlyingStep<'_, '_, F> {
    /// Deviation of the force between the stages from their interpolation, relative to the
    /// tolerances, by one more evaluation at the apex, where a position-dependent force differs
    /// most; `None` if unnecessary. Soon after an impact a step may be a whole flight, and one much
    /// longer than the last has little that speaks for it.
    fn look_at_the_apex<E>(&mut self, contact: Option<f64>) -> Result<Option<f64>, Failure<E>>
    where
        F: Force<E>,
    {
        let PairSteps { steps, .. } = &mut *self.pair;
        let known = self.mode.experience().is_enough(steps.last().h);
        let turns = self.now.xdot > 0.0 && (contact.is_some() || steps.last().end.xdot < 0.0);
        if known || !turns || !steps.limits().adaptive || steps.is_jump() {
            return Ok(None);
        }
        if self.force.dependence::<E>() == Dependence::Constant {
            return Ok(None);
        }
        let polynomials = steps.last_mut().polynomials(self.force)?;
        let apex = polynomials[1].first_negative().unwrap_or(0.5);
        self.defect(&polynomials, apex).map(Some)
    }

    /// The length of a step that ends before a pulse of the force between the stages of a long one, of
    /// which a part counts.
    #[inline(never)]
    fn missed_pulse<E>(&mut self, part: f64) -> Result<Option<f64>, Failure<E>>
    where
        F: Force<E>,
    {
        let PairSteps { steps, pulses, .. } = &mut *self.pair;
        let (t, h, limits) = (steps.last().from.t, steps.last().h, steps.limits());
        let wanted = limits.adaptive && limits.max_step == f64::INFINITY;
        if !pulses.is_long(h) || !wanted || steps.is_jump() {
            return Ok(None);
        }
        let mut pulses = *pulses;
        let polynomials = steps.last_mut().polynomials(self.force)?;
        let nodes = self.pair.steps.last().pair.c;
        let found = pulses.deviation((t, part * h), (h, nodes), |at| {
            Ok(self.defect(&polynomials, at / h)? <= PULSE * DEFECT)
        });
        self.pair.pulses = pulses;
        found
    }

    /// The fraction of the step at the impact near `theta`, and the velocity before it, if the
    /// polynomials of the step determine them to the tolerances, judged by their last terms and by
    /// the deviation `seen` at the apex or halfway to the impact. Where they nearly do they are
    /// corrected.
    fn told_by_polynomials<E>(
        &mut self,
        theta: f64,
        seen: Option<f64>,
    ) -> Result<Option<(f64, f64)>, Failure<E>>
    where
        F: Force<E>,
    {
        let steps = &self.pair.steps;
        // the step onto an impact under a constant force is exact, and costs nothing
        let constant = self.force.dependence::<E>() == Dependence::Constant;
        if constant || !steps.limits().adaptive || steps.is_jump() {
            return Ok(None);
        }
        let last = steps.last();
        let autonomous = Equation::<f64, Failure<E>>::is_autonomous(self.force);
        if !autonomous && seen.is_none() && !self.mode.experience().is_enough(GREW * last.h) {
            // between its stages there is room for a pulse that a second step sees
            return Ok(None);
        }
        let polynomials = last.polynomials_of(0);
        let xdot = polynomials[1].at(theta);
        let steep = -xdot > STEEP * last.from.xdot.abs().max(last.end.xdot.abs());
        let [of_x, of_xdot] = polynomials.each_ref().map(|it| [it.last_term(), 0.0]);
        let last_terms = StepError { x: of_x, xdot: of_xdot, double: false };
        let scales = last.scales(0, &steps.limits().tolerances);
        let last_term = last_terms.norm(scales);
        // false for NaN, too
        let nearly = last_term <= if autonomous { NEARLY_RESOLVED } else { RESOLVED };
        if !(steep && nearly) {
            return Ok(None);
        }
        if last_term > RESOLVED {
            return self.corrected(&polynomials[1], (theta, xdot), scales);
        }
        let defect = match seen {
            Some(defect) => defect,
            None => self.defect(&polynomials, 0.5 * theta)?,
        };
        Ok((defect <= RESOLVED).then_some((theta, xdot)))
    }

    /// The impact near the part `theta` of the step, with the velocity `xdot` there by the
    /// polynomial `p` of the velocity, once the residual of the equation of motion is integrated:
    ///
    /// ```text
    /// r = f(t, x_0 + int p, p) - p'
    /// dx' = int r dtau                  dx = x_0 + int p dtau + int (t - tau) r dtau            (1)
    /// ```
    ///
    /// by Gauss's formula, which is exact for the first terms that the polynomials do not have. That
    /// the force differs at the corrected state, by `f_x dx + f_x' dx'`, is left. None where the
    /// correction is larger than the tolerances, or leads out of the step.
    fn corrected<E>(
        &mut self,
        p: &Bernstein,
        (theta, xdot): (f64, f64),
        scales: [f64; 2],
    ) -> Result<Option<(f64, f64)>, Failure<E>>
    where
        F: Force<E>,
    {
        let (from, h) = (self.now, self.pair.steps.last().h);
        let length = theta * h;
        let [mut dx, mut dxdot] = [from.x + h * p.integral(theta), 0.0];
        for (node, weight) in GAUSS {
            let (at, weight) = (theta * node, length * weight);
            let there = from.after(at * h, from.x + h * p.integral(at), p.at(at));
            let residual = self.force.at(there.t, there.x, there.xdot)? - p.slope(at) / h;
            dxdot += weight * residual;
            dx += weight * (1.0 - node) * length * residual;
        }
        let correction = StepError { x: [dx, 0.0], xdot: [dxdot, 0.0], double: false };
        let late = -dx / (xdot + dxdot);
        let impact = (theta + late / h, xdot + dxdot + late * p.slope(theta) / h);
        let within = impact.0 > 0.0 && impact.0 <= 1.0 && impact.1 < 0.0;
        Ok((within && correction.norm(scales) <= 1.0).then_some(impact))
    }

    /// How far the polynomials of the step are from the equation of motion after a part of it,
    /// relative to the tolerances.
    fn defect<E>(&mut self, polynomials: &[Bernstein; 2], theta: f64) -> Result<f64, Failure<E>>
    where
        F: Force<E>,
    {
        let steps = &self.pair.steps;
        let (last, tolerances) = (steps.last(), &steps.limits().tolerances);
        let defect = last.defect(polynomials, theta, self.force)?;
        Ok(defect.norm(last.scales(0, tolerances)))
    }
}
