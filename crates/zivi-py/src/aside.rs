//! Memory for libraries whose allocations may not fail: it is set aside first.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use pyo3::PyResult;

use crate::interface::with_room;

thread_local! {
    /// Memory that this thread has set aside.
    static ASIDE: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
}

/// The allocator of the system. If it fails, the thread's reserve is returned to it and the request
/// is repeated.
struct WithAside;

#[global_allocator]
static ALLOCATOR: WithAside = WithAside;

/// Whether something was set aside, which is given back.
#[cold]
fn give_back() -> bool {
    // not where a thread ends
    ASIDE.try_with(Cell::take).is_ok_and(|block| block.capacity() > 0)
}

// SAFETY: all is the system's
unsafe impl GlobalAlloc for WithAside {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's layout
        let ask = || unsafe { System.alloc(layout) };
        once_more(ask)
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's layout
        let ask = || unsafe { System.alloc_zeroed(layout) };
        once_more(ask)
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller's block, unchanged if there is no longer one
        let ask = || unsafe { System.realloc(block, layout, size) };
        once_more(ask)
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's block and layout
        unsafe { System.dealloc(block, layout) }
    }
}

#[inline(always)]
fn once_more(ask: impl Fn() -> *mut u8) -> *mut u8 {
    let block = ask();
    if block.is_null() && give_back() {
        return ask();
    }
    block
}

/// Runs `work`, which needs at most this number of bytes and would abort without them; a
/// `MemoryError` if they are not available.
pub(crate) fn with_aside<R>(bytes: usize, work: impl FnOnce() -> R) -> PyResult<R> {
    ASIDE.set(with_room(bytes)?);
    let result = work();
    ASIDE.take();
    Ok(result)
}
