//! The end of the interpreter while runs go on in other threads.
//!
//! Before Python 3.14, a thread that requests the lock of a finalised interpreter is terminated by
//! it through its callers: Rust frames cannot be unwound that way, and the process aborts. Hence
//! the interpreter waits at its exit until the runs of other threads have stopped, and none begins.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use pyo3::exceptions::PySystemExit;
use pyo3::prelude::*;

static LEAVING: AtomicBool = AtomicBool::new(false);
static RUNNING: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Runs of this thread, one in the force of another.
    static OWN: Cell<usize> = const { Cell::new(0) };
    /// Whether this thread ends the interpreter: it may go on.
    static ENDS: Cell<bool> = const { Cell::new(false) };
}

/// A call that may give the lock away before it returns.
pub(crate) struct UnlockedCall;

/// Begins a run; `SystemExit`, of which threads make no words, if the interpreter ends.
pub(crate) fn running() -> PyResult<UnlockedCall> {
    RUNNING.fetch_add(1, Ordering::SeqCst);
    OWN.set(OWN.get() + 1);
    let run = UnlockedCall;
    look().map(|()| run)
}

impl Drop for UnlockedCall {
    fn drop(&mut self) {
        OWN.set(OWN.get() - 1);
        RUNNING.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Whether to go on; needs no lock.
#[inline]
pub(crate) fn look() -> PyResult<()> {
    if LEAVING.load(Ordering::SeqCst) {
        return look_while_leaving();
    }
    Ok(())
}

#[cold]
fn look_while_leaving() -> PyResult<()> {
    if ENDS.get() {
        return Ok(());
    }
    Err(PySystemExit::new_err("the interpreter ends"))
}

/// Asks the runs of other threads to stop and waits until they have; False if some have not.
#[pyfunction]
pub(crate) fn stop_runs(py: Python<'_>, seconds: f64) -> bool {
    ENDS.set(true);
    LEAVING.store(true, Ordering::SeqCst);
    let end = Instant::now() + Duration::from_secs_f64(seconds.clamp(0.0, 1e6));
    while RUNNING.load(Ordering::SeqCst) > OWN.get() {
        if Instant::now() > end {
            return false;
        }
        py.detach(|| std::thread::sleep(Duration::from_millis(1)));
    }
    true
}

/// Forgets the runs of threads that a fork has not taken over.
#[pyfunction]
pub(crate) fn forget_runs() {
    RUNNING.store(OWN.get(), Ordering::SeqCst);
}
