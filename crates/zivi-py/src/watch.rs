//! Ctrl-C and progress: looking at the interpreter now and then during a run.

use pyo3::prelude::*;
use zivi::Monitor;

/// Lets Python handle its signals, and reports the fraction done to a callable.
pub(crate) struct Watch {
    pub(crate) progress: Option<Py<PyAny>>,
}

impl Monitor<PyErr> for Watch {
    fn poll(&mut self, done: usize, of: usize) -> PyResult<()> {
        Python::attach(|py| {
            py.check_signals()?;
            match &self.progress {
                Some(report) => report.call1(py, (done, of)).map(drop),
                None => Ok(()),
            }
        })
    }
}
