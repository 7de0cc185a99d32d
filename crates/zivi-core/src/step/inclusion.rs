//! The step as a variational inequality on the box `[-1, 1]^2` in `Lambda = (lambda_s, lambda_v)`.
//!
//! ```text
//! F(Lambda) = -(s_gamma, v_gamma)        0 in F(Lambda) + N_[-1,1]^2(Lambda)
//! ```
//!
//! `lambda in sgn z` is `z in N_[-1,1](lambda)`. None of this is used by the exact solution: it is
//! the other form of the same step, for general solvers and for checking.

use super::{Case, StepSolution, ThetaGammaStep};
use crate::step::candidates::SIGN_TOLERANCE;
use crate::vi::{self, natural_component};
use crate::Lifted;

impl ThetaGammaStep {
    /// `F(Lambda) = -(s_gamma, v_gamma)` for the step from `z` under the force `f`.
    #[inline]
    #[must_use]
    pub fn vi_map(&self, z: Lifted, f: f64, [lambda_s, lambda_v]: [f64; 2]) -> [f64; 2] {
        let (h, gamma) = (self.h, self.gamma);
        let r = self.restitution.r(lambda_s, lambda_v);
        [
            -(z.s + gamma * h * (r * z.v + self.theta * h * lambda_s * f)),
            -(z.v + lambda_s * (gamma * h * f / r)),
        ]
    }

    /// The Jacobian `dF/dLambda`, row by row.
    ///
    /// ```text
    /// d s_gamma = gamma h [ -kappa lambda_v v + theta h f,   -kappa lambda_s v            ]
    /// d v_gamma = gamma h f/R^2 [ 1,                          kappa lambda_s^2            ]
    /// ```
    /// (`d(lambda_s/R)/d lambda_s = (R + kappa lambda_s lambda_v)/R^2 = 1/R^2`.)
    #[must_use]
    pub fn vi_jacobian(&self, z: Lifted, f: f64, [lambda_s, lambda_v]: [f64; 2]) -> [[f64; 2]; 2] {
        let (h, gamma, kappa) = (self.h, self.gamma, self.restitution.kappa());
        let r = self.restitution.r(lambda_s, lambda_v);
        let gain = gamma * h * f / (r * r);
        [
            [
                -gamma * h * (self.theta * h * f - kappa * lambda_v * z.v),
                gamma * h * kappa * lambda_s * z.v,
            ],
            [-gain, -gain * kappa * lambda_s * lambda_s],
        ]
    }

    /// Magnitudes of the terms of `s_gamma` and `v_gamma`: the row scales that make the residual
    /// dimensionless (`1` where all terms of a row vanish).
    #[inline]
    #[must_use]
    pub fn vi_scales(&self, z: Lifted, f: f64, [lambda_s, lambda_v]: [f64; 2]) -> [f64; 2] {
        let reach = self.gamma * self.h;
        let r = self.restitution.r(lambda_s, lambda_v);
        let or_one = |scale: f64| if scale == 0.0 { 1.0 } else { scale };
        [
            or_one(z.s.abs() + reach * (r * z.v.abs() + self.theta * self.h * f.abs())),
            or_one(z.v.abs() + (reach * f / r).abs()),
        ]
    }

    /// The end of the step for multipliers that solve the inclusion. The argument vanishes for an
    /// interior multiplier (`N(lambda) = {0}`) and at rounding level: of coincident cases the more
    /// degenerate one, the choice of [`Self::solve`].
    #[must_use]
    pub fn end(&self, z: Lifted, f: f64, lambda: [f64; 2]) -> StepSolution {
        let (h, gamma) = (self.h, self.gamma);
        let [lambda_s, lambda_v] = lambda;
        let [row_s, row_v] = self.vi_map(z, f, lambda);
        let [scale_s, scale_v] = self.vi_scales(z, f, lambda);
        let vanishes = |lambda: f64, row: f64, scale: f64| {
            lambda.abs() < 1.0 || row.abs() <= SIGN_TOLERANCE * scale
        };
        let at_wall = vanishes(lambda_s, row_s, scale_s);
        let at_apex = vanishes(lambda_v, row_v, scale_v);
        let r = self.restitution.r(lambda_s, lambda_v);
        let kick = h * lambda_s * f / r;
        let extrapolated = |z: f64| 0.0 - (1.0 - gamma) / gamma * z;
        StepSolution {
            s: if at_wall { extrapolated(z.s) } else { z.s + h * r * (z.v + self.theta * kick) },
            v: if at_apex { extrapolated(z.v) } else { z.v + kick },
            lambda_s,
            lambda_v,
            case: match (at_wall, at_apex) {
                (true, true) => Case::Origin,
                (true, false) => Case::Wall,
                (false, true) => Case::Apex,
                (false, false) => Case::Regular,
            },
        }
    }

    /// The natural residual of `Lambda` with the rows of `F` divided by their scales:
    /// dimensionless, at rounding level for a solution, however small the state is.
    #[inline]
    #[must_use]
    pub fn vi_residual(&self, z: Lifted, f: f64, lambda: [f64; 2]) -> f64 {
        let [row_s, row_v] = self.vi_map(z, f, lambda);
        let [scale_s, scale_v] = self.vi_scales(z, f, lambda);
        let [lambda_s, lambda_v] = lambda;
        let of_s = natural_component(lambda_s, row_s / scale_s, -1.0, 1.0).abs();
        let of_v = natural_component(lambda_v, row_v / scale_v, -1.0, 1.0).abs();
        if of_s > of_v || of_s.is_nan() {
            of_s
        } else {
            of_v
        }
    }
}

/// The step from `z` under the frozen force `f`, in the form that the solvers of [`crate::vi`]
/// take: unknowns `Lambda` on the box `[-1, 1]^2`.
#[derive(Clone, Copy, Debug)]
pub struct StepInclusion<'a> {
    /// The scheme.
    pub step: &'a ThetaGammaStep,
    /// Where the step starts.
    pub z: Lifted,
    /// The force over the step (m/s^2).
    pub f: f64,
}

impl vi::Problem for StepInclusion<'_> {
    fn map(&mut self, lambda: &[f64], f: &mut [f64]) -> Result<(), vi::EvaluationError> {
        if let (&[lambda_s, lambda_v], [row_s, row_v]) = (lambda, f) {
            [*row_s, *row_v] = self.step.vi_map(self.z, self.f, [lambda_s, lambda_v]);
        }
        Ok(())
    }

    fn jacobian(
        &mut self,
        lambda: &[f64],
        jacobian: &mut [f64],
    ) -> Result<(), vi::EvaluationError> {
        if let (&[lambda_s, lambda_v], [ss, sv, vs, vv]) = (lambda, jacobian) {
            [[*ss, *sv], [*vs, *vv]] = self.step.vi_jacobian(self.z, self.f, [lambda_s, lambda_v]);
        }
        Ok(())
    }
}
