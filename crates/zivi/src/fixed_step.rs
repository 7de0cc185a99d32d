//! The loop that all fixed-step methods share: step, record, note the events, let others look.

use zivi_core::{transform, Branch, Lifted, Physical, Restitution, StepFailure};

use crate::events::EventLog;
use crate::monitor::Pace;
use crate::recorder::Recorder;
use crate::trajectory::{Columns, Run, Sample, SetupError, Trajectory};
use crate::{Force, Grid, Monitor, Status};

/// Where a step starts.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    /// Time (s).
    pub t: f64,
    /// State.
    pub z: Lifted,
    /// Side of the wall on which the mass was last, `+1` or `-1`.
    pub side: f64,
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

    /// Takes another step size from here on (the last step of a run may be shorter).
    ///
    /// # Errors
    /// When the step size is refused.
    fn resize(&mut self, h: f64) -> Result<(), SetupError>;

    /// Number of force evaluations so far.
    fn nfev(&self) -> u64;

    /// Whether the solver that was asked for failed in the last step, which another then took.
    fn has_failed(&self) -> bool {
        false
    }
}

/// Why a step failed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Failure<E> {
    /// For a reason that has a status.
    Status(Status),
    /// The force raised an error.
    Raised(E),
}

impl<E> From<StepFailure> for Failure<E> {
    fn from(failure: StepFailure) -> Self {
        Failure::Status(match failure {
            StepFailure::NotFinite => Status::StateNotFinite,
            StepFailure::NoSolution => Status::StepNotSolved,
        })
    }
}

/// Evaluates the force, turning NaN and infinity into a failure.
#[inline]
pub(crate) fn finite_force<E>(
    force: &mut impl Force<E>,
    t: f64,
    state: Physical,
) -> Result<f64, Failure<E>> {
    let value = force.at(t, state.x, state.xdot).map_err(Failure::Raised)?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Failure::Status(Status::ForceNotFinite))
    }
}

/// Runs `method` over `grid` from the physical state `initial` (branch `+1`).
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
pub fn run<E, F: Force<E>>(
    mut method: impl FixedStep<E, F>,
    wall: Restitution,
    force: &mut F,
    grid: Grid,
    initial: Physical,
    monitor: &mut impl Monitor<E>,
) -> Result<Run<E>, SetupError> {
    check_state(initial)?;
    let n = grid.n_steps();
    let mut z = transform::lift(initial, Branch::Positive, wall);
    if !z.v.is_finite() {
        let range = "a velocity whose image v = xdot0/(1 - kappa sgn xdot0) is finite";
        return Err(SetupError::Setting("xdot0", initial.xdot, range));
    }
    let incoming = initial.x == 0.0 && initial.xdot < 0.0;
    let mut log = EventLog::start(grid.t(0), z, incoming, wall);
    let columns = Columns::with_room(n + 1, |start, len| monitor.record_allocated(start, len))
        .map_err(|_| SetupError::Memory(n))?;
    let mut record = Recorder::start(columns, grid.t(0), z, wall);

    let mut side = transform::side(z, Branch::Positive.sigma());
    let mut failed_steps = Vec::new();
    let mut pace = Pace::start();
    let (mut k, mut t) = (0, grid.t(0));
    let ending = 'run: loop {
        let until = (k + pace.chunk()).min(n);
        while k < until {
            // no call in this loop: the state stays in registers
            let easy = until.min(n - 1).min(k + record.room());
            while k < easy {
                match method.everyday(z) {
                    Some(sample) if uneventful(z, sample.z) => {
                        k += 1;
                        t = grid.t(k);
                        record.push(t, sample);
                        z = sample.z;
                    }
                    _ => break,
                }
            }
            if k == until {
                break;
            }
            // the residuals of a block are those of one step size
            if record.is_full() || k + 1 == n {
                record.flush(|z, f, lambda| method.residual(z, f, lambda));
            }
            if k + 1 == n {
                method.resize(grid.last_h())?;
            }
            let sample = match method.advance(Start { t, z, side }, force) {
                Ok(sample) => sample,
                Err(failure) => break 'run failure,
            };
            k += 1;
            if method.has_failed() {
                failed_steps.push(k);
            }
            let t_next = grid.t(k);
            record.push(t_next, sample);
            if !uneventful(z, sample.z) {
                log.step((t, z), (t_next, sample.z));
                side = transform::side(sample.z, side);
            }
            (t, z) = (t_next, sample.z);
        }
        if let Err(stop) = monitor.poll(k, n) {
            break Failure::Raised(stop);
        }
        if k == n {
            break Failure::Status(Status::Completed);
        }
        pace.adjust();
    };
    record.flush(|z, f, lambda| method.residual(z, f, lambda));
    let (status, raised) = match ending {
        Failure::Status(status) => (status, None),
        Failure::Raised(error) => (Status::Raised, Some(error)),
    };
    let (columns, events) = (record.into_columns(), log.finish());
    let trajectory = Trajectory { columns, events, failed_steps, status, nfev: method.nfev() };
    Ok(Run { trajectory, raised })
}

/// Nothing happens, and the side is the same, while `s` keeps its sign or the mass rests.
#[inline(always)]
fn uneventful(before: Lifted, after: Lifted) -> bool {
    let rest = Lifted::default();
    before.s * after.s > 0.0 || (before == rest && after == rest)
}

fn check_state(initial: Physical) -> Result<(), SetupError> {
    if !(initial.x >= 0.0 && initial.x.is_finite()) {
        return Err(SetupError::Setting("x0", initial.x, "a finite distance >= 0 from the wall"));
    }
    if !initial.xdot.is_finite() {
        return Err(SetupError::Setting("xdot0", initial.xdot, "a finite velocity"));
    }
    Ok(())
}
