//! What a `scipy.LowLevelCallable` holds.

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyCapsuleMethods, PyTuple};

/// A function with the data that it is called with, and how its signature is written.
pub(crate) struct Capsule {
    pub(crate) address: usize,
    pub(crate) data: usize,
    pub(crate) signature: String,
}

impl Capsule {
    pub(crate) fn of(callable: &Bound<'_, PyTuple>, argument: &str) -> PyResult<Self> {
        let item = callable.get_item(0)?;
        let capsule = item.cast::<PyCapsule>().map_err(|_| {
            PyTypeError::new_err(format!(
                "{argument}: the LowLevelCallable holds no function capsule"
            ))
        })?;
        let name = capsule.name()?;
        // SAFETY: the capsule is alive and nobody renames it while its name is read here
        let signature =
            name.map_or(String::new(), |name| unsafe { name.as_cstr() }.to_string_lossy().into());
        let address = capsule.pointer_checked(name.map(|name| unsafe { name.as_cstr() }))?;
        // SAFETY: reading the context of a live capsule
        let data = capsule.context()? as usize;
        Ok(Self { address: address.as_ptr() as usize, data, signature })
    }
}
