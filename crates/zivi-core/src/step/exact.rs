//! The exact solution of the step by cases: each pair of signs is `-1`, `+1` or interior.
//!
//! The step is symmetric under `(s, v, lambda) -> -(s, v, lambda)`, so it is solved on the side
//! `+1`. With `v_gamma = 0` or `s_gamma = 0` the other equation fixes the interior sign in closed
//! form; no iteration anywhere, at most nine candidates.

use super::selection::{distance, exact_motion};
use super::{StepFailure, StepSolution, ThetaGammaStep};
use crate::step::candidates::Pattern;
use crate::step::candidates::{Frozen, ImplicitEuler, SchemeWeights, SIGN_TOLERANCE};
use crate::{Lifted, Real, Restitution};

impl ThetaGammaStep {
    /// Solves one step from `z` under the frozen force `f`; `side` (`+1` or `-1`) is where the
    /// mass was last, and only matters at the origin.
    ///
    /// # Errors
    /// [`StepFailure`] for input that is not finite, overflow, or no acceptable sign pattern.
    ///
    /// ```
    /// use zivi_core::{Case, Lifted, Restitution, ThetaGammaStep};
    /// let restitution = Restitution::from_kappa(0.41)?;
    /// let step = ThetaGammaStep::new(1e-3, 1.0, 1.0, restitution).unwrap();
    /// let rest = step.solve(Lifted::default(), -9.81, 1.0).unwrap();
    /// assert_eq!((rest.s, rest.v, rest.case), (0.0, 0.0, Case::Origin));
    /// # Ok::<(), zivi_core::RestitutionError>(())
    /// ```
    #[inline(always)]
    pub fn solve(&self, z: Lifted, f: Real, side: Real) -> Result<StepSolution, StepFailure> {
        if let Some(solution) = self.everyday(z, f) {
            return Ok(solution);
        }
        // destructured, so that the usual solution need not be stored when this one is returned
        let StepSolution { s, v, lambda_s, lambda_v, case } =
            if (self.theta, self.gamma) == (1.0, 1.0) {
                thorough(self.h, self.restitution, ImplicitEuler, z, f, side)?
            } else {
                thorough(self.h, self.restitution, (self.theta, self.gamma), z, f, side)?
            };
        Ok(StepSolution { s, v, lambda_s, lambda_v, case })
    }

    /// The steps that most of a run consists of, under `f <= 0`: rest, and the regular pattern of
    /// the present signs with room to spare, which is then the only solution.
    #[inline(always)]
    #[must_use]
    pub fn everyday(&self, z: Lifted, f: Real) -> Option<StepSolution> {
        if f > 0.0 || z.s == 0.0 || z.v == 0.0 {
            let rests = f <= 0.0 && f.is_finite() && z == Lifted::default();
            return rests.then_some(StepSolution::REST);
        }
        let sign = |z: Real| if z > 0.0 { 1.0 } else { -1.0 };
        let (lambda_s, lambda_v) = (sign(z.s), sign(z.v));
        // two cases and no products, and not mirrored to the side +1: both would lengthen the impact sequence from
        // step to step
        let Self { h, restitution, inverse_r: [outward, inward], .. } = *self;
        let away = lambda_s * lambda_v > 0.0;
        let r = restitution.r(1.0, if away { 1.0 } else { -1.0 });
        let inverse_r = if away { outward } else { inward };
        let seen = Frozen { h, restitution, weights: (self.theta, self.gamma), s: z.s, v: z.v, f };
        match seen.regular((lambda_s, lambda_v), (r, inverse_r), -SIGN_TOLERANCE) {
            Some(StepSolution { s, v, lambda_s, lambda_v, case })
                if (Lifted { s, v }).is_finite() =>
            {
                Some(StepSolution { s, v, lambda_s, lambda_v, case })
            }
            _ => None,
        }
    }

    /// Every solution of the step (numerically coincident ones included), in the order of
    /// [`PATTERNS`](super::PATTERNS).
    pub fn solutions(&self, z: Lifted, f: Real) -> impl Iterator<Item = StepSolution> {
        let (sigma, frozen) = self.frozen(z, f, 1.0);
        frozen.candidates().map(move |solution| solution.mirrored(sigma))
    }

    /// The solution with the signs of `pattern`, if finite.
    #[must_use]
    pub fn accepted(
        &self,
        pattern: Pattern,
        z: Lifted,
        f: Real,
        side: Real,
    ) -> Option<StepSolution> {
        let (sigma, frozen) = self.frozen(z, f, side);
        let found = frozen.on(pattern, SIGN_TOLERANCE)?;
        found.end().is_finite().then_some(found.mirrored(sigma))
    }

    /// The end of the step with the signs of `pattern`, whether or not they fit: a continuous
    /// function of `f` within each of [`Self::force_ranges`], for finding a force that depends on
    /// where the step ends.
    #[must_use]
    pub fn continued(
        &self,
        pattern: Pattern,
        z: Lifted,
        f: Real,
        side: Real,
    ) -> Option<StepSolution> {
        // not infinite: infinity times a vanishing scale is NaN
        let (sigma, frozen) = self.frozen(z, f, side);
        let found = frozen.on(pattern, Real::MAX)?;
        found.end().is_finite().then_some(found.mirrored(sigma))
    }

    /// The forces between which a solution with the signs of `pattern` can lie: at most two
    /// ranges (closed, possibly unbounded).
    ///
    /// ```text
    /// regular:  g s_gamma >= 0 and r v_gamma >= 0, both linear in f  (g, r the signs)
    /// apex:     R = -gamma h g f / v in [1 - kappa, 1 + kappa]
    /// wall:     |theta h f - kappa lambda_v v| >= |s/(gamma h) + v|
    /// ```
    #[must_use]
    pub fn force_ranges(
        &self,
        pattern: Pattern,
        z: Lifted,
        side: Real,
    ) -> [Option<(Real, Real)>; 2] {
        let (_, Frozen { s, v, .. }) = self.frozen(z, 0.0, side);
        let ThetaGammaStep { h, theta, gamma, restitution, .. } = *self;
        let approach = s / (gamma * h);
        let range = |low: Real, high: Real| (low <= high).then_some((low, high));
        match pattern {
            Pattern::Origin => [range(Real::NEG_INFINITY, Real::INFINITY), None],
            Pattern::Wall(lambda_v) => {
                let middle = restitution.kappa() * lambda_v * v / (theta * h);
                let half = (approach + v).abs() / (theta * h);
                [range(Real::NEG_INFINITY, middle - half), range(middle + half, Real::INFINITY)]
            }
            Pattern::Apex(lambda_s) => {
                let unit = -lambda_s * v / (gamma * h);
                let (a, b) = (unit * restitution.r(1.0, 1.0), unit * restitution.r(1.0, -1.0));
                [range(a.min(b), a.max(b)), None]
            }
            Pattern::Regular(lambda_s, lambda_v) => {
                let r = restitution.r(lambda_s, lambda_v);
                let stays = -lambda_s * (approach + r * v) / (theta * h);
                let turns = -lambda_s * v * r / (gamma * h);
                if lambda_s * lambda_v > 0.0 {
                    [range(stays.max(turns), Real::INFINITY), None]
                } else {
                    [range(stays, turns), None]
                }
            }
        }
    }

    /// Distance of a solution from the exact motion under its own force, in units of that motion
    /// (`h^2 f` and `h f`); zero for `f <= 0`, where the solution is unique.
    #[must_use]
    pub fn inconsistency(&self, solution: &StepSolution, z: Lifted, f: Real, side: Real) -> Real {
        if f <= 0.0 {
            return 0.0;
        }
        let (sigma, Frozen { s, v, .. }) = self.frozen(z, f, side);
        let exact = exact_motion(Lifted { s, v }, f, self.h, self.restitution);
        distance(&solution.mirrored(sigma), exact, self.h) / (self.h * self.h * f)
    }

    /// The branch `sigma` of the state, and the step on this branch.
    #[inline]
    fn frozen(&self, z: Lifted, f: Real, side: Real) -> (Real, Frozen<(Real, Real)>) {
        Frozen::seen((self.h, self.restitution), (self.theta, self.gamma), z, f, side)
    }
}

/// Any step over `h` on a wall: those that are not everyday. (Numbers and not a scheme, which need not
/// be in memory then.)
#[cold]
#[inline(never)]
pub(crate) fn thorough<W: SchemeWeights>(
    h: Real,
    restitution: Restitution,
    weights: W,
    z: Lifted,
    f: Real,
    side: Real,
) -> Result<StepSolution, StepFailure> {
    let (sigma, frozen) = Frozen::seen((h, restitution), weights, z, f, side);
    let found = match frozen.roomy() {
        Some(found) => found,
        None => frozen.selected()?,
    };
    let found = found.mirrored(sigma);
    if found.end().is_finite() {
        Ok(found)
    } else {
        Err(StepFailure::NotFinite)
    }
}
