//! The baseline: explicit Euler on the transformed field with single-valued signs.
//!
//! ```text
//! v+ = v + h sgn(s) f / R     s+ = s + h R v     R = 1 - kappa sgn s sgn v,  sgn 0 = +1
//! ```
//!
//! It passes the accumulation but never rests: the signs alternate and `(s, v)` chatters.

use zivi_core::setting::Setting;
use zivi_core::{transform, Lifted, Physical, Restitution, ThetaGammaStep};

use crate::record::columns::Sample;
use crate::record::status::Failure;
use crate::record::trajectory::Values;
use crate::record::trajectory::{Run, SetupError};
use crate::stepping::fixed_step::{run, FixedStep, Scheme, Start};
use crate::system::dynamics::finite_force;
use crate::{Force, Grid, Monitor, Status};

/// Simulates with explicit Euler and explicit signs.
///
/// # Errors
/// [`SetupError`] before anything is computed. Whatever goes wrong later is in the run's status.
pub fn simulate_explicit_euler<E, F: Force<E>>(
    restitution: Restitution,
    force: &mut F,
    grid: Grid,
    initial: Physical,
    monitor: &mut impl Monitor<E>,
) -> Result<Run<E>, SetupError> {
    let scheme = ExplicitEuler;
    scheme.check(grid.h(), restitution)?;
    scheme.run(restitution, force, grid, initial, monitor)
}

/// The scheme, which has no settings but the step size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ExplicitEuler;

impl Scheme for ExplicitEuler {
    const NAME: &'static str = "ExplicitEuler";
    const MEANING: &'static str = "explicit Euler with explicit signs";
    const SETTINGS: &'static [Setting] = &[ThetaGammaStep::STEP];

    fn of(_: &Values) -> Result<Self, SetupError> {
        Ok(Self)
    }

    /// The same range of `h` and `e` as the implicit scheme, checked in one place.
    fn check(&self, h: f64, restitution: Restitution) -> Result<(), SetupError> {
        Ok(ThetaGammaStep::new(h, 1.0, 1.0, restitution).map(drop)?)
    }

    fn run<E, F: Force<E>>(
        &self,
        restitution: Restitution,
        force: &mut F,
        grid: Grid,
        initial: Physical,
        monitor: &mut impl Monitor<E>,
    ) -> Result<Run<E>, SetupError> {
        run(
            ExplicitStepper { h: grid.h(), restitution, nfev: 0 },
            restitution,
            force,
            grid,
            initial,
            monitor,
        )
    }
}

/// The scheme as something that steps.
struct ExplicitStepper {
    h: f64,
    restitution: Restitution,
    nfev: u64,
}

/// The sign of a program without a sign of zero: `sgn 0 = +1`.
fn one_sided_sign(z: f64) -> f64 {
    if z < 0.0 {
        -1.0
    } else {
        1.0
    }
}

impl<E, F: Force<E>> FixedStep<E, F> for ExplicitStepper {
    #[inline]
    fn advance(&mut self, start: Start, force: &mut F) -> Result<Sample, Failure<E>> {
        let Start { t, z, .. } = start;
        let (lambda_s, lambda_v) = (one_sided_sign(z.s), one_sided_sign(z.v));
        let xdot = self.restitution.r(lambda_s, lambda_v) * z.v * lambda_s;
        self.nfev += 1;
        let f = finite_force(force, t, Physical { x: z.s.abs(), xdot })?;
        let rate = transform::field(z.v, lambda_s, lambda_v, f, self.restitution);
        let z = Lifted { s: z.s + self.h * rate.s, v: z.v + self.h * rate.v };
        if z.is_finite() {
            Ok(Sample { z, lambda_s, lambda_v, f })
        } else {
            Err(Failure::Status(Status::StateNotFinite))
        }
    }

    fn residual(&self, _: Lifted, _: f64, _: [f64; 2]) -> f64 {
        f64::NAN
    }

    fn resize(&mut self, h: f64) {
        self.h = h;
    }

    fn nfev(&self) -> u64 {
        self.nfev
    }
}
