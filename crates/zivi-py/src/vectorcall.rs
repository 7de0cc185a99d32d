//! Calls of Python functions without a tuple of their arguments.
//!
//! `PyObject_Vectorcall` is public since Python 3.9, but in the stable interface from 3.12 on only:
//! an extension for 3.11 as well must not be linked to it, and asks the interpreter for it by name.

use pyo3::ffi::{PyObject, PyObject_CallFunctionObjArgs};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyAnyMethods;

type Vectorcall = unsafe extern "C" fn(
    callable: *mut PyObject,
    arguments: *const *mut PyObject,
    count: usize,
    names: *mut PyObject,
) -> *mut PyObject;

/// The bit of the count that allows the function to write in front of the arguments.
const ROOM_IN_FRONT: usize = 1 << (usize::BITS - 1);

/// Where the function is, if the interpreter tells.
fn vectorcall(py: Python<'_>) -> Option<Vectorcall> {
    static FOUND: PyOnceLock<Option<Vectorcall>> = PyOnceLock::new();
    let find = || -> PyResult<usize> {
        let ctypes = py.import("ctypes")?;
        let function = ctypes.getattr("pythonapi")?.getattr("PyObject_Vectorcall")?;
        let address = ctypes.getattr("cast")?.call1((function, ctypes.getattr("c_void_p")?))?;
        address.getattr("value")?.extract()
    };
    *FOUND.get_or_init(py, || {
        let address = find().ok().filter(|&address| address != 0)?;
        // SAFETY: the function of that name, whose interface is fixed in all versions that have it
        Some(unsafe { std::mem::transmute::<usize, Vectorcall>(address) })
    })
}

/// A Python function that is called often.
pub(crate) struct Function<'py> {
    callable: Bound<'py, PyAny>,
    vectorcall: Option<Vectorcall>,
}

impl<'py> Function<'py> {
    pub(crate) fn new(callable: Bound<'py, PyAny>) -> Self {
        let vectorcall = vectorcall(callable.py());
        Self { callable, vectorcall }
    }

    #[inline]
    pub(crate) fn py(&self) -> Python<'py> {
        self.callable.py()
    }

    /// Its value for two or three arguments.
    #[inline]
    pub(crate) fn call(
        &self,
        one: &Bound<'py, PyAny>,
        two: &Bound<'py, PyAny>,
        three: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let null = std::ptr::null_mut::<PyObject>();
        let function = self.callable.as_ptr();
        let [one, two] = [one, two].map(|it| it.as_ptr());
        let (three, count) = three.map_or((null, 2), |it| (it.as_ptr(), 3));
        // SAFETY: objects that live as long as the call, behind one place that may be written to,
        // or ended by null; it gives a new object, or null with an error
        unsafe {
            let value = match self.vectorcall {
                Some(call) => {
                    let mut places = [null, one, two, three];
                    call(function, places.as_mut_ptr().add(1), count | ROOM_IN_FRONT, null)
                }
                None => PyObject_CallFunctionObjArgs(function, one, two, three, null),
            };
            Bound::from_owned_ptr_or_err(self.py(), value)
        }
    }
}
