//! Mechanical systems that come from Python.

use std::ffi::{c_int, c_void};

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyCapsuleMethods, PyTuple};
use zivi::system::dynamics::{Dynamics, Layout};

use crate::force::Raised;

type Evaluate = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64) -> c_int;
type EvaluateWith =
    unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64, *mut c_void) -> c_int;
type Fill = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64);
type FillWith = unsafe extern "C" fn(f64, *const f64, *const f64, *mut f64, *mut c_void);

/// What a compiled system is called with, after what it returns.
const ARGUMENTS: &str = "(double,double*,double*,double*";

/// A system as the Python layer hands it over, a tuple that starts with its kind.
pub(crate) enum DynamicsSpec<'py> {
    Compiled(CompiledDynamics),
    Callable(PythonDynamics<'py>),
}

impl<'py> DynamicsSpec<'py> {
    pub(crate) fn from_tuple(spec: &Bound<'py, PyTuple>, layout: Layout) -> PyResult<Self> {
        let kind: String = spec.get_item(0)?.extract()?;
        match kind.as_str() {
            "compiled" => Ok(Self::Compiled(CompiledDynamics {
                layout,
                address: spec.get_item(1)?.extract()?,
                data: spec.get_item(2)?.extract()?,
                returns_int: spec.get_item(3)?.extract()?,
                raised: Raised::now(),
            })),
            "callable" => {
                let py = spec.py();
                let zeros = || PyArray1::zeros(py, layout.n, false);
                let (callable, q, w) = (spec.get_item(1)?, zeros(), zeros());
                Ok(Self::Callable(PythonDynamics { layout, callable, q, w }))
            }
            other => Err(PyValueError::new_err(format!("unknown kind of system {other:?}"))),
        }
    }
}

/// A compiled function, called without the interpreter. Whoever made the tuple keeps it alive.
#[derive(Clone, Copy)]
pub(crate) struct CompiledDynamics {
    layout: Layout,
    address: usize,
    data: Option<usize>,
    returns_int: bool,
    raised: Raised,
}

impl Dynamics<PyErr> for CompiledDynamics {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        let (q, w, to) = (q.as_ptr(), w.as_ptr(), out.as_mut_ptr());
        // SAFETY: the Python layer passes only the address of a function whose signature was
        // checked or declared, and holds the object that owns the code for the duration of the
        // run; `q` and `w` have n numbers, `out` as many as the layout says.
        let code = unsafe {
            match (self.data.map(|data| data as *mut c_void), self.returns_int) {
                (None, true) => std::mem::transmute::<usize, Evaluate>(self.address)(t, q, w, to),
                (Some(data), true) => {
                    std::mem::transmute::<usize, EvaluateWith>(self.address)(t, q, w, to, data)
                }
                (None, false) => {
                    std::mem::transmute::<usize, Fill>(self.address)(t, q, w, to);
                    0
                }
                (Some(data), false) => {
                    std::mem::transmute::<usize, FillWith>(self.address)(t, q, w, to, data);
                    0
                }
            }
        };
        if code != 0 || self.raised.here() {
            return Err(PyRuntimeError::new_err(format!(
                "the compiled system failed at t = {t:?} (it returned {code})"
            )));
        }
        Ok(())
    }
}

/// A Python callable; the interpreter lock is held for the whole run.
pub(crate) struct PythonDynamics<'py> {
    layout: Layout,
    callable: Bound<'py, PyAny>,
    /// What it is called with.
    q: Bound<'py, PyArray1<f64>>,
    w: Bound<'py, PyArray1<f64>>,
}

impl Dynamics<PyErr> for PythonDynamics<'_> {
    fn layout(&self) -> Layout {
        self.layout
    }

    fn evaluate(&mut self, t: f64, q: &[f64], w: &[f64], out: &mut [f64]) -> PyResult<()> {
        fill(&self.q, q)?;
        fill(&self.w, w)?;
        let value = self.callable.call1((t, &self.q, &self.w))?;
        let array = value.cast::<PyArray1<f64>>().map_err(|_| {
            let kind = value.get_type();
            PyTypeError::new_err(format!("the system must return an array of float64, got {kind}"))
        })?;
        if array.len() != out.len() {
            let (got, wanted) = (array.len(), out.len());
            return Err(PyValueError::new_err(format!(
                "the system must return {wanted} numbers, got {got}"
            )));
        }
        let readable = array.readonly();
        for (out, value) in out.iter_mut().zip(readable.as_array()) {
            *out = *value;
        }
        Ok(())
    }
}

/// Writes numbers into an array that only this module and what it calls know.
pub(crate) fn fill(array: &Bound<'_, PyArray1<f64>>, values: &[f64]) -> PyResult<()> {
    let mut writable = array.try_readwrite().map_err(|_| {
        PyRuntimeError::new_err("the arrays that a system is called with must not be locked")
    })?;
    for (to, value) in writable.as_array_mut().iter_mut().zip(values) {
        *to = *value;
    }
    Ok(())
}

/// `(address, user data or None, whether it returns an int)` of a `scipy.LowLevelCallable`, after a
/// check of its signature.
#[pyfunction]
pub(crate) fn compiled_model(
    callable: &Bound<'_, PyTuple>,
    argument: &str,
) -> PyResult<(usize, Option<usize>, bool)> {
    let item = callable.get_item(0)?;
    let capsule = item.cast::<PyCapsule>().map_err(|_| {
        PyTypeError::new_err(format!("{argument}: the LowLevelCallable holds no function capsule"))
    })?;
    let name = capsule.name()?;
    // SAFETY: the capsule is alive and nobody renames it while its name is read here
    let signature: String =
        name.map_or(String::new(), |name| unsafe { name.as_cstr() }.to_string_lossy().into());
    let address = capsule.pointer_checked(name.map(|name| unsafe { name.as_cstr() }))?;
    // SAFETY: reading the context of a live capsule
    let data = capsule.context()? as usize;
    let written = signature.replace("const", "").replace(' ', "");
    for (returns, returns_int) in [("int", true), ("void", false)] {
        if written == format!("{returns}{ARGUMENTS})") {
            return Ok((address.as_ptr() as usize, None, returns_int));
        }
        if written == format!("{returns}{ARGUMENTS},void*)") {
            return Ok((address.as_ptr() as usize, Some(data), returns_int));
        }
    }
    Err(PyTypeError::new_err(format!(
        "{argument} must have the signature \"int (double, double *, double *, double *)\" (or void, \
         or with a last \"void *\"), got {signature:?}"
    )))
}

/// A NumPy vector as a slice; a TypeError-free copy where it is not contiguous.
pub(crate) fn vector(array: &PyReadonlyArray1<'_, f64>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}
