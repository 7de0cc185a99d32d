//! The candidates of a step: for each pair of signs the end of the step, if it has those signs.

pub use crate::real::SIGN_TOLERANCE;

use crate::step::selection::{distance, exact_motion};
use crate::step::{Case, StepFailure, StepSolution};
use crate::{sgn, transform, Lifted, Real, Restitution};

/// `theta` and `gamma`, as a type: the code for those of implicit Euler is shorter and faster.
pub(crate) trait SchemeWeights: Copy {
    fn both(self) -> (Real, Real);
}

impl SchemeWeights for (Real, Real) {
    #[inline(always)]
    fn both(self) -> (Real, Real) {
        self
    }
}

/// Those of the implicit Euler scheme, known to the compiler.
#[derive(Clone, Copy)]
pub(crate) struct ImplicitEuler;

impl SchemeWeights for ImplicitEuler {
    #[inline(always)]
    fn both(self) -> (Real, Real) {
        (1.0, 1.0)
    }
}

/// A step to be solved, seen from the side `+1`.
#[derive(Clone, Copy)]
pub(super) struct Frozen<W> {
    pub(super) h: Real,
    pub(super) restitution: Restitution,
    pub(super) weights: W,
    pub(super) s: Real,
    pub(super) v: Real,
    pub(super) f: Real,
}

impl<W: SchemeWeights> Frozen<W> {
    /// The branch `sigma` of the state, and the step on this branch.
    #[inline]
    pub(super) fn seen(
        (h, restitution): (Real, Restitution),
        weights: W,
        z: Lifted,
        f: Real,
        side: Real,
    ) -> (Real, Self) {
        let sigma = transform::side(z, Real::copysign(1.0, side));
        (sigma, Self { h, restitution, weights, s: sigma * z.s, v: sigma * z.v, f })
    }

    /// Steps away from the wall, through it or over an apex, under `f <= 0`. With `theta >= gamma` the solution is
    /// unique then: a regular one whose signs have much more room than the tolerance is it, and the
    /// degenerate patterns need not be tried.
    #[inline(always)]
    pub(super) fn roomy(&self) -> Option<StepSolution> {
        const ROOM: Real = 1e4 * SIGN_TOLERANCE;
        const AWAY: &[(Real, Real)] = &[(1.0, 1.0)];
        const THROUGH: &[(Real, Real)] = &[(-1.0, -1.0), (1.0, -1.0)];
        let (theta, gamma) = self.weights.both();
        if self.f > 0.0 || theta < gamma {
            return None;
        }
        let signs = if self.s == 0.0 { AWAY } else { THROUGH };
        signs.iter().find_map(|&signs| self.regular(signs, self.both_r(signs), -ROOM))
    }

    /// `R` and `1/R` with both signs at their ends.
    #[inline]
    fn both_r(&self, (lambda_s, lambda_v): (Real, Real)) -> (Real, Real) {
        let r = self.restitution.r(lambda_s, lambda_v);
        (r, 1.0 / r)
    }

    /// The solution that the rule of [`crate::step::selection`] takes.
    #[inline(always)]
    pub(super) fn selected(&self) -> Result<StepSolution, StepFailure> {
        if !(self.s.is_finite() && self.v.is_finite() && self.f.is_finite()) {
            return Err(StepFailure::NotFinite);
        }
        if self.f > 0.0 {
            return self.nearest();
        }
        self.candidates().next().ok_or(StepFailure::NoSolution)
    }

    /// The candidate nearest to the exact motion.
    #[cold]
    #[inline(never)]
    fn nearest(&self) -> Result<StepSolution, StepFailure> {
        let Self { h, restitution, s, v, f, .. } = *self;
        let exact = exact_motion(Lifted { s, v }, f, h, restitution);
        if !exact.is_finite() {
            return Err(StepFailure::NotFinite);
        }
        let mut best: Option<(Real, StepSolution)> = None;
        for candidate in self.candidates() {
            let away = distance(&candidate, exact, h);
            if best.is_none_or(|(least, _)| away.total_cmp(&least).is_lt()) {
                best = Some((away, candidate));
            }
        }
        best.map(|(_, nearest)| nearest).ok_or(StepFailure::NoSolution)
    }

    /// The accepted candidates, most degenerate first, evaluated as they are requested.
    pub(super) fn candidates(self) -> impl Iterator<Item = StepSolution> {
        PATTERNS.iter().filter_map(move |&pattern| self.on(pattern, SIGN_TOLERANCE))
    }

    /// The candidate of one pattern, its sign conditions violated by no more than `slack`.
    #[inline(never)]
    pub(super) fn on(&self, pattern: Pattern, slack: Real) -> Option<StepSolution> {
        match pattern {
            Pattern::Origin => self.origin(slack),
            Pattern::Wall(lambda_v) => self.wall(lambda_v, slack),
            Pattern::Apex(lambda_s) => self.apex(lambda_s, slack),
            Pattern::Regular(lambda_s, lambda_v) => {
                let signs = (lambda_s, lambda_v);
                self.regular(signs, self.both_r(signs), slack)
            }
        }
    }

    /// Both signs at their ends: `R` is known, `s_gamma` and `v_gamma` must have those signs.
    /// A negative `slack` is the margin that is requested.
    #[inline(always)]
    pub(super) fn regular(
        &self,
        (lambda_s, lambda_v): (Real, Real),
        (r, inverse_r): (Real, Real),
        slack: Real,
    ) -> Option<StepSolution> {
        let (h, (theta, gamma)) = (self.h, self.weights.both());
        let travel = h * r * self.v;
        let push = h * lambda_s * self.f;
        let kick = push * inverse_r;
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
    fn apex(&self, lambda_s: Real, slack: Real) -> Option<StepSolution> {
        let (Self { h, restitution, .. }, (theta, gamma)) = (*self, self.weights.both());
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
    fn wall(&self, lambda_v: Real, slack: Real) -> Option<StepSolution> {
        let (Self { h, restitution, .. }, (theta, gamma)) = (*self, self.weights.both());
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
    fn origin(&self, slack: Real) -> Option<StepSolution> {
        let (Self { h, restitution, .. }, (theta, gamma)) = (*self, self.weights.both());
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
    fn stopping_signs(&self, push: Real, slack: Real) -> Option<(Real, Real)> {
        if self.v == 0.0 {
            return Some((0.0, 0.0));
        }
        let c = (self.v / push).abs();
        let size = interior_sign(c, 1.0 + self.restitution.kappa() * c, c, slack)?;
        let sign = -sgn(self.v) * sgn(push);
        Some((sign * size, sign))
    }

    /// `z+` from `z_gamma = 0`, that is `-(1 - gamma)/gamma z` (and not `-0`).
    fn extrapolated(&self, z: Real) -> Real {
        let (_, gamma) = self.weights.both();
        0.0 - (1.0 - gamma) / gamma * z
    }
}

/// The root of `slope * lambda = value` if it lies in `[-1, 1]` to within the rounding of the
/// `terms` that the equation is made of, then clipped.
fn interior_sign(value: Real, slope: Real, terms: Real, slack: Real) -> Option<Real> {
    if value == 0.0 {
        return Some(0.0);
    }
    let lambda = value / slope;
    let within = value.abs() <= slope.abs() + slack * terms;
    (within && !lambda.is_nan()).then_some(lambda.clamp(-1.0, 1.0))
}

// The pairs of signs that a step can have.

/// Which signs are interior, and the ends that the others take, seen from the side of the state
/// (`lambda_s = 1` is the side where the mass is).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pattern {
    /// `s_gamma = v_gamma = 0`.
    Origin,
    /// `s_gamma = 0`, with this `lambda_v`.
    Wall(Real),
    /// `v_gamma = 0`, with this `lambda_s`.
    Apex(Real),
    /// These `lambda_s` and `lambda_v`.
    Regular(Real, Real),
}

/// All patterns, the most degenerate first: the order of [`crate::step::selection`].
pub const PATTERNS: [Pattern; 9] = [
    Pattern::Origin,
    Pattern::Wall(1.0),
    Pattern::Wall(-1.0),
    Pattern::Apex(1.0),
    Pattern::Apex(-1.0),
    Pattern::Regular(1.0, 1.0),
    Pattern::Regular(1.0, -1.0),
    Pattern::Regular(-1.0, 1.0),
    Pattern::Regular(-1.0, -1.0),
];
