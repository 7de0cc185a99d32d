//! A whole run with its derivatives.

use super::{ColumnStep, Derivatives, EventRates, Limit, Question, Validity, Wrt};
use crate::numeric::stages::{factor, shorter, FACTORS};
use crate::piecewise::steps::Driver;
use crate::record::status::Failure;
use crate::record::trajectory::SetupError;
use crate::switched::mode::{Counted, Mode, NextInFlight, Piece, Point, Stages};
use crate::switched::recording::{check_span, check_stops, running};
use crate::switched::settings::{Output, SwitchedRk, SwitchedRun};
use crate::switched::SwitchedIntegrator;
use crate::system::force::Stops;
use crate::system::slopes::{DifferentiableForce, Place};
use crate::zeno::arc::Bounce;
use crate::zeno::chain::{ChainRates, Rate};
use crate::{AnyImpactLaw, Dependence, Impact, Monitor, Physical, Status};

/// Simulates as [`crate::simulate_switched_rk`], with the derivatives of the run.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
///
/// ```
/// use zivi::switched::sensitivity::{sensitivity, Question, Wrt};
/// use zivi::{ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk};
///
/// // the Zeno time of a ball that is dropped from 1 m, by its height and by e
/// let question =
///     Question { wrt: &[Wrt::X0, Wrt::E], sizes: &[1.0, 0.5], controlled: true, times: &[] };
/// let (_, derivatives) = sensitivity(
///     SwitchedRk::with_tol(1e-10), Restitution::from_e(0.5)?, &mut ConstantForce(-2.0),
///     (0.0, 4.0), Physical { x: 1.0, xdot: 0.0 }, Output::default(), &question, &mut Silent,
/// )?;
/// // t = sqrt(2 x/g) (1 + e)/(1 - e), with sqrt(2 x/g) = 1
/// assert!((derivatives.events.zeno_times[0] - 1.5).abs() < 1e-9);
/// assert!((derivatives.events.zeno_times[1] - 8.0).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[allow(clippy::too_many_arguments)]
pub fn sensitivity<E, F: DifferentiableForce<E>>(
    settings: SwitchedRk,
    law: impl Into<AnyImpactLaw>,
    force: &mut F,
    (t0, t1): (f64, f64),
    initial: Physical,
    output: Output<'_, E>,
    question: &Question<'_>,
    monitor: &mut impl Monitor<E>,
) -> Result<(SwitchedRun<E>, Derivatives), SetupError> {
    check_span(t0, t1, output.t_eval)?;
    check_stops(output.tstops)?;
    let mut integrator = SwitchedIntegrator::new(settings, law)?;
    integrator.start(t0, initial)?;
    integrator.probe(force.shortest_period().is_none(), t1 - t0);
    let Question { wrt, sizes, controlled, times } = *question;
    let dense = !times.is_empty();
    let mut follower = VariationalRun::new(wrt, sizes, controlled, t1, output.tstops, dense);
    let mut force = Counted::new(force);
    Stops::new(output.tstops, t1).enter(t0, &mut force.smooth);
    let begun = follower.begin(integrator.now(), integrator.law(), &mut force);
    let mut run = running(integrator, t1, output);
    let ending = match begun {
        Ok(()) => run.go(&mut follower, &mut force, monitor),
        Err(failure) => failure.into(),
    };
    let nfev = force.count();
    follower.ends(run.method.now());
    let mut run = run.finish(ending, nfev, |start, len| monitor.record_allocated(start, len))?;
    let mut samples = Vec::new();
    let room = times.len().saturating_mul(2 * wrt.len());
    samples.try_reserve_exact(room).map_err(|_| SetupError::Memory(times.len()))?;
    if let Some(path) = &follower.path {
        for (k, &t) in times.iter().enumerate() {
            if k % BETWEEN_POLLS == 0 {
                if let Err(raised) = monitor.poll(k, times.len()) {
                    run.raised = Some(raised);
                    run.trajectory.status = Status::Raised;
                    break;
                }
            }
            let at = path.at(t);
            samples.extend_from_slice(&at.x);
            samples.extend_from_slice(&at.v);
        }
    }
    Ok((run, gather(follower, settings, samples)))
}

/// Samples of derivatives between two checks for interruption.
const BETWEEN_POLLS: usize = 1 << 12;

fn gather(mut follower: VariationalRun, settings: SwitchedRk, samples: Vec<f64>) -> Derivatives {
    let grazing = follower.validity.is_undecided(&settings, follower.highest);
    let end = std::mem::take(&mut follower.step.end);
    Derivatives {
        q: end.x,
        qdot: end.v,
        events: follower.events,
        radius: follower.validity.radius,
        nearest: follower.validity.nearest,
        grazing,
        lost_at: None,
        samples,
        n_slopes: follower.step.forcing.count,
    }
}

// Follows a run of the switched method with the columns: each step, impact, Zeno point, rest and
// lift-off.
//
// ```text
// impact    dt = -X-/v-      dv- = V- + a- dt      du = -after'(-v-) dv- + after_q(-v-)
//           X+ = -u dt       V+ = du - a+ dt       a+- = f(t, 0, x'+-)
// ```

/// The columns of a run in progress.
pub(in crate::switched) struct VariationalRun {
    wrt: Vec<Wrt>,
    /// Magnitudes of the variables of differentiation.
    sizes: Vec<f64>,
    /// Whether the steps are adapted to the columns too.
    controlled: bool,
    pub(in crate::switched) step: ColumnStep,
    chains: Vec<ChainRates>,
    pub(in crate::switched) events: EventRates,
    pub(in crate::switched) validity: Validity,
    pub(in crate::switched) path: Option<super::ColumnPath>,
    /// `dt` and `du` of the last impact; of the arrival at rest.
    dt: Vec<f64>,
    du: Vec<f64>,
    /// Of the Zeno point that the impact sequence is about to reach.
    zeno: Vec<f64>,
    /// Since when the mass rests.
    resting: Option<f64>,
    /// The largest distance so far, and when the run ends.
    pub(in crate::switched) highest: f64,
    end: f64,
    /// Times at which the force may jump, increasing.
    stops: Vec<f64>,
}

impl VariationalRun {
    pub(in crate::switched) fn new(
        wrt: &[Wrt],
        sizes: &[f64],
        controlled: bool,
        end: f64,
        stops: &[f64],
        dense: bool,
    ) -> Self {
        let m = wrt.len();
        let zeros = vec![0.0; m];
        Self {
            wrt: wrt.to_vec(),
            sizes: sizes.to_vec(),
            controlled,
            step: ColumnStep::new(wrt),
            chains: vec![ChainRates::default(); m],
            events: EventRates::default(),
            validity: Validity::new(m),
            path: dense.then(|| super::ColumnPath::new(m)),
            dt: zeros.clone(),
            du: zeros,
            zeno: Vec::new(),
            resting: None,
            highest: 0.0,
            end,
            stops: stops.to_vec(),
        }
    }

    /// The columns where the integrator starts, through an impact if it starts with one.
    pub(in crate::switched) fn begin<E, F: DifferentiableForce<E>>(
        &mut self,
        start: Point,
        law: &AnyImpactLaw,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let pull = force.at(start.t, start.x, start.xdot)?;
        self.step.end.clear();
        self.highest = start.x;
        if start.physical().is_at_origin() {
            for (dt, wrt) in self.dt.iter_mut().zip(&self.wrt) {
                *dt = if *wrt == Wrt::T0 { 1.0 } else { 0.0 };
            }
            self.resting = Some(start.t);
            return Ok(());
        }
        for (column, wrt) in self.wrt.iter().enumerate() {
            let (x, v) = match wrt {
                Wrt::X0 => (1.0, 0.0),
                Wrt::Xdot0 => (0.0, 1.0),
                Wrt::T0 => (-start.xdot, -pull),
                Wrt::Law(_) | Wrt::Parameter(_) => (0.0, 0.0),
            };
            (self.step.end.x[column], self.step.end.v[column]) = (x, v);
        }
        if start.physical().arrives() {
            let xdot_after = law.after(-start.xdot);
            let impact = Impact { t: start.t, xdot_before: start.xdot, xdot_after };
            return self.strike(&impact, law, force);
        }
        Ok(())
    }

    /// Through an impact, from the columns before it to those after it.
    fn strike<E, F: DifferentiableForce<E>>(
        &mut self,
        impact: &Impact,
        law: &AnyImpactLaw,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let Impact { t, xdot_before: v, xdot_after: u } = *impact;
        let before = force.at(t, 0.0, v)?;
        let after = force.at(t, 0.0, u)?;
        if before > 0.0 {
            // pulled off the wall: v^2/(2 a) is how much higher the lowest point may be
            let depth = v * v / (2.0 * before);
            self.validity.note(Limit::Impact, t, depth, self.step.end.x.iter().copied());
        }
        let slope = law.slope(-v);
        let Self { step, dt, du, wrt, .. } = self;
        for column in 0..dt.len() {
            let (x, xdot) = (&mut step.end.x[column], &mut step.end.v[column]);
            dt[column] = -*x / v;
            let dv = *xdot + before * dt[column];
            du[column] = wrt[column].of_law(|parameter| law.by(parameter, -v)) - slope * dv;
            (*x, *xdot) = (-u * dt[column], du[column] - after * dt[column]);
        }
        self.note_neighbours(t);
        for (list, row) in
            [(&mut self.events.impact_dt, &self.dt), (&mut self.events.impact_du, &self.du)]
        {
            list.try_reserve(row.len()).map_err(|_| Failure::Status(Status::OutOfMemory))?;
            list.extend_from_slice(row);
        }
        Ok(())
    }

    /// After the evaluation of the last impact: its contribution to the impact sequence, and whether the
    /// derivatives of a Zeno time are known as accurately as the time.
    fn weigh<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let Some(&last) = integrator.chain().bounces().last() else { return Ok(()) };
        if last.t != integrator.t() {
            return Ok(());
        }
        let mut dg = vec![0.0; self.dt.len()];
        self.wall_rates(last.t, &self.dt.clone(), force, &mut dg)?;
        dg.iter_mut().for_each(|dg| *dg = -*dg);
        // flights after it are others, or long, where its speed or the pull has vanished
        self.validity.note(Limit::Chain, last.t, last.g.abs(), dg.iter().copied());
        self.validity.note(Limit::Chain, last.t, last.u, self.du.iter().copied());
        for (column, dg) in dg.into_iter().enumerate() {
            let (dt, du) = (self.dt[column], self.du[column]);
            let de = self.limit_by(column, integrator);
            let rate = Rate { dt, du, dg, de, flow: [&[], &[]], dz: &[] };
            self.chains[column].note(integrator.chain(), &rate);
        }
        let Mode::Flight(NextInFlight::Jump { .. }) = integrator.mode() else { return Ok(()) };
        let tolerance = integrator.settings().zeno_tolerance(integrator.chain(), last.g);
        let (rtol, mut known) = (integrator.settings().rtol, true);
        self.zeno.clear();
        if integrator.law().geometric_up_to() == 0.0 {
            self.weigh_alone(integrator, last);
            return Ok(());
        }
        for (column, chain) in self.chains.iter().enumerate() {
            let (de, size) = (self.limit_by(column, integrator), self.sizes[column]);
            let landing = chain.landing(integrator.chain(), de, |_, _| 1.0);
            let (dt, error) = landing.map_or((0.0, f64::INFINITY), |it| (it.t, it.size));
            known &= error * size <= tolerance + rtol * size * dt.abs();
            self.zeno.push(dt);
        }
        if self.controlled && !integrator.chain().is_over() && !known {
            integrator.cancel_jump();
        }
        Ok(())
    }

    /// The derivatives of the end `t + 2 S(u)/g` of impacts that are in no geometric impact sequence.
    fn weigh_alone(&mut self, integrator: &SwitchedIntegrator, last: Bounce) {
        const STEP: f64 = 1e-4;
        let Bounce { u, g, .. } = last;
        let sum = |u: f64| integrator.law().sum_of_speeds(u).unwrap_or(f64::NAN);
        let slope = (sum(u * (1.0 + STEP)) - sum(u * (1.0 - STEP))) / (2.0 * STEP * u);
        for (dt, du) in self.dt.iter().zip(&self.du) {
            self.zeno.push(dt + 2.0 * slope * du / g);
        }
    }

    /// The derivative of the ratio of speeds in an impact sequence.
    fn limit_by(&self, column: usize, integrator: &SwitchedIntegrator) -> f64 {
        self.wrt[column].of_law(|parameter| integrator.law().limit_by(parameter))
    }

    /// An event at `t` that moves by `self.dt` may pass the end of the run, or a jump of the force.
    fn note_neighbours(&mut self, t: f64) {
        self.validity.note(Limit::End, t, self.end - t, self.dt.iter().copied());
        let after = self.stops.partition_point(|&stop| stop <= t);
        let near = [after.checked_sub(1), Some(after)];
        for stop in near.into_iter().flatten().filter_map(|i| self.stops.get(i)) {
            self.validity.note(Limit::Stop, t, (stop - t).abs(), self.dt.iter().copied());
        }
    }

    /// At the end of the run: an impact shortly after it may move before it.
    pub(in crate::switched) fn ends(&mut self, end: Point) {
        if end.x > 0.0 && end.xdot < 0.0 {
            let rates: Vec<f64> = self.step.end.x.iter().map(|x| x / end.xdot).collect();
            self.validity.note(Limit::End, end.t, -end.x / end.xdot, rates);
        }
    }

    /// The derivatives of `f(t, 0, 0)` along a time that moves by `dt`; also `f_t`.
    fn wall_rates<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        dt: &[f64],
        force: &mut Counted<'_, F>,
        out: &mut [f64],
    ) -> Result<f64, Failure<E>> {
        let place = Place::new(t, 0.0, 0.0);
        let slopes = self.step.forcing.slopes(place, true, force)?;
        for (out, dt) in out.iter_mut().zip(dt) {
            *out = slopes.t * dt;
        }
        self.step.forcing.add_to(out, 1.0);
        Ok(slopes.t)
    }

    /// A tail or a rest.
    fn other<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &SwitchedIntegrator,
        piece: Piece,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        let t = integrator.t();
        match piece {
            Piece::Tail => {
                self.dt.clone_from(&self.zeno);
                self.came_to_rest(t, true, force)?;
                if let (Some(path), Some(tail)) = (&mut self.path, integrator.tail()) {
                    path.push_tail(tail.start());
                }
            }
            Piece::Rest { from, lifted } => {
                self.rest((from, t), lifted, force)?;
                if let Some(path) = &mut self.path {
                    path.push_rest(from);
                }
            }
            Piece::Flight { .. } => {}
        }
        Ok(piece)
    }
}

impl<'f, E, F: DifferentiableForce<E>> Driver<SwitchedIntegrator, Counted<'f, F>, E>
    for VariationalRun
{
    fn step(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'f, F>,
    ) -> Result<Piece, Failure<E>> {
        if let Mode::Flight(NextInFlight::AfterImpact) = integrator.mode() {
            integrator.settle(t_end, force)?;
            self.weigh(integrator, force)?;
        }
        match integrator.mode() {
            Mode::Rest(_) | Mode::Flight(NextInFlight::Jump { .. }) => {
                let piece = integrator.proceed(t_end, force)?;
                self.other(integrator, piece, force)
            }
            Mode::Flight(_) => self.fly_within(integrator, t_end, force),
        }
    }
}

// The columns in flight: through the steps of the motion, shorter ones where the columns need them.

/// Steps rejected for the columns before one is accepted regardless.
const RETRIES: u32 = 40;
/// How far the step onto an impact may be moved to it, relative to its length.
const NUDGE: f64 = 1e-4;

impl VariationalRun {
    /// The columns over a piece of flight; by how much the step was too long for them.
    fn fly<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        onto: Option<&mut Stages>,
        force: &mut Counted<'_, F>,
    ) -> Result<f64, Failure<E>> {
        let settings = *integrator.settings();
        let stages = onto.unwrap_or_else(|| integrator.flight().last_mut());
        self.step.step(stages, force)?;
        if !self.controlled || !settings.adaptive {
            return Ok(0.0);
        }
        self.step.error(stages, &settings.tolerances(), &self.sizes, force)
    }

    /// The step onto an impact that was found on the polynomials of a longer one.
    fn onto<E, F: DifferentiableForce<E>>(
        integrator: &mut SwitchedIntegrator,
        impact: Option<Impact>,
        force: &mut Counted<'_, F>,
    ) -> Result<Option<Stages>, Failure<E>> {
        let flight = integrator.flight();
        let length = flight.landing().filter(|_| impact.is_some());
        let last = flight.last_mut();
        let Some(total) = length.filter(|&total| far(total, last)) else { return Ok(None) };
        let mut stages = last.clone();
        let (from, slope) = (stages.from, stages.start_slope(0));
        stages.step(&from, &slope, total, force)?;
        Ok(Some(stages))
    }

    /// Contributions of an accepted segment of flight: a minimum, the dense output, an impact.
    fn flew<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        impact: Option<Impact>,
        onto: Option<&mut Stages>,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let law = integrator.law().clone();
        let flight = integrator.flight();
        self.highest = self.highest.max(flight.last_mut().from.x.abs());
        if impact.is_none() {
            self.minimum(flight.last_mut(), force)?;
        }
        let length = flight.landing().filter(|_| impact.is_some());
        let stages = onto.unwrap_or_else(|| flight.last_mut());
        if let Some(path) = &mut self.path {
            // the columns are forced by the motion at its own further stages
            stages.complete(force)?;
            self.step.all_stages(stages, force)?;
            path.push_flight(stages, &self.step, length);
        }
        if let Some(total) = length {
            self.step.polish(stages, total - stages.h, force)?;
        }
        match impact {
            Some(impact) => self.strike(&impact, &law, force),
            None => Ok(()),
        }
    }

    /// A minimum of the distance within the step, above the wall.
    fn minimum<E, F: DifferentiableForce<E>>(
        &mut self,
        stages: &mut Stages,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        if !(stages.from.xdot < 0.0 && stages.end.xdot > 0.0) {
            return Ok(());
        }
        let [x, xdot] = stages.polynomials(force)?;
        let Some(theta) = xdot.negated().first_negative() else { return Ok(()) };
        self.step.all_stages(stages, force)?;
        let rates: Vec<f64> = (0..self.sizes.len())
            .map(|column| self.step.polynomials(stages, column)[0].at(theta))
            .collect();
        let t = stages.from.t + theta * stages.h;
        self.validity.note(Limit::Minimum, t, x.at(theta), rates);
        Ok(())
    }

    /// A step of flight, shorter ones until the columns are within the tolerances too.
    fn fly_within<E, F: DifferentiableForce<E>>(
        &mut self,
        integrator: &mut SwitchedIntegrator,
        t_end: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<Piece, Failure<E>> {
        std::mem::swap(&mut self.step.from, &mut self.step.end);
        let before = integrator.clone();
        let order = integrator.flight().last_mut().order_of_error();
        let shortest = 16.0 * f64::EPSILON * before.t().abs();
        for retry in 0.. {
            let piece = integrator.proceed(t_end, force)?;
            let Piece::Flight { impact, .. } = piece else {
                // rest follows an impact that stopped the mass
                std::mem::swap(&mut self.step.from, &mut self.step.end);
                return self.other(integrator, piece, force);
            };
            if let Some(impact) = impact.filter(|_| integrator.flight().landing().is_none()) {
                // the last step ended at the wall
                std::mem::swap(&mut self.step.from, &mut self.step.end);
                self.strike(&impact, integrator.law(), force)?;
                return Ok(piece);
            }
            let mut onto = Self::onto(integrator, impact, force)?;
            let h = onto.as_ref().map_or_else(|| integrator.flight().last_mut().h, |it| it.h);
            let error = self.fly(integrator, onto.as_mut(), force)?;
            let factor = factor(error, order);
            if error <= 1.0 || retry == RETRIES || h <= shortest {
                if error > 0.0 {
                    // that an impact comes soon says nothing of the next step
                    let most = if onto.is_some() { f64::INFINITY } else { FACTORS.1 };
                    integrator.flight().steps_mut().limit_next(h * factor.clamp(FACTORS.0, most));
                }
                self.flew(integrator, impact, onto.as_mut(), force)?;
                return Ok(piece);
            }
            integrator.give_up_step(&before, shorter(factor) * h);
        }
        Err(Failure::Status(Status::Internal))
    }
}

/// Whether an impact lies away from the end of the step that was made onto it.
fn far(total: f64, stages: &Stages) -> bool {
    (total - stages.h).abs() > NUDGE * stages.h
}

// The columns at rest: where it begins, what limits it, the lift-off that ends it.
//
// ```text
// rest      X = V = 0
// lift-off  dt = -f_q/f_t at (t, 0, 0),  X = V = 0
// ```

/// Looks at the slope of the force over a part of a rest.
const LOOKS: u32 = 8;

impl VariationalRun {
    /// At rest, where the Zeno time moves by `self.dt`.
    fn came_to_rest<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        through_chain: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.step.end.clear();
        self.events.zeno_times.extend_from_slice(&self.dt);
        self.note_neighbours(t);
        if through_chain {
            let pull = -force.at_wall(t)?;
            let mut rates = vec![0.0; self.dt.len()];
            self.wall_rates(t, &self.dt.clone(), force, &mut rates)?;
            self.validity.note(Limit::Zeno, t, pull, rates);
        }
        self.resting = Some(t);
        Ok(())
    }

    /// At rest by an impact that stops the mass: with `e > 0` it would go on for `2 u/g` more.
    fn stopped<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let pull = -force.at_wall(t)?;
        if pull > 0.0 {
            for (dt, du) in self.dt.iter_mut().zip(&self.du) {
                *dt += 2.0 * du / pull;
            }
        }
        self.came_to_rest(t, false, force)
    }

    /// A part of a rest, and the lift-off at its end.
    fn rest<E, F: DifferentiableForce<E>>(
        &mut self,
        (from, to): (f64, f64),
        lifted: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let since = match self.resting {
            Some(since) => since,
            None => {
                self.stopped(from, force)?;
                from
            }
        };
        if force.dependence_at_rest::<E>() != Dependence::Constant {
            self.maxima_at_rest(from, to, force)?;
        } else if !lifted {
            let pull = -force.at_wall(from)?;
            let mut rates = vec![0.0; self.dt.len()];
            self.wall_rates(from, &vec![0.0; rates.len()], force, &mut rates)?;
            self.validity.note(Limit::Rest, from, pull, rates);
        }
        if lifted {
            // at once where the force jumps to a pull: at a fixed time
            let jumped = from == to && since < to && self.stops.contains(&to);
            if jumped {
                self.dt.fill(0.0);
            }
            self.lift_off(to, to > since && !jumped, force)?;
        }
        Ok(())
    }

    fn lift_off<E, F: DifferentiableForce<E>>(
        &mut self,
        t: f64,
        smoothly: bool,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        self.step.end.clear();
        if smoothly {
            let mut rates = vec![0.0; self.dt.len()];
            let zeros = rates.clone();
            let mut rise = self.wall_rates(t, &zeros, force, &mut rates)?;
            // the run has the time to a few roundings; the derivatives are those at the root
            let off = force.at_wall(t)? / rise;
            if off.abs() <= 64.0 * f64::EPSILON * t.abs() {
                rise = self.wall_rates(t - off, &zeros, force, &mut rates)?;
            }
            for (dt, rate) in self.dt.iter_mut().zip(&rates) {
                *dt = if *rate == 0.0 { 0.0 } else { -rate / rise };
            }
            // a maximum of f_t^2/(2 |f_tt|) above zero: f_tt over the time in which f_t changes
            let ahead = 1e-4 * (self.end - t).min(1.0);
            let mut unused = zeros.clone();
            let later = self.wall_rates(t + ahead, &zeros, force, &mut unused)?;
            let curvature = ((later - rise) / ahead).abs();
            let height = rise * rise / (2.0 * curvature);
            if height.is_finite() {
                self.validity.note(Limit::LiftOff, t, height, rates.iter().copied());
            }
        } else {
            let pull = force.at_wall(t)?;
            for (v, dt) in self.step.end.v.iter_mut().zip(&self.dt) {
                *v = -pull * dt;
            }
        }
        self.note_neighbours(t);
        self.events.liftoff_times.extend_from_slice(&self.dt);
        self.resting = None;
        Ok(())
    }

    /// Where the force at rest is at a maximum below zero: its slope changes from + to -.
    fn maxima_at_rest<E, F: DifferentiableForce<E>>(
        &mut self,
        from: f64,
        to: f64,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Failure<E>> {
        let zeros = vec![0.0; self.dt.len()];
        let mut rates = zeros.clone();
        let (mut before, mut rise) = (from, self.wall_rates(from, &zeros, force, &mut rates)?);
        for look in 1..=LOOKS {
            let at = from + (to - from) * f64::from(look) / f64::from(LOOKS);
            let next = self.wall_rates(at, &zeros, force, &mut rates)?;
            if rise > 0.0 && next <= 0.0 {
                let slope = |t: f64| self.wall_rates(t, &zeros, force, &mut rates);
                let top = crate::numeric::root::between((before, rise), (at, next), slope)?.best;
                let pull = -force.at_wall(top)?;
                self.wall_rates(top, &zeros, force, &mut rates)?;
                self.validity.note(Limit::Rest, top, pull, rates.iter().copied());
            }
            (before, rise) = (at, next);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::switched::sensitivity::Wrt;
    use crate::switched::Order;
    use crate::system::slopes::{Place, Slopes};
    use crate::{ConstantForce, Force, LinearForce, Restitution, Silent};
    use std::convert::Infallible;

    fn run<F: DifferentiableForce<Infallible>>(
        settings: SwitchedRk,
        mut force: F,
        to: f64,
        (x, xdot): (f64, f64),
        (wrt, size): (Wrt, f64),
    ) -> (SwitchedRun<Infallible>, Derivatives) {
        let law = Restitution::from_e(0.5).unwrap();
        let question = Question { wrt: &[wrt], sizes: &[size], controlled: true, times: &[] };
        let (initial, output) = (Physical { x, xdot }, Output::default());
        sensitivity(settings, law, &mut force, (0.0, to), initial, output, &question, &mut Silent)
            .unwrap()
    }

    #[test]
    fn a_mass_that_is_pulled_off_where_it_starts_goes_with_its_start() {
        // x = (t - t0)^2, x' = 2 (t - t0), at t = 1
        let (force, wrt) = (ConstantForce(2.0), (Wrt::T0, 1.0));
        let (_, found) = run(SwitchedRk::default(), force, 1.0, (0.0, 0.0), wrt);
        assert_eq!(found.events.liftoff_times, [1.0]);
        assert!((found.q[0] + 2.0).abs() < 1e-14 && (found.qdot[0] + 2.0).abs() < 1e-14);
    }

    /// `p (t - 1)`, below it by 1 until `t = 1`, above it by 1/2 from then on.
    struct Thrown(f64);

    impl Force<Infallible> for Thrown {
        fn at(&mut self, t: f64, _: f64, _: f64) -> Result<f64, Infallible> {
            Ok(if t < 1.0 { -1.0 } else { 0.5 } + self.0 * (t - 1.0))
        }
    }

    impl DifferentiableForce<Infallible> for Thrown {
        fn parameters(&self) -> usize {
            1
        }

        fn slopes(
            &mut self,
            place: Place,
            _: bool,
            _: &[usize],
            out: &mut [f64],
        ) -> Result<Slopes, Infallible> {
            out.fill(place.t - 1.0);
            Ok(Slopes { t: self.0, x: 0.0, xdot: 0.0 })
        }
    }

    #[test]
    fn a_jump_that_was_not_told_throws_off_at_its_own_time() {
        let (force, wrt) = (Thrown(1.0), (Wrt::Parameter(0), 1.0));
        let (run, found) = run(SwitchedRk::default(), force, 2.0, (0.0, 0.0), wrt);
        assert!((run.trajectory.events.liftoff_times[0] - 1.0).abs() < 1e-14);
        assert!(found.events.liftoff_times[0].abs() < 1e-12);
        // x = (t - 1)^2/4 + p (t - 1)^3/6
        assert!((found.q[0] - 1.0 / 6.0).abs() < 1e-9);
    }

    /// `-x - g`
    fn spring(gravity: f64) -> LinearForce {
        let [damping, amplitude, omega, phase] = [0.0; 4];
        LinearForce { stiffness: 1.0, damping, gravity, amplitude, omega, phase }
    }

    #[test]
    fn columns_do_not_shorten_steps_of_a_fixed_length() {
        let settings = SwitchedRk {
            rtol: 1e-13,
            atol: [1e-16; 2],
            order: Order::Five,
            max_step: 0.5,
            adaptive: false,
            ..SwitchedRk::DEFAULT
        };
        let force = spring(0.0);
        let (run, found) = run(settings, force, 1.0, (1.0, 0.0), (Wrt::Parameter(0), 1.0));
        assert_eq!((run.counts.accepted, run.counts.rejected), (2, 0));
        // x = cos(sqrt(k) t)
        assert!((found.q[0] + 0.5 * 1.0_f64.sin()).abs() < 1e-4);
    }

    #[test]
    fn the_derivative_of_a_zeno_time_is_known_relative_to_itself() {
        let settings = SwitchedRk { rtol: 1e-6, atol: [1e-9; 2], ..SwitchedRk::DEFAULT };
        let of = |size: f64| {
            let force = spring(1.0);
            let (run, found) = run(settings, force, 9.0, (1.0, 0.0), (Wrt::X0, size));
            (run.trajectory.events.impacts.len(), found.events.zeno_times.len())
        };
        // the absolute tolerance, which is divided by the size, is negligible relative to it
        assert_eq!(of(1e4), of(1e10));
    }
}
