//! Walls that move.

use pyo3::gc::{PyTraverseError, PyVisit};
use pyo3::prelude::*;
use zivi::system::linear_system::GapMotion;
use zivi::{HarmonicWall, WallMotion};

use crate::time_table::PyTimeTable;

/// The motion of a wall, of one of its kinds.
#[pyclass(frozen, module = "zivi._zivi")]
pub(crate) struct Wall {
    kind: Kind,
}

enum Kind {
    Harmonic(HarmonicWall),
    /// Moves as the first column.
    Table(Py<PyTimeTable>),
    /// Gives position, velocity and acceleration.
    Callable(Py<PyAny>),
}

#[pymethods]
impl Wall {
    #[staticmethod]
    #[pyo3(signature = (*, amplitude, omega, phase, offset))]
    fn harmonic(amplitude: f64, omega: f64, phase: f64, offset: f64) -> Self {
        Self { kind: Kind::Harmonic(HarmonicWall { amplitude, omega, phase, offset }) }
    }

    #[staticmethod]
    fn table(table: Py<PyTimeTable>) -> Self {
        Self { kind: Kind::Table(table) }
    }

    #[staticmethod]
    fn callable(motion: Py<PyAny>) -> Self {
        Self { kind: Kind::Callable(motion) }
    }

    /// Whether runs do without the interpreter.
    #[getter]
    pub(crate) fn is_native(&self) -> bool {
        matches!(self.kind, Kind::Harmonic(_))
    }

    fn __traverse__(&self, visit: PyVisit<'_>) -> Result<(), PyTraverseError> {
        match &self.kind {
            Kind::Harmonic(_) => Ok(()),
            Kind::Table(table) => visit.call(table),
            Kind::Callable(motion) => visit.call(motion),
        }
    }
}

impl Wall {
    /// The motion of the wall of a gap, without the interpreter.
    pub(crate) fn motion_of_gap(&self) -> Option<GapMotion> {
        match &self.kind {
            Kind::Harmonic(wall) => Some(GapMotion::Harmonic(*wall)),
            Kind::Table(table) => Some(GapMotion::Table(table.get().inner.clone())),
            Kind::Callable(_) => None,
        }
    }
}

/// A wall prepared for evaluation.
pub(crate) enum AnyWall<'py> {
    Harmonic(HarmonicWall),
    Table(Bound<'py, PyTimeTable>),
    Callable(Bound<'py, PyAny>),
}

impl<'py> AnyWall<'py> {
    pub(crate) fn of(py: Python<'py>, wall: &Wall) -> Self {
        match &wall.kind {
            Kind::Harmonic(wall) => Self::Harmonic(*wall),
            Kind::Table(table) => Self::Table(table.bind(py).clone()),
            Kind::Callable(motion) => Self::Callable(motion.bind(py).clone()),
        }
    }
}

impl WallMotion<PyErr> for AnyWall<'_> {
    fn at(&mut self, t: f64) -> PyResult<[f64; 3]> {
        match self {
            Self::Harmonic(wall) => wall.at(t),
            Self::Table(table) => Ok(table.get().inner.motion(t, 0)),
            Self::Callable(motion) => {
                let (w, wdot, wddot) = motion.call1((t,))?.extract()?;
                Ok([w, wdot, wddot])
            }
        }
    }

    fn harmonic(&self) -> Option<HarmonicWall> {
        match self {
            Self::Harmonic(wall) => Some(*wall),
            Self::Table(_) | Self::Callable(_) => None,
        }
    }
}
