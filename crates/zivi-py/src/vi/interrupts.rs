//! What may end a solve from outside: a signal, the time, the caller's callback.

use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyStopIteration;
use pyo3::prelude::*;
use zivi_core::vi::{Affine, EvaluationError, Interruption, Problem, Progress};

use crate::leaving;

/// Time between two readings of the signals where the lock must be taken for it.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Watches one solve.
pub(super) struct Interrupts {
    deadline: Option<Instant>,
    timed_out: Cell<bool>,
    looked: Cell<Instant>,
    observe: Option<Py<PyAny>>,
    raised: RefCell<Option<PyErr>>,
}

impl Interrupts {
    pub(super) fn new(time_limit: Option<f64>, observe: Option<Py<PyAny>>) -> Self {
        let now = Instant::now();
        // a limit beyond the range of the clock is none
        let limit = time_limit.and_then(|limit| Duration::try_from_secs_f64(limit).ok());
        Self {
            deadline: limit.and_then(|limit| now.checked_add(limit)),
            timed_out: Cell::new(false),
            looked: Cell::new(now),
            observe,
            raised: RefCell::new(None),
        }
    }

    pub(super) fn timed_out(&self) -> bool {
        self.timed_out.get()
    }

    /// What a signal handler or the callback has raised.
    pub(super) fn raised(&self) -> Option<PyErr> {
        self.raised.take()
    }

    fn keep(&self, error: PyErr) -> Interruption {
        self.raised.replace(Some(error));
        Interruption::Failed
    }

    /// Looks at the clock, and at the signals; the lock is held.
    pub(super) fn look(&self, py: Python<'_>) -> Result<(), Interruption> {
        self.look_at_clock(Instant::now)?;
        leaving::look().and_then(|()| py.check_signals()).map_err(|error| self.keep(error))
    }

    /// The same without the lock, which is taken now and then.
    pub(super) fn look_detached(&self) -> Result<(), Interruption> {
        let now = Instant::now();
        self.look_at_clock(|| now)?;
        if now - self.looked.get() < LOOK_EVERY {
            return Ok(());
        }
        self.looked.set(now);
        let looked = leaving::look().and_then(|()| Python::attach(|py| py.check_signals()));
        looked.map_err(|error| self.keep(error))
    }

    fn look_at_clock(&self, now: impl Fn() -> Instant) -> Result<(), Interruption> {
        if self.deadline.is_some_and(|deadline| now() >= deadline) {
            self.timed_out.set(true);
            return Err(Interruption::Stopped);
        }
        Ok(())
    }

    /// Hands an iteration to the callback, which may end the solve by `StopIteration`.
    pub(super) fn report(&self, progress: &Progress) -> Result<(), Interruption> {
        let Some(observe) = &self.observe else { return Ok(()) };
        leaving::look().map_err(|error| self.keep(error))?;
        Python::attach(|py| {
            let Progress { iteration, residual, worst, stage } = *progress;
            match observe.call1(py, (iteration, residual, worst, stage.name())) {
                Ok(_) => Ok(()),
                Err(error) if error.is_instance_of::<PyStopIteration>(py) => {
                    Err(Interruption::Stopped)
                }
                Err(error) => Err(self.keep(error)),
            }
        })
    }
}

/// An affine problem, solved without the lock but for a look at the signals now and then.
pub(super) struct Interruptible<'a> {
    pub(super) affine: Affine<'a>,
    pub(super) interrupts: Interrupts,
}

impl Problem for Interruptible<'_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.affine.map(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.affine.jacobian(z, jacobian)
    }

    fn is_affine(&self) -> bool {
        true
    }

    fn poll(&mut self) -> Result<(), Interruption> {
        self.interrupts.look_detached()
    }

    fn monitor(&mut self, progress: &Progress) -> Result<(), Interruption> {
        self.interrupts.report(progress)
    }
}
