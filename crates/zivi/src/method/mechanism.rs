//! A mechanical system of several coordinates and gaps, and the methods that run it.

use super::interface::{newton, Method, System};
use crate::mechanics::{
    simulate_mechanical, simulate_mechanical_moreau_jean, simulate_mechanical_theta_gamma,
    MechanicalOutput, MechanicalRun,
};
use crate::stepping::fixed_step::FixedSteps;
use crate::system::dynamics::Dynamics;
use crate::{AnyImpactLaw, Monitor, MoreauJean, SetupError, SwitchedRk, ThetaGamma};

/// A mechanical system: `M q'' = F + N^T lambda` with gaps `g(t, q) >= 0`.
pub struct Mechanism<'d, D> {
    /// Mass matrix, forces and gaps.
    pub dynamics: &'d mut D,
    /// An impact law for each gap.
    pub laws: &'d [AnyImpactLaw],
}

impl<E, D: Dynamics<E>> System<E> for Mechanism<'_, D> {
    /// Coordinates and velocities.
    type State<'a> = (&'a [f64], &'a [f64]);
    type Keep<'a> = MechanicalOutput<'a, E>;
    type Run = MechanicalRun<E>;
}

impl<'d, E, D: Dynamics<E>> Method<E, Mechanism<'d, D>> for SwitchedRk {
    fn run(
        &self,
        Mechanism { dynamics, laws }: Mechanism<'d, D>,
        span: (f64, f64),
        y0: (&[f64], &[f64]),
        keep: MechanicalOutput<'_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<MechanicalRun<E>, SetupError> {
        simulate_mechanical(*self, dynamics, laws, span, y0, keep, monitor)
    }
}

impl<'d, E, D: Dynamics<E>> Method<E, Mechanism<'d, D>> for FixedSteps<MoreauJean> {
    fn run(
        &self,
        Mechanism { dynamics, laws }: Mechanism<'d, D>,
        span: (f64, f64),
        y0: (&[f64], &[f64]),
        keep: MechanicalOutput<'_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<MechanicalRun<E>, SetupError> {
        let (grid, method, e) = (self.grid(span)?, self.scheme, coefficients(laws)?);
        simulate_mechanical_moreau_jean(method, dynamics, &e, grid, y0, keep.events, monitor)
    }
}

/// The implicit member of the family, `theta = gamma = 1`, only.
impl<'d, E, D: Dynamics<E>> Method<E, Mechanism<'d, D>> for FixedSteps<ThetaGamma> {
    fn run(
        &self,
        Mechanism { dynamics, laws }: Mechanism<'d, D>,
        span: (f64, f64),
        y0: (&[f64], &[f64]),
        keep: MechanicalOutput<'_, E>,
        monitor: &mut impl Monitor<E>,
    ) -> Result<MechanicalRun<E>, SetupError> {
        if self.scheme != ThetaGamma::implicit_euler() {
            return Err(SetupError::Refused(
                "method must be the theta-gamma scheme with theta = gamma = 1 and its exact solver",
            ));
        }
        let (grid, e) = (self.grid(span)?, coefficients(laws)?);
        simulate_mechanical_theta_gamma(dynamics, &e, grid, y0, keep.events, monitor)
    }
}

/// The coefficients of restitution that schemes of fixed steps need.
fn coefficients(laws: &[AnyImpactLaw]) -> Result<Vec<f64>, SetupError> {
    laws.iter().map(|law| Ok(newton(law)?.e())).collect()
}
