//! The controllers, and their loop with a mass that moves by the implicit step.

use crate::table::{SampleRow, TABLE};
use zivi_core::control::regulation::RegulationStep;
use zivi_core::control::{ExplicitTwisting, Gains, TwistingRegulator, TwistingTracker};
use zivi_core::{sgn, transform, Branch, Lifted, Physical, Restitution, ThetaGammaStep};

pub(crate) enum LoopLaw {
    /// `u = -mu1 - mu2 sgn x'` with the sign of the sample.
    Sampled(Gains),
    Regulator(TwistingRegulator, RegulationStep),
    Tracker(TwistingTracker),
    Explicit(ExplicitTwisting),
}

/// Forces on the mass, in the controller's model of it, and on the reference (m/s^2).
#[derive(Clone, Copy)]
pub(crate) struct LoopForces {
    pub(crate) plant: f64,
    pub(crate) model: f64,
    pub(crate) reference: f64,
}

const NONE: f64 = f64::NAN;

impl LoopLaw {
    fn tick(&mut self, measured: Physical, forces: LoopForces) -> Option<(f64, [f64; 6])> {
        let LoopForces { model: f, reference: f_ref, .. } = forces;
        match self {
            LoopLaw::Sampled(gains) => {
                Some((-gains.mu1() - gains.mu2() * sgn(measured.xdot), [NONE; 6]))
            }
            LoopLaw::Regulator(law, _) => {
                let u = law.tick(measured, f).ok()?;
                let [lambda_s, lambda_v] = law.state().signs;
                Some((u, [lambda_s, lambda_v, NONE, NONE, NONE, NONE]))
            }
            LoopLaw::Tracker(law) => Some((law.tick(measured, f, f_ref).ok()?, law.state().signs)),
            LoopLaw::Explicit(law) => Some((law.tick(measured, f, f_ref).ok()?, law.state().signs)),
        }
    }

    /// The end of the regulator's own step, whose force at the wall differs from that of a held control.
    fn planned(&self, z: Lifted, side: f64, force: f64) -> Option<Lifted> {
        let LoopLaw::Regulator(_, step) = self else { return None };
        let mirror = |z: Lifted| Lifted { s: side * z.s, v: side * z.v };
        Some(mirror(step.solve(mirror(z), force).end))
    }

    fn reference(&self) -> Physical {
        match self {
            LoopLaw::Tracker(law) => law.reference(),
            LoopLaw::Explicit(law) => law.reference(),
            _ => Physical { x: NONE, xdot: NONE },
        }
    }
}

/// A start above the wall, on the branch `s >= 0`.
pub(crate) fn lifted(start: Physical, restitution: Restitution) -> Option<Lifted> {
    let z = transform::lift(start, Branch::Positive, restitution);
    (z.s >= 0.0 && z.is_finite()).then_some(z)
}

/// The loop: measure, update the control, move the mass by one implicit step, with the control held or as planned.
pub(crate) fn close(
    mut law: LoopLaw,
    scheme: ThetaGammaStep,
    forces: LoopForces,
    start: Physical,
    n: u32,
) -> Option<u32> {
    let restitution = scheme.restitution();
    let mut state = start;
    let mut z = lifted(start, restitution)?;
    let mut side = transform::side(z, 1.0);
    let (mut u, mut signs) = (0.0, [NONE; 6]);
    TABLE.fill(n, |k| {
        if k > 0 {
            z = match law.planned(z, side, forces.plant) {
                Some(end) => end,
                None => scheme.solve(z, forces.plant + u, side).ok()?.end(),
            };
            side = transform::side(z, side);
            state = transform::project(z, restitution);
        }
        let reference = law.reference();
        if k < n as usize {
            (u, signs) = law.tick(state, forces)?;
        }
        let [lambda_s, lambda_v, others @ ..] = signs;
        let Physical { x, xdot } = state;
        let Physical { x: x_ref, xdot: xdot_ref } = reference;
        let (s, v) = (z.s, z.v);
        Some(SampleRow { x, xdot, s, v, x_ref, xdot_ref, u, lambda_s, lambda_v, others })
    })
}
