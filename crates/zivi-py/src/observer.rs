//! The observer as a Python class.

use crate::interface::with_room;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi_core::observer::{
    Covariance, Estimate, ImpactObserver, Measurement, Memory, ObserverSettings, ObserverState,
    REMEMBERED,
};
use zivi_core::{Physical, Restitution, SettingError};

fn refused(error: SettingError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// `(started, x, xdot, d, [xx, xv, xd, vv, vd, dd], in_a_row, refused)`, the fields of the first
/// version; and since the second its number, whether the velocity waits, `e, xe, ve, de, ee`, how
/// many positions are remembered, and of each `y, age`.
type State = (bool, f64, f64, f64, [f64; 6], u32, u32, [f64; LATER]);
/// The same of the first version.
type First = (bool, f64, f64, f64, [f64; 6], u32, u32);
/// The version of a state, and its additional fields.
const VERSION: f64 = 2.0;
const LATER: usize = 8 + 2 * REMEMBERED;

type Array<'py> = Bound<'py, PyArray1<f64>>;
/// Estimates, their standard deviations, and whether a measurement was rejected.
type Observed<'py> = (Vec<Array<'py>>, Vec<Array<'py>>, Bound<'py, PyArray1<bool>>);

/// The observer; users see its subclass `zivi.ImpactObserver`.
#[pyclass(subclass, module = "zivi._zivi", name = "Observer")]
pub(crate) struct PyObserver {
    pub(crate) inner: ImpactObserver,
}

#[pymethods]
impl PyObserver {
    #[new]
    #[pyo3(signature = (e, h, *, noise, q_d, se, dmax, position_only, learn_e, q_e))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        e: f64,
        h: f64,
        noise: (f64, f64),
        q_d: f64,
        se: f64,
        dmax: f64,
        position_only: bool,
        learn_e: bool,
        q_e: f64,
    ) -> PyResult<Self> {
        let restitution = Restitution::from_e(e);
        let restitution = restitution.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let settings = ObserverSettings::new(restitution, h)
            .and_then(|it| it.with_noise(noise.0, noise.1))
            .and_then(|it| it.with_force(q_d, dmax))
            .and_then(|it| it.with_restitution_error(se))
            .and_then(|it| it.with_learning(learn_e, q_e))
            .map_err(refused)?
            .with_position_only(position_only);
        Ok(Self { inner: ImpactObserver::new(settings) })
    }

    /// Return the estimate at this measurement.
    ///
    /// Parameters
    /// ----------
    /// x : float or None
    ///     Measured distance from the wall (m); noise may make it negative. None or NaN: the
    ///     measurement is missing, the motion is followed and nothing is corrected.
    /// xdot : float, optional
    ///     Measured velocity (m/s); None, NaN or, with ``position_only``, unknown.
    /// force : float
    ///     Known force on the mass over the period that ends with this measurement (m/s^2).
    /// u : float
    ///     Control that acted over that period, after limits and delay (m/s^2). At the first
    ///     measurement both are ignored.
    /// dt : float, optional
    ///     Time since the last call, > 0 (s); by default `h`.
    ///
    /// Returns
    /// -------
    /// (float, float, float)
    ///     Position (m), velocity (m/s) and unknown force (m/s^2); NaN before the first measurement.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the measurement is infinite or another number is not finite. The observer is then
    ///     then.
    #[pyo3(signature = (x, xdot=None, force=0.0, u=0.0, *, dt=None))]
    fn step(
        &mut self,
        x: Option<f64>,
        xdot: Option<f64>,
        force: f64,
        u: f64,
        dt: Option<f64>,
    ) -> PyResult<(f64, f64, f64)> {
        let measured = x.map(|x| Measurement { x, xdot });
        let dt = dt.unwrap_or(self.inner.settings().h());
        let found = self.inner.tick_after(dt, measured, force, u).map_err(refused)?;
        match self.inner.remembered().started {
            true => Ok((found.state.x, found.state.xdot, found.d)),
            false => Ok((f64::NAN, f64::NAN, f64::NAN)),
        }
    }

    /// Forget all measurements.
    fn reset(&mut self) {
        self.inner.reset();
    }

    /// Estimates at recorded measurements, from a fresh start; nothing of this one changes. Forces
    /// and controls are held from their times on. NaN means not measured.
    fn _observe<'py>(
        &self,
        py: Python<'py>,
        t: PyReadonlyArray1<'py, f64>,
        x: PyReadonlyArray1<'py, f64>,
        xdot: PyReadonlyArray1<'py, f64>,
        held: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Observed<'py>> {
        let mut it = self.inner;
        it.reset();
        let (t, x, xdot, held) = (t.as_slice()?, x.as_slice()?, xdot.as_slice()?, held.as_slice()?);
        let mut columns: [Vec<f64>; 8] = Default::default();
        for column in &mut columns {
            *column = with_room(t.len())?;
        }
        let mut out = with_room(t.len())?;
        for (k, (now, x)) in t.iter().zip(x).enumerate() {
            let xdot = xdot.get(k).copied();
            let before = it.state().refused;
            let measured = Measurement { x: *x, xdot };
            match k.checked_sub(1) {
                None => it.tick(measured, 0.0, 0.0),
                Some(last) => it.tick_after(now - t[last], Some(measured), held[last], 0.0),
            }
            .map_err(|error| PyValueError::new_err(format!("measurement {k}: {error}")))?;
            let ObserverState { started, estimate, e, covariance, refused, .. } = it.state();
            let (Estimate { state, d }, Covariance { xx, vv, dd, ee, .. }) = (estimate, covariance);
            let mut row = [state.x, state.xdot, d, e, xx.sqrt(), vv.sqrt(), dd.sqrt(), ee.sqrt()];
            if !started {
                row = [f64::NAN; 8];
            }
            for (column, value) in columns.iter_mut().zip(row) {
                column.push(value);
            }
            out.push(refused > before);
        }
        let mut arrays = columns.into_iter().map(|it| PyArray1::from_vec(py, it));
        let estimates = arrays.by_ref().take(4).collect();
        Ok((estimates, arrays.collect(), PyArray1::from_vec(py, out)))
    }

    #[getter]
    fn _covariance(&self) -> [[f64; 4]; 4] {
        self.inner.state().covariance.rows()
    }

    /// The restitution and its variance.
    #[getter]
    fn _restitution(&self) -> (f64, f64) {
        let ObserverState { e, covariance, .. } = self.inner.state();
        (e, covariance.ee)
    }

    fn _get_state(&self) -> State {
        let ObserverState { started, waiting, estimate, e, covariance, memory, .. } =
            self.inner.state();
        let Estimate { state: Physical { x, xdot }, d } = estimate;
        let Covariance { xx, xv, xd, vv, vd, dd, xe, ve, de, ee } = covariance;
        let first = [xx, xv, xd, vv, vd, dd];
        let ObserverState { in_a_row, refused, .. } = self.inner.state();
        let waiting = f64::from(u8::from(waiting));
        let mut later = [0.0; LATER];
        let head = [VERSION, waiting, e, xe, ve, de, ee, f64::from(memory.count)];
        let seen = memory.y.iter().zip(&memory.age).flat_map(|(y, age)| [*y, *age]);
        for (to, value) in later.iter_mut().zip(head.into_iter().chain(seen)) {
            *to = value;
        }
        (started, x, xdot, d, first, in_a_row, refused, later)
    }

    fn _set_state(&mut self, state: &Bound<'_, PyAny>) -> PyResult<()> {
        let (first, later) = match state.extract::<State>() {
            Ok((started, x, xdot, d, covariance, in_a_row, refused, later)) => {
                ((started, x, xdot, d, covariance, in_a_row, refused), Some(later))
            }
            Err(_) => (state.extract::<First>()?, None),
        };
        let (started, x, xdot, d, [xx, xv, xd, vv, vd, dd], in_a_row, refused) = first;
        let estimate = Estimate { state: Physical { x, xdot }, d };
        let fresh = ImpactObserver::new(*self.inner.settings()).state();
        let covariance = Covariance { xx, xv, xd, vv, vd, dd, ..fresh.covariance };
        let mut state = ObserverState { started, estimate, covariance, in_a_row, refused, ..fresh };
        if let Some([_, waiting, e, xe, ve, de, ee, count, seen @ ..]) = later {
            let mut memory = Memory { count: count as u32, ..Memory::default() };
            for (k, from) in seen.chunks_exact(2).enumerate() {
                (memory.y[k], memory.age[k]) = (from[0], from[1]);
            }
            let covariance = Covariance { xe, ve, de, ee, ..covariance };
            state = ObserverState { waiting: waiting != 0.0, e, covariance, memory, ..state };
        }
        self.inner.set_state(state);
        Ok(())
    }
}
