//! Interface of Python and Rust: arrays, errors, capsules, calls, orderings, interrupts.

use std::alloc::{alloc_zeroed, GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::convert::Infallible;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use numpy::{Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::{
    PyKeyboardInterrupt, PyMemoryError, PySystemExit, PyTypeError, PyValueError,
};
use pyo3::ffi::{PyObject, PyObject_CallFunctionObjArgs};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyAnyMethods, PyCapsule, PyCapsuleMethods, PyTuple};
use pyo3::PyResult;
use zivi::drive::batch::Stop;
use zivi::mechanics::GapSet;
use zivi::{Monitor, SetupError};

// NumPy arrays of the results of a run.

pub(crate) type Vector<T> = Py<PyArray1<T>>;

pub(crate) type Matrix<T> = Py<PyArray2<T>>;

/// The error for too many numbers.
fn no_room(n: usize) -> PyErr {
    PyMemoryError::new_err(format!("an array of {n} numbers does not fit into memory"))
}

/// An empty list with a capacity; a `MemoryError` if it does not fit.
pub(crate) fn with_room<T>(n: usize) -> PyResult<Vec<T>> {
    let mut list = Vec::new();
    list.try_reserve_exact(n).map_err(|_| no_room(n))?;
    Ok(list)
}

/// A list of values; a `MemoryError` where it does not fit (a `collect` would end the process).
pub(crate) fn list<T>(values: impl IntoIterator<Item = T>) -> PyResult<Vec<T>> {
    let values = values.into_iter();
    let (least, most) = values.size_hint();
    if most != Some(least) {
        return try_list(values.map(Ok));
    }
    let mut list = with_room(least)?;
    list.extend(values);
    Ok(list)
}

/// The same of values each of which may fail.
pub(crate) fn try_list<T>(values: impl IntoIterator<Item = PyResult<T>>) -> PyResult<Vec<T>> {
    let values = values.into_iter();
    let mut list = with_room(values.size_hint().0)?;
    for value in values {
        if list.len() == list.capacity() {
            list.try_reserve(1).map_err(|_| no_room(2 * list.len()))?;
        }
        list.push(value?);
    }
    Ok(list)
}

/// The same as an array.
pub(crate) fn array<T: Element>(
    py: Python<'_>,
    values: impl IntoIterator<Item = T>,
) -> PyResult<Vector<T>> {
    Ok(PyArray1::from_vec(py, list(values)?).unbind())
}

/// So many zeros, which take memory when they are written.
pub(crate) fn zeros(n: usize) -> PyResult<Vec<f64>> {
    let layout = Layout::array::<f64>(n).map_err(|_| no_room(n))?;
    if n == 0 {
        return Ok(Vec::new());
    }
    // SAFETY: the layout is not empty
    let start = unsafe { alloc_zeroed(layout) }.cast::<f64>();
    if start.is_null() {
        return Err(no_room(n));
    }
    // SAFETY: from the global allocator with the layout of `n` numbers; zeros are valid numbers
    Ok(unsafe { Vec::from_raw_parts(start, n, n) })
}

/// Rows of a matrix from one list: the columns `from .. from + width` of rows of length `stride`.
pub(crate) fn columns(
    py: Python<'_>,
    values: &[f64],
    stride: usize,
    from: usize,
    width: usize,
) -> PyResult<Matrix<f64>> {
    let rows = values.len().checked_div(stride).unwrap_or(0);
    let picked = values.chunks_exact(stride.max(1)).flat_map(|row| row[from..][..width].iter());
    let mut all = with_room(rows * width)?;
    all.extend(picked);
    Ok(PyArray1::from_vec(py, all).reshape([rows, width])?.unbind())
}

/// Which gaps are in each of the sets.
pub(crate) fn members(py: Python<'_>, sets: &[GapSet], m: usize) -> PyResult<Matrix<bool>> {
    let all = sets.iter().flat_map(|set| (0..m).map(|gap| set.has(gap)));
    Ok(array(py, all)?.into_bound(py).reshape([sets.len(), m])?.unbind())
}

pub(crate) type Array = Py<PyArray1<f64>>;

/// A NumPy vector as a slice, copied unless contiguous.
pub(crate) fn vector(array: &PyReadonlyArray1<'_, f64>) -> PyResult<Vec<f64>> {
    list(array.as_array().iter().copied())
}

/// A motion as numbers, if they fit into memory.
pub(crate) fn stored(
    py: Python<'_>,
    numbers: Option<Vec<f64>>,
) -> PyResult<Bound<'_, PyArray1<f64>>> {
    let refused =
        || PyMemoryError::new_err("the motion of a run as numbers does not fit into memory");
    Ok(PyArray1::from_vec(py, numbers.ok_or_else(refused)?))
}

// Errors of a set-up as Python exceptions, and exceptions of a run.

/// The exception that ended a run; the first read takes it. Its traceback knows the frames that know
/// the record: a record that kept it would keep itself.
pub(crate) struct EndedBy(Mutex<Option<PyErr>>);

impl EndedBy {
    pub(crate) fn new(error: Option<PyErr>) -> Self {
        Self(Mutex::new(error))
    }
}

impl<'py> IntoPyObject<'py> for &EndedBy {
    type Target = PyAny;
    type Output = Bound<'py, PyAny>;
    type Error = Infallible;

    fn into_pyobject(self, py: Python<'py>) -> Result<Self::Output, Self::Error> {
        let taken = self.0.lock().ok().and_then(|mut held| held.take());
        Ok(match taken {
            Some(error) => error.into_value(py).into_bound(py).into_any(),
            None => py.None().into_bound(py),
        })
    }
}

pub(crate) fn setup_error(error: SetupError) -> PyErr {
    match error {
        SetupError::Memory(_) | SetupError::BatchMemory { .. } | SetupError::Threads(_) => {
            PyMemoryError::new_err(error.to_string())
        }
        _ => PyValueError::new_err(error.to_string()),
    }
}

// Content of a `scipy.LowLevelCallable`.

/// A function with its data argument and the text of its signature.
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

// Calls of Python functions without a tuple of their arguments.
//
// `PyObject_Vectorcall` is public since Python 3.9, but in the stable interface from 3.12 on only:
// an extension that supports 3.11 must not be linked to it and looks it up by name at run time.

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

    /// Its value for one argument.
    pub(crate) fn call_with_one(&self, one: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        self.callable.call1((one,))
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
        // SAFETY: objects that outlive the call, after one writable slot or terminated by null; it
        // returns a new object, or null with an error
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

// Ctrl-C and progress: looking at the interpreter now and then during a run.

/// Lets Python handle its signals, and reports the fraction done to a callable.
pub(crate) struct Watch<'a> {
    progress: Option<Py<PyAny>>,
    /// For a run in a thread of a batch: whether the batch stops.
    stop: Option<Stop<'a>>,
}

impl<'a> Watch<'a> {
    pub(crate) fn reporting(progress: Option<Py<PyAny>>) -> Self {
        Self { progress, stop: None }
    }

    /// Of a run in another thread than that of the caller, who looks after signals.
    pub(crate) fn stopped_by(stop: Stop<'a>) -> Self {
        Self { progress: None, stop: Some(stop) }
    }
}

impl Monitor<PyErr> for Watch<'_> {
    fn poll(&mut self, done: usize, of: usize) -> PyResult<()> {
        look()?;
        if let Some(stop) = self.stop {
            return match stop() {
                true => Err(PyKeyboardInterrupt::new_err("the batch was stopped")),
                false => Ok(()),
            };
        }
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

/// Advises the system about memory that is about to be filled.
pub(crate) fn advise(start: *const f64, len: usize) {
    advise_large_pages(start as usize, len * size_of::<f64>());
}

/// Requests large pages for memory that is about to be filled (NumPy does so for large arrays):
/// with small ones, fresh memory costs more than the steps. Advice only; errors do not matter.
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

// The end of the interpreter while runs go on in other threads.
//
// Before Python 3.14, a thread that requests the lock of a finalised interpreter is terminated by
// it through its callers: Rust frames cannot be unwound that way, and the process aborts. Hence
// the interpreter waits at its exit until the runs of other threads have stopped, and none begins.

static LEAVING: AtomicBool = AtomicBool::new(false);
static RUNNING: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Runs of this thread, one in the force of another.
    static OWN: Cell<usize> = const { Cell::new(0) };
    /// Whether this thread ends the interpreter: it may go on.
    static ENDS: Cell<bool> = const { Cell::new(false) };
}

/// A call that may give the lock away before it returns.
pub(crate) struct UnlockedCall;

/// Begins a run; `SystemExit`, of which threads make no words, if the interpreter ends.
pub(crate) fn running() -> PyResult<UnlockedCall> {
    RUNNING.fetch_add(1, Ordering::SeqCst);
    OWN.set(OWN.get() + 1);
    let run = UnlockedCall;
    look().map(|()| run)
}

impl Drop for UnlockedCall {
    fn drop(&mut self) {
        OWN.set(OWN.get() - 1);
        RUNNING.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Whether to go on; needs no lock.
#[inline]
pub(crate) fn look() -> PyResult<()> {
    if LEAVING.load(Ordering::SeqCst) {
        return look_while_leaving();
    }
    Ok(())
}

#[cold]
fn look_while_leaving() -> PyResult<()> {
    if ENDS.get() {
        return Ok(());
    }
    Err(PySystemExit::new_err("the interpreter ends"))
}

/// Asks the runs of other threads to stop and waits until they have; False if some have not.
#[pyfunction]
pub(crate) fn stop_runs(py: Python<'_>, seconds: f64) -> bool {
    ENDS.set(true);
    LEAVING.store(true, Ordering::SeqCst);
    let end = Instant::now() + Duration::from_secs_f64(seconds.clamp(0.0, 1e6));
    while RUNNING.load(Ordering::SeqCst) > OWN.get() {
        if Instant::now() > end {
            return false;
        }
        py.detach(|| std::thread::sleep(Duration::from_millis(1)));
    }
    true
}

/// Forgets the runs of threads that a fork has not taken over.
#[pyfunction]
pub(crate) fn forget_runs() {
    RUNNING.store(OWN.get(), Ordering::SeqCst);
}

// Memory for libraries whose allocations may not fail: it is set aside first.

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
