//! A whole run: steps, samples, events, dense output.

use zivi_core::{sgn, transform, Branch, Restitution};

use super::integrator::{Counts, Piece, SwitchedIntegrator};
use super::path::{DensePath, PathPoint};
use super::settings::SwitchedRk;
use super::stages::{Counted, Point};
use super::tail::Tail;
use super::watch::{EventHit, UserEvent, Watch};
use crate::fixed_step::Failure;
use crate::monitor::Pace;
use crate::trajectory::{Columns, SetupError, Trajectory};
use crate::{Events, Force, GridError, Impact, Monitor, Physical, Status};

/// What a run shall give, besides its impacts, Zeno points and lift-offs.
pub struct Output<'a, E> {
    /// Times of the samples, increasing and within the span. `None`: a sample at the start, at
    /// the end of each step, at each impact (the state after it, with `x = 0`), Zeno point and
    /// lift-off, and at the end.
    pub t_eval: Option<&'a [f64]>,
    /// Whether to keep the motion as a function of time.
    pub dense: bool,
    /// The user's events.
    pub events: Vec<UserEvent<'a, E>>,
}

impl<E> Default for Output<'_, E> {
    fn default() -> Self {
        Self { t_eval: None, dense: false, events: Vec::new() }
    }
}

/// A run of the switched method.
#[derive(Clone, Debug, PartialEq)]
pub struct SwitchedRun<E> {
    /// Samples, impacts, Zeno points, lift-offs, status.
    pub trajectory: Trajectory,
    /// The error that the force, an event or the monitor raised (the status is
    /// [`Status::Raised`] then).
    pub raised: Option<E>,
    /// The motion as a function of time, if [`Output::dense`] asked for it.
    pub path: Option<DensePath>,
    /// The arcs that jumps to rest skipped, in order.
    pub tails: Vec<Tail>,
    /// For each event of the user what happened, in order.
    pub hits: Vec<Vec<EventHit>>,
    /// How much work was done.
    pub counts: Counts,
}

impl<E> SwitchedRun<E> {
    /// All impacts with a speed of at least `speed` (m/s) after them, those included that a jump
    /// to rest skipped, in order; at most `at_most` of each tail.
    ///
    /// ```
    /// use zivi::{
    ///     simulate_switched_rk, ConstantForce, Output, Physical, Restitution, Silent, SwitchedRk,
    /// };
    ///
    /// let (ball, wall) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
    /// let run = simulate_switched_rk(
    ///     SwitchedRk::default(), wall, &mut ConstantForce(-2.0), (0.0, 4.0), ball,
    ///     Output::default(), &mut Silent,
    /// )?;
    /// assert_eq!(run.trajectory.events.impacts.len(), 3);
    /// // 2 m/s at the first impact, 2^-20 m/s after the 21st
    /// assert_eq!(run.impacts_down_to(0.99 * 0.5f64.powi(20), 1000).len(), 21);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn impacts_down_to(&self, speed: f64, at_most: usize) -> Vec<Impact> {
        let fast = |impact: &Impact| impact.xdot_after >= speed;
        let mut all = Vec::new();
        let mut tails = self.tails.iter().peekable();
        for impact in &self.trajectory.events.impacts {
            while let Some(tail) = tails.next_if(|tail| tail.start() < impact.t) {
                all.extend(tail.impacts_down_to(speed, at_most));
            }
            all.extend(Some(*impact).filter(fast));
        }
        all.extend(tails.flat_map(|tail| tail.impacts_down_to(speed, at_most)));
        all
    }
}

/// Simulates `x'' = f`, `x >= 0`, `x'+ = -e x'-` with the switched Runge-Kutta method.
///
/// Samples have `s = sigma x` and `v = sigma x'/(1 - kappa sgn x')` on the branch `sigma` that
/// changes at each impact; their multipliers are the signs, at rest 0, and their residual is NaN:
/// no inclusion is solved. On a plastic wall (`e = 0`) `v` is infinite while the mass moves off.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
///
/// ```
/// use zivi::{
///     simulate_switched_rk, LinearForce, Output, Physical, Restitution, Silent, Status,
///     SwitchedRk,
/// };
///
/// // a mass on a table that vibrates with 1.5 g
/// let mut force = LinearForce {
///     stiffness: 0.0, damping: 0.0, gravity: 9.81,
///     amplitude: 14.715, omega: 6.283185307179586, phase: -1.5707963267948966,
/// };
/// let (start, wall) = (Physical { x: 0.2, xdot: 0.0 }, Restitution::from_e(0.5)?);
/// let run = simulate_switched_rk(
///     SwitchedRk::with_tol(1e-9), wall, &mut force, (0.0, 2.0), start, Output::default(),
///     &mut Silent,
/// )?;
/// assert_eq!(run.trajectory.status, Status::Completed);
/// let events = &run.trajectory.events;
/// assert!((events.zeno_times[0] - 0.8286081107).abs() < 1e-8);
/// assert!((events.liftoff_times[0] - 1.1161397636).abs() < 1e-8);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn simulate_switched_rk<E, F: Force<E>>(
    settings: SwitchedRk,
    wall: Restitution,
    force: &mut F,
    (t0, t1): (f64, f64),
    initial: Physical,
    mut output: Output<'_, E>,
    monitor: &mut impl Monitor<E>,
) -> Result<SwitchedRun<E>, SetupError> {
    check_span(t0, t1, output.t_eval)?;
    let mut integrator = SwitchedIntegrator::new(settings, wall)?;
    integrator.start(t0, initial)?;
    let (t_eval, dense) = (output.t_eval, output.dense);
    let mut run = Running {
        t1,
        integrator,
        watch: Watch::new(&mut output.events),
        samples: Samples { t_eval, next: 0, rows: Vec::new() },
        path: dense.then(DensePath::default),
        events: Events::default(),
        tails: Vec::new(),
        airborne: None,
        end: (t0, PathPoint { x: 0.0, xdot: 0.0, sigma: 1.0 }),
    };
    let mut force = Counted::new(force);
    let ending = run.go(&mut force, monitor);
    let nfev = force.count();
    run.finish(ending, nfev, |start, len| monitor.record_allocated(start, len))
}

fn check_span(t0: f64, t1: f64, t_eval: Option<&[f64]>) -> Result<(), SetupError> {
    if !(t0.is_finite() && t1.is_finite() && (t1 - t0).is_finite()) {
        return Err(GridError::SpanNotFinite(t0, t1).into());
    }
    if t1 <= t0 {
        return Err(GridError::SpanEmpty(t0, t1).into());
    }
    let mut last = f64::NEG_INFINITY;
    for &t in t_eval.unwrap_or_default() {
        if !(t > last && t >= t0 && t <= t1) {
            return Err(SetupError::Setting("t_eval", t, "increasing times within t_span"));
        }
        last = t;
    }
    Ok(())
}

/// Rows of `t`, `x`, `x'`, `sigma`.
struct Samples<'a> {
    t_eval: Option<&'a [f64]>,
    /// The next of the wanted times.
    next: usize,
    rows: Vec<[f64; 4]>,
}

impl Samples<'_> {
    /// Whether there is something to sample before `t`.
    fn wants_before(&self, t: f64) -> bool {
        self.t_eval.is_some_and(|times| times.get(self.next).is_some_and(|&next| next < t))
    }

    /// Samples the motion at the wanted times before `t`.
    fn along(&mut self, t: f64, motion: impl Fn(f64) -> PathPoint) {
        while self.wants_before(t) {
            let at = self.t_eval.unwrap_or_default()[self.next];
            self.push(at, motion(at));
            self.next += 1;
        }
    }

    /// A sample at the end of a step, unless the times are given.
    fn at_step(&mut self, t: f64, point: PathPoint) {
        if self.t_eval.is_none() {
            self.push(t, point);
        }
    }

    /// A sample where the run ends, if it is wanted and not there yet.
    fn at_end(&mut self, t: f64, point: PathPoint) {
        let wanted = match self.t_eval {
            Some(times) => times.get(self.next) == Some(&t),
            None => self.rows.last().is_none_or(|row| row[0] < t),
        };
        if wanted {
            self.push(t, point);
        }
    }

    fn push(&mut self, t: f64, point: PathPoint) {
        self.rows.push([t, point.x, point.xdot, point.sigma]);
    }
}

/// Why a run ends.
enum Ending<E> {
    Failed(Failure<E>),
    /// An event of the user ends it.
    Event(EventHit),
}

impl<E> From<Failure<E>> for Ending<E> {
    fn from(failure: Failure<E>) -> Self {
        Ending::Failed(failure)
    }
}

/// An event that ends the run is passed on like an error.
fn unless_terminal<E>(found: Result<Option<EventHit>, E>) -> Result<(), Ending<E>> {
    match found {
        Ok(None) => Ok(()),
        Ok(Some(hit)) => Err(Ending::Event(hit)),
        Err(error) => Err(Ending::Failed(Failure::Raised(error))),
    }
}

/// A run under way.
struct Running<'e, 'a, E> {
    t1: f64,
    integrator: SwitchedIntegrator,
    watch: Watch<'e, 'a, E>,
    samples: Samples<'a>,
    path: Option<DensePath>,
    events: Events,
    tails: Vec<Tail>,
    /// Impacts when the mass was last at rest, if it is not at rest now.
    airborne: Option<usize>,
    /// What is recorded goes up to here.
    end: (f64, PathPoint),
}

/// Progress is told in parts of the span.
const PARTS: usize = 1_000_000;

/// Arcs of a tail that events look at one by one.
const ARCS: usize = 32;

impl<E> Running<'_, '_, E> {
    fn go<F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
        monitor: &mut impl Monitor<E>,
    ) -> Ending<E> {
        match self.try_go(force, monitor) {
            Ok(()) => Ending::Failed(Failure::Status(Status::Completed)),
            Err(ending) => ending,
        }
    }

    fn try_go<F: Force<E>>(
        &mut self,
        force: &mut Counted<'_, F>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<(), Ending<E>> {
        self.begin()?;
        let mut pace = Pace::start();
        let t0 = self.integrator.now.t;
        loop {
            for _ in 0..pace.chunk() {
                if self.integrator.now.t >= self.t1 {
                    break;
                }
                let piece = self.integrator.step(self.t1, force)?;
                self.absorb(piece, force)?;
            }
            let t = self.integrator.now.t;
            let done = ((t - t0) / (self.t1 - t0) * PARTS as f64) as usize;
            monitor.poll(done, PARTS).map_err(Failure::Raised)?;
            if t >= self.t1 {
                return Ok(());
            }
            pace.adjust();
        }
    }

    /// The initial state; a mass that arrives at the wall has its impact first.
    fn begin(&mut self) -> Result<(), Ending<E>> {
        let Point { t, x, xdot } = self.integrator.now;
        if self.integrator.is_at_rest() {
            self.events.rest_time = Some(t);
        } else {
            self.airborne = Some(0);
        }
        self.end = (t, PathPoint { x, xdot, sigma: self.integrator.sigma });
        self.watch.start(t, self.end.1).map_err(Failure::Raised)?;
        if x == 0.0 && xdot < 0.0 {
            let piece = self.integrator.strike(self.integrator.now, t, xdot);
            if let Piece::Flight { impact: Some(impact), .. } = piece {
                self.events.impacts.push(impact);
            }
            self.end = self.here();
            self.jumped()?;
        }
        self.samples.at_step(t, self.end.1);
        Ok(())
    }

    /// The state of the integrator.
    fn here(&self) -> (f64, PathPoint) {
        let (Point { t, x, xdot }, sigma) = (self.integrator.now, self.integrator.sigma);
        (t, PathPoint { x, xdot, sigma })
    }

    fn absorb<F: Force<E>>(
        &mut self,
        piece: Piece,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Ending<E>> {
        match piece {
            Piece::Flight { from, sigma, impact } => self.flight(from, sigma, impact, force),
            Piece::Tail(tail) => self.tail(tail),
            Piece::Rest { from, lifted } => self.rest(from, lifted),
        }
    }

    fn flight<F: Force<E>>(
        &mut self,
        from: Point,
        sigma: f64,
        impact: Option<Impact>,
        force: &mut Counted<'_, F>,
    ) -> Result<(), Ending<E>> {
        let end = self.here();
        let wanted =
            self.path.is_some() || !self.watch.is_idle() || self.samples.wants_before(end.0);
        if wanted && end.0 > from.t {
            let curve = self.integrator.curve(sigma, force)?;
            if let Some(path) = &mut self.path {
                path.push_flight(&curve);
            }
            let stop = self.watch.along(from.t, end.0, |t| curve.at(t));
            let until = until(&stop, end.0);
            self.samples.along(until, |t| curve.at(t));
            unless_terminal(stop)?;
        }
        self.end = end;
        if let Some(impact) = impact {
            self.events.impacts.push(impact);
            self.samples.at_step(end.0, end.1);
            return self.jumped();
        }
        self.samples.at_step(end.0, end.1);
        Ok(())
    }

    /// Events by the jump of the velocity.
    fn jumped(&mut self) -> Result<(), Ending<E>> {
        unless_terminal(self.watch.across(self.end.0, self.end.1))
    }

    fn tail(&mut self, mut tail: Tail) -> Result<(), Ending<E>> {
        let end = self.here();
        let stop = self.watch_tail(&tail, end);
        let until = until(&stop, end.0);
        self.samples.along(until, |t| tail.at(t));
        tail.cut(until);
        if let Some(path) = &mut self.path {
            path.push_tail(&tail);
        }
        self.tails.push(tail);
        unless_terminal(stop)?;
        self.end = end;
        self.samples.at_step(end.0, end.1);
        self.came_to_rest(end.0);
        Ok(())
    }

    fn watch_tail(&mut self, tail: &Tail, end: (f64, PathPoint)) -> Result<Option<EventHit>, E> {
        if self.watch.is_idle() {
            return Ok(None);
        }
        let mut t = tail.start();
        for m in 0..ARCS {
            let Some(arc) = tail.arc(m) else { break };
            if let Some(stop) = self.watch.along(arc.start, arc.end, |t| arc.at(t))? {
                return Ok(Some(stop));
            }
            t = arc.end;
            let after = tail.arc(m + 1).map_or(end.1, |next| next.at(t));
            if let Some(stop) = self.watch.across(t, after)? {
                return Ok(Some(stop));
            }
        }
        self.watch.along(t, end.0, |_| end.1)
    }

    fn rest(&mut self, from: f64, lifted: bool) -> Result<(), Ending<E>> {
        let end = self.here();
        if self.airborne.is_some() {
            self.came_to_rest(from);
        }
        if end.0 > from {
            if let Some(path) = &mut self.path {
                path.push_rest(from, end.1.sigma);
            }
            let stop = self.watch.along(from, end.0, |_| end.1);
            let until = until(&stop, end.0);
            self.samples.along(until, |_| end.1);
            unless_terminal(stop)?;
        }
        self.end = end;
        if lifted {
            self.events.rest_time = None;
            self.events.liftoff_times.push(end.0);
            self.airborne = Some(self.events.impacts.len());
            if end.0 > from {
                self.samples.at_step(end.0, end.1);
            }
        }
        Ok(())
    }

    fn came_to_rest(&mut self, t: f64) {
        if self.airborne.take().is_some_and(|impacts| self.events.impacts.len() > impacts) {
            self.events.zeno_times.push(t);
        }
        self.events.rest_time = Some(t);
    }

    fn finish(
        mut self,
        ending: Ending<E>,
        nfev: u64,
        advise: impl FnOnce(*const f64, usize),
    ) -> Result<SwitchedRun<E>, SetupError> {
        let (status, raised) = match ending {
            Ending::Failed(Failure::Status(status)) => (status, None),
            Ending::Failed(Failure::Raised(error)) => (Status::Raised, Some(error)),
            Ending::Event(EventHit { t, x, xdot, sigma }) => {
                self.end = (t, PathPoint { x, xdot, sigma });
                (Status::TerminatedByEvent, None)
            }
        };
        let (t, end) = self.end;
        self.samples.at_end(t, end);
        if let Some(path) = &mut self.path {
            path.finish(t, end);
        }
        let columns = columns(&self.samples.rows, self.integrator.wall, advise)?;
        let events = self.events;
        let trajectory =
            Trajectory { columns, summary: None, events, failed_steps: Vec::new(), status, nfev };
        let counts = Counts { nfev, ..self.integrator.counts };
        let (path, tails, hits) = (self.path, self.tails, self.watch.into_hits());
        Ok(SwitchedRun { trajectory, raised, path, tails, hits, counts })
    }
}

/// The end of a part of the motion, or where an event ends the run before.
fn until<E>(stop: &Result<Option<EventHit>, E>, end: f64) -> f64 {
    match stop {
        Ok(Some(hit)) => hit.t,
        _ => end,
    }
}

fn columns(
    rows: &[[f64; 4]],
    wall: Restitution,
    advise: impl FnOnce(*const f64, usize),
) -> Result<Columns, SetupError> {
    let mut columns = Columns::with_room(rows.len().max(1), advise)
        .map_err(|_| SetupError::Memory(rows.len()))?;
    let mut to = columns.extend(rows.len());
    for (k, &[t, x, xdot, sigma]) in rows.iter().enumerate() {
        let branch = if sigma > 0.0 { Branch::Positive } else { Branch::Negative };
        let z = transform::lift(Physical { x, xdot }, branch, wall);
        let at_rest = x == 0.0 && xdot == 0.0;
        let lambda_s = if at_rest { 0.0 } else { sigma };
        // no negative zeros
        let (s, v) = (z.s + 0.0, z.v + 0.0);
        let row = [t, x, xdot, s, v, lambda_s, sigma * sgn(xdot) + 0.0, f64::NAN];
        for (to, value) in to.iter_mut().zip(row) {
            to[k] = value;
        }
    }
    Ok(columns)
}
