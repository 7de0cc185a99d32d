//! What the two controllers with a reference have in common.

/// What the two controllers with a reference have in common.
macro_rules! with_reference {
    ($class:ident, $($own:tt)*) => {
        #[pymethods]
        impl $class {
            $($own)*

            /// Give the control for the period that starts with this measurement, and advance the
            /// reference by one period.
            ///
            /// Parameters
            /// ----------
            /// x, xdot : float or None
            ///     Measured distance from the wall (m) and velocity (m/s). Without `x` the sample is
            ///     missing: the control is held, the reference advances.
            /// force : float
            ///     Force on the mass without control (m/s^2).
            /// force_ref : float
            ///     Force on the reference (m/s^2).
            /// dt : float, optional
            ///     Length of the period that starts now, > 0 (s); by default `h`. The step is planned,
            ///     and the reference advances, over it.
            ///
            /// Returns
            /// -------
            /// float
            ///     The control, to be held for one period (m/s^2).
            ///
            /// Raises
            /// ------
            /// ValueError
            ///     For a sample that is not finite or too deep behind the wall; nothing has
            ///     changed then: the reference has not advanced, the last control is still `u`.
            #[pyo3(signature = (x, xdot=None, force=0.0, force_ref=0.0, *, dt=None))]
            fn step(
                &mut self,
                x: Option<f64>,
                xdot: Option<f64>,
                force: f64,
                force_ref: f64,
                dt: Option<f64>,
            ) -> PyResult<f64> {
                self.stepped(sample(x, xdot)?, (force, force_ref), dt)
            }

            /// Set the reference's distance from its wall, >= 0 (m), and its velocity (m/s), and
            /// forget everything else.
            fn reset(&mut self, x_ref: f64, xdot_ref: f64) -> PyResult<()> {
                self.inner.reset(Physical { x: x_ref, xdot: xdot_ref }).map_err(refused)?;
                self.forget();
                Ok(())
            }

            /// Distance of the reference from its wall: that at the next sample (m).
            #[getter]
            fn x_ref(&self) -> f64 {
                self.inner.reference().x
            }

            /// Velocity of the reference (m/s).
            #[getter]
            fn xdot_ref(&self) -> f64 {
                self.inner.reference().xdot
            }

            /// The last control (m/s^2).
            #[getter]
            fn u(&self) -> f64 {
                self.inner.state().u
            }

            #[getter]
            fn _signs(&self) -> [f64; 6] {
                self.inner.state().signs
            }

            #[getter]
            fn _status(&self) -> u8 {
                self.inner.state().status.bits()
            }

            fn _get_state(&self) -> State {
                tracker_state(self.inner.state())
            }

            fn _set_state(&mut self, state: State) {
                self.inner.set_state(restored(state));
            }
        }
    };
}

pub(super) use with_reference;
