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

use super::outcome::BatchError;
use crate::{Monitor, SetupError, Status};

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_the_order_of_their_chunks_and_are_there_only_once_made() {
        let mut results = InOrder::with_room(6).unwrap();
        results.take(vec![(2, vec![4, 5]), (1, vec![2, 3])]);
        assert_eq!(results.list, []);
        results.take(vec![(0, vec![0, 1])]);
        assert_eq!((results.list, results.later.len()), (vec![0, 1, 2, 3, 4, 5], 0));
        assert!(InOrder::<[u8; 1 << 20]>::with_room(usize::MAX >> 20).is_err());
    }
}
