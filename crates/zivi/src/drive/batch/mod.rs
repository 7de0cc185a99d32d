//! Many runs at once, on all cores: parameters and initial states side by side.
//!
//! Each run is independent of all others, so the results do not depend on the number of threads.
//! Memory is what [`Save`] keeps, and a record of one run for each thread while it is computed.
//! A run that a fault ends ([`crate::Status::Internal`]) or for which no memory is left
//! ([`crate::Status::OutOfMemory`]) costs no other its result.

mod lanes;
mod loops;
mod outcome;
mod pool;
mod returns;

use zivi_core::{Physical, Restitution, ThetaGammaStep};

pub use loops::{simulate_closed_loop_batch, LoopMember, LoopOutcome, LoopSettings};
pub use outcome::{Outcome, Saved};
pub use pool::available_threads;
pub use returns::{map_impacts, orbits, Mapped};

use crate::stepping::fixed_step::{check_initial, lift};
use crate::switched::check_span;
use crate::switched::grazing::simulate_watching;
use crate::{
    simulate_explicit_euler, simulate_moreau_jean, simulate_switched_rk, simulate_theta_gamma,
    Dependence, Force, Grid, Keep, Monitor, MoreauJean, Output, Run, SetupError, Solver, Summary,
    SwitchedRk, ThetaGamma, Trajectory, QUANTITIES,
};

/// What is saved of each run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Save<'a> {
    /// The last state, counts of events, rest time.
    #[default]
    Final,
    /// The same, and the largest position and speed of all samples.
    Statistics,
    /// The same as [`Save::Final`], and every event.
    Events,
    /// The same as [`Save::Final`], and whether the run passed a grazing that its tolerances
    /// decided (the switched method only).
    Grazing,
    /// The same as [`Save::Final`], and the first and every so many samples after it (at least 1).
    Every(usize),
    /// The same as [`Save::Final`], and the states at these times, increasing and within the span
    /// (the switched method only).
    At(&'a [f64]),
    /// The same as [`Save::Final`], and the samples of these steps, increasing numbers, with `s`
    /// and `v` (methods of fixed steps only).
    Steps(&'a [usize]),
}

impl Save<'_> {
    /// Samples from one that is saved to the next, 0 if none is.
    fn every(self) -> usize {
        match self {
            Save::Every(every) => every,
            _ => 0,
        }
    }
}

/// A method with the span of the runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Course {
    /// The theta-gamma scheme.
    ThetaGamma(ThetaGamma, Grid),
    /// Explicit signs.
    ExplicitEuler(Grid),
    /// Moreau-Jean time stepping.
    MoreauJean(MoreauJean, Grid),
    /// The switched Runge-Kutta method over a span; it saves no regular samples.
    SwitchedRk(SwitchedRk, (f64, f64)),
}

impl Course {
    /// The steps of a method of fixed steps.
    fn grid(self) -> Option<Grid> {
        match self {
            Course::ThetaGamma(_, grid)
            | Course::ExplicitEuler(grid)
            | Course::MoreauJean(_, grid) => Some(grid),
            Course::SwitchedRk(..) => None,
        }
    }

    /// Where the runs start (s).
    fn start(self) -> f64 {
        match self {
            Course::SwitchedRk(_, (t0, _)) => t0,
            _ => self.grid().map_or(f64::NAN, |grid| grid.t(0)),
        }
    }
}

/// One run of a batch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Member<F> {
    /// The wall.
    pub wall: Restitution,
    /// The force.
    pub force: F,
    /// The initial state.
    pub initial: Physical,
}

/// The batch is to end: what a force of a batch may raise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped;

/// Why a batch gave nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum BatchError<E> {
    /// The member of this number, or what is the same for all, is out of range.
    Setup(Option<usize>, SetupError),
    /// The monitor wants to stop.
    Raised(E),
}

/// Runs every member, on `threads` threads (at least 1).
///
/// # Errors
/// [`BatchError`]: a member cannot start (the first one is named), before anything is computed;
/// or the monitor wants to stop.
///
/// ```
/// use zivi::drive::batch::{simulate_batch, Course, Member, Save};
/// use zivi::{ConstantForce, Grid, Physical, Restitution, Silent, ThetaGamma};
///
/// let wall = Restitution::from_kappa(0.41)?;
/// let ball = |x| Member { wall, force: ConstantForce(-9.81), initial: Physical { x, xdot: 6.0 } };
/// let balls: Vec<_> = (0..100).map(|i| ball(0.01 * f64::from(i))).collect();
/// let course = Course::ThetaGamma(ThetaGamma::implicit_euler(), Grid::new(0.0, 4.0, 1e-3)?);
/// let ends = simulate_batch(&balls, course, Save::Final, 2, &mut Silent).unwrap();
/// assert!(ends.iter().all(|end| end.summary.x == 0.0 && end.rest_time < 3.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn simulate_batch<E, F: Force<Stopped> + Copy + Send + Sync>(
    members: &[Member<F>],
    course: Course,
    save: Save<'_>,
    threads: usize,
    monitor: &mut impl Monitor<E>,
) -> Result<Vec<Outcome>, BatchError<E>> {
    check_save(course, save).map_err(|error| BatchError::Setup(None, error))?;
    for (i, member) in members.iter().enumerate() {
        check(member, course).map_err(|error| BatchError::Setup(Some(i), error))?;
    }
    check_memory(members, course, save, threads)?;
    let work = pool::Work {
        width: lanes::WIDTH,
        chunk: |chunk: &[Member<F>], stop: &dyn Fn() -> bool| several(chunk, course, save, stop),
        lost: |member: &Member<F>, status| {
            Outcome::lost(course.start(), member.initial, status, save)
        },
    };
    pool::run(members, threads, monitor, work)
}

/// Refuses what is not saved of a method.
fn check_save(course: Course, save: Save<'_>) -> Result<(), SetupError> {
    match (course, save) {
        (Course::SwitchedRk(..), Save::Every(_) | Save::Steps(_)) => {
            Err(SetupError::Setting("save", f64::NAN, "for a method of fixed steps"))
        }
        (Course::SwitchedRk(_, (t0, t1)), Save::At(times)) => check_span(t0, t1, Some(times)),
        (Course::SwitchedRk(..), Save::Grazing) => Ok(()),
        (_, Save::At(_) | Save::Grazing) => {
            Err(SetupError::Setting("save", f64::NAN, "for the switched method"))
        }
        _ => Ok(()),
    }
}

/// Refuses a batch whose results would not fit into memory.
fn check_memory<E, F: Force<Stopped>>(
    members: &[Member<F>],
    course: Course,
    save: Save<'_>,
    threads: usize,
) -> Result<(), BatchError<E>> {
    let samples = match save {
        Save::At(times) => times.len(),
        // s and v take as much as x and x'
        Save::Steps(steps) => 2 * steps.len(),
        _ => course.grid().map_or(0, |grid| outcome::samples(save.every(), grid)),
    };
    let whole = course.grid().map_or(samples, |grid| outcome::samples(1, grid));
    let recorded = match (course, save) {
        (_, Save::Steps(_)) | (Course::MoreauJean(..), _) => whole,
        _ if members.iter().all(|member| side_by_side(member, course)) => 0,
        _ => samples,
    };
    let record = recorded.saturating_mul(QUANTITIES * size_of::<f64>());
    let of_run = size_of::<Outcome>().saturating_add(samples.saturating_mul(SAMPLE));
    Need { runs: members.len(), samples, of_run, record }.check(recorded, threads)
}

/// Bytes of a saved sample.
const SAMPLE: usize = 2 * size_of::<f64>();

/// What a batch takes of memory.
struct Need {
    runs: usize,
    /// Samples that are kept of each run.
    samples: usize,
    /// Bytes that are kept of each run; arrays of the same size are made of them.
    of_run: usize,
    /// Bytes of a run while it is computed.
    record: usize,
}

impl Need {
    /// Refuses what does not fit; a run records so many samples while it is computed.
    fn check<E>(self, recorded: usize, threads: usize) -> Result<(), BatchError<E>> {
        // a product beyond all numbers does not fit either
        let records = self.record.saturating_mul(threads.min(self.runs));
        let kept = self.of_run.saturating_mul(self.runs).saturating_mul(2);
        let fits = |bytes| Vec::<u8>::new().try_reserve_exact(bytes).is_ok();
        let refused = if !fits(records) {
            SetupError::Memory(recorded)
        } else if !fits(records.saturating_add(kept)) {
            let Self { runs, samples, .. } = self;
            SetupError::BatchMemory { runs, samples, bytes: kept as f64 }
        } else {
            return Ok(());
        };
        Err(BatchError::Setup(None, refused))
    }
}

/// Whether a member can be moved side by side with others.
fn side_by_side<F: Force<Stopped>>(member: &Member<F>, course: Course) -> bool {
    matches!(course, Course::ThetaGamma(ThetaGamma { solver: Solver::Exact, .. }, _))
        && member.force.dependence() == Dependence::Constant
}

/// Whether a member can start.
fn check<F>(member: &Member<F>, course: Course) -> Result<(), SetupError> {
    let Member { wall, initial, .. } = *member;
    match course {
        Course::ThetaGamma(ThetaGamma { theta, gamma, .. }, grid) => {
            ThetaGammaStep::new(grid.h(), theta, gamma, wall)?;
            lift(initial, wall).map(drop)
        }
        Course::ExplicitEuler(grid) => {
            ThetaGammaStep::new(grid.h(), 1.0, 1.0, wall)?;
            lift(initial, wall).map(drop)
        }
        Course::MoreauJean(method, _) => method.validated().and(check_initial(initial)),
        Course::SwitchedRk(method, _) => method.validated().and(check_initial(initial)),
    }
}

/// The runs of a chunk.
fn several<F: Force<Stopped> + Copy>(
    chunk: &[Member<F>],
    course: Course,
    save: Save<'_>,
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Outcome>, SetupError> {
    if let Course::ThetaGamma(ThetaGamma { theta, gamma, .. }, grid) = course {
        let several = !matches!(save, Save::Steps(_));
        if several && chunk.iter().all(|it| side_by_side(it, course)) {
            let mut masses = Vec::with_capacity(chunk.len());
            for &Member { wall, mut force, initial } in chunk {
                let step = ThetaGammaStep::new(grid.h(), theta, gamma, wall)?;
                // a constant has nothing to raise
                let force = force.at(grid.t(0), 0.0, 0.0).unwrap_or(f64::NAN);
                masses.push(lanes::Falling { step, force, initial });
            }
            return lanes::run(&masses, grid, save, stop);
        }
    }
    chunk.iter().map(|member| one(member, course, save, stop)).collect()
}

/// Looks whether to stop, and keeps what is to be saved.
struct Quiet<'a> {
    keep: Keep,
    stop: &'a dyn Fn() -> bool,
}

impl Monitor<Stopped> for Quiet<'_> {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), Stopped> {
        if (self.stop)() {
            Err(Stopped)
        } else {
            Ok(())
        }
    }

    fn keep(&self) -> Keep {
        self.keep
    }
}

/// One run by the loop of its method.
fn one<F: Force<Stopped> + Copy>(
    member: &Member<F>,
    course: Course,
    save: Save<'_>,
    stop: &dyn Fn() -> bool,
) -> Result<Outcome, SetupError> {
    let Member { wall, mut force, initial } = *member;
    let every = save.every();
    let keep = if let Save::Steps(_) = save { Keep::All } else { Keep::Every(every) };
    let watch = &mut Quiet { keep, stop };
    // the end of a run that is not sampled there
    let mut end = None;
    let mut grazing = false;
    let Run { trajectory, .. } = match course {
        Course::ThetaGamma(method, grid) => {
            simulate_theta_gamma(method, wall, &mut force, grid, initial, watch)?
        }
        Course::ExplicitEuler(grid) => {
            simulate_explicit_euler(wall, &mut force, grid, initial, watch)?
        }
        Course::MoreauJean(method, grid) => {
            simulate_moreau_jean(method, wall, &mut force, grid, initial, watch)?
        }
        Course::SwitchedRk(method, span) if save == Save::Grazing => {
            let (run, grazes) = simulate_watching(method, wall, &mut force, span, initial, watch)?;
            grazing = grazes;
            Run { trajectory: run.trajectory, raised: run.raised }
        }
        Course::SwitchedRk(method, span) => {
            let t_eval = if let Save::At(times) = save { Some(times) } else { None };
            let output = Output { t_eval, ..Output::default() };
            let run = simulate_switched_rk(method, wall, &mut force, span, initial, output, watch)?;
            end = t_eval.map(|_| run.end);
            Run { trajectory: run.trajectory, raised: run.raised }
        }
    };
    let Trajectory { columns, summary, events, status, nfev, .. } = trajectory;
    // a method that keeps all of its samples is thinned afterwards
    let saved = match (save, summary) {
        (Save::At(_), _) | (Save::Every(_), Some(_)) => Saved::every(&columns, 1)?,
        (Save::Every(every), None) => Saved::every(&columns, every)?,
        (Save::Steps(steps), _) => Saved::steps(&columns, steps)?,
        _ => Saved::default(),
    };
    let mut summary = summary.unwrap_or_else(|| Summary::of(&columns));
    if let Some((t, Physical { x, xdot })) = end {
        (summary.t, summary.x, summary.xdot) = (t, x, xdot);
    }
    if save != Save::Statistics {
        (summary.x_max, summary.speed_max) = (0.0, 0.0);
    }
    Ok(Outcome { grazing, ..Outcome::new(events, saved, summary, (status, nfev), save) })
}
