//! Ctrl-C and progress: looking at the interpreter now and then during a run.

use pyo3::prelude::*;
use zivi::Monitor;

use crate::leaving;

/// Lets Python handle its signals, and reports the fraction done to a callable.
pub(crate) struct Watch {
    pub(crate) progress: Option<Py<PyAny>>,
}

impl Monitor<PyErr> for Watch {
    fn poll(&mut self, done: usize, of: usize) -> PyResult<()> {
        leaving::look()?;
        Python::attach(|py| {
            py.check_signals()?;
            match &self.progress {
                Some(report) => report.call1(py, (done, of)).map(drop),
                None => Ok(()),
            }
        })
    }

    fn record_allocated(&mut self, start: *const f64, len: usize) {
        advise(start, len);
    }
}

/// Tells the system what so many numbers that are about to be filled are for.
pub(crate) fn advise(start: *const f64, len: usize) {
    advise_large_pages(start as usize, len * size_of::<f64>());
}

/// Asks for large pages behind memory that is about to be filled (as NumPy does for its own large
/// arrays): with small ones, fresh memory costs more than the steps. Advice only; errors do not
/// matter.
#[cfg(target_os = "linux")]
fn advise_large_pages(start: usize, bytes: usize) {
    const PAGE: usize = 4096;
    const LARGE: usize = 1 << 22;
    if bytes < LARGE {
        return;
    }
    let aligned = start.next_multiple_of(PAGE);
    // SAFETY: the range lies in one live allocation, and the advice changes no content
    unsafe {
        libc::madvise(aligned as *mut libc::c_void, start + bytes - aligned, libc::MADV_HUGEPAGE);
    }
}

#[cfg(not(target_os = "linux"))]
fn advise_large_pages(_start: usize, _bytes: usize) {}
