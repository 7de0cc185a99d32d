//! The explicit baseline.

use pyo3::prelude::*;
use zivi::drive::closed_loop::{AnyController, Solved};
use zivi::Solver;
use zivi_core::control::{ExplicitTwisting, Gains};
use zivi_core::Physical;

use super::arguments::{gains, port, refused, restored, sample, tracker_state, State};
use super::reference::with_reference;
use crate::transform::restitution_of;

/// The explicit baseline; `zivi.ExplicitTwisting` is what users see.
#[pyclass(subclass, module = "zivi._zivi")]
pub(crate) struct Explicit {
    pub(super) inner: ExplicitTwisting,
}

impl Explicit {
    /// Its signs are those of the sample: nothing is solved.
    pub(super) fn solved(&self) -> Solved<ExplicitTwisting> {
        Solved { controller: self.inner, solver: Solver::Exact }
    }

    pub(super) fn any(&self) -> AnyController {
        AnyController::Explicit(self.inner)
    }

    /// Takes over where this one is.
    pub(super) fn restore(&mut self, controller: &AnyController) {
        if let AnyController::Explicit(it) = controller {
            self.inner = *it;
        }
    }

    fn forget(&mut self) {}

    /// A tick, or a period without a sample.
    fn stepped(
        &mut self,
        sample: Option<Physical>,
        (force, force_ref): (f64, f64),
        dt: Option<f64>,
    ) -> PyResult<f64> {
        let mut it = self.solved();
        if let Some(dt) = dt {
            it.controller = it.controller.lasting(dt).map_err(refused)?;
        }
        let u = match sample {
            Some(measured) => it.tick(measured, force, force_ref),
            None => it.controller.miss(force_ref),
        };
        let u = u.map_err(refused)?;
        self.inner.set_state(it.controller.state());
        Ok(u)
    }
}

with_reference! { Explicit,
    #[new]
    #[pyo3(signature = (mu1, mu2, *, h, kappa, kappa_ref, bound, depth, actuator))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        mu1: f64,
        mu2: f64,
        h: f64,
        kappa: f64,
        kappa_ref: f64,
        bound: Option<f64>,
        depth: f64,
        actuator: (f64, f64),
    ) -> PyResult<Self> {
        let (restitution, restitution_ref) = (restitution_of(kappa)?, restitution_of(kappa_ref)?);
        let gains = gains(mu1, mu2, restitution, bound, Gains::for_tracking)?;
        let bare = ExplicitTwisting::new(gains, h, restitution, restitution_ref).map_err(refused)?;
        Ok(Self { inner: bare.with_port(port(depth, actuator)?) })
    }
}
