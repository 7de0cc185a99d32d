//! Forces that come from Python.

use std::cell::Cell;
use std::ffi::c_void;
use std::sync::atomic::{AtomicUsize, Ordering};

use pyo3::exceptions::{PyException, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyCapsuleMethods, PyTuple};
use zivi::system::slopes::Parametrised;
use zivi::{Dependence, Force, HarmonicWall, LinearLaw, OnMovingWall, WallMotion};

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

const PLAIN: &str = "double (double, double, double)";
const WITH_DATA: &str = "double (double, double, double, void *)";

/// A force as the Python layer hands it over, a tuple that starts with its kind.
pub(crate) enum ForceSpec<'py> {
    Constant(f64),
    Linear(zivi::LinearForce),
    Compiled(CompiledForce),
    Callable(PythonForce<'py>),
    /// Any of these above a moving wall, seen from the wall.
    Moving(Box<OnMovingWall<ForceSpec<'py>, WallSpec<'py>>>),
}

/// The motion of a wall, a tuple that starts with its kind.
pub(crate) enum WallSpec<'py> {
    Harmonic(HarmonicWall),
    /// A callable that gives position, velocity and acceleration.
    Callable(Bound<'py, PyAny>),
}

impl<'py> WallSpec<'py> {
    pub(crate) fn from_tuple(spec: &Bound<'py, PyTuple>) -> PyResult<Self> {
        let kind: String = spec.get_item(0)?.extract()?;
        match kind.as_str() {
            "harmonic" => {
                let number = |k: usize| -> PyResult<f64> { spec.get_item(k)?.extract() };
                Ok(Self::Harmonic(HarmonicWall {
                    amplitude: number(1)?,
                    omega: number(2)?,
                    phase: number(3)?,
                    offset: number(4)?,
                }))
            }
            "callable" => Ok(Self::Callable(spec.get_item(1)?)),
            other => Err(PyValueError::new_err(format!("unknown kind of wall {other:?}"))),
        }
    }
}

impl WallMotion<PyErr> for WallSpec<'_> {
    fn at(&mut self, t: f64) -> PyResult<[f64; 3]> {
        match self {
            Self::Harmonic(wall) => wall.at(t),
            Self::Callable(motion) => {
                let (w, wdot, wddot) = motion.call1((t,))?.extract()?;
                Ok([w, wdot, wddot])
            }
        }
    }

    fn harmonic(&self) -> Option<HarmonicWall> {
        match self {
            Self::Harmonic(wall) => Some(*wall),
            Self::Callable(_) => None,
        }
    }
}

impl<'py> ForceSpec<'py> {
    pub(crate) fn from_tuple(spec: &Bound<'py, PyTuple>) -> PyResult<Self> {
        let kind: String = spec.get_item(0)?.extract()?;
        match kind.as_str() {
            "constant" => Ok(Self::Constant(spec.get_item(1)?.extract()?)),
            "linear" => {
                let number = |k: usize| -> PyResult<f64> { spec.get_item(k)?.extract() };
                Ok(Self::Linear(zivi::LinearForce {
                    stiffness: number(1)?,
                    damping: number(2)?,
                    gravity: number(3)?,
                    amplitude: number(4)?,
                    omega: number(5)?,
                    phase: number(6)?,
                }))
            }
            "compiled" => Ok(Self::Compiled(CompiledForce::from_tuple(spec)?)),
            "callable" => Ok(Self::Callable(PythonForce { callable: spec.get_item(1)? })),
            "moving" => {
                let force = Self::from_tuple(spec.get_item(1)?.cast()?)?;
                let wall = WallSpec::from_tuple(spec.get_item(2)?.cast()?)?;
                Ok(Self::Moving(Box::new(OnMovingWall { force, wall })))
            }
            other => Err(PyValueError::new_err(format!("unknown kind of force {other:?}"))),
        }
    }
}

/// A force that needs no interpreter.
#[derive(Clone, Copy)]
pub(crate) enum NativeForce {
    Constant(zivi::ConstantForce),
    Linear(zivi::LinearForce),
    Compiled(CompiledForce),
    MovingConstant(OnMovingWall<zivi::ConstantForce, HarmonicWall>),
    MovingLinear(OnMovingWall<zivi::LinearForce, HarmonicWall>),
    MovingCompiled(OnMovingWall<CompiledForce, HarmonicWall>),
}

impl ForceSpec<'_> {
    /// The same without the interpreter, unless it is a Python callable.
    pub(crate) fn native(&self) -> Option<NativeForce> {
        match self {
            Self::Constant(value) => Some(NativeForce::Constant(zivi::ConstantForce(*value))),
            Self::Linear(linear) => Some(NativeForce::Linear(*linear)),
            Self::Compiled(compiled) => Some(NativeForce::Compiled(*compiled)),
            Self::Callable(_) => None,
            Self::Moving(moving) => {
                let WallSpec::Harmonic(wall) = moving.wall else { return None };
                match moving.force.native()? {
                    NativeForce::Constant(force) => {
                        Some(NativeForce::MovingConstant(OnMovingWall { force, wall }))
                    }
                    NativeForce::Linear(force) => {
                        Some(NativeForce::MovingLinear(OnMovingWall { force, wall }))
                    }
                    NativeForce::Compiled(force) => {
                        Some(NativeForce::MovingCompiled(OnMovingWall { force, wall }))
                    }
                    _ => None,
                }
            }
        }
    }
}

impl<E> Force<E> for NativeForce {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        match self {
            Self::Constant(force) => force.at(t, x, xdot),
            Self::Linear(force) => force.at(t, x, xdot),
            Self::Compiled(force) => force.at(t, x, xdot),
            Self::MovingConstant(force) => force.at(t, x, xdot),
            Self::MovingLinear(force) => force.at(t, x, xdot),
            Self::MovingCompiled(force) => force.at(t, x, xdot),
        }
    }

    fn dependence(&self) -> Dependence {
        match self {
            Self::Constant(force) => Force::<E>::dependence(force),
            Self::Linear(force) => Force::<E>::dependence(force),
            Self::Compiled(force) => Force::<E>::dependence(force),
            Self::MovingConstant(force) => Force::<E>::dependence(force),
            Self::MovingLinear(force) => Force::<E>::dependence(force),
            Self::MovingCompiled(force) => Force::<E>::dependence(force),
        }
    }

    fn dependence_at_rest(&self) -> Dependence {
        match self {
            Self::Linear(force) => Force::<E>::dependence_at_rest(force),
            other => Force::<E>::dependence(other),
        }
    }

    fn shortest_period(&self) -> Option<f64> {
        match self {
            Self::Constant(force) => Force::<E>::shortest_period(force),
            Self::Linear(force) => Force::<E>::shortest_period(force),
            _ => None,
        }
    }

    fn linear(&self) -> Option<LinearLaw> {
        match self {
            Self::Constant(force) => Force::<E>::linear(force),
            Self::Linear(force) => Force::<E>::linear(force),
            Self::MovingConstant(force) => Force::<E>::linear(force),
            Self::MovingLinear(force) => Force::<E>::linear(force),
            Self::Compiled(_) | Self::MovingCompiled(_) => None,
        }
    }
}

impl Force<PyErr> for ForceSpec<'_> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<f64> {
        match self {
            Self::Constant(value) => Ok(*value),
            Self::Linear(force) => force.at(t, x, xdot),
            Self::Compiled(force) => force.at(t, x, xdot),
            Self::Callable(force) => force.at(t, x, xdot),
            Self::Moving(force) => force.at(t, x, xdot),
        }
    }

    fn dependence(&self) -> Dependence {
        if let Self::Moving(moving) = self {
            return moving.dependence();
        }
        self.native().map_or(Dependence::State, |force| Force::<PyErr>::dependence(&force))
    }

    fn dependence_at_rest(&self) -> Dependence {
        match self {
            Self::Linear(force) => Force::<PyErr>::dependence_at_rest(force),
            other => other.dependence(),
        }
    }

    fn shortest_period(&self) -> Option<f64> {
        self.native().and_then(|force| Force::<PyErr>::shortest_period(&force))
    }

    fn linear(&self) -> Option<LinearLaw> {
        self.native().and_then(|force| Force::<PyErr>::linear(&force))
    }

    fn is_interruption(&self, error: &PyErr) -> bool {
        // KeyboardInterrupt and SystemExit are no Exceptions
        Python::attach(|py| !error.is_instance_of::<PyException>(py))
    }
}

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

/// A look at the exceptions that compiled functions raised.
#[derive(Clone, Copy)]
pub(crate) struct Raised {
    /// Those that were there when this was last looked at.
    seen: usize,
}

impl Raised {
    pub(crate) fn now() -> Self {
        Self { seen: RAISED.load(Ordering::Relaxed) }
    }

    /// Whether the compiled function that this thread called last raised one. The counter is one
    /// for all threads: a look at it costs next to nothing.
    pub(crate) fn here(&mut self) -> bool {
        let count = RAISED.load(Ordering::Relaxed);
        let changed = count != self.seen;
        self.seen = count;
        changed && RAISED_HERE.take()
    }
}

/// A compiled function, called without the interpreter. Whoever made the tuple keeps it alive.
#[derive(Clone, Copy)]
pub(crate) struct CompiledForce {
    address: usize,
    data: Option<usize>,
    /// What is passed behind time and state, so many of them.
    parameters: [f64; MOST_PARAMETERS],
    n: usize,
    /// The exceptions that were there when this was last looked at.
    seen: usize,
}

impl CompiledForce {
    /// `("compiled", address, user data or None)` or the same and the values of its parameters.
    pub(crate) fn from_tuple(spec: &Bound<'_, PyTuple>) -> PyResult<Self> {
        let given: Vec<f64> =
            if spec.len() > 3 { spec.get_item(3)?.extract()? } else { Vec::new() };
        let (n, mut parameters) = (given.len(), [0.0; MOST_PARAMETERS]);
        let Some(values) = parameters.get_mut(..n) else {
            return Err(PyValueError::new_err(format!(
                "a compiled force has at most {MOST_PARAMETERS} parameters, got {n}"
            )));
        };
        values.copy_from_slice(&given);
        let (address, data) = (spec.get_item(1)?.extract()?, spec.get_item(2)?.extract()?);
        Ok(Self { address, data, parameters, n, seen: RAISED.load(Ordering::Relaxed) })
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

impl Parametrised for ForceSpec<'_> {}

impl<E> Force<E> for CompiledForce {
    #[inline]
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> Result<f64, E> {
        // SAFETY: the Python layer (`zivi.system`) passes only the address of a function whose
        // declared signature it has compared with PLAIN or WITH_DATA, and holds the object that
        // owns the code for the duration of the run.
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
        // the counter is one for all threads: a look at it costs next to nothing
        let quiet = RAISED.load(Ordering::Relaxed) == self.seen;
        Ok(if quiet { value } else { self.unless_raised(value) })
    }
}

/// `(address, user data or None)` of a `scipy.LowLevelCallable`, after a check of its signature.
#[pyfunction]
pub(crate) fn compiled_force(
    callable: &Bound<'_, PyTuple>,
    argument: &str,
) -> PyResult<(usize, Option<usize>)> {
    let item = callable.get_item(0)?;
    let capsule = item.cast::<PyCapsule>().map_err(|_| {
        PyTypeError::new_err(format!("{argument}: the LowLevelCallable holds no function capsule"))
    })?;
    let name = capsule.name()?;
    // SAFETY: the capsule is alive and nobody renames it while its name is read here
    let signature =
        name.map_or(String::new(), |name| unsafe { name.as_cstr() }.to_string_lossy().into());
    let address = capsule.pointer_checked(name.map(|name| unsafe { name.as_cstr() }))?;
    // SAFETY: reading the context of a live capsule
    let data = capsule.context()? as usize;
    let squeezed = |text: &str| text.replace(' ', "");
    let written = squeezed(&signature);
    if written == squeezed(PLAIN) {
        Ok((address.as_ptr() as usize, None))
    } else if written == squeezed(WITH_DATA) {
        Ok((address.as_ptr() as usize, Some(data)))
    } else {
        Err(PyTypeError::new_err(format!(
            "{argument} must have the signature {PLAIN:?} (or {WITH_DATA:?}), got {signature:?}"
        )))
    }
}

/// A Python callable; the interpreter lock is held for the whole run.
pub(crate) struct PythonForce<'py> {
    callable: Bound<'py, PyAny>,
}

impl Force<PyErr> for PythonForce<'_> {
    fn at(&mut self, t: f64, x: f64, xdot: f64) -> PyResult<f64> {
        let value = self.callable.call1((t, x, xdot))?;
        value.extract().map_err(|error| {
            let kind = value.get_type();
            let alone = match value.len() {
                Ok(2) => ": the acceleration alone, not [xdot, acceleration]",
                _ => "",
            };
            let message = format!("force(t, x, xdot) must return a float, got {kind}{alone}");
            let named = PyTypeError::new_err(message);
            named.set_cause(value.py(), Some(error));
            named
        })
    }

    fn is_interruption(&self, error: &PyErr) -> bool {
        !error.is_instance_of::<PyException>(self.callable.py())
    }
}
