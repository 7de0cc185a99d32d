//! The loop of fixed-step schemes, and their common interface.
//!
//! The loop that all fixed-step methods share: step, record, note the events, let others look.

use crate::record::columns::{Reserve, Sample};
use crate::record::events::EventLog;
use crate::record::recorder::{memory, Keep, Recorder};
use crate::record::recorder::{DenseStep, Interpolation, StepEnd};
use crate::record::status::PollInterval;
use crate::record::trajectory::Values;
use crate::record::trajectory::{Run, SetupError, Trajectory};
use crate::system::dynamics::check_initial;
use crate::{Failure, Force, Grid, Monitor, Status};
use std::ops::ControlFlow;
use zivi_core::setting::Setting;
use zivi_core::{transform, Branch, Lifted, Physical, Restitution};

/// Where a step starts.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    /// Time (s).
    pub t: f64,
    /// State.
    pub z: Lifted,
    /// Side of the wall on which the mass was last, `+1` or `-1`.
    pub sigma: f64,
}

/// A method that advances by one step.
pub trait FixedStep<E, F: Force<E>> {
    /// One step from `start`.
    ///
    /// # Errors
    /// Why there is no next state; the run ends at `start`.
    fn advance(&mut self, start: Start, force: &mut F) -> Result<Sample, Failure<E>>;

    /// The next step if it takes neither an evaluation of the force nor a search: the same as
    /// [`FixedStep::advance`] gives. Must be small and call nothing.
    #[inline(always)]
    fn everyday(&self, _: Lifted) -> Option<Sample> {
        None
    }

    /// Relative natural residual of a step from `z` under the force `f` with the multipliers
    /// `lambda`, recomputed from the inclusion (NaN for a method that solves none).
    fn residual(&self, z: Lifted, f: f64, lambda: [f64; 2]) -> f64;

    /// Takes another step size from here on, positive and finite (the last step of a run may be
    /// shorter).
    fn resize(&mut self, h: f64);

    /// Number of force evaluations so far.
    fn nfev(&self) -> u64;

    /// Whether the requested solver failed in the last step, so that another one solved it.
    fn has_failed(&self) -> bool {
        false
    }
}

/// Runs `method` over `grid` from the physical state `initial` (branch `+1`).
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
pub fn run<E, F: Force<E>>(
    method: impl FixedStep<E, F>,
    restitution: Restitution,
    force: &mut F,
    grid: Grid,
    initial: Physical,
    monitor: &mut impl Monitor<E>,
) -> Result<Run<E>, SetupError> {
    let mut walk = FixedStepRun::start(method, restitution, grid, initial, monitor)?;
    let ending = watched(grid.n_steps(), monitor, |until, monitor| {
        walk.go_to::<E, F>(until, force, monitor)
    });
    Ok(walk.finish::<E, F>(ending))
}

/// Continues, monitored, up to `of` steps, and returns the end: `go_to` advances to a total number
/// of steps.
pub(crate) fn watched<E, M: Monitor<E>>(
    of: usize,
    monitor: &mut M,
    mut go_to: impl FnMut(usize, &mut M) -> Result<(), Failure<E>>,
) -> Failure<E> {
    let mut pace = PollInterval::start();
    let mut done = 0;
    loop {
        done = (done + pace.chunk()).min(of);
        if let Err(failure) = go_to(done, monitor) {
            return failure;
        }
        if let Err(stop) = monitor.poll(done, of) {
            return Failure::Raised(stop);
        }
        if done == of {
            return Failure::Status(Status::Completed);
        }
        pace.adjust();
    }
}

/// Tells a step to a monitor that follows.
///
/// # Errors
/// How the run ends, if the monitor ends it.
pub(crate) fn tell<E>(
    monitor: &mut impl Monitor<E>,
    from: StepEnd,
    to: StepEnd,
    interpolation: Interpolation,
) -> Result<(), Failure<E>> {
    let step = DenseStep { from, to, interpolation };
    match monitor.follow(&step).map_err(Failure::Raised)? {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(status) => Err(Failure::Status(status)),
    }
}

/// A run in progress: `k` steps are done, the last of them ended at `t` in `z`.
struct FixedStepRun<M> {
    method: M,
    restitution: Restitution,
    grid: Grid,
    record: Recorder,
    log: EventLog,
    failed_steps: Vec<usize>,
    reserve: Reserve,
    k: usize,
    t: f64,
    z: Lifted,
    sigma: f64,
}

impl<M> FixedStepRun<M> {
    fn start<E>(
        method: M,
        restitution: Restitution,
        grid: Grid,
        initial: Physical,
        monitor: &mut impl Monitor<E>,
    ) -> Result<Self, SetupError> {
        let z = lift(initial, restitution)?;
        let (t, n) = (grid.t(0), grid.n_steps());
        let keep = monitor.keep();
        let (columns, kept) = memory(n, keep, |start, len| monitor.record_allocated(start, len))
            .map_err(|_| SetupError::Memory(n))?;
        let record = Recorder::start(columns, t, z, restitution);
        let incoming = initial.arrives();
        Ok(Self {
            method,
            restitution,
            grid,
            record: match (keep, kept) {
                (Keep::Every(every), Some(kept)) => record.thinned(every, kept),
                _ => record,
            },
            log: EventLog::start(t, z, incoming, restitution),
            failed_steps: Vec::new(),
            reserve: Reserve::default(),
            k: 0,
            t,
            z,
            sigma: transform::side(z, Branch::Positive.sigma()),
        })
    }

    /// Steps until `until` steps are done.
    fn go_to<E, F: Force<E>>(
        &mut self,
        until: usize,
        force: &mut F,
        monitor: &mut impl Monitor<E>,
    ) -> Result<(), Failure<E>>
    where
        M: FixedStep<E, F>,
    {
        let last = self.grid.n_steps() - 1;
        let follows = monitor.follows();
        while self.k < until {
            if !follows {
                self.easy_steps::<E, F>(until.min(last));
            }
            if self.k == until {
                break;
            }
            // the residuals of a block are those of one step size
            if self.record.is_full() || self.k == last {
                self.flush::<E, F>();
            }
            if self.k == last {
                self.method.resize(self.grid.last_h());
            }
            let from = follows.then(|| self.knot());
            self.step(force)?;
            if let Some(from) = from {
                tell(monitor, from, self.knot(), Interpolation::Lifted(self.restitution))?;
            }
        }
        Ok(())
    }

    /// Where the run is.
    fn knot(&self) -> StepEnd {
        StepEnd { t: self.t, state: transform::project(self.z, self.restitution), z: self.z }
    }

    /// The steps without search, while there are no events and the record has room.
    #[inline]
    fn easy_steps<E, F: Force<E>>(&mut self, until: usize)
    where
        M: FixedStep<E, F>,
    {
        // no call in this loop, and no field: the state stays in registers
        let (mut k, mut t, mut z) = (self.k, self.t, self.z);
        let until = until.min(k + self.record.room());
        while k < until {
            match self.method.everyday(z) {
                Some(sample) if uneventful(z, sample.z) => {
                    k += 1;
                    t = self.grid.t(k);
                    self.record.push(t, sample);
                    z = sample.z;
                }
                _ => break,
            }
        }
        (self.k, self.t, self.z) = (k, t, z);
    }

    /// Any one step.
    #[inline]
    fn step<E, F: Force<E>>(&mut self, force: &mut F) -> Result<(), Failure<E>>
    where
        M: FixedStep<E, F>,
    {
        let Self { t, z, sigma, .. } = *self;
        let sample = self.method.advance(Start { t, z, sigma }, force)?;
        let t_next = self.grid.t(self.k + 1);
        if !uneventful(z, sample.z) {
            self.log.step((t, z), (t_next, sample.z))?;
            self.sigma = transform::side(sample.z, sigma);
        }
        if self.method.has_failed() {
            self.reserve.room(&mut self.failed_steps, 1, size_of::<i64>())?;
            self.failed_steps.push(self.k + 1);
        }
        (self.k, self.t, self.z) = (self.k + 1, t_next, sample.z);
        self.record.push(t_next, sample);
        Ok(())
    }

    fn flush<E, F: Force<E>>(&mut self)
    where
        M: FixedStep<E, F>,
    {
        let method = &self.method;
        self.record.flush(|z, f, lambda| method.residual(z, f, lambda));
    }

    fn finish<E, F: Force<E>>(mut self, ending: Failure<E>) -> Run<E>
    where
        M: FixedStep<E, F>,
    {
        self.flush::<E, F>();
        let (status, raised) = match ending {
            Failure::Status(status) => (status, None),
            Failure::Raised(error) => (Status::Raised, Some(error)),
        };
        let (columns, summary) = self.record.finish();
        let trajectory = Trajectory {
            columns,
            summary,
            events: self.log.finish(),
            failed_steps: self.failed_steps,
            status,
            nfev: self.method.nfev(),
        };
        Run { trajectory, raised }
    }
}

/// Nothing happens, and the side is the same, while `s` keeps its sign or the mass rests.
#[inline(always)]
fn uneventful(before: Lifted, after: Lifted) -> bool {
    let rest = Lifted::default();
    before.s * after.s > 0.0 || (before == rest && after == rest)
}

/// The initial state on the branch `+1`.
pub(crate) fn lift(initial: Physical, restitution: Restitution) -> Result<Lifted, SetupError> {
    check_initial(initial)?;
    let z = transform::lift(initial, Branch::Positive, restitution);
    if !z.v.is_finite() {
        let range = "a velocity whose image v = xdot0/(1 - kappa sgn xdot0) is finite";
        return Err(SetupError::Setting("xdot0", initial.xdot, range));
    }
    Ok(z)
}

// Interface of fixed-step schemes: settings, and integration over a grid.

/// A fixed-step scheme: its settings other than the step size.
///
/// One that advances `(s, v)` implements [`FixedStep`] and leaves the
/// loop to [`fixed_step::run`](run). [`FixedSteps`] makes it a
/// [`Method`](crate::method::Method).
pub trait Scheme: Sized {
    /// Its name, as programs and files have it.
    const NAME: &'static str;

    /// Its description in a few words.
    const MEANING: &'static str;

    /// Its settings, the step size first.
    const SETTINGS: &'static [Setting];

    /// Whether a mass may be below the wall at the end of a step.
    const PENETRATES: bool = false;

    /// The scheme with the values of its settings.
    ///
    /// # Errors
    /// [`SetupError`] where one is missing.
    fn of(values: &Values) -> Result<Self, SetupError>;

    /// Rejects settings, a step size or a wall out of range.
    ///
    /// # Errors
    /// [`SetupError`] names what is out of range.
    fn check(&self, h: f64, restitution: Restitution) -> Result<(), SetupError>;

    /// Refuses a state where no run can start: one that has no finite image `(s, v)`.
    ///
    /// # Errors
    /// [`SetupError`] names what is out of range.
    fn check_start(&self, initial: Physical, restitution: Restitution) -> Result<(), SetupError> {
        lift(initial, restitution).map(drop)
    }

    /// Runs over a grid.
    ///
    /// # Errors
    /// [`SetupError`] before anything is computed. Whatever goes wrong later is in the status.
    fn run<E, F: Force<E>>(
        &self,
        restitution: Restitution,
        force: &mut F,
        grid: Grid,
        initial: Physical,
        monitor: &mut impl Monitor<E>,
    ) -> Result<Run<E>, SetupError>;
}

/// A scheme with its step size: all of its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FixedSteps<S> {
    /// Step size (s), positive and finite; the last step of a run may be shorter.
    pub h: f64,
    /// The scheme.
    pub scheme: S,
}

impl<S> FixedSteps<S> {
    /// The steps over a span.
    ///
    /// # Errors
    /// [`SetupError::Grid`] for a span without steps.
    pub fn grid(&self, (t0, t1): (f64, f64)) -> Result<Grid, SetupError> {
        Ok(Grid::new(t0, t1, self.h)?)
    }
}
