//! The exact solution of the step by cases: each pair of signs is `-1`, `+1` or interior.
//!
//! The step is symmetric under `(s, v, lambda) -> -(s, v, lambda)`, so it is solved on the side
//! `+1`. With `v_gamma = 0` or `s_gamma = 0` the other equation fixes the interior sign in closed
//! form; no iteration anywhere, at most nine candidates.

use super::selection::{distance, exact_motion};
use super::{Case, StepFailure, StepSolution, ThetaGammaStep};
use crate::{sgn, transform, Lifted};

/// Relative tolerance of the sign tests: a candidate that violates one by less is taken as equal
/// to the degenerate candidate beside it.
const SIGN_TOLERANCE: f64 = 1e-13;

/// A step to be solved, seen from the side `+1`.
#[derive(Clone, Copy)]
struct Frozen<'a> {
    step: &'a ThetaGammaStep,
    s: f64,
    v: f64,
    f: f64,
}

impl ThetaGammaStep {
    /// Solves one step from `z` under the frozen force `f`; `side` (`+1` or `-1`) is where the
    /// mass was last, and only matters at the origin.
    ///
    /// # Errors
    /// [`StepFailure`] for input that is not finite, overflow, or no acceptable sign pattern.
    ///
    /// ```
    /// use zivi_core::{Case, Lifted, Restitution, ThetaGammaStep};
    /// let wall = Restitution::from_kappa(0.41)?;
    /// let step = ThetaGammaStep::new(1e-3, 1.0, 1.0, wall).unwrap();
    /// let rest = step.solve(Lifted::default(), -9.81, 1.0).unwrap();
    /// assert_eq!((rest.s, rest.v, rest.case), (0.0, 0.0, Case::Origin));
    /// # Ok::<(), zivi_core::RestitutionError>(())
    /// ```
    #[inline]
    pub fn solve(&self, z: Lifted, f: f64, side: f64) -> Result<StepSolution, StepFailure> {
        let sigma = transform::side(z, side);
        let frozen = Frozen { step: self, s: sigma * z.s, v: sigma * z.v, f };
        let found = match frozen.clearly_regular() {
            Some(solution) => solution,
            None => frozen.selected()?,
        };
        if found.s.is_finite() && found.v.is_finite() {
            Ok(found.mirrored(sigma))
        } else {
            Err(StepFailure::NotFinite)
        }
    }

    /// Every solution of the step (numerically coincident ones included), in the order origin,
    /// wall, apex, regular.
    pub fn solutions(&self, z: Lifted, f: f64) -> impl Iterator<Item = StepSolution> + '_ {
        let sigma = transform::side(z, 1.0);
        let frozen = Frozen { step: self, s: sigma * z.s, v: sigma * z.v, f };
        frozen.candidates().map(move |solution| solution.mirrored(sigma))
    }
}

impl<'a> Frozen<'a> {
    /// The everyday step, pressed to the wall and away from every switch: the regular pattern of
    /// the current velocity with room to spare is the only solution, no other need be looked at.
    #[inline]
    fn clearly_regular(&self) -> Option<StepSolution> {
        if self.f > 0.0 || self.v == 0.0 || !self.step.is_unique_under_attraction() {
            return None;
        }
        self.regular(1.0, sgn(self.v), -SIGN_TOLERANCE)
    }

    /// The solution that the rule of [`super::selection`] takes.
    fn selected(&self) -> Result<StepSolution, StepFailure> {
        if !(self.s.is_finite() && self.v.is_finite() && self.f.is_finite()) {
            return Err(StepFailure::NotFinite);
        }
        let found = if self.f <= 0.0 {
            self.candidates().next()
        } else {
            let (h, wall) = (self.step.h, self.step.wall);
            let exact = exact_motion(Lifted { s: self.s, v: self.v }, self.f, h, wall);
            let away = |candidate: &StepSolution| distance(candidate, exact, h);
            self.candidates().min_by(|a, b| away(a).total_cmp(&away(b)))
        };
        found.ok_or(StepFailure::NoSolution)
    }

    /// The accepted candidates, most degenerate first, evaluated as they are asked for.
    fn candidates(self) -> impl Iterator<Item = StepSolution> + 'a {
        (0..9).filter_map(move |number| match number {
            0 => self.origin(),
            1 => self.wall(1.0),
            2 => self.wall(-1.0),
            3 => self.apex(1.0),
            4 => self.apex(-1.0),
            5 => self.regular(1.0, 1.0, SIGN_TOLERANCE),
            6 => self.regular(1.0, -1.0, SIGN_TOLERANCE),
            7 => self.regular(-1.0, 1.0, SIGN_TOLERANCE),
            _ => self.regular(-1.0, -1.0, SIGN_TOLERANCE),
        })
    }

    /// Both signs at their ends: `R` is known, `s_gamma` and `v_gamma` must have those signs.
    /// `slack` is the relative violation that is accepted (negative: the margin that is asked for).
    #[inline]
    fn regular(&self, lambda_s: f64, lambda_v: f64, slack: f64) -> Option<StepSolution> {
        let ThetaGammaStep { h, theta, gamma, wall, inverse_r: [outward, inward] } = *self.step;
        let away = lambda_s * lambda_v > 0.0;
        let r = wall.r(1.0, if away { 1.0 } else { -1.0 });
        let travel = h * r * self.v;
        let push = h * lambda_s * self.f;
        let kick = push * if away { outward } else { inward };
        let drop = theta * h * push;
        let s_gamma = lambda_s * (self.s + gamma * (travel + drop));
        let v_gamma = lambda_v * (self.v + gamma * kick);
        let scale_s = self.s.abs() + gamma * (travel.abs() + drop.abs());
        let scale_v = self.v.abs() + gamma * kick.abs();
        (s_gamma >= -slack * scale_s && v_gamma >= -slack * scale_v).then_some(StepSolution {
            s: self.s + (travel + drop),
            v: self.v + kick,
            lambda_s,
            lambda_v,
            case: Case::Regular,
        })
    }

    /// `v_gamma = 0` with `lambda_s` at an end: `R = -gamma h lambda_s f / v` gives `lambda_v`.
    fn apex(&self, lambda_s: f64) -> Option<StepSolution> {
        let ThetaGammaStep { h, theta, gamma, wall, .. } = *self.step;
        let r = -gamma * h * lambda_s * self.f / self.v;
        let lambda_v = interior_sign(1.0 - r, wall.kappa() * lambda_s)?;
        // R v = -gamma h lambda_s f, so s+ = s + (theta - gamma) h^2 lambda_s f
        let rise = (theta - gamma) * h * h * lambda_s * self.f;
        let scale = self.s.abs() + gamma * rise.abs();
        (lambda_s * (self.s + gamma * rise) >= -SIGN_TOLERANCE * scale).then_some(StepSolution {
            s: self.s + rise,
            v: self.extrapolated(self.v),
            lambda_s,
            lambda_v,
            case: Case::Apex,
        })
    }

    /// `s_gamma = 0` with `lambda_v` at an end: linear in `lambda_s`.
    ///
    /// ```text
    /// s/(gamma h) + v = lambda_s (kappa lambda_v v - theta h f)
    /// ```
    fn wall(&self, lambda_v: f64) -> Option<StepSolution> {
        let ThetaGammaStep { h, theta, gamma, wall, .. } = *self.step;
        let slope = wall.kappa() * lambda_v * self.v - theta * h * self.f;
        let lambda_s = interior_sign(self.s / (gamma * h) + self.v, slope)?;
        let r = wall.r(lambda_s, lambda_v);
        let kick = h * lambda_s * self.f / r;
        let scale = self.v.abs() + gamma * kick.abs();
        (lambda_v * (self.v + gamma * kick) >= -SIGN_TOLERANCE * scale).then_some(StepSolution {
            s: self.extrapolated(self.s),
            v: self.v + kick,
            lambda_s,
            lambda_v,
            case: Case::Wall,
        })
    }

    /// `s_gamma = v_gamma = 0`: `R v = -gamma h lambda_s f` and
    /// `s = -gamma (theta - gamma) h^2 lambda_s f`.
    fn origin(&self) -> Option<StepSolution> {
        let ThetaGammaStep { h, theta, gamma, wall, .. } = *self.step;
        let push = gamma * h * self.f;
        let (lambda_s, lambda_v) = if theta == gamma {
            let reach = h * (self.v.abs() + push.abs());
            (self.s <= SIGN_TOLERANCE * reach).then_some(())?;
            self.stopping_signs(push)?
        } else {
            let lambda_s = interior_sign(-self.s, (theta - gamma) * h * push)?;
            let r = if self.v == 0.0 { 1.0 } else { -lambda_s * push / self.v };
            (self.v != 0.0 || lambda_s * push == 0.0).then_some(())?;
            (lambda_s, interior_sign(1.0 - r, wall.kappa() * lambda_s)?)
        };
        Some(StepSolution {
            s: self.extrapolated(self.s),
            v: self.extrapolated(self.v),
            lambda_s,
            lambda_v,
            case: Case::Origin,
        })
    }

    /// Signs that stop the mass at the wall, `R v = -lambda_s push`: one equation for two signs.
    /// `lambda_v = 0` is taken where it does (`|v| <= |push|`), then `|lambda_s| = 1`.
    fn stopping_signs(&self, push: f64) -> Option<(f64, f64)> {
        if self.v == 0.0 {
            return Some((0.0, 0.0));
        }
        let lambda_s = -self.v / push;
        if lambda_s.abs() <= 1.0 {
            return Some((lambda_s, 0.0));
        }
        let end = sgn(lambda_s);
        let lambda_v = interior_sign(1.0 - 1.0 / lambda_s.abs(), self.step.wall.kappa() * end)?;
        Some((end, lambda_v))
    }

    /// `z+` from `z_gamma = 0`, that is `-(1 - gamma)/gamma z` (and not `-0`).
    fn extrapolated(&self, z: f64) -> f64 {
        0.0 - (1.0 - self.step.gamma) / self.step.gamma * z
    }
}

/// The root of `slope * lambda = value` if it lies in `[-1, 1]` (to within rounding, then clipped).
fn interior_sign(value: f64, slope: f64) -> Option<f64> {
    if value == 0.0 {
        return Some(0.0);
    }
    let lambda = value / slope;
    (lambda.abs() <= 1.0 + SIGN_TOLERANCE).then_some(lambda.clamp(-1.0, 1.0))
}
