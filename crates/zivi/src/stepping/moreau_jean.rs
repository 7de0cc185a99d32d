//! The baseline of nonsmooth mechanics: Moreau-Jean time stepping in `(x, x')`.
//!
//! ```text
//! v+ = v + h f_theta + P        f_theta = theta f(t+, x+, v+) + (1 - theta) f(t, x, v)
//! x+ = x + h (theta v+ + (1 - theta) v)
//! 0 <= P  _|_  v+ + e v >= 0    where x + h v/2 <= 0, else P = 0                      (1)
//! ```
//!
//! The contact is decided at velocity level, where the predicted gap `x + h v/2` is closed; the
//! position is not corrected, so `x` may be negative, by up to about `h |v|`. See J. J. Moreau,
//! *Unilateral contact and dry friction in finite freedom dynamics* (1988), and M. Jean, *The
//! non-smooth contact dynamics method*, Comput. Methods Appl. Mech. Eng. 177 (1999).
//!
//! The record. A step with `P > 0` from `v < 0` is an impact at its end, with the velocities
//! `v` and `v+ = -e v`. Velocities of at most `h |f_theta|` on both sides of a step with `P > 0`
//! are those of a mass that is pressed to the wall: there rest begins, and it ends with a
//! step without `P` on which the mass leaves, faster than `h |f_theta|` or pulled outward. Samples have `s = sigma x`, negative `x` included, on a branch `sigma` that
//! changes at each impact, and `v = sigma x'/(1 - kappa sgn x')`; their multipliers are the signs
//! (0 at rest), their residual is NaN.

use crate::record::columns::{Columns, Reserve};
use crate::record::events::EventReader;
use crate::record::recorder::{Interpolation, StepEnd};
use crate::record::recorder::{Keep, Summary};
use crate::record::status::Failure;
use crate::record::trajectory::Values as ReferencePoint;
use crate::record::trajectory::{Run, SetupError, Trajectory};
use crate::stepping::fixed_step::{tell, watched, Scheme};
use crate::stepping::implicit::{Opening, Shown, SignSearch, DEFAULT_SLOPE};
use crate::system::dynamics::{check_initial, finite_force};
use crate::{Dependence, Events, Force, Grid, Impact, Monitor, Occurrence, Status};
use std::collections::TryReserveError;
use zivi_core::setting::{Setting, Value, Values};
use zivi_core::{sgn, transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

/// Settings of the method; the step size is the grid's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoreauJean {
    /// Weight of the end of the step, in `[0, 1]` (default 1/2).
    pub theta: f64,
}

impl Default for MoreauJean {
    fn default() -> Self {
        Self::MIDPOINT
    }
}

impl MoreauJean {
    /// The default, `theta = 1/2`.
    pub const MIDPOINT: Self = Self { theta: 0.5 };

    /// The weight `theta`.
    pub const THETA: Setting = Setting {
        name: "theta",
        meaning: "weight of the end of the step",
        unit: "1",
        values: Values::UNIT,
        range: "a number from 0 to 1",
        default: Value::Number(Self::MIDPOINT.theta),
    };

    /// The settings, checked for their ranges.
    ///
    /// # Errors
    /// [`SetupError::Setting`] for a weight outside `[0, 1]`.
    pub fn validated(self) -> Result<Self, SetupError> {
        Self::THETA.check(self.theta)?;
        Ok(self)
    }
}

/// Simulates `x'' = f`, `x >= 0`, `x'+ = -e x'-` with Moreau-Jean time stepping.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status:
/// [`Status::ForceNotConverged`] where no force at the end of a step is consistent with the step
/// that it gives.
///
/// ```
/// use zivi::{
///     simulate_moreau_jean, ConstantForce, Grid, MoreauJean, Physical, Restitution, Silent,
/// };
///
/// let (ball, restitution) = (Physical { x: 1.0, xdot: 0.0 }, Restitution::from_e(0.5)?);
/// let grid = Grid::new(0.0, 4.0, 1e-3)?;
/// let run = simulate_moreau_jean(
///     MoreauJean::default(), restitution, &mut ConstantForce(-2.0), grid, ball, &mut Silent,
/// )?;
/// // impacts at 1, 2, 2.5, ... and rest at 3, to first order
/// assert!((run.trajectory.events.impacts[1].t - 2.0).abs() < 3e-3);
/// assert!((run.trajectory.events.rest_time.unwrap() - 3.0).abs() < 3e-2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn simulate_moreau_jean<E, F: Force<E>>(
    method: MoreauJean,
    restitution: Restitution,
    force: &mut F,
    grid: Grid,
    initial: Physical,
    monitor: &mut impl Monitor<E>,
) -> Result<Run<E>, SetupError> {
    method.validated()?.run(restitution, force, grid, initial, monitor)
}

impl Scheme for MoreauJean {
    const NAME: &'static str = "MoreauJean";
    const MEANING: &'static str = "Moreau-Jean time stepping with Newton's law on velocities";
    const SETTINGS: &'static [Setting] = &[ThetaGammaStep::STEP, MoreauJean::THETA];
    const PENETRATES: bool = true;

    fn of(values: &ReferencePoint) -> Result<Self, SetupError> {
        Ok(Self { theta: values.number(&Self::THETA)? })
    }

    fn check(&self, h: f64, _: Restitution) -> Result<(), SetupError> {
        // the range of h is that of the implicit scheme, whatever the wall
        ThetaGammaStep::new(h, 1.0, 1.0, Restitution::ELASTIC)?;
        self.validated().map(drop)
    }

    fn check_start(&self, initial: Physical, _: Restitution) -> Result<(), SetupError> {
        check_initial(initial)
    }

    fn run<E, F: Force<E>>(
        &self,
        restitution: Restitution,
        force: &mut F,
        grid: Grid,
        initial: Physical,
        monitor: &mut impl Monitor<E>,
    ) -> Result<Run<E>, SetupError> {
        walk(*self, restitution, force, (grid, initial), monitor)
    }
}

fn walk<E, F: Force<E>>(
    MoreauJean { theta }: MoreauJean,
    restitution: Restitution,
    force: &mut F,
    (grid, initial): (Grid, Physical),
    monitor: &mut impl Monitor<E>,
) -> Result<Run<E>, SetupError> {
    check_initial(initial)?;
    let thinned = match monitor.keep() {
        Keep::All => None,
        Keep::Every(every) => Some(DecimatedRecord { every, summary: Summary::default() }),
    };
    let every = thinned.as_ref().map_or(1, |it| it.every);
    let room = grid.n_steps().checked_div(every).map_or(1, |it| it + 1);
    let columns = Columns::with_room(room, |start, len| monitor.record_allocated(start, len))
        .map_err(|_| SetupError::Memory(grid.n_steps()))?;
    let mover = Mover::new(theta, restitution.e(), (grid.t(0), initial));
    let (k, state) = (0, initial);
    let mut walk = MoreauWalk { mover, restitution, grid, columns, thinned, k, state };
    walk.record();
    let ending =
        watched(grid.n_steps(), monitor, |until, monitor| walk.go_to(until, force, monitor));
    Ok(walk.finish(ending))
}

/// Steps, and reads off each what happens.
pub(crate) struct Mover {
    pub(crate) scheme: MoreauJeanStepper,
    pub(crate) log: ContactLog,
}

impl Mover {
    pub(crate) fn new(theta: f64, e: f64, (t, initial): (f64, Physical)) -> Self {
        Self {
            scheme: MoreauJeanStepper::new(theta, e),
            log: ContactLog::start(t, initial.is_at_origin()),
        }
    }

    /// The step of size `h` from `start`, between these times.
    #[inline]
    pub(crate) fn step<E>(
        &mut self,
        start: Physical,
        (t, t_end): (f64, f64),
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<Physical, Failure<E>> {
        let step = self.scheme.step(start, (t, t_end), h, force)?;
        if !(step.end.x.is_finite() && step.end.xdot.is_finite()) {
            return Err(Failure::Status(Status::StateNotFinite));
        }
        self.log.step((t, start.xdot), (t_end, step))?;
        Ok(step.end)
    }
}

/// Reads impacts, rest and lift-off off the impulses.
pub(crate) struct ContactLog {
    reader: EventReader,
    sigma: f64,
    pub(crate) at_rest: bool,
    reserve: Reserve,
}

impl ContactLog {
    fn start(t: f64, at_rest: bool) -> Self {
        let (reader, reserve) = (EventReader::starting(t, at_rest), Reserve::default());
        Self { reader, sigma: 1.0, at_rest, reserve }
    }

    pub(crate) fn finish(self) -> Events {
        self.reader.events
    }

    /// An error if memory for the record of events is exhausted.
    #[inline(always)]
    fn step(
        &mut self,
        start: (f64, f64),
        (t_end, step): (f64, MoreauJeanStep),
    ) -> Result<(), TryReserveError> {
        if step.impulse > 0.0 || self.at_rest {
            self.at_wall(start, (t_end, step))
        } else {
            Ok(())
        }
    }

    /// A step that is not of a flight.
    #[inline(never)]
    fn at_wall(
        &mut self,
        (t, before): (f64, f64),
        (t_end, step): (f64, MoreauJeanStep),
    ) -> Result<(), TryReserveError> {
        self.reader.events.make_room(&mut self.reserve)?;
        let pressed = step.impulse > 0.0;
        let after = step.end.xdot;
        let slow = before.abs() <= step.pull.abs() && after.abs() <= step.pull.abs();
        if self.at_rest {
            // a mass that settles may lack an impulse for a step; one that leaves gets faster
            let leaves = after > step.pull.abs() || (step.pull > 0.0 && step.end.x > 0.0);
            if !pressed && leaves {
                self.at_rest = false;
                self.reader.note(Occurrence::lift_off_of_mass(t));
            }
        } else if pressed && slow {
            self.at_rest = true;
            self.reader.note(Occurrence::rest_of_mass(t_end));
        } else if pressed && before < 0.0 {
            self.sigma = -self.sigma;
            let impact = Impact { t: t_end, xdot_before: before, xdot_after: after };
            let number = self.reader.events.impacts.len() as u64 + 1;
            self.reader.note(Occurrence::of_mass(impact, number));
        }
        Ok(())
    }
}

/// Every n-th sample is kept, none for `0`, and a summary of all.
struct DecimatedRecord {
    every: usize,
    summary: Summary,
}

impl DecimatedRecord {
    /// Whether the sample after `k` steps is kept.
    fn keeps(&self, k: usize) -> bool {
        self.every > 0 && k.is_multiple_of(self.every)
    }

    /// Samples after `k` steps and later ones that are not kept.
    fn skipped_after(&self, k: usize) -> usize {
        match self.every {
            0 => usize::MAX,
            every => every - 1 - k % every,
        }
    }
}

/// A run in progress: `k` steps are done, the last of them ended in `state`.
struct MoreauWalk {
    mover: Mover,
    restitution: Restitution,
    grid: Grid,
    columns: Columns,
    thinned: Option<DecimatedRecord>,
    k: usize,
    state: Physical,
}

impl MoreauWalk {
    fn go_to<E>(
        &mut self,
        until: usize,
        force: &mut impl Force<E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<(), Failure<E>> {
        let follows = monitor.follows();
        while self.k < until {
            if !follows {
                self.easy_steps(until);
                if self.k == until {
                    break;
                }
            }
            let last = self.k + 1 == self.grid.n_steps();
            let h = if last { self.grid.last_h() } else { self.grid.h() };
            let (t, t_end) = (self.grid.t(self.k), self.grid.t(self.k + 1));
            let from = follows.then(|| self.knot());
            let end = self.mover.step(self.state, (t, t_end), h, force)?;
            (self.k, self.state) = (self.k + 1, end);
            self.record();
            if let Some(from) = from {
                tell(monitor, from, self.knot(), Interpolation::Physical)?;
            }
        }
        Ok(())
    }

    /// The steps of a flight or of rest under a constant force, while there are no events and no
    /// samples to store: the same arithmetic with the state in registers.
    fn easy_steps(&mut self, until: usize) {
        let (Some(thinned), Some(f)) = (&self.thinned, self.mover.scheme.fixed) else {
            return;
        };
        let end = until.min(self.grid.n_steps() - 1);
        let end = end.min(self.k.saturating_add(thinned.skipped_after(self.k)));
        let (h, mut k, mut state) = (self.grid.h(), self.k, self.state);
        let Summary { mut x_max, mut speed_max, .. } = thinned.summary;
        let at_rest = self.mover.log.at_rest;
        while k < end {
            let step = self.mover.scheme.under(f, state, h);
            let Physical { x, xdot } = step.end;
            if (step.impulse > 0.0) != at_rest || !(x.is_finite() && xdot.is_finite()) {
                break;
            }
            if step.end == state && self.repeats(f, state, h) {
                state = if (end - k).is_multiple_of(2) { state } else { step.end };
                k = end;
                break;
            }
            (k, state) = (k + 1, step.end);
            (x_max, speed_max) = (x_max.max(x.abs()), speed_max.max(xdot.abs()));
        }
        if k > self.k {
            let (t, Physical { x, xdot }) = (self.grid.t(k), state);
            let summary = Summary { t, x, xdot, x_max, speed_max };
            self.thinned = Some(DecimatedRecord { every: thinned.every, summary });
        }
        (self.k, self.state) = (k, state);
    }

    /// Whether two steps lead to the same bits, pressed to the wall: at rest the velocity is a zero
    /// whose sign changes with each step.
    #[inline(never)]
    fn repeats(&self, f: f64, state: Physical, h: f64) -> bool {
        let one = self.mover.scheme.under(f, state, h);
        let two = self.mover.scheme.under(f, one.end, h);
        let bits = |it: Physical| [it.x.to_bits(), it.xdot.to_bits()];
        one.impulse > 0.0 && two.impulse > 0.0 && bits(two.end) == bits(state)
    }

    /// Where the run is.
    fn knot(&self) -> StepEnd {
        let branch = if self.mover.log.sigma > 0.0 { Branch::Positive } else { Branch::Negative };
        let z = transform::lift(self.state, branch, self.restitution);
        // no negative zeros
        let z = Lifted { s: z.s + 0.0, v: z.v + 0.0 };
        StepEnd { t: self.grid.t(self.k), state: self.state, z }
    }

    fn record(&mut self) {
        if let Some(thinned) = &mut self.thinned {
            thinned.summary.note(self.grid.t(self.k), self.state);
            if !thinned.keeps(self.k) {
                return;
            }
        }
        let StepEnd { t, state: Physical { x, xdot }, z } = self.knot();
        let sigma = self.mover.log.sigma;
        let (lambda_s, lambda_v) =
            if self.mover.log.at_rest { (0.0, 0.0) } else { (sigma, sigma * sgn(xdot)) };
        self.columns.push([t, x, xdot, z.s, z.v, lambda_s, lambda_v + 0.0, f64::NAN]);
    }

    fn finish<E>(self, ending: Failure<E>) -> Run<E> {
        let (status, raised) = match ending {
            Failure::Status(status) => (status, None),
            Failure::Raised(error) => (Status::Raised, Some(error)),
        };
        let trajectory = Trajectory {
            columns: self.columns,
            summary: self.thinned.map(|it| it.summary),
            events: self.mover.log.finish(),
            failed_steps: Vec::new(),
            status,
            nfev: self.mover.scheme.nfev,
        };
        Run { trajectory, raised }
    }
}

// One step of Moreau's scheme, and the scalar equation of a force that is evaluated at its end.

/// One step of (1).
#[derive(Clone, Copy, Debug)]
struct MoreauJeanStep {
    end: Physical,
    /// `P`, and the change of velocity that the force alone gives.
    impulse: f64,
    pull: f64,
}

/// The scheme with its state between steps.
pub(crate) struct MoreauJeanStepper {
    theta: f64,
    e: f64,
    /// The force at the start of the step.
    pub(crate) here: Option<f64>,
    /// The value of a force that depends on nothing, once it is known.
    fixed: Option<f64>,
    /// Slope of the mismatch at the last solution.
    pub(crate) slope: f64,
    /// The largest force so far.
    pub(crate) largest: f64,
    pub(crate) nfev: u64,
}

/// The mismatch of the force at the end of a step that is accepted, relative to the force.
pub(crate) const TOLERANCE: f64 = 1e-12;
/// Trial forces in a step.
const TRIALS: usize = 60;
/// From this trial on a mismatch at the rounding of the force is accepted too.
const SLOW: usize = 3;
/// Change of the force within the rounding of the state, relative to the largest so far.
const JUMP: f64 = 1e-6;

impl MoreauJeanStepper {
    fn new(theta: f64, e: f64) -> Self {
        Self { theta, e, here: None, fixed: None, slope: DEFAULT_SLOPE, largest: 0.0, nfev: 0 }
    }

    fn step<E>(
        &mut self,
        start: Physical,
        (t, t_end): (f64, f64),
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<MoreauJeanStep, Failure<E>> {
        if let Some(f) = self.fixed {
            return Ok(self.under(f, start, h));
        }
        let dependence = force.dependence();
        let first = match self.here {
            Some(f) => f,
            None => self.evaluate(force, t, start)?,
        };
        if dependence == Dependence::Constant {
            self.fixed = Some(first);
            return Ok(self.under(first, start, h));
        }
        let theta = self.theta;
        if dependence == Dependence::State && theta > 0.0 {
            return self.implicit(start, first, t_end, h, force);
        }
        let known = if theta > 0.0 { Some(self.evaluate(force, t_end, start)?) } else { None };
        let f = (1.0 - theta) * first + theta * known.unwrap_or(0.0);
        let step = self.under(f, start, h);
        self.here = match known {
            Some(last) => Some(last),
            None => Some(self.evaluate(force, t_end, step.end)?),
        };
        Ok(step)
    }

    /// The step whose force at the end is that of the state at the end: one scalar equation.
    fn implicit<E>(
        &mut self,
        start: Physical,
        first: f64,
        t_end: f64,
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<MoreauJeanStep, Failure<E>> {
        let mut opening = Opening::from(first, self.slope);
        let found = opening.root(|last| -> Result<_, Failure<E>> {
            let (step, value) = self.tried((first, last), start, t_end, h, force)?;
            if !is_consistent(value, last, first) {
                return Ok(Shown::Mismatch(value - last));
            }
            self.here = Some(last);
            Ok(Shown::Root(step))
        });
        match found? {
            Some(step) => Ok(step),
            None => self.follow(opening.search(TRIALS), (start, first), t_end, h, force),
        }
    }

    /// The same where the first two trials are not it.
    #[inline(never)]
    fn follow<E>(
        &mut self,
        mut search: SignSearch,
        (start, first): (Physical, f64),
        t_end: f64,
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<MoreauJeanStep, Failure<E>> {
        while let Some(last) = search.trial() {
            let (step, value) = self.tried((first, last), start, t_end, h, force)?;
            let mismatch = value - last;
            if is_consistent(value, last, first)
                || (search.trials() > SLOW
                    && mismatch.abs() <= self.rounding(step.end, value, t_end, force)?)
            {
                (self.slope, self.here) = (search.slope(), Some(last));
                return Ok(step);
            }
            search.learn(mismatch);
        }
        Err(Failure::Status(Status::ForceNotConverged))
    }

    /// The step under the forces `first` at its start and `last` at its end, and the force there.
    #[inline(always)]
    fn tried<E>(
        &mut self,
        (first, last): (f64, f64),
        start: Physical,
        t_end: f64,
        h: f64,
        force: &mut impl Force<E>,
    ) -> Result<(MoreauJeanStep, f64), Failure<E>> {
        let step = self.under((1.0 - self.theta) * first + self.theta * last, start, h);
        let value = self.evaluate(force, t_end, step.end)?;
        Ok((step, value))
    }

    /// How much the force changes when the state changes by its rounding: no trial can do better.
    #[cold]
    fn rounding<E>(
        &mut self,
        Physical { x, xdot }: Physical,
        value: f64,
        t: f64,
        force: &mut impl Force<E>,
    ) -> Result<f64, Failure<E>> {
        let beside = |z: f64| z * (1.0 + 8.0 * f64::EPSILON);
        let by_x = self.evaluate(force, t, Physical { x: beside(x), xdot })? - value;
        let by_xdot = self.evaluate(force, t, Physical { x, xdot: beside(xdot) })? - value;
        let rounding = by_x.abs() + by_xdot.abs() + 8.0 * f64::EPSILON * value.abs();
        // more than that is no rounding but a jump of the force
        Ok(if rounding <= JUMP * self.largest { rounding } else { 0.0 })
    }

    /// The step under the force `f_theta`.
    #[inline(always)]
    fn under(&self, f: f64, start: Physical, h: f64) -> MoreauJeanStep {
        let Physical { x, xdot: v } = start;
        let free = v + h * f;
        let closed = x + 0.5 * h * v <= 0.0;
        let xdot = if closed { free.max(-self.e * v) } else { free };
        let end = Physical { x: x + h * (self.theta * xdot + (1.0 - self.theta) * v), xdot };
        MoreauJeanStep { end, impulse: xdot - free, pull: h * f }
    }

    fn evaluate<E>(
        &mut self,
        force: &mut impl Force<E>,
        t: f64,
        state: Physical,
    ) -> Result<f64, Failure<E>> {
        self.nfev += 1;
        let f = finite_force(force, t, state)?;
        self.largest = self.largest.max(f.abs());
        Ok(f)
    }
}

/// Whether the trial `last` is the force at the end of the step that it gives.
#[inline(always)]
fn is_consistent(value: f64, last: f64, first: f64) -> bool {
    (value - last).abs() <= TOLERANCE * value.abs().max(first.abs())
}
