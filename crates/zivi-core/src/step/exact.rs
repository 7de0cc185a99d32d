//! The exact solution of the step by cases: each pair of signs is `-1`, `+1` or interior.
//!
//! The step is symmetric under `(s, v, lambda) -> -(s, v, lambda)`, so it is solved on the side
//! `+1`. With `v_gamma = 0` or `s_gamma = 0` the other equation fixes the interior sign in closed
//! form; no iteration anywhere, at most nine candidates.

use super::pattern::{Pattern, PATTERNS};
use super::selection::{distance, exact_motion};
use super::{Case, StepFailure, StepSolution, ThetaGammaStep};
use crate::{sgn, transform, Lifted};

/// Relative tolerance of the sign tests: a candidate that violates one by less is taken as equal
/// to the degenerate candidate beside it.
pub const SIGN_TOLERANCE: f64 = 1e-13;

/// `theta` and `gamma`, handed on as numbers of their own: where all steps of a program have the same
/// ones, as in the library for C programs, the compiler works them in.
type Weights = (f64, f64);

/// A step to be solved, seen from the side `+1`.
#[derive(Clone, Copy)]
struct Frozen<'a> {
    step: &'a ThetaGammaStep,
    weights: Weights,
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
    /// let restitution = Restitution::from_kappa(0.41)?;
    /// let step = ThetaGammaStep::new(1e-3, 1.0, 1.0, restitution).unwrap();
    /// let rest = step.solve(Lifted::default(), -9.81, 1.0).unwrap();
    /// assert_eq!((rest.s, rest.v, rest.case), (0.0, 0.0, Case::Origin));
    /// # Ok::<(), zivi_core::RestitutionError>(())
    /// ```
    #[inline(always)]
    pub fn solve(&self, z: Lifted, f: f64, side: f64) -> Result<StepSolution, StepFailure> {
        if let Some(solution) = self.everyday(z, f) {
            return Ok(solution);
        }
        // taken apart, so that the everyday solution need not be kept where this one is returned
        let StepSolution { s, v, lambda_s, lambda_v, case } =
            self.seldom((self.theta, self.gamma), z, f, side)?;
        Ok(StepSolution { s, v, lambda_s, lambda_v, case })
    }

    /// The steps that most of a run consists of, under `f <= 0`: rest, and the regular pattern of
    /// the present signs with room to spare, which is then the only solution.
    #[inline(always)]
    #[must_use]
    pub fn everyday(&self, z: Lifted, f: f64) -> Option<StepSolution> {
        if f > 0.0 || z.s == 0.0 || z.v == 0.0 {
            let rests = f <= 0.0 && f.is_finite() && z == Lifted::default();
            return rests.then_some(StepSolution::REST);
        }
        let sign = |z: f64| if z > 0.0 { 1.0 } else { -1.0 };
        // not mirrored to the side +1: that would lengthen the chain from step to step
        let weights = (self.theta, self.gamma);
        let seen = Frozen { step: self, weights, s: z.s, v: z.v, f };
        match seen.regular(sign(z.s), sign(z.v), -SIGN_TOLERANCE) {
            Some(StepSolution { s, v, lambda_s, lambda_v, case })
                if (Lifted { s, v }).is_finite() =>
            {
                Some(StepSolution { s, v, lambda_s, lambda_v, case })
            }
            _ => None,
        }
    }

    /// The steps that are not everyday.
    #[inline(never)]
    fn seldom(
        &self,
        weights: Weights,
        z: Lifted,
        f: f64,
        side: f64,
    ) -> Result<StepSolution, StepFailure> {
        match self.roomy(weights, z, f) {
            Some(found) => Ok(found),
            None => self.by_cases(weights, z, f, side),
        }
    }

    /// Steps through the wall or over an apex, under `f <= 0`. With `theta >= gamma` the solution is
    /// unique then: a regular one whose signs have much more room than the tolerance is it, and the
    /// degenerate patterns need not be tried.
    #[inline(always)]
    fn roomy(&self, weights: Weights, z: Lifted, f: f64) -> Option<StepSolution> {
        const ROOM: f64 = 1e4 * SIGN_TOLERANCE;
        let (theta, gamma) = weights;
        if f > 0.0 || z.s == 0.0 || theta < gamma {
            return None;
        }
        let (side, seen) = (sgn(z.s), Frozen { step: self, weights, s: z.s, v: z.v, f });
        // towards the wall v has the other side's sign, and so has what is beyond it
        for lambda_s in [-side, side] {
            let found = seen.regular(lambda_s, -side, -ROOM);
            if let Some(StepSolution { s, v, lambda_s, lambda_v, case }) = found {
                if (Lifted { s, v }).is_finite() {
                    return Some(StepSolution { s, v, lambda_s, lambda_v, case });
                }
            }
        }
        None
    }

    /// Any step, on the side `+1`, by the rule of [`super::selection`].
    #[cold]
    #[inline(never)]
    fn by_cases(
        &self,
        weights: Weights,
        z: Lifted,
        f: f64,
        side: f64,
    ) -> Result<StepSolution, StepFailure> {
        let (sigma, frozen) = self.frozen(z, f, side);
        let frozen = Frozen { weights, ..frozen };
        let found = frozen.selected()?.mirrored(sigma);
        if found.end().is_finite() {
            Ok(found)
        } else {
            Err(StepFailure::NotFinite)
        }
    }

    /// Every solution of the step (numerically coincident ones included), in the order of
    /// [`PATTERNS`].
    pub fn solutions(&self, z: Lifted, f: f64) -> impl Iterator<Item = StepSolution> + '_ {
        let (sigma, frozen) = self.frozen(z, f, 1.0);
        frozen.candidates().map(move |solution| solution.mirrored(sigma))
    }

    /// The solution with the signs of `pattern`, if there is a finite one.
    #[must_use]
    pub fn accepted(&self, pattern: Pattern, z: Lifted, f: f64, side: f64) -> Option<StepSolution> {
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
        f: f64,
        side: f64,
    ) -> Option<StepSolution> {
        // not infinite: infinity times a vanishing scale is NaN
        let (sigma, frozen) = self.frozen(z, f, side);
        let found = frozen.on(pattern, f64::MAX)?;
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
    pub fn force_ranges(&self, pattern: Pattern, z: Lifted, side: f64) -> [Option<(f64, f64)>; 2] {
        let (_, Frozen { s, v, .. }) = self.frozen(z, 0.0, side);
        let ThetaGammaStep { h, theta, gamma, restitution, .. } = *self;
        let approach = s / (gamma * h);
        let range = |low: f64, high: f64| (low <= high).then_some((low, high));
        match pattern {
            Pattern::Origin => [range(f64::NEG_INFINITY, f64::INFINITY), None],
            Pattern::Wall(lambda_v) => {
                let middle = restitution.kappa() * lambda_v * v / (theta * h);
                let half = (approach + v).abs() / (theta * h);
                [range(f64::NEG_INFINITY, middle - half), range(middle + half, f64::INFINITY)]
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
                    [range(stays.max(turns), f64::INFINITY), None]
                } else {
                    [range(stays, turns), None]
                }
            }
        }
    }

    /// Distance of a solution from the exact motion under its own force, in units of that motion
    /// (`h^2 f` and `h f`); zero for `f <= 0`, where there is nothing to choose.
    #[must_use]
    pub fn inconsistency(&self, solution: &StepSolution, z: Lifted, f: f64, side: f64) -> f64 {
        if f <= 0.0 {
            return 0.0;
        }
        let (sigma, Frozen { s, v, .. }) = self.frozen(z, f, side);
        let exact = exact_motion(Lifted { s, v }, f, self.h, self.restitution);
        distance(&solution.mirrored(sigma), exact, self.h) / (self.h * self.h * f)
    }

    /// The side `sigma` of the state, and the step as it is seen from there.
    #[inline]
    fn frozen(&self, z: Lifted, f: f64, side: f64) -> (f64, Frozen<'_>) {
        let last = if side < 0.0 { -1.0 } else { 1.0 };
        let sigma = transform::side(z, last);
        let weights = (self.theta, self.gamma);
        (sigma, Frozen { step: self, weights, s: sigma * z.s, v: sigma * z.v, f })
    }
}

impl<'a> Frozen<'a> {
    /// The solution that the rule of [`super::selection`] takes.
    fn selected(&self) -> Result<StepSolution, StepFailure> {
        if !(self.s.is_finite() && self.v.is_finite() && self.f.is_finite()) {
            return Err(StepFailure::NotFinite);
        }
        let (h, restitution) = (self.step.h, self.step.restitution);
        let chosen = self.f > 0.0;
        let mut exact = Lifted::default();
        if chosen {
            exact = exact_motion(Lifted { s: self.s, v: self.v }, self.f, h, restitution);
            if !exact.is_finite() {
                return Err(StepFailure::NotFinite);
            }
        }
        let mut best: Option<(f64, StepSolution)> = None;
        for candidate in self.candidates() {
            if !chosen {
                return Ok(candidate);
            }
            let away = distance(&candidate, exact, h);
            if best.is_none_or(|(least, _)| away.total_cmp(&least).is_lt()) {
                best = Some((away, candidate));
            }
        }
        best.map(|(_, nearest)| nearest).ok_or(StepFailure::NoSolution)
    }

    /// The accepted candidates, most degenerate first, evaluated as they are asked for.
    fn candidates(self) -> impl Iterator<Item = StepSolution> + 'a {
        PATTERNS.iter().filter_map(move |&pattern| self.on(pattern, SIGN_TOLERANCE))
    }

    /// The candidate of one pattern, its sign conditions violated by no more than `slack`.
    fn on(&self, pattern: Pattern, slack: f64) -> Option<StepSolution> {
        match pattern {
            Pattern::Origin => self.origin(slack),
            Pattern::Wall(lambda_v) => self.wall(lambda_v, slack),
            Pattern::Apex(lambda_s) => self.apex(lambda_s, slack),
            Pattern::Regular(lambda_s, lambda_v) => self.regular(lambda_s, lambda_v, slack),
        }
    }

    /// Both signs at their ends: `R` is known, `s_gamma` and `v_gamma` must have those signs.
    /// A negative `slack` is the margin that is asked for.
    #[inline(always)]
    fn regular(&self, lambda_s: f64, lambda_v: f64, slack: f64) -> Option<StepSolution> {
        let ThetaGammaStep { h, restitution, inverse_r: [outward, inward], .. } = *self.step;
        let (theta, gamma) = self.weights;
        let away = lambda_s * lambda_v > 0.0;
        let r = restitution.r(1.0, if away { 1.0 } else { -1.0 });
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
    fn apex(&self, lambda_s: f64, slack: f64) -> Option<StepSolution> {
        let (ThetaGammaStep { h, restitution, .. }, (theta, gamma)) = (*self.step, self.weights);
        let r = -gamma * h * lambda_s * self.f / self.v;
        let lambda_v = interior_sign(1.0 - r, restitution.kappa() * lambda_s, 2.0, slack)?;
        // R v = -gamma h lambda_s f, so s+ = s + (theta - gamma) h^2 lambda_s f
        let rise = (theta - gamma) * h * h * lambda_s * self.f;
        let scale = self.s.abs() + gamma * rise.abs();
        (lambda_s * (self.s + gamma * rise) >= -slack * scale).then_some(StepSolution {
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
    fn wall(&self, lambda_v: f64, slack: f64) -> Option<StepSolution> {
        let (ThetaGammaStep { h, restitution, .. }, (theta, gamma)) = (*self.step, self.weights);
        let slope = restitution.kappa() * lambda_v * self.v - theta * h * self.f;
        let approach = self.s / (gamma * h);
        let terms = approach.abs() + self.v.abs() + slope.abs();
        let lambda_s = interior_sign(approach + self.v, slope, terms, slack)?;
        let r = restitution.r(lambda_s, lambda_v);
        let kick = h * lambda_s * self.f / r;
        let scale = self.v.abs() + gamma * kick.abs();
        (lambda_v * (self.v + gamma * kick) >= -slack * scale).then_some(StepSolution {
            s: self.extrapolated(self.s),
            v: self.v + kick,
            lambda_s,
            lambda_v,
            case: Case::Wall,
        })
    }

    /// `s_gamma = v_gamma = 0`: `R v = -gamma h lambda_s f` and
    /// `s = -gamma (theta - gamma) h^2 lambda_s f`.
    fn origin(&self, slack: f64) -> Option<StepSolution> {
        let (ThetaGammaStep { h, restitution, .. }, (theta, gamma)) = (*self.step, self.weights);
        let push = gamma * h * self.f;
        let (lambda_s, lambda_v) = if theta == gamma {
            let signs = self.stopping_signs(push, slack)?;
            // against the two terms of s_gamma that cancel, R v and theta h lambda_s f
            let reach = 2.0 * gamma * h * (signs.0 * push).abs();
            (self.s <= slack * reach).then_some(signs)?
        } else {
            let lambda_s = interior_sign(-self.s, (theta - gamma) * h * push, self.s, slack)?;
            let r = if self.v == 0.0 { 1.0 } else { -lambda_s * push / self.v };
            (self.v != 0.0 || lambda_s * push == 0.0).then_some(())?;
            (lambda_s, interior_sign(1.0 - r, restitution.kappa() * lambda_s, 2.0, slack)?)
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
    ///
    /// Of the family the member with the smallest `|lambda_s|` is taken, `lambda_v = sgn lambda_s`:
    /// with `c = |v/push|` it is `|lambda_s| = c (1 - kappa |lambda_s|) = c/(1 + kappa c)`, which
    /// is at most 1 just where the family is not empty, `(1 - kappa) |v| <= |push|`.
    fn stopping_signs(&self, push: f64, slack: f64) -> Option<(f64, f64)> {
        if self.v == 0.0 {
            return Some((0.0, 0.0));
        }
        let c = (self.v / push).abs();
        let size = interior_sign(c, 1.0 + self.step.restitution.kappa() * c, c, slack)?;
        let sign = -sgn(self.v) * sgn(push);
        Some((sign * size, sign))
    }

    /// `z+` from `z_gamma = 0`, that is `-(1 - gamma)/gamma z` (and not `-0`).
    fn extrapolated(&self, z: f64) -> f64 {
        let (_, gamma) = self.weights;
        0.0 - (1.0 - gamma) / gamma * z
    }
}

/// The root of `slope * lambda = value` if it lies in `[-1, 1]` to within the rounding of the
/// `terms` that the equation is made of, then clipped.
fn interior_sign(value: f64, slope: f64, terms: f64, slack: f64) -> Option<f64> {
    if value == 0.0 {
        return Some(0.0);
    }
    let lambda = value / slope;
    let within = value.abs() <= slope.abs() + slack * terms;
    (within && !lambda.is_nan()).then_some(lambda.clamp(-1.0, 1.0))
}
