//! Threads that take chunks of independent work, watched by the caller's thread.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::Mutex;
use std::time::Duration;

use super::BatchError;
use crate::{Monitor, SetupError};

/// Between two looks of the monitor.
const PERIOD: Duration = Duration::from_millis(30);

/// The results of the chunk of this number.
type Finished<R> = (usize, Result<Vec<R>, SetupError>);

/// What several threads share.
struct Shared<R> {
    next: AtomicUsize,
    done: AtomicUsize,
    stop: AtomicBool,
    /// Threads that still work.
    working: AtomicUsize,
    /// Results of chunks, in the order in which they were finished.
    finished: Mutex<Vec<Finished<R>>>,
}

/// `work` on every chunk of at most `width` of the `items`; the results in the order of the items.
///
/// # Errors
/// The first chunk's that fails, or what the monitor raises.
pub(super) fn run<E, T: Sync, R: Send>(
    items: &[T],
    width: usize,
    threads: usize,
    monitor: &mut impl Monitor<E>,
    work: impl Fn(&[T], &dyn Fn() -> bool) -> Result<Vec<R>, SetupError> + Sync,
) -> Result<Vec<R>, BatchError<E>> {
    let threads = threads.max(1);
    let width = width.min(items.len().div_ceil(threads)).max(1);
    let shared = Shared {
        next: AtomicUsize::new(0),
        done: AtomicUsize::new(0),
        stop: AtomicBool::new(false),
        working: AtomicUsize::new(0),
        finished: Mutex::new(Vec::new()),
    };
    let caller = std::thread::current();
    let raised = std::thread::scope(|scope| {
        for _ in 0..threads.min(items.len().div_ceil(width)) {
            shared.working.fetch_add(1, Ordering::Relaxed);
            scope.spawn(|| {
                take_chunks(items, width, &shared, &work);
                shared.working.fetch_sub(1, Ordering::Release);
                caller.unpark();
            });
        }
        let mut raised = None;
        while shared.working.load(Ordering::Acquire) > 0 {
            std::thread::park_timeout(PERIOD);
            let done = shared.done.load(Ordering::Relaxed);
            if let (None, Err(error)) = (&raised, monitor.poll(done, items.len())) {
                raised = Some(error);
                shared.stop.store(true, Ordering::Relaxed);
            }
        }
        raised
    });
    match raised {
        Some(error) => Err(BatchError::Raised(error)),
        None => collected(shared.finished.into_inner().unwrap_or_default()),
    }
}

fn take_chunks<T, R>(
    items: &[T],
    width: usize,
    shared: &Shared<R>,
    work: &impl Fn(&[T], &dyn Fn() -> bool) -> Result<Vec<R>, SetupError>,
) {
    let stop = || shared.stop.load(Ordering::Relaxed);
    while !stop() {
        let number = shared.next.fetch_add(1, Ordering::Relaxed);
        let Some(chunk) = items.chunks(width).nth(number) else { break };
        let result = work(chunk, &stop);
        if result.is_err() {
            shared.stop.store(true, Ordering::Relaxed);
        }
        shared.done.fetch_add(chunk.len(), Ordering::Relaxed);
        if let Ok(mut finished) = shared.finished.lock() {
            finished.push((number, result));
        }
    }
}

fn collected<E, R>(mut finished: Vec<Finished<R>>) -> Result<Vec<R>, BatchError<E>> {
    finished.sort_by_key(|(number, _)| *number);
    let mut all = Vec::new();
    for (_, result) in finished {
        all.extend(result.map_err(|error| BatchError::Setup(None, error))?);
    }
    Ok(all)
}

/// The number of threads that the machine runs at once.
#[must_use]
pub fn available_threads() -> usize {
    std::thread::available_parallelism().map_or(1, NonZeroUsize::get)
}
