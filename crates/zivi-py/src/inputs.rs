//! How controls act on a mechanical system.

use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::system::dynamics::{Driven, InputMatrix};

use crate::dynamics::{AnyDynamics, CompiledDynamics, CompiledFunction};
use crate::friction::Rubbing;
use crate::system::Mechanism;

/// The matrix of inputs `B` of a mechanical system.
#[pyclass(frozen, module = "zivi._zivi", name = "Inputs")]
pub(crate) struct PyInputs {
    /// How many.
    pub(crate) r: usize,
    kind: InputsKind,
}

enum InputsKind {
    Constant(Vec<f64>),
    /// A compiled function and its owner.
    Compiled(CompiledFunction, Py<PyAny>),
    /// A function of `(t, q)` that gives an array.
    Callable(Py<PyAny>),
}

#[pymethods]
impl PyInputs {
    /// A constant matrix, row by row.
    #[staticmethod]
    fn constant(r: usize, matrix: Vec<f64>) -> Self {
        Self { r, kind: InputsKind::Constant(matrix) }
    }

    /// As `Model.compiled`; it fills in the matrix row by row.
    #[staticmethod]
    fn compiled(r: usize, address: usize, data: usize, owner: Py<PyAny>) -> Self {
        let function = CompiledFunction::with_data(address, data);
        Self { r, kind: InputsKind::Compiled(function, owner) }
    }

    /// A function of time and coordinates that gives a contiguous matrix.
    #[staticmethod]
    fn callable(r: usize, function: Py<PyAny>) -> Self {
        Self { r, kind: InputsKind::Callable(function) }
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.kind {
            InputsKind::Constant(_) => Ok(()),
            InputsKind::Compiled(_, held) | InputsKind::Callable(held) => visit.call(held),
        }
    }
}

/// The matrix of inputs as a function of time and coordinates.
pub(crate) type Matrices<'a> = Box<dyn FnMut(f64, &[f64], &mut [f64]) -> PyResult<()> + 'a>;

/// The same without the interpreter.
pub(crate) type NativeMatrices = Box<dyn FnMut(f64, &[f64], &mut [f64]) -> PyResult<()> + Send>;

/// A system, evaluated with or without the interpreter, with its controls.
pub(crate) type Evaluated<'a, 'py> = Driven<Rubbing<'a, AnyDynamics<'py>>, Matrices<'a>>;

/// A system that needs no interpreter, with its controls.
pub(crate) type Native<'a> = Driven<Rubbing<'a, CompiledDynamics>, NativeMatrices>;

impl PyInputs {
    /// The matrix; `None` if it needs the interpreter.
    fn native(&self) -> Option<InputMatrix<NativeMatrices>> {
        match &self.kind {
            InputsKind::Constant(matrix) => Some(InputMatrix::Constant(matrix.clone())),
            InputsKind::Compiled(function, _) => {
                let function = *function;
                Some(InputMatrix::Function(Box::new(move |t, q, out| {
                    match function.call(t, q, q, out) {
                        0 => Ok(()),
                        code => Err(PyRuntimeError::new_err(format!(
                            "the compiled inputs failed at t = {t:?} (they returned {code})"
                        ))),
                    }
                })))
            }
            InputsKind::Callable(_) => None,
        }
    }

    fn matrix<'a>(&'a self, py: Python<'a>) -> InputMatrix<Matrices<'a>> {
        if let InputsKind::Callable(function) = &self.kind {
            let function = function.bind(py).clone();
            return InputMatrix::Function(Box::new(move |t, q, out| {
                let q = PyArray1::from_slice(function.py(), q);
                let value = function.call1((t, q))?;
                let array = value.cast::<numpy::PyArray2<f64>>()?;
                if array.len() != out.len() {
                    let (got, wanted) = (array.len(), out.len());
                    let message = format!("inputs must give {wanted} numbers, got {got}");
                    return Err(PyValueError::new_err(message));
                }
                let readable = array.readonly();
                out.iter_mut().zip(readable.as_array()).for_each(|(to, &from)| *to = from);
                Ok(())
            }));
        }
        match self.native() {
            Some(InputMatrix::Function(function)) => InputMatrix::Function(function),
            Some(InputMatrix::Constant(matrix)) => InputMatrix::Constant(matrix),
            None => InputMatrix::Constant(Vec::new()),
        }
    }

    /// A system with these controls.
    pub(crate) fn driven<'a>(
        &'a self,
        py: Python<'a>,
        system: &'a Mechanism,
    ) -> PyResult<Evaluated<'a, 'a>> {
        let size = (system.n, self.r);
        Driven::new(system.rubbing(py), size, self.matrix(py)).ok_or_else(wrong_shape)
    }

    /// The same without the interpreter; `None` if the interpreter is needed.
    pub(crate) fn driven_alone<'a>(
        &self,
        py: Python<'_>,
        system: &'a Mechanism,
    ) -> Option<Native<'a>> {
        Driven::new(system.rubbing_alone(py)?, (system.n, self.r), self.native()?)
    }
}

fn wrong_shape() -> PyErr {
    PyValueError::new_err("inputs must be a matrix of shape (n, r)")
}
