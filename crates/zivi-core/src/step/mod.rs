//! One step of the theta-gamma scheme for a force frozen over the step.
//!
//! ```text
//! v+ = v + h lambda_s f / R                     R = 1 - kappa lambda_s lambda_v
//! s+ = s + h R (theta v+ + (1 - theta) v)
//! lambda_s in sgn s_gamma,  lambda_v in sgn v_gamma,  z_gamma = gamma z+ + (1 - gamma) z
//! ```
//!
//! `theta = gamma = 1` is the implicit Euler scheme of the paper, the only member that reaches
//! rest exactly. Inserting `v+` gives the two quantities that everything here is built on:
//!
//! ```text
//! s_gamma = s + gamma h (R v + theta h lambda_s f)
//! v_gamma = v + gamma h lambda_s f / R
//! ```
//!
//! The rooms: [`inclusion`] writes the step as a box VI (`F`, its Jacobian, the natural
//! residual); [`ThetaGammaStep::solve`] in `exact` finds its solution by cases (`candidates`);
//! [`selection`] chooses among several solutions.

mod candidates;
mod exact;
#[cfg(not(feature = "single"))]
pub mod inclusion;
pub mod selection;

pub(crate) use candidates::ImplicitEuler;
pub use candidates::SIGN_TOLERANCE;
pub use candidates::{Pattern, PATTERNS};
pub(crate) use exact::thorough;
#[cfg(not(feature = "single"))]
pub use inclusion::StepInclusion;

use core::ops::Bound;

use crate::setting::{require, Setting, SettingError, Value, Values};
use crate::{Lifted, Real, Restitution};

/// The scheme with its step size and the wall: all that is constant over a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThetaGammaStep {
    h: Real,
    theta: Real,
    gamma: Real,
    restitution: Restitution,
    /// `1/(1 - kappa)` and `1/(1 + kappa)`: `1/R` away from the wall and towards it.
    inverse_r: [Real; 2],
}

impl ThetaGammaStep {
    /// The step size.
    pub const STEP: Setting = Setting {
        name: "h",
        meaning: "step",
        unit: "s",
        values: Values::POSITIVE,
        range: "a finite step size > 0",
        default: Value::Required,
    };
    /// The weight `theta`.
    pub const THETA: Setting = Setting {
        name: "theta",
        meaning: "weight of the end of the step in the state",
        unit: "1",
        values: Values::Numbers(Bound::Excluded(0.0), Bound::Included(1.0)),
        range: "in (0, 1]",
        default: Value::Number(1.0),
    };
    /// The weight `gamma`.
    pub const GAMMA: Setting = Setting {
        name: "gamma",
        meaning: "weight of the end of the step in the signs",
        ..Self::THETA
    };

    /// A step of size `h` (s) with `theta`, `gamma` in `(0, 1]` on a wall with `e > 0`.
    ///
    /// # Errors
    /// [`SettingError`] names the first setting that is out of range.
    pub fn new(
        h: Real,
        theta: Real,
        gamma: Real,
        restitution: Restitution,
    ) -> Result<Self, SettingError> {
        Self::STEP.check(h)?;
        Self::THETA.check(theta)?;
        Self::GAMMA.check(gamma)?;
        let kappa = restitution.kappa();
        require(
            kappa < 1.0,
            "e",
            restitution.e(),
            "> 0 for this scheme (R = 0 at e = 0; below about 1e-16 kappa rounds to 1)",
        )?;
        Ok(Self::trusted(h, theta, gamma, restitution))
    }

    /// The same of numbers that were checked before and are not checked again.
    #[inline]
    #[must_use]
    pub fn trusted(h: Real, theta: Real, gamma: Real, restitution: Restitution) -> Self {
        let kappa = restitution.kappa();
        Self { h, theta, gamma, restitution, inverse_r: [1.0 / (1.0 - kappa), 1.0 / (1.0 + kappa)] }
    }

    /// The same as the implicit Euler scheme.
    #[inline]
    pub(crate) fn implicit(&self) -> Self {
        Self { theta: 1.0, gamma: 1.0, ..*self }
    }

    /// The same scheme with another step size (the last step of a run is often shorter).
    ///
    /// # Errors
    /// [`SettingError`] when `h` is not positive and finite.
    pub fn with_h(self, h: Real) -> Result<Self, SettingError> {
        Self::new(h, self.theta, self.gamma, self.restitution)
    }

    /// The step size `h` (s).
    #[must_use]
    pub fn h(&self) -> Real {
        self.h
    }

    /// The weight `theta` of the new velocity in the position update.
    #[must_use]
    pub fn theta(&self) -> Real {
        self.theta
    }

    /// The point `gamma` at which the signs are taken.
    #[must_use]
    pub fn gamma(&self) -> Real {
        self.gamma
    }

    /// The wall.
    #[must_use]
    pub fn restitution(&self) -> Restitution {
        self.restitution
    }
}

/// Which of the two set-valued signs are taken in their interior.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Case {
    /// `s_gamma = 0` and `v_gamma = 0`: rest, for implicit Euler.
    Origin,
    /// `s_gamma = 0`: the step ends on the wall.
    Wall,
    /// `v_gamma = 0`: the step ends at the apex (or holds there).
    Apex,
    /// Both signs are `+1` or `-1`.
    Regular,
}

/// The end of a step and the signs that lead there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSolution {
    /// New position `s+` (m).
    pub s: Real,
    /// New velocity `v+` (m/s).
    pub v: Real,
    /// The multiplier `lambda_s` in `sgn s_gamma`.
    pub lambda_s: Real,
    /// The multiplier `lambda_v` in `sgn v_gamma`.
    pub lambda_v: Real,
    /// The case that was taken.
    pub case: Case,
}

impl StepSolution {
    /// Rest continues.
    const REST: Self = Self { s: 0.0, v: 0.0, lambda_s: 0.0, lambda_v: 0.0, case: Case::Origin };

    /// The new state `(s+, v+)`.
    #[inline(always)]
    #[must_use]
    pub fn end(&self) -> Lifted {
        Lifted { s: self.s, v: self.v }
    }

    /// The mirror image `(s, v, lambda) -> -(s, v, lambda)`, which solves the mirrored step (adding
    /// `0.0` turns the `-0.0` of a mirrored zero into `0.0`).
    #[inline]
    fn mirrored(self, sigma: Real) -> Self {
        let mirror = |z: Real| sigma * z + 0.0;
        Self {
            s: mirror(self.s),
            v: mirror(self.v),
            lambda_s: mirror(self.lambda_s),
            lambda_v: mirror(self.lambda_v),
            case: self.case,
        }
    }
}

/// Why a step has no answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepFailure {
    /// The state or the force is not finite, or became so (overflow).
    NotFinite,
    /// No sign pattern was accepted within rounding.
    NoSolution,
}
