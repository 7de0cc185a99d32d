//! `F` and its Jacobian as Python callables.

use crate::interface;
use crate::interface::array;
use numpy::ndarray::Dimension;
use numpy::{PyArray, PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyArithmeticError, PyStopIteration, PyValueError};
use pyo3::prelude::*;
use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};
use zivi_core::vi::{Affine, EvaluationError, Interruption, Problem, Progress};

/// Calls Python. Exceptions are stored for the caller and stop the solver, except errors that mean
/// that a function is undefined at a point: after the first call they count as values that are not
/// finite.
pub(super) struct Callbacks<'py> {
    py: Python<'py>,
    f: Bound<'py, PyAny>,
    convert: (Bound<'py, PyAny>, Bound<'py, PyAny>),
    pub(super) raised: RefCell<Option<PyErr>>,
    pub(super) nfev: Cell<usize>,
    njev: Cell<usize>,
    /// Relative rounding error of the type that `F` returns.
    pub(super) rounding: Cell<f64>,
    undefined: RefCell<Option<PyErr>>,
    undefined_count: Cell<usize>,
}

impl<'py> Callbacks<'py> {
    pub(super) fn new(
        py: Python<'py>,
        f: Bound<'py, PyAny>,
        convert: (Bound<'py, PyAny>, Bound<'py, PyAny>),
    ) -> Self {
        Self {
            py,
            f,
            convert,
            raised: RefCell::new(None),
            nfev: Cell::new(0),
            njev: Cell::new(0),
            rounding: Cell::new(f64::EPSILON),
            undefined: RefCell::new(None),
            undefined_count: Cell::new(0),
        }
    }

    pub(super) fn map(&self, z: &[f64], out: &mut [f64]) -> Result<(), EvaluationError> {
        self.nfev.set(self.nfev.get() + 1);
        let called = self.at(z).and_then(|z| self.f.call1((z,)));
        let Some(value) = self.defined(called, self.nfev.get())? else {
            out.fill(f64::NAN);
            return Ok(());
        };
        if let Ok(array) = value.cast::<PyArray1<f64>>() {
            if array.len() == out.len() && copy(array, out) {
                return Ok(());
            }
        }
        self.keep(self.convert_values(value, out))
    }

    /// A point as the argument of a callable.
    fn at(&self, z: &[f64]) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(array(self.py, z.iter().copied())?.into_bound(self.py))
    }

    /// Values of another type or shape.
    fn convert_values(&self, value: Bound<'py, PyAny>, out: &mut [f64]) -> PyResult<()> {
        let (array, rounding): (Bound<'py, PyArray1<f64>>, f64) =
            self.convert.0.call1((value,))?.extract()?;
        self.rounding.set(rounding);
        copy_all(&array, out)
    }

    fn jacobian(
        &self,
        jac: &Bound<'py, PyAny>,
        z: &[f64],
        out: &mut [f64],
    ) -> Result<(), EvaluationError> {
        self.njev.set(self.njev.get() + 1);
        let called = self.at(z).and_then(|z| jac.call1((z,)));
        let Some(value) = self.defined(called, self.njev.get())? else {
            out.fill(f64::NAN);
            return Ok(());
        };
        if let Ok(array) = value.cast::<PyArray2<f64>>() {
            let n = z.len();
            if array.shape() == [n, n] && copy(array, out) {
                return Ok(());
            }
        }
        self.keep((|| {
            let array: Bound<'py, PyArray2<f64>> = self.convert.1.call1((value,))?.extract()?;
            copy_all(&array, out)
        })())
    }

    /// The value of a call; `None` if undefined.
    fn defined(
        &self,
        called: PyResult<Bound<'py, PyAny>>,
        call: usize,
    ) -> Result<Option<Bound<'py, PyAny>>, EvaluationError> {
        match called {
            Err(error) if call > 1 && self.means_undefined(&error) => {
                self.undefined_count.set(self.undefined_count.get() + 1);
                self.undefined.replace(Some(error));
                Ok(None)
            }
            other => self.keep(other.map(Some)),
        }
    }

    fn means_undefined(&self, error: &PyErr) -> bool {
        error.is_instance_of::<PyArithmeticError>(self.py)
            || error.is_instance_of::<PyValueError>(self.py)
    }

    fn keep<T>(&self, result: PyResult<T>) -> Result<T, EvaluationError> {
        result.map_err(|error| {
            self.raised.replace(Some(error));
            EvaluationError
        })
    }

    /// Text about points where `F` or its Jacobian raised.
    pub(super) fn undefined(&self) -> String {
        match &*self.undefined.borrow() {
            None => String::new(),
            Some(error) => format!(
                "; raised at {} points and taken as not defined there, the last time {error}",
                self.undefined_count.get()
            ),
        }
    }
}

/// `to <- from`, row by row for any memory order; false if `from` cannot be read.
fn copy<D: Dimension>(from: &Bound<'_, PyArray<f64, D>>, to: &mut [f64]) -> bool {
    let Ok(from) = from.try_readonly() else { return false };
    // a matrix in Fortran order is also contiguous: only `as_array` knows its rows
    let from = from.as_array();
    match from.as_slice() {
        Some(from) if from.len() == to.len() => to.copy_from_slice(from),
        _ => to.iter_mut().zip(&from).for_each(|(to, from)| *to = *from),
    }
    true
}

/// The same of an array that was made for it, and has the shape.
fn copy_all<D: Dimension>(from: &Bound<'_, PyArray<f64, D>>, to: &mut [f64]) -> PyResult<()> {
    match copy(from, to) {
        true => Ok(()),
        false => Err(PyValueError::new_err("an array that was returned is being written to")),
    }
}

/// `F` and its Jacobian, both from Python.
pub(super) struct MapWithJacobian<'a, 'py> {
    callbacks: &'a Callbacks<'py>,
    jac: Bound<'py, PyAny>,
}

impl<'a, 'py> MapWithJacobian<'a, 'py> {
    pub(super) fn new(callbacks: &'a Callbacks<'py>, jac: Bound<'py, PyAny>) -> Self {
        Self { callbacks, jac }
    }
}

impl Problem for MapWithJacobian<'_, '_> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.callbacks.map(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.callbacks.jacobian(&self.jac, z, jacobian)
    }

    fn rounding(&self) -> f64 {
        self.callbacks.rounding.get()
    }
}

/// A problem with callbacks, and an eye on the clock and the signals between them.
pub(super) struct Watched<'a, 'py, P> {
    problem: P,
    callbacks: &'a Callbacks<'py>,
    interrupts: &'a Interrupts,
}

impl<'a, 'py, P> Watched<'a, 'py, P> {
    pub(super) fn new(
        problem: P,
        callbacks: &'a Callbacks<'py>,
        interrupts: &'a Interrupts,
    ) -> Self {
        Self { problem, callbacks, interrupts }
    }
}

impl<P: Problem> Problem for Watched<'_, '_, P> {
    fn map(&mut self, z: &[f64], f: &mut [f64]) -> Result<(), EvaluationError> {
        self.problem.map(z, f)
    }

    fn jacobian(&mut self, z: &[f64], jacobian: &mut [f64]) -> Result<(), EvaluationError> {
        self.problem.jacobian(z, jacobian)
    }

    fn is_differenced(&self) -> bool {
        self.problem.is_differenced()
    }

    fn rounding(&self) -> f64 {
        self.problem.rounding()
    }

    fn poll(&mut self) -> Result<(), Interruption> {
        self.interrupts.look(self.callbacks.py)
    }

    fn monitor(&mut self, progress: &Progress) -> Result<(), Interruption> {
        self.interrupts.report(progress)
    }
}

// External interruptions of a solve: a signal, the time limit, the caller's callback.

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
        // a limit outside the range of the clock is ignored
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

    /// Exception of a signal handler or of the callback.
    pub(super) fn raised(&self) -> Option<PyErr> {
        self.raised.take()
    }

    fn keep(&self, error: PyErr) -> Interruption {
        self.raised.replace(Some(error));
        Interruption::Failed
    }

    /// Checks the clock and the signals; the GIL is held.
    pub(super) fn look(&self, py: Python<'_>) -> Result<(), Interruption> {
        self.look_at_clock(Instant::now)?;
        interface::look().and_then(|()| py.check_signals()).map_err(|error| self.keep(error))
    }

    /// The same without the lock, which is taken now and then.
    pub(super) fn look_detached(&self) -> Result<(), Interruption> {
        let now = Instant::now();
        self.look_at_clock(|| now)?;
        if now - self.looked.get() < LOOK_EVERY {
            return Ok(());
        }
        self.looked.set(now);
        let looked = interface::look().and_then(|()| Python::attach(|py| py.check_signals()));
        looked.map_err(|error| self.keep(error))
    }

    fn look_at_clock(&self, now: impl Fn() -> Instant) -> Result<(), Interruption> {
        if self.deadline.is_some_and(|deadline| now() >= deadline) {
            self.timed_out.set(true);
            return Err(Interruption::Stopped);
        }
        Ok(())
    }

    /// Passes an iteration to the callback, which may end the solve by `StopIteration`.
    pub(super) fn report(&self, progress: &Progress) -> Result<(), Interruption> {
        let Some(observe) = &self.observe else { return Ok(()) };
        interface::look().map_err(|error| self.keep(error))?;
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

/// An affine problem, solved without the GIL except for occasional checks of signals.
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
