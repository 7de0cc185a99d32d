//! The observer as a Python class.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use zivi_core::observer::{
    Covariance, Estimate, ImpactObserver, Measurement, ObserverSettings, ObserverState,
};
use zivi_core::{Physical, Restitution, SettingError};

fn refused(error: SettingError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// `(started, x, xdot, d, [xx, xv, xd, vv, vd, dd], in_a_row, refused)`.
type State = (bool, f64, f64, f64, [f64; 6], u32, u32);

type Array<'py> = Bound<'py, PyArray1<f64>>;
/// Estimates, their standard deviations, and whether a measurement was refused.
type Observed<'py> = (Vec<Array<'py>>, Vec<Array<'py>>, Bound<'py, PyArray1<bool>>);

/// The observer; `zivi.ImpactObserver` is what users see.
#[pyclass(subclass, module = "zivi._zivi")]
pub(crate) struct Observer {
    pub(crate) inner: ImpactObserver,
}

#[pymethods]
impl Observer {
    #[new]
    #[pyo3(signature = (e, h, *, noise, q_d, se, dmax, position_only))]
    fn new(
        e: f64,
        h: f64,
        noise: (f64, f64),
        q_d: f64,
        se: f64,
        dmax: f64,
        position_only: bool,
    ) -> PyResult<Self> {
        let restitution = Restitution::from_e(e);
        let restitution = restitution.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let settings = ObserverSettings::new(restitution, h)
            .and_then(|it| it.with_noise(noise.0, noise.1))
            .and_then(|it| it.with_force(q_d, dmax))
            .and_then(|it| it.with_restitution_error(se))
            .map_err(refused)?
            .with_position_only(position_only);
        Ok(Self { inner: ImpactObserver::new(settings) })
    }

    /// Give the estimate at this measurement.
    ///
    /// Parameters
    /// ----------
    /// x : float
    ///     Measured distance from the wall (m); noise may make it negative.
    /// xdot : float or None
    ///     Measured velocity (m/s); None, or with ``position_only``, it is not known.
    /// force : float
    ///     Known force on the mass over the period that ends with this measurement (m/s^2).
    /// u : float
    ///     Control that acted over that period, after limits and delay (m/s^2). At the first
    ///     measurement both are of no consequence.
    ///
    /// Returns
    /// -------
    /// (float, float, float)
    ///     Position (m), velocity (m/s) and unknown force (m/s^2).
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     For a number that is not finite; nothing has changed then.
    #[pyo3(signature = (x, xdot, force, u))]
    fn step(&mut self, x: f64, xdot: Option<f64>, force: f64, u: f64) -> PyResult<(f64, f64, f64)> {
        let found = self.inner.tick(Measurement { x, xdot }, force, u).map_err(refused)?;
        Ok((found.state.x, found.state.xdot, found.d))
    }

    /// Forget all measurements.
    fn reset(&mut self) {
        self.inner.reset();
    }

    /// Estimates at recorded measurements, from a fresh start; nothing of this one changes. Forces
    /// and controls are held from their times on. A velocity that is NaN was not measured.
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
        let mut columns: [Vec<f64>; 6] = Default::default();
        let mut out = Vec::with_capacity(t.len());
        for (k, (now, x)) in t.iter().zip(x).enumerate() {
            let xdot = xdot.get(k).copied().filter(|it| !it.is_nan());
            let before = it.state().refused;
            let measured = Measurement { x: *x, xdot };
            match k.checked_sub(1) {
                None => it.tick(measured, 0.0, 0.0),
                Some(last) => it.tick_after(now - t[last], measured, held[last], 0.0),
            }
            .map_err(|error| PyValueError::new_err(format!("measurement {k}: {error}")))?;
            let ObserverState { estimate: Estimate { state, d }, covariance, refused, .. } =
                it.state();
            let Covariance { xx, vv, dd, .. } = covariance;
            let row = [state.x, state.xdot, d, xx.sqrt(), vv.sqrt(), dd.sqrt()];
            for (column, value) in columns.iter_mut().zip(row) {
                column.push(value);
            }
            out.push(refused > before);
        }
        let mut arrays = columns.into_iter().map(|it| PyArray1::from_vec(py, it));
        let estimates = arrays.by_ref().take(3).collect();
        Ok((estimates, arrays.collect(), PyArray1::from_vec(py, out)))
    }

    #[getter]
    fn _covariance(&self) -> [[f64; 3]; 3] {
        self.inner.state().covariance.rows()
    }

    fn _get_state(&self) -> State {
        let ObserverState { started, estimate, covariance, in_a_row, refused } = self.inner.state();
        let Estimate { state: Physical { x, xdot }, d } = estimate;
        let Covariance { xx, xv, xd, vv, vd, dd } = covariance;
        (started, x, xdot, d, [xx, xv, xd, vv, vd, dd], in_a_row, refused)
    }

    fn _set_state(&mut self, state: State) {
        let (started, x, xdot, d, [xx, xv, xd, vv, vd, dd], in_a_row, refused) = state;
        let estimate = Estimate { state: Physical { x, xdot }, d };
        let covariance = Covariance { xx, xv, xd, vv, vd, dd };
        let state = ObserverState { started, estimate, covariance, in_a_row, refused };
        self.inner.set_state(state);
    }
}
