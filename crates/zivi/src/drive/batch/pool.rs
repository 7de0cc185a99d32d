//! Threads that take chunks of independent work, watched by the caller's thread.
//!
//! An item whose work panics or runs out of memory does not affect the results of others.

use std::collections::BTreeMap;
use std::iter::Enumerate;
use std::num::NonZeroUsize;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::slice::Chunks;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{Builder, Thread};
use std::time::Duration;

use zivi_core::Physical;

use crate::record::columns::{Columns, Quantity};
use crate::{Events, Grid, Impact, Monitor, SetupError, Status, Summary, Tail};

/// Whether the work shall stop.
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

/// Time between two calls of the monitor.
const PERIOD: Duration = Duration::from_millis(30);

/// State shared by the threads.
struct PoolState<'a, T, R> {
    /// Chunks that nobody has taken yet, numbered.
    waiting: Mutex<Enumerate<Chunks<'a, T>>>,
    /// Results of chunks that the caller has not taken yet.
    finished: Mutex<Vec<(usize, Vec<R>)>>,
    done: AtomicUsize,
    stop: AtomicBool,
    /// Threads that still work.
    working: AtomicUsize,
    /// The first chunk that failed as a whole.
    failed: Mutex<Option<(usize, SetupError)>>,
}

/// A thread at work: when it ends, however it ends, it is counted out and the caller is woken.
struct AtWork<'a> {
    working: &'a AtomicUsize,
    caller: &'a Thread,
}

impl Drop for AtWork<'_> {
    fn drop(&mut self) {
        self.working.fetch_sub(1, Ordering::Release);
        self.caller.unpark();
    }
}

/// Work on the items.
#[derive(Clone, Copy, Debug)]
pub struct Work<W, L> {
    /// Items of a chunk, at most.
    pub width: usize,
    /// The results of a chunk, one for each item.
    pub chunk: W,
    /// The result of an item that could not be worked on, and why.
    pub lost: L,
}

/// `work` on every chunk of the `items`; the results in the order of the items.
///
/// # Errors
/// The error of the first chunk that fails for a reason other than memory; failure to start a
/// thread; an error of the monitor.
pub fn run<E, T: Sync, R: Send>(
    items: &[T],
    threads: usize,
    monitor: &mut impl Monitor<E>,
    mut work: Work<
        impl Fn(&[T], Stop<'_>) -> Result<Vec<R>, SetupError> + Sync,
        impl Fn(&T, Status) -> R + Sync,
    >,
) -> Result<Vec<R>, BatchError<E>> {
    let threads = threads.max(1);
    work.width = work.width.min(items.len().div_ceil(threads)).max(1);
    let wanted = threads.min(items.len().div_ceil(work.width));
    let mut results = InOrder::with_room(items.len()).map_err(|it| BatchError::Setup(None, it))?;
    let shared = PoolState {
        waiting: Mutex::new(items.chunks(work.width).enumerate()),
        finished: Mutex::new(Vec::new()),
        done: AtomicUsize::new(0),
        stop: AtomicBool::new(false),
        working: AtomicUsize::new(0),
        failed: Mutex::new(None),
    };
    let caller = std::thread::current();
    let (raised, started) = std::thread::scope(|scope| {
        let mut started = 0;
        for _ in 0..wanted {
            shared.working.fetch_add(1, Ordering::Relaxed);
            let at_work = AtWork { working: &shared.working, caller: &caller };
            let (shared, work) = (&shared, &work);
            let thread = Builder::new().spawn_scoped(scope, move || {
                let _at_work = at_work;
                take_chunks(shared, work);
            });
            // fewer threads give the same results
            if thread.is_err() {
                break;
            }
            started += 1;
        }
        (watch(&shared, items.len(), monitor, &mut results), started)
    });
    let failed = shared.failed.into_inner().unwrap_or_else(PoisonError::into_inner);
    match (raised, failed) {
        (Some(error), _) => Err(BatchError::Raised(error)),
        _ if started < wanted.min(1) => Err(BatchError::Setup(None, SetupError::Threads(threads))),
        (None, Some((_, error))) => Err(BatchError::Setup(None, error)),
        (None, None) => Ok(results.list),
    }
}

/// Results in the order of the items. The list takes memory only as it is filled: a batch that is
/// stopped early never allocates memory for all its items.
struct InOrder<R> {
    list: Vec<R>,
    /// The number of the next chunk.
    next: usize,
    /// Chunks after it that are done.
    later: BTreeMap<usize, Vec<R>>,
}

impl<R> InOrder<R> {
    fn with_room(runs: usize) -> Result<Self, SetupError> {
        let (mut list, bytes) = (Vec::new(), size_of::<R>() as f64 * runs as f64);
        let none = SetupError::BatchMemory { runs, samples: 0, bytes };
        list.try_reserve_exact(runs).map_err(|_| none)?;
        Ok(Self { list, next: 0, later: BTreeMap::new() })
    }

    fn take(&mut self, finished: Vec<(usize, Vec<R>)>) {
        self.later.extend(finished);
        while let Some(results) = self.later.remove(&self.next) {
            self.list.extend(results);
            self.next += 1;
        }
    }
}

/// Looks after the threads until they are done, and takes their results; what the monitor raised.
fn watch<E, T, R>(
    shared: &PoolState<'_, T, R>,
    of: usize,
    monitor: &mut impl Monitor<E>,
    results: &mut InOrder<R>,
) -> Option<E> {
    let mut raised = None;
    loop {
        let at_work = shared.working.load(Ordering::Acquire) > 0;
        results.take(std::mem::take(&mut *lock(&shared.finished)));
        if !at_work {
            break;
        }
        std::thread::park_timeout(PERIOD);
        let done = shared.done.load(Ordering::Relaxed);
        if let (None, Err(error)) = (&raised, monitor.poll(done, of)) {
            raised = Some(error);
            shared.stop.store(true, Ordering::Relaxed);
        }
    }
    raised
}

fn take_chunks<T: Sync, R: Send>(
    shared: &PoolState<'_, T, R>,
    work: &Work<impl Fn(&[T], Stop<'_>) -> Result<Vec<R>, SetupError>, impl Fn(&T, Status) -> R>,
) {
    let stop = || shared.stop.load(Ordering::Relaxed);
    while !stop() {
        let next = lock(&shared.waiting).next();
        let Some((number, chunk)) = next else { break };
        match guarded(chunk, &stop, work) {
            Ok(results) => lock(&shared.finished).push((number, results)),
            Err(error) => {
                shared.stop.store(true, Ordering::Relaxed);
                let mut failed = lock(&shared.failed);
                if failed.as_ref().is_none_or(|(first, _)| number < *first) {
                    *failed = Some((number, error));
                }
            }
        }
        shared.done.fetch_add(chunk.len(), Ordering::Relaxed);
    }
}

/// The data guarded by a mutex; code under the lock does not panic.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The results of a chunk; where it fails as a whole, those of its items one by one.
fn guarded<T, R>(
    chunk: &[T],
    stop: Stop<'_>,
    work: &Work<impl Fn(&[T], Stop<'_>) -> Result<Vec<R>, SetupError>, impl Fn(&T, Status) -> R>,
) -> Result<Vec<R>, SetupError> {
    // what a panic leaves half done is dropped with it: the work shares nothing that it changes
    let status = match catch_unwind(AssertUnwindSafe(|| (work.chunk)(chunk, stop))) {
        Ok(Err(SetupError::Memory(_))) => Status::OutOfMemory,
        Ok(result) => return result,
        Err(_) => Status::Internal,
    };
    if let [item] = chunk {
        return Ok(vec![(work.lost)(item, status)]);
    }
    let mut all = Vec::with_capacity(chunk.len());
    for item in chunk.chunks(1) {
        all.extend(guarded(item, stop, work)?);
    }
    Ok(all)
}

/// The number of cores.
#[must_use]
pub fn available_threads() -> usize {
    std::thread::available_parallelism().map_or(1, NonZeroUsize::get)
}

// Saved data of one run of a batch.

/// Choice of the saved data of each run.
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
    /// The data of [`Save::Final`], the first sample and every n-th after it (n >= 1).
    Every(usize),
    /// The same as [`Save::Final`], and the states at these times, increasing and within the span
    /// (the switched method only); every event if the flag is set.
    At(&'a [f64], bool),
    /// The same as [`Save::Final`], and the samples of these steps, increasing numbers, with `s`
    /// and `v` (methods of fixed steps only); every event if the flag is set.
    Steps(&'a [usize], bool),
}

impl Save<'_> {
    /// Samples from one that is saved to the next, 0 if none is.
    pub(super) fn every(self) -> usize {
        match self {
            Save::Every(every) => every,
            _ => 0,
        }
    }

    /// Whether the events are saved.
    pub(super) fn events(self) -> bool {
        matches!(self, Save::Events | Save::At(_, true) | Save::Steps(_, true))
    }
}

/// Sampled positions and velocities of one run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// Distances from the wall (m).
    pub x: Vec<f64>,
    /// Velocities (m/s).
    pub xdot: Vec<f64>,
    /// Transformed positions (m), with [`Save::Steps`].
    pub s: Vec<f64>,
    /// Transformed velocities (m/s), with [`Save::Steps`].
    pub v: Vec<f64>,
}

impl Saved {
    pub(super) fn with_room(every: usize, grid: Grid) -> Result<Self, SetupError> {
        let room = samples(every, grid);
        Ok(Self { x: with_room(room)?, xdot: with_room(room)?, ..Self::default() })
    }

    /// The first sample and every n-th after it.
    pub(super) fn every(columns: &Columns, every: usize) -> Result<Self, SetupError> {
        let of = |quantity| thinned(columns.of(quantity), every);
        Ok(Self { x: of(Quantity::X)?, xdot: of(Quantity::Xdot)?, ..Self::default() })
    }

    /// The samples of these steps, as far as the run went.
    pub(super) fn steps(columns: &Columns, steps: &[usize]) -> Result<Self, SetupError> {
        let of = |quantity| -> Result<Vec<f64>, SetupError> {
            let values = columns.of(quantity);
            let mut list = with_room(steps.len())?;
            list.extend(steps.iter().map_while(|&step| values.get(step)));
            Ok(list)
        };
        Ok(Self {
            x: of(Quantity::X)?,
            xdot: of(Quantity::Xdot)?,
            s: of(Quantity::S)?,
            v: of(Quantity::V)?,
        })
    }

    pub(super) fn push(&mut self, x: f64, xdot: f64) {
        self.x.push(x);
        self.xdot.push(xdot);
    }
}

/// Number of samples kept, every n-th, none for `0`.
pub(super) fn samples(every: usize, grid: Grid) -> usize {
    grid.n_steps().checked_div(every).map_or(0, |it| it + 1)
}

fn with_room(room: usize) -> Result<Vec<f64>, SetupError> {
    let mut list = Vec::new();
    list.try_reserve_exact(room).map_err(|_| SetupError::Memory(room))?;
    Ok(list)
}

/// The first value and every n-th after it, none for `0`.
pub(super) fn thinned(values: &[f64], every: usize) -> Result<Vec<f64>, SetupError> {
    if every == 0 {
        return Ok(Vec::new());
    }
    let mut list = with_room(values.len().div_ceil(every))?;
    list.extend(values.iter().step_by(every));
    Ok(list)
}

/// Result of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The last state and the extremes (the extremes only with [`Save::Statistics`]).
    pub summary: Summary,
    /// How it ended.
    pub status: Status,
    /// Evaluations of the force.
    pub nfev: u64,
    /// Numbers of impacts, Zeno points, lift-offs and resolved impacts.
    pub counts: [u64; 4],
    /// Time of the first impact (s), NaN without one.
    pub first_impact: f64,
    /// Time of the last impact (s), NaN without one.
    pub last_impact: f64,
    /// Time of the last impact that was resolved (s), NaN without one.
    pub last_resolved: f64,
    /// Largest speed before an impact (m/s), 0 without one.
    pub hardest_impact: f64,
    /// Time from which the mass rests until the end (s), NaN if it does not.
    pub rest_time: f64,
    /// Whether it passed a grazing that its tolerances decided, with [`Save::Grazing`].
    pub grazing: bool,
    /// The events, with [`Save::Events`]; impacts are those that were resolved.
    pub events: Option<Events>,
    /// The impacts, with [`Save::Events`].
    pub impacts: Vec<Impact>,
    /// The samples, with [`Save::Every`].
    pub saved: Saved,
}

impl Outcome {
    /// Of a run from `initial` at `t` of which nothing is left.
    pub(super) fn lost(
        t: f64,
        Physical { x, xdot }: Physical,
        status: Status,
        save: Save<'_>,
    ) -> Self {
        let summary = Summary { t, x, xdot, ..Summary::default() };
        let none = (Events::default(), [].as_slice());
        Self::new(none, Saved::default(), summary, (status, 0), (save, 0.0))
    }

    /// `slowest` is the part of the fastest impact down to which impacts are counted.
    pub(super) fn new(
        (mut events, tails): (Events, &[Tail]),
        saved: Saved,
        summary: Summary,
        (status, nfev): (Status, u64),
        (save, slowest): (Save<'_>, f64),
    ) -> Self {
        // what is kept of many runs takes no more room than it needs
        events.impacts.shrink_to_fit();
        events.zeno_times.shrink_to_fit();
        events.liftoff_times.shrink_to_fit();
        let time = |impact: Option<&Impact>| impact.map_or(f64::NAN, |impact| impact.t);
        let hardest = |so_far: f64, impact: &Impact| so_far.max(-impact.xdot_before);
        let count = |it: usize| it as u64;
        let hardest_impact = events.impacts.iter().fold(0.0, hardest);
        let listed =
            ListedImpacts { speed: slowest * hardest_impact, resolved: &events.impacts, tails };
        let (n_impacts, last_impact) = listed.count();
        Self {
            summary,
            status,
            nfev,
            counts: [
                count(n_impacts),
                count(events.zeno_times.len()),
                count(events.liftoff_times.len()),
                count(events.impacts.len()),
            ],
            first_impact: listed.first(),
            last_impact,
            last_resolved: time(events.impacts.last()),
            hardest_impact,
            rest_time: events.rest_time.unwrap_or(f64::NAN),
            grazing: false,
            impacts: if save.events() { listed.impacts() } else { Vec::new() },
            events: save.events().then_some(events),
            saved,
        }
    }
}

/// The impacts with at least a speed before them (m/s), resolved or skipped by a jump to rest.
struct ListedImpacts<'a> {
    speed: f64,
    resolved: &'a [Impact],
    tails: &'a [Tail],
}

impl ListedImpacts<'_> {
    fn fast(&self) -> impl DoubleEndedIterator<Item = &Impact> {
        self.resolved.iter().filter(|it| -it.xdot_before >= self.speed)
    }

    /// The time of the first (s), which is a resolved one; NaN without one.
    fn first(&self) -> f64 {
        self.fast().next().map_or(f64::NAN, |it| it.t)
    }

    /// Their number, and the time of the last (s), NaN without one.
    fn count(&self) -> (usize, f64) {
        let last = self.fast().next_back().map_or(f64::NAN, |it| it.t);
        let skipped = self.tails.iter().map(|tail| tail.count_down_to(self.speed));
        skipped
            .filter(|(count, _)| *count > 0)
            .fold((self.fast().count(), last), |(sum, last), (count, t)| (sum + count, last.max(t)))
    }

    fn impacts(&self) -> Vec<Impact> {
        let skipped = self.tails.iter().flat_map(|tail| {
            let count = tail.count_down_to(self.speed).0;
            tail.impacts_down_to(0.0, count)
        });
        let mut all: Vec<Impact> = self.fast().copied().chain(skipped).collect();
        all.sort_by(|one, two| one.t.total_cmp(&two.t));
        all
    }
}

/// Why a batch gave nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum BatchError<E> {
    /// The member of this number, or a common setting, is out of range.
    Setup(Option<usize>, SetupError),
    /// The monitor wants to stop.
    Raised(E),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_the_order_of_their_chunks_and_are_there_only_once_made() {
        let mut results = InOrder::with_room(6).unwrap();
        results.take(vec![(2, vec![4, 5]), (1, vec![2, 3])]);
        assert!(results.list.is_empty());
        results.take(vec![(0, vec![0, 1])]);
        assert_eq!((results.list, results.later.len()), (vec![0, 1, 2, 3, 4, 5], 0));
        assert!(InOrder::<[u8; 1 << 20]>::with_room(usize::MAX >> 20).is_err());
    }
}
