//! Batches of closed loops: studies of gains and tolerances.

use zivi_core::observer::ImpactObserver;
use zivi_core::{Physical, Restitution};

use super::pool::{samples, thinned};
use super::{pool, BatchError, Need, Stopped};
use crate::drive::closed_loop::{
    observe_closed_loop, AnyController, Forces, Loop, LoopOptions, LoopRun, Motion, ReferencePoint,
    ReferenceWithWall, Samples, Sensor, LOOP_COLUMNS, SIGNS,
};
use crate::drive::Updates;
use crate::system::dynamics::check_initial;
use crate::{Force, Grid, Impact, Monitor, SetupError, Status};

/// One closed loop of a batch.
#[derive(Clone, Debug)]
pub struct LoopMember<'r, F> {
    /// The controller, its reference where it starts.
    pub controller: AnyController,
    /// Observer whose estimates replace the measurement, if any.
    pub observer: Option<ImpactObserver>,
    /// The plant's wall.
    pub restitution: Restitution,
    /// The forces on the plant, in the controller's model and on the reference.
    pub forces: [F; 3],
    /// The plant's initial state.
    pub initial: Physical,
    /// The samples.
    pub grid: Grid,
    /// A reference that is given at the samples, and its wall.
    pub reference: Option<(&'r [ReferencePoint], Restitution)>,
}

/// Settings common to all loops of a batch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopSettings {
    /// How the plants move between samples.
    pub motion: Motion,
    /// Resolution of the measured position and velocity (m, m/s), `0` is exact.
    pub resolution: (f64, f64),
    /// Periods that pass before a control acts.
    pub delay: usize,
    /// The position error (m) that counts as followed.
    pub within: f64,
    /// Samples from one that is saved to the next, `0` for none.
    pub every: usize,
    /// The slowest impacts that are counted, as a part of the fastest of the loop.
    pub slowest: f64,
}

/// Number of quantities whose samples are saved.
const SAVED: usize = 3;

/// Result of one closed loop.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoopOutcome {
    /// Time (s), plant and reference at the end: `t, x, x', x_r, x_r'`.
    pub last: [f64; 5],
    /// The first sample from which the position error stays within `within` to the end (s): the
    /// initial one if it always does, NaN if it does not stay or without a reference.
    pub settling_time: f64,
    /// Largest position error (m), NaN without a reference.
    pub error_max: f64,
    /// Root mean square of the position error (m), NaN without a reference.
    pub error_rms: f64,
    /// Largest control (m/s^2).
    pub u_max: f64,
    /// Root mean square of the control (m/s^2).
    pub u_rms: f64,
    /// Total variation of the control (m/s^2).
    pub u_variation: f64,
    /// Number of impacts, down to [`LoopSettings::slowest`].
    pub n_impacts: u64,
    /// Counts of the control updates.
    pub updates: Updates,
    /// Time from which the plant rests until the end (s), NaN if it does not.
    pub rest_time: f64,
    /// How it ended.
    pub status: Option<Status>,
    /// Saved positions, reference positions and controls.
    pub saved: [Vec<f64>; SAVED],
}

/// Runs every loop, on `threads` threads (at least 1).
///
/// # Errors
/// [`BatchError`]: a loop cannot start (the first one is named), before anything is computed; or
/// the monitor wants to stop.
pub fn simulate_closed_loop_batch<E, F: Force<Stopped> + Copy + Send + Sync>(
    members: &[LoopMember<'_, F>],
    settings: LoopSettings,
    threads: usize,
    monitor: &mut impl Monitor<E>,
) -> Result<Vec<LoopOutcome>, BatchError<E>> {
    for (i, member) in members.iter().enumerate() {
        check_initial(member.initial).map_err(|error| BatchError::Setup(Some(i), error))?;
    }
    check_memory(members, settings, threads)?;
    let work = pool::Work {
        width: CHUNK,
        chunk: |chunk: &[LoopMember<'_, F>], stop: pool::Stop<'_>| {
            chunk.iter().map(|member| one(member, settings, stop)).collect()
        },
        lost: LoopOutcome::lost,
    };
    pool::run(members, threads, monitor, work)
}

/// Rejects a batch whose results would not fit into memory.
fn check_memory<E, F>(
    members: &[LoopMember<'_, F>],
    settings: LoopSettings,
    threads: usize,
) -> Result<(), BatchError<E>> {
    let most = |every| members.iter().map(|member| samples(every, member.grid)).max().unwrap_or(0);
    // while it is computed, a loop keeps all of its samples
    let (saved, recorded) = (most(settings.every), most(1));
    let record = recorded.saturating_mul((LOOP_COLUMNS + SIGNS) * size_of::<f64>() + 1);
    let kept = saved.saturating_mul(SAVED * size_of::<f64>());
    let of_run = size_of::<LoopOutcome>().saturating_add(kept);
    Need { runs: members.len(), samples: saved, of_run, record }.check(recorded, threads)
}

/// Number of loops per task of a thread.
const CHUNK: usize = 8;

/// Looks whether to stop.
struct LoopInterrupt<'a>(&'a dyn Fn() -> bool);

impl Monitor<Stopped> for LoopInterrupt<'_> {
    fn poll(&mut self, _: usize, _: usize) -> Result<(), Stopped> {
        if (self.0)() {
            Err(Stopped)
        } else {
            Ok(())
        }
    }
}

fn one<F: Force<Stopped> + Copy>(
    member: &LoopMember<'_, F>,
    settings: LoopSettings,
    stop: &dyn Fn() -> bool,
) -> Result<LoopOutcome, SetupError> {
    let LoopMember { observer, restitution, mut forces, initial, grid, reference: given, .. } =
        *member;
    let mut controller = member.controller.clone();
    let LoopSettings { motion, resolution, delay, .. } = settings;
    let sensor = Sensor { resolution, ..Sensor::default() };
    let surroundings = Loop { restitution, grid, initial, motion, sensor, observer, delay };
    let [plant, model, reference] = &mut forces;
    let forces = Forces { plant, model, reference };
    let mut samples = given.map(|(samples, restitution)| (Samples(samples), restitution));
    let reference = samples
        .as_mut()
        .map(|(it, restitution)| ReferenceWithWall { reference: it, restitution: *restitution });
    let options = LoopOptions { reference, ..LoopOptions::default() };
    let monitor = &mut LoopInterrupt(stop);
    let controller = controller.dynamic();
    let run = observe_closed_loop(controller, surroundings, forces, options, monitor)?;
    LoopOutcome::of(&run, settings)
}

impl LoopOutcome {
    /// Of a loop of which nothing is left.
    fn lost<F>(member: &LoopMember<'_, F>, status: Status) -> Self {
        let Physical { x, xdot } = member.initial;
        let none = f64::NAN;
        Self {
            last: [member.grid.t(0), x, xdot, none, none],
            settling_time: none,
            error_max: none,
            error_rms: none,
            rest_time: none,
            status: Some(status),
            ..Self::default()
        }
    }

    fn of(run: &LoopRun<Stopped>, settings: LoopSettings) -> Result<Self, SetupError> {
        let [t, x, xdot, x_ref, xdot_ref, u] = &run.columns;
        let last = [t, x, xdot, x_ref, xdot_ref].map(|it| it.last().copied().unwrap_or(f64::NAN));
        // the last sample repeats the control of the one before
        let held = &u[..u.len().saturating_sub(1)];
        let errors = || x.iter().zip(x_ref).map(|(x, x_ref)| (x - x_ref).abs());
        let every = |column: &[f64]| thinned(column, settings.every);
        Ok(Self {
            last,
            settling_time: settling_time(t, errors(), settings.within),
            error_max: errors().fold(f64::NAN, f64::max),
            error_rms: rms(errors()),
            u_max: held.iter().fold(0.0, |most, u| most.max(u.abs())),
            u_rms: rms(held.iter().copied()),
            u_variation: held.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum(),
            n_impacts: counted(&run.events.impacts, settings.slowest),
            updates: run.updates,
            rest_time: run.events.rest_time.unwrap_or(f64::NAN),
            status: Some(run.status),
            saved: [every(x)?, every(x_ref)?, every(u)?],
        })
    }
}

/// How many impacts are at least so fast, as a part of the fastest.
fn counted(impacts: &[Impact], slowest: f64) -> u64 {
    let fastest = impacts.iter().fold(0.0, |most: f64, it| most.max(-it.xdot_before));
    impacts.iter().filter(|it| -it.xdot_before >= slowest * fastest).count() as u64
}

/// The first of the times from which the errors stay within a bound, NaN if they do not (an unknown
/// error counts as too large).
fn settling_time(
    t: &[f64],
    mut errors: impl DoubleEndedIterator<Item = f64> + ExactSizeIterator,
    within: f64,
) -> f64 {
    let from =
        errors.rposition(|error| error.is_nan() || error > within).map_or(0, |last| last + 1);
    t.get(from).copied().unwrap_or(f64::NAN)
}

/// Root mean square, NaN of nothing.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), value| (sum + value * value, n + 1.0));
    (sum / n).sqrt()
}
