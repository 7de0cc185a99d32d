//! Compiled functions as forces.

use std::cell::Cell;
use std::ffi::c_void;
use std::sync::atomic::{AtomicUsize, Ordering};

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use zivi::system::slopes::{Differenced, Parametrised};
use zivi::Force;

use super::force::NativeForce;
use crate::interface::Capsule;

/// `double f(double t, double x, double xdot)`.
type Plain = unsafe extern "C" fn(f64, f64, f64) -> f64;
/// The same with a pointer to the caller's data.
type WithData = unsafe extern "C" fn(f64, f64, f64, *mut c_void) -> f64;

/// The most parameters of a compiled force: with time and state they fit into the registers.
const MOST_PARAMETERS: usize = 5;
type With1 = unsafe extern "C" fn(f64, f64, f64, f64) -> f64;
type With2 = unsafe extern "C" fn(f64, f64, f64, f64, f64) -> f64;
type With3 = unsafe extern "C" fn(f64, f64, f64, f64, f64, f64) -> f64;
type With4 = unsafe extern "C" fn(f64, f64, f64, f64, f64, f64, f64) -> f64;
type With5 = unsafe extern "C" fn(f64, f64, f64, f64, f64, f64, f64, f64) -> f64;

/// `double e(double v)`, a coefficient of restitution.
type Ratio = unsafe extern "C" fn(f64) -> f64;

const PLAIN: &str = "double (double, double, double)";
const WITH_DATA: &str = "double (double, double, double, void *)";

/// Exceptions that compiled functions raised and could not hand on, in all threads.
static RAISED: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Whether the last evaluation in this thread raised one.
    static RAISED_HERE: Cell<bool> = const { Cell::new(false) };
}

/// Notes that the compiled function that this thread is in raised an exception, which C cannot
/// hand on: what it returns means nothing.
#[pyfunction]
pub(crate) fn force_raised() {
    RAISED_HERE.set(true);
    RAISED.fetch_add(1, Ordering::Relaxed);
}

/// Check for exceptions raised by compiled functions.
#[derive(Clone, Copy)]
pub(crate) struct Raised {
    /// Those that were there when this was last looked at.
    seen: usize,
}

impl Raised {
    pub(crate) fn now() -> Self {
        Self { seen: RAISED.load(Ordering::Relaxed) }
    }

    /// Whether the compiled function that this thread called last raised one. All threads share one
    /// counter, which is cheap to read.
    pub(crate) fn here(&mut self) -> bool {
        let count = RAISED.load(Ordering::Relaxed);
        let changed = count != self.seen;
        self.seen = count;
        changed && RAISED_HERE.take()
    }
}

/// The coefficient of restitution at a speed by a compiled function, `double e(double v)`; NaN where
/// it raised an exception. The `ImpactLaw` holds the owner of its code.
pub(crate) fn compiled_ratio(address: usize) -> impl Fn(f64) -> f64 + Send + Sync {
    move |v| {
        let mut raised = Raised::now();
        // SAFETY: the Python layer (`zivi.system.impact_law`) passes only the address of a function
        // of this signature, and the law holds the object that owns the code.
        let e = unsafe { std::mem::transmute::<usize, Ratio>(address)(v) };
        if raised.here() {
            f64::NAN
        } else {
            e
        }
    }
}

/// A compiled function, called without the interpreter. The `Force` holds the owner of its code.
#[derive(Clone, Copy)]
pub(crate) struct CompiledForce {
    address: usize,
    data: Option<usize>,
    /// Parameters passed after time and state.
    parameters: [f64; MOST_PARAMETERS],
    n: usize,
    /// The exceptions that were there when this was last looked at.
    seen: usize,
    reads_time: bool,
}

impl CompiledForce {
    pub(crate) fn new(address: usize, data: Option<usize>, given: &[f64]) -> PyResult<Self> {
        let (n, mut parameters) = (given.len(), [0.0; MOST_PARAMETERS]);
        let Some(values) = parameters.get_mut(..n) else {
            return Err(PyValueError::new_err(format!(
                "a compiled force has at most {MOST_PARAMETERS} parameters, got {n}"
            )));
        };
        values.copy_from_slice(given);
        Ok(Self { address, data, parameters, n, seen: 0, reads_time: true })
    }

    /// The same, of which it is known whether it uses the time.
    pub(crate) fn reading_time(self, reads_time: bool) -> Self {
        Self { reads_time, ..self }
    }

    /// The value that the function returns.
    fn with_parameters(&self, t: f64, x: f64, xdot: f64) -> f64 {
        let [a, b, c, d, e] = self.parameters;
        let address = self.address;
        // SAFETY: as in `at`; the Python layer has compared the number of the arguments with that
        // of the parameters.
        unsafe {
            match self.n {
                1 => std::mem::transmute::<usize, With1>(address)(t, x, xdot, a),
                2 => std::mem::transmute::<usize, With2>(address)(t, x, xdot, a, b),
                3 => std::mem::transmute::<usize, With3>(address)(t, x, xdot, a, b, c),
                4 => std::mem::transmute::<usize, With4>(address)(t, x, xdot, a, b, c, d),
                _ => std::mem::transmute::<usize, With5>(address)(t, x, xdot, a, b, c, d, e),
            }
        }
    }

    /// The value, NaN if an exception was raised in its stead.
    #[cold]
    #[inline(never)]
    fn unless_raised(&mut self, value: f64) -> f64 {
        self.seen = RAISED.load(Ordering::Relaxed);
        if RAISED_HERE.take() {
            f64::NAN
        } else {
            value
        }
    }
}

impl Parametrised for CompiledForce {
    fn values(&mut self) -> &mut [f64] {
        &mut self.parameters[..self.n]
    }
}

impl NativeForce for CompiledForce {
    type Differentiable = Differenced<Self>;

    fn differentiable(self, duration: f64) -> Differenced<Self> {
        Differenced::new(self, duration)
    }

    fn parameter(&mut self, index: usize) -> Result<&mut f64, usize> {
        let n = self.n;
        self.parameters[..n].get_mut(index).ok_or_else(|| index - n)
    }

    /// Earlier exceptions are ignored.
    fn listening(self) -> Self {
        Self { seen: RAISED.load(Ordering::Relaxed), ..self }
    }

    fn address(&self) -> Option<usize> {
        Some(self.address)
    }
}

impl<E> Force<E> for CompiledForce {
    #[inline]
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        // SAFETY: the Python layer (`zivi.system`) passes only the address of a function whose
        // declared signature it has compared with PLAIN or WITH_DATA, and `Force` holds
        // the object that owns the code.
        let value = unsafe {
            match self.data {
                _ if self.n > 0 => self.with_parameters(t, x, xdot),
                None => std::mem::transmute::<usize, Plain>(self.address)(t, x, xdot),
                Some(data) => std::mem::transmute::<usize, WithData>(self.address)(
                    t,
                    x,
                    xdot,
                    data as *mut c_void,
                ),
            }
        };
        // all threads share one counter, which is cheap to read
        let quiet = RAISED.load(Ordering::Relaxed) == self.seen;
        Ok(if quiet { value } else { self.unless_raised(value) })
    }

    fn shortest_period(&self) -> Option<f64> {
        (!self.reads_time).then_some(f64::INFINITY)
    }
}

impl CompiledForce {
    /// That of a `scipy.LowLevelCallable`, after a check of its signature.
    pub(crate) fn of_low_level(callable: &Bound<'_, PyTuple>, argument: &str) -> PyResult<Self> {
        let Capsule { address, data, signature } = Capsule::of(callable, argument)?;
        let squeezed = |text: &str| text.replace(' ', "");
        let written = squeezed(&signature);
        if written == squeezed(PLAIN) {
            Self::new(address, None, &[])
        } else if written == squeezed(WITH_DATA) {
            Self::new(address, Some(data), &[])
        } else {
            Err(PyTypeError::new_err(format!(
                "{argument} must have the signature {PLAIN:?} (or {WITH_DATA:?}), got {signature:?}"
            )))
        }
    }
}
