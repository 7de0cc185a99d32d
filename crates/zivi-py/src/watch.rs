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

    fn record_allocated(&mut self, memory: &mut [f64]) {
        advise_large_pages(memory);
    }
}

/// Asks for large pages behind a block that is about to be filled (as NumPy does for its own
/// arrays): with small ones, fresh memory costs more than the steps. Advice only; errors do not
/// matter.
#[cfg(target_os = "linux")]
fn advise_large_pages(memory: &mut [f64]) {
    const PAGE: usize = 4096;
    const LARGE: usize = 1 << 22;
    let bytes = std::mem::size_of_val(memory);
    if bytes < LARGE {
        return;
    }
    let start = memory.as_mut_ptr() as usize;
    let aligned = start.next_multiple_of(PAGE);
    // SAFETY: the range lies in `memory`, and the advice changes no content
    unsafe {
        libc::madvise(aligned as *mut libc::c_void, start + bytes - aligned, libc::MADV_HUGEPAGE);
    }
}

#[cfg(not(target_os = "linux"))]
fn advise_large_pages(_memory: &mut [f64]) {}
