//! Batches: many runs on all cores, for arrays of parameters and initial states.
//!
//! Each run is independent of all others, so the results do not depend on the number of threads.
//! The memory requirement is the data of [`Save`] plus the record of one run per thread.
//! A run that a fault ends ([`crate::Status::Internal`]) or for which no memory is left
//! ([`crate::Status::OutOfMemory`]) costs no other its result.

mod lanes;
mod loops;
mod pool;

use zivi_core::{Physical, ThetaGammaStep};

use crate::method::{newton, AnyMethod, Method, PointMass, PointRun, Settings};
use crate::switched::check_span;
use crate::switched::sensitivity::simulate_watching;
use crate::{
    AnyImpactLaw, Dependence, FixedSteps, Force, Grid, ImpactMap, Keep, Kick, MapParameter,
    Monitor, MoreauJean, Output, PathPoint, Return, SetupError, Solver, Summary, ThetaGamma,
    Trajectory, QUANTITIES,
};

pub use loops::{simulate_closed_loop_batch, LoopMember, LoopOutcome, LoopSettings};
pub use pool::{
    available_threads, run as run_chunks, BatchError, Outcome, Save, Saved, Stop, Work,
};

/// A method and the span of the runs, the same for all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task {
    /// The method with its settings; the switched method saves no regular samples.
    pub method: AnyMethod,
    /// Start and end (s).
    pub span: (f64, f64),
    /// The slowest impacts that are counted, as a part of the fastest of the run.
    pub slowest: f64,
}

/// Checked settings common to all runs.
#[derive(Clone, Copy)]
struct BatchPlan<'a> {
    method: AnyMethod,
    span: (f64, f64),
    /// The steps of a method of fixed steps.
    grid: Option<Grid>,
    save: Save<'a>,
    slowest: f64,
}

impl<'a> BatchPlan<'a> {
    /// Rejects a span without steps, and data that a method cannot save.
    fn new(Task { method, span, slowest }: Task, save: Save<'a>) -> Result<Self, SetupError> {
        // a span that gives no grid gives no run either
        let grid = Grid::new(span.0, span.1, method.step().unwrap_or(f64::MAX))?;
        let refuse = |range| Err(SetupError::Setting("save", f64::NAN, range));
        let grid = method.step().map(|_| grid);
        match (grid, save) {
            (None, Save::Every(_) | Save::Steps(..)) => refuse("for a method of fixed steps"),
            (Some(_), Save::At(..) | Save::Grazing) => refuse("for the switched method"),
            (None, Save::At(times, _)) => check_span(span.0, span.1, Some(times)),
            _ => Ok(()),
        }?;
        Ok(Self { method, span, grid, save, slowest })
    }
}

/// One run of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Member<'a, F> {
    /// Impact law.
    pub law: AnyImpactLaw,
    /// The force.
    pub force: F,
    /// The initial state.
    pub initial: Physical,
    /// Increasing times at which the force is not smooth (s): steps of the switched method end there.
    pub tstops: &'a [f64],
    /// Times at which the velocity jumps, and the jumps (s, m/s), increasing.
    pub kicks: &'a [(f64, f64)],
}

/// The batch is to end: what a force of a batch may raise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stopped;

/// Runs every member, on `threads` threads (at least 1).
///
/// # Errors
/// [`BatchError`]: a member cannot start (the first one is named), before anything is computed;
/// or the monitor wants to stop.
///
/// ```
/// use zivi::drive::batch::{simulate_batch, Task, Member, Save};
/// use zivi::{ConstantForce, FixedSteps, Physical, Restitution, Silent, ThetaGamma};
///
/// let law = Restitution::from_kappa(0.41)?;
/// let force = ConstantForce(-9.81);
/// let initial = |x| Physical { x, xdot: 6.0 };
/// let ball = |x| Member { law: law.into(), force, initial: initial(x), tstops: &[], kicks: &[] };
/// let balls: Vec<_> = (0..100).map(|i| ball(0.01 * f64::from(i))).collect();
/// let method = FixedSteps { h: 1e-3, scheme: ThetaGamma::implicit_euler() }.into();
/// let task = Task { method, span: (0.0, 4.0), slowest: 1e-3 };
/// let ends = simulate_batch(&balls, task, Save::Final, 2, &mut Silent).unwrap();
/// assert!(ends.iter().all(|end| end.summary.x == 0.0 && end.rest_time < 3.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn simulate_batch<E, F: Force<Stopped> + Copy + Send + Sync>(
    members: &[Member<'_, F>],
    task: Task,
    save: Save<'_>,
    threads: usize,
    monitor: &mut impl Monitor<E>,
) -> Result<Vec<Outcome>, BatchError<E>> {
    let plan = BatchPlan::new(task, save).map_err(|error| BatchError::Setup(None, error))?;
    let mut alone = false;
    check_each(members, monitor, |member| {
        alone |= !side_by_side(member, plan.method);
        plan.method.check_start(member.initial, &member.law)
    })?;
    check_memory(members.len(), alone, plan, threads)?;
    let work = pool::Work {
        width: lanes::WIDTH,
        chunk: |chunk: &[Member<'_, F>], stop: Stop<'_>| several(chunk, plan, stop),
        lost: |member: &Member<'_, F>, status| {
            Outcome::lost(plan.span.0, member.initial, status, save)
        },
    };
    pool::run(members, threads, monitor, work)
}

/// The same by the switched method, where each run ends at a time of its own instead of that of the
/// task.
///
/// # Errors
/// Those of [`simulate_batch`]; an end that is not after the start; states at times to be saved.
pub fn simulate_batch_to<E, F: Force<Stopped> + Copy + Send + Sync>(
    members: &[(Member<'_, F>, f64)],
    task: Task,
    save: Save<'_>,
    threads: usize,
    monitor: &mut impl Monitor<E>,
) -> Result<Vec<Outcome>, BatchError<E>> {
    let plan = BatchPlan::new(task, save).map_err(|error| BatchError::Setup(None, error))?;
    // times of samples would be beyond some of the ends
    if plan.grid.is_some() || matches!(save, Save::At(..)) {
        let what = "for the switched method without times of samples";
        let error = SetupError::Setting("ends", f64::NAN, what);
        return Err(BatchError::Setup(None, error));
    }
    let start = plan.span.0;
    check_each(members, monitor, |(member, end)| {
        plan.method.check_start(member.initial, &member.law)?;
        check_span(start, *end, None)
    })?;
    let work = pool::Work {
        width: lanes::WIDTH,
        chunk: |chunk: &[(Member<'_, F>, f64)], stop: Stop<'_>| {
            let run = |(member, end): &(Member<'_, F>, f64)| {
                one(member, BatchPlan { span: (start, *end), ..plan }, stop)
            };
            chunk.iter().map(run).collect()
        },
        lost: |(member, _): &(Member<'_, F>, f64), status| {
            Outcome::lost(start, member.initial, status, save)
        },
    };
    pool::run(members, threads, monitor, work)
}

/// Number of members checked between two calls of the monitor.
const BETWEEN_POLLS: usize = 1 << 16;

/// Refuses the first member that `check` does not pass.
fn check_each<E, T>(
    members: &[T],
    monitor: &mut impl Monitor<E>,
    mut check: impl FnMut(&T) -> Result<(), SetupError>,
) -> Result<(), BatchError<E>> {
    for (i, member) in members.iter().enumerate() {
        if i > 0 && i % BETWEEN_POLLS == 0 {
            monitor.poll(0, members.len()).map_err(BatchError::Raised)?;
        }
        check(member).map_err(|error| BatchError::Setup(Some(i), error))?;
    }
    Ok(())
}

/// Rejects a batch whose results would not fit into memory; returns whether some are run alone.
fn check_memory<E>(
    runs: usize,
    alone: bool,
    plan: BatchPlan<'_>,
    threads: usize,
) -> Result<(), BatchError<E>> {
    let BatchPlan { method, grid, save, .. } = plan;
    let samples = match save {
        Save::At(times, _) => times.len(),
        // s and v take as much as x and x'
        Save::Steps(steps, _) => 2 * steps.len(),
        _ => grid.map_or(0, |grid| pool::samples(save.every(), grid)),
    };
    let whole = grid.map_or(samples, |grid| pool::samples(1, grid));
    let recorded = match (method, save) {
        (_, Save::Steps(..)) | (AnyMethod::MoreauJean(_), _) => whole,
        _ if !alone => 0,
        _ => samples,
    };
    let record = recorded.saturating_mul(QUANTITIES * size_of::<f64>());
    let of_run = size_of::<Outcome>().saturating_add(samples.saturating_mul(SAMPLE));
    Need { runs, samples, of_run, record }.check(recorded, threads)
}

/// Bytes of a saved sample.
const SAMPLE: usize = 2 * size_of::<f64>();

/// Memory requirement of a batch (bytes).
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
    /// Rejects a batch that does not fit; `recorded` is the number of samples of a run in progress.
    fn check<E>(self, recorded: usize, threads: usize) -> Result<(), BatchError<E>> {
        // an overflowing product does not fit either
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

/// Whether a member can be moved side by side with others whose force has the same dependence.
fn side_by_side<F: Force<Stopped>>(member: &Member<'_, F>, method: AnyMethod) -> bool {
    member.law.constant().is_some_and(|wall| match method {
        AnyMethod::ThetaGamma(it) => {
            it.scheme.solver == Solver::Exact && lanes::takes(&member.force, wall)
        }
        AnyMethod::MoreauJean(it) => lanes::moreau::takes(&member.force, it.scheme.theta),
        _ => false,
    })
}

/// The runs of a chunk.
fn several<F: Force<Stopped> + Copy>(
    chunk: &[Member<'_, F>],
    plan: BatchPlan<'_>,
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Outcome>, SetupError> {
    let mut outcomes: Vec<Option<Outcome>> = vec![None; chunk.len()];
    if let (Some(grid), false) = (plan.grid, matches!(plan.save, Save::Steps(..))) {
        for dependence in [Dependence::Constant, Dependence::Time, Dependence::State] {
            let among = |member: &Member<'_, F>| {
                member.force.dependence() == dependence && side_by_side(member, plan.method)
            };
            let places: Vec<usize> = (0..chunk.len()).filter(|&it| among(&chunk[it])).collect();
            if !places.is_empty() {
                let members: Vec<_> = places.iter().map(|&place| &chunk[place]).collect();
                let ends = alike(&members, dependence, (plan, grid), stop)?;
                for (place, end) in places.into_iter().zip(ends) {
                    outcomes[place] = Some(end);
                }
            }
        }
    }
    for (end, member) in outcomes.iter_mut().zip(chunk) {
        if end.is_none() {
            *end = Some(one(member, plan, stop)?);
        }
    }
    Ok(outcomes.into_iter().map_while(|it| it).collect())
}

/// The runs of members that are moved side by side.
fn alike<F: Force<Stopped> + Copy>(
    members: &[&Member<'_, F>],
    dependence: Dependence,
    (plan, grid): (BatchPlan<'_>, Grid),
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Outcome>, SetupError> {
    let save = (plan.save, plan.slowest);
    match plan.method {
        AnyMethod::ThetaGamma(FixedSteps { scheme: ThetaGamma { theta, gamma, .. }, .. }) => {
            let mass = |member: &&Member<'_, F>| {
                let step = ThetaGammaStep::new(grid.h(), theta, gamma, newton(&member.law)?)?;
                Ok(lanes::Mass { step, force: member.force, initial: member.initial })
            };
            let masses = members.iter().map(mass).collect::<Result<Vec<_>, SetupError>>()?;
            lanes::run(&masses, dependence, grid, save, stop)
        }
        AnyMethod::MoreauJean(FixedSteps { scheme: MoreauJean { theta }, .. }) => {
            let mass = |member: &&Member<'_, F>| {
                let e = newton(&member.law)?.e();
                Ok(lanes::moreau::Mass { e, force: member.force, initial: member.initial })
            };
            let masses = members.iter().map(mass).collect::<Result<Vec<_>, SetupError>>()?;
            lanes::moreau::run(&masses, theta, grid, save, stop)
        }
        _ => members.iter().map(|it| one(it, plan, stop)).collect(),
    }
}

/// Checks for interruption, and stores the data to save.
struct Unobserved<'a> {
    keep: Keep,
    stop: &'a dyn Fn() -> bool,
}

impl Monitor<Stopped> for Unobserved<'_> {
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

/// Kicks at known times.
fn kicks_at<E>(kicks: &[(f64, f64)]) -> Kick<'_, E, PathPoint> {
    Box::new(move |t, at| {
        let first = kicks.partition_point(|kick| kick.0 < t);
        let end = kicks.partition_point(|kick| kick.0 <= t);
        at.xdot += kicks[first..end].iter().map(|kick| kick.1).sum::<f64>();
        Ok(end > first)
    })
}

/// One run by the loop of its method.
fn one<F: Force<Stopped> + Copy>(
    member: &Member<'_, F>,
    BatchPlan { method, span, save, slowest, .. }: BatchPlan<'_>,
    stop: &dyn Fn() -> bool,
) -> Result<Outcome, SetupError> {
    let &Member { ref law, mut force, initial, tstops, kicks } = member;
    let every = save.every();
    let keep = if let Save::Steps(..) = save { Keep::All } else { Keep::Every(every) };
    let watch = &mut Unobserved { keep, stop };
    // samples between the ends are drawn only where they are kept or looked at
    let t_eval = match (save, method) {
        (Save::At(times, _), _) => Some(times),
        (Save::Final | Save::Events, AnyMethod::SwitchedRk(_)) => Some([].as_slice()),
        _ => None,
    };
    let kicks = (!kicks.is_empty()).then(|| kicks_at(kicks));
    let output = Output { t_eval, tstops, kicks, ..Output::default() };
    let system = PointMass { force: &mut force, law: law.clone() };
    let (PointRun { trajectory, end, motion, .. }, grazing) = match (method, save) {
        (AnyMethod::SwitchedRk(method), Save::Grazing) if output.kicks.is_none() => {
            let force = system.force;
            let (run, grazes) =
                simulate_watching(method, system.law, force, (span, tstops), initial, watch)?;
            (PointRun::switched(run, law), grazes)
        }
        _ => (method.run(system, span, initial, output, watch)?, false),
    };
    let Trajectory { columns, summary, events, status, nfev, .. } = trajectory;
    // a method that keeps all of its samples is thinned afterwards
    let saved = match (save, summary) {
        (Save::At(..), _) | (Save::Every(_), Some(_)) => Saved::every(&columns, 1)?,
        (Save::Every(every), None) => Saved::every(&columns, every)?,
        (Save::Steps(steps, _), _) => Saved::steps(&columns, steps)?,
        _ => Saved::default(),
    };
    let mut summary = summary.unwrap_or_else(|| Summary::of(&columns));
    // the end of a run that is not sampled there
    if let (Some(_), Some((t, Physical { x, xdot }))) = (t_eval, end) {
        (summary.t, summary.x, summary.xdot) = (t, x, xdot);
    }
    if save != Save::Statistics {
        (summary.x_max, summary.speed_max) = (0.0, 0.0);
    }
    let tails = motion.as_ref().map_or([].as_slice(), |it| &it.tails);
    let (happened, ended) = ((events, tails), (status, nfev));
    Ok(Outcome { grazing, ..Outcome::new(happened, saved, summary, ended, (save, slowest)) })
}

// Many impacts mapped to the next, on all cores.

/// Results of the impact map for one of many impacts.
#[derive(Clone, Debug, PartialEq)]
pub struct Mapped {
    /// The next impact.
    pub next: Return,
    /// `[[dphi'/dphi, dphi'/du], [du'/dphi, du'/du]]`.
    pub jacobian: [[f64; 2]; 2],
    /// The derivatives of its phase and speed by each parameter.
    pub by: Vec<[f64; 2]>,
}

/// Number of impacts per task of a thread.
const WIDTH: usize = 64;

/// The next impact of each of many, with derivatives by the state and by parameters.
///
/// # Errors
/// [`BatchError`]: the map cannot be differentiated so, or the monitor wants to stop.
pub fn map_impacts<E>(
    map: &ImpactMap,
    starts: &[[f64; 2]],
    parameters: &[MapParameter],
    threads: usize,
    monitor: &mut impl Monitor<E>,
) -> Result<Vec<Mapped>, BatchError<E>> {
    let one = |&[phase, u]: &[f64; 2]| {
        let (next, jacobian) = map.with_jacobian(phase, u);
        let by = match parameters {
            [] => Vec::new(),
            _ => map.with_parameters(phase, u, parameters)?.1,
        };
        Ok(Mapped { next, jacobian, by })
    };
    let nothing = [[f64::NAN; 2]; 2];
    let work = pool::Work {
        width: WIDTH,
        chunk: |chunk: &[[f64; 2]], _: pool::Stop<'_>| chunk.iter().map(one).collect(),
        lost: |_: &[f64; 2], _| Mapped {
            next: map.next(f64::NAN, f64::NAN),
            jacobian: nothing,
            by: vec![[f64::NAN; 2]; parameters.len()],
        },
    };
    pool::run(starts, threads, monitor, work)
}

/// The orbits of many impacts under maps of their own, or one for all: phase and speed of `n`
/// impacts each, the first after `skip` others.
///
/// # Errors
/// [`BatchError::Raised`]: the monitor wants to stop.
pub fn orbits<E>(
    maps: &[ImpactMap],
    starts: &[[f64; 2]],
    (skip, n): (usize, usize),
    threads: usize,
    monitor: &mut impl Monitor<E>,
) -> Result<Vec<Vec<[f64; 2]>>, BatchError<E>> {
    let numbered: Vec<(usize, [f64; 2])> = starts.iter().copied().enumerate().collect();
    let one = |&(i, start): &(usize, [f64; 2]), stop: &dyn Fn() -> bool| {
        let map = &maps[if maps.len() == 1 { 0 } else { i }];
        let mut out = vec![[f64::NAN; 2]; n];
        map.orbit_unless(start, skip, &mut out, stop);
        out
    };
    let work = pool::Work {
        width: 1,
        chunk: |chunk: &[(usize, [f64; 2])], stop: pool::Stop<'_>| {
            Ok(chunk.iter().map(|item| one(item, stop)).collect())
        },
        lost: |_: &(usize, [f64; 2]), _| vec![[f64::NAN; 2]; n],
    };
    pool::run(&numbered, threads, monitor, work)
}
